"""One HTML file that opens offline: the verdict first, then the claims, the pictures, every number, and where they came from."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

from optsim.report.chart import psnr_chart
from optsim.report.claims import RULE, make_claims
from optsim.report.data import Row, RunData
from optsim.report.document import document, links_to
from optsim.report.finding import EARLY, Finding
from optsim.report.gallery import Gallery
from optsim.report.html import Child, Markup, section, table, tag
from optsim.report.page_origin import missing, modelled, provenance
from optsim.report.select import db, main_recipe, ratio_text
from optsim.report.style import Drawn
from optsim.report.verdict import make_verdict
from optsim.report.wording import recipe_text

SECTIONS = (
    ("findings", "What bears on it"),
    ("claims", "The paper’s claims"),
    ("paper-figures", "The paper’s figures, redrawn"),
    ("more-figures", "Further figures"),
    ("results", "Every result"),
    ("model", "What was modelled"),
    ("provenance", "Where this comes from"),
)


def render_page(run: RunData, drawn: Sequence[Drawn]) -> str:
    """Write the report as one HTML text: pictures inside, no network, names of the run escaped."""
    gallery = Gallery(run)
    paper = [d for d in drawn if d.title.startswith("Fig. ")]
    other = [d for d in drawn if not d.title.startswith("Fig. ")]
    titles = dict(SECTIONS)
    main = tag(
        "main",
        section("findings", titles["findings"], findings(run)),
        section("claims", titles["claims"], claims(gallery)),
        section("paper-figures", titles["paper-figures"], figures(paper)),
        section("more-figures", titles["more-figures"], figures(other)),
        section("results", titles["results"], results(run)),
        section("model", titles["model"], modelled(run)),
        section("provenance", titles["provenance"], provenance(run)),
    )
    return document(f"optsim: {', '.join(run.targets) or 'empty run'}", lead(run), main, foot(run))


def lead(run: RunData) -> Markup:
    """Write the headline, its numbers and the chart."""
    verdict = make_verdict(run)
    sizes = {truth.radiance.shape for truth in run.truths.values()}
    what = ", ".join(" × ".join(map(str, shape)) for shape in sorted(sizes))
    kicker = f"optsim {run.summary.get('version', '')} · coded-aperture snapshot spectral imaging · {what}".rstrip(" ·")
    cards = [tag("li", tag("b", text.split(":")[0]), text.split(":", 1)[1].strip()) for text in verdict.readings]
    return tag(
        "header",
        tag(
            "div",
            tag("p", kicker, class_="kicker"),
            tag("h1", verdict.title),
            tag("ul", cards, class_="readings") if cards else None,
            tag("p", verdict.basis, class_="basis"),
            tag("p", verdict.tau, class_="basis") if verdict.tau else None,
            tag("ul", [tag("li", note) for note in run.notes], class_="notes") if run.notes else None,
            psnr_chart(run, main_recipe(run)),
            links_to(SECTIONS),
        ),
    )


def findings(run: RunData) -> list[Child]:
    """Write each finding with its small table."""
    verdict = make_verdict(run)
    if not verdict.findings:
        return [missing("Nothing was reconstructed.")]
    return [finding(f) for f in verdict.findings]


def finding(f: Finding) -> list[Child]:
    """Write one finding."""
    early = any(cell.endswith(EARLY) for row in f.rows for cell in row)
    caption = f"{EARLY} a solve behind this number stopped before its tolerance" if early else None
    columns = 2 if f.header[:1] == ("R",) or f.header[1:2] == ("score",) else 1
    return [
        tag("h3", f.label),
        tag("p", f.text) if f.text else None,
        tag("ul", [tag("li", point) for point in f.points], class_="points") if f.points else None,
        table(f.header, f.rows, numeric_from=columns, caption=caption) if f.rows else None,
    ]


def claims(gallery: Gallery) -> list[Child]:
    """Write the table of the paper's claims."""
    rows = [(c.claim, c.reading or "–", c.found, tag("span", c.verdict, class_=f"verdict {c.standing}")) for c in make_claims(gallery)]
    recipe = f" All numbers: {recipe_text(gallery.recipe)}." if gallery.recipe else ""
    intro = tag("p", "Rueda, Lau and Arce, “Multi-spectral compressive snapshot imaging using RGB image sensors”, Optics Express, 2015.")
    return [
        intro,
        table(("the paper says", "mono read as", "this run", "verdict"), rows, class_="wide claims", numeric_from=9),
        tag("p", RULE + recipe),
    ]


def figures(drawn: Sequence[Drawn]) -> list[Child]:
    """Write figures with their captions."""
    if not drawn:
        return [missing("No figure of this kind could be drawn from what was run.")]
    return [figure(d) for d in drawn]


def figure(d: Drawn) -> Markup:
    """Write one figure with its picture inside the page."""
    image = tag("img", src=inline_picture(d.png), alt=d.alt, loading="lazy", tabindex="0", title="open at full size")
    return tag("figure", image, tag("figcaption", tag("b", d.title + ". "), d.caption), id=d.name)


def inline_picture(path: Path) -> str:
    """Return a picture as a data address: WebP at quality 86, a quarter of the PNG's size, with no difference that shows."""
    from PIL import Image

    packed = io.BytesIO()
    with Image.open(path) as picture:
        picture.convert("RGB").save(packed, "WEBP", quality=86, method=4)
    return "data:image/webp;base64," + base64.b64encode(packed.getvalue()).decode("ascii")


COLUMNS = (
    "target", "sensor", "masks", "R", "shots", "data", "operator", "solver", "tau rule", "tau",
    "PSNR, dB", "SSIM", "angle, °", "s", "iterations", "seed", "stopped because",
)  # fmt: skip


def results(run: RunData) -> list[Child]:
    """Write every row; the peak of the PSNR stands in the header."""
    if not run.rows:
        return [missing("No row was written.")]
    peaks = "; ".join(f"{name} {truth.peak:.6g}" for name, truth in run.truths.items())
    caption = (
        "PSNR is the mean over bands of the band PSNR; its peak is the maximum of the true cube"
        + (f" ({peaks} W m⁻² sr⁻¹ nm⁻¹). " if peaks else ". ")
        + "Angle: mean spectral angle over pixels. "
        "tau is absolute, in Eq. 4 without a factor 1/2. Tinted rows stopped before their tolerance."
    )
    head = tag("tr", [tag("th", name, scope="col", class_="n" if name in NUMERIC else None) for name in COLUMNS])
    body = [
        tag("tr", [cell(name, value) for name, value in zip(COLUMNS, row_cells(row))], class_="early" if row.converged is False else None)
        for row in run.rows
    ]
    inner = tag("table", tag("caption", caption), tag("thead", head), tag("tbody", body), id="all", class_="wide results sortable")
    search = tag(
        "p",
        tag("input", type="search", placeholder="filter: foveon 1/8 gpsr", data_filter="all", aria_label="Filter the rows"),
        class_="filter",
    )
    return [search, tag("div", inner, class_="scroll", tabindex="0", role="region", aria_label="Every result")]


NUMERIC = {"R", "shots", "tau", "PSNR, dB", "SSIM", "angle, °", "s", "iterations", "seed"}


def row_cells(row: Row) -> list[tuple[str, object]]:
    """Return (text, stored value) of each column of a row."""

    def number(value: float | None, digits: str, absent: str = "–") -> tuple[str, object]:
        return (format(value, digits), value) if value is not None else (absent, "")

    return [
        (row.target, None), (row.sensor, None), (row.masks, None), (ratio_text(row.R), row.R), (str(row.shots), row.shots),
        (row.model, None), (row.operator, None), (row.solver, None), (row.tau_rule or "–", None), number(row.tau, ".3g"),
        number(row.psnr_db, ".2f", "exact"), number(row.ssim, ".3f"), number(row.sam_deg, ".2f"), number(row.seconds, ".1f"),
        number(row.iterations, "d"), (str(row.seed), row.seed), (row.stop, None),
    ]  # fmt: skip


def cell(name: str, value: tuple[str, object]) -> Markup:
    """Write one cell; numbers keep their stored value for sorting and checking."""
    text, stored = value
    kind = "n" if name in NUMERIC else "stop" if name == "stopped because" else None
    return tag("td", text, class_=kind, data_v=None if stored is None else repr(stored) if stored != "" else "")


def foot(run: RunData) -> Markup:
    """Write the last lines."""
    ties = f"Gaps under {db(0.05)} are called ties."
    return tag(
        "footer",
        tag("div", f"Numbers on this page were computed from {len(run.rows)} rows of summary.json and the cubes beside it. {ties}"),
    )
