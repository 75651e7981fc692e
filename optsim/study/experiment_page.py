"""The experiment's page: scores, signatures, and the paper's Fig. 9, 10 and 11."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim import __version__
from optsim.cube import bands_of
from optsim.files.guard import atomic_path
from optsim.report import figures_more, figures_target
from optsim.report.color import SceneLight
from optsim.report.data import SERIES, Capture, Frames, RunData, Solve, Truth
from optsim.report.figures_experiment import figure_signatures
from optsim.report.gallery import Gallery
from optsim.report.html import Child, table, tag
from optsim.report.page import figure
from optsim.report.plain_page import plain_page
from optsim.report.select import Recipe, ratio_text
from optsim.report.style import Drawn, styled
from optsim.study.claims.worlds import BENCH
from optsim.study.store import Store

if TYPE_CHECKING:
    from optsim.study.experiment import Experiment, Shoot

SHOWN = Recipe("physical", "camera", "admm", "auto")


def write_page(found: Experiment, shoots: Sequence[Shoot], store: Store, command: str) -> None:
    """Draw the figures and write experiment.html."""
    gallery = Gallery(_run_data(found, shoots, store), SHOWN)
    folder = found.folder / "figures"
    with styled():
        drawn = [
            figures_more.figure_frames(gallery, BENCH, folder, SHOWN.model),
            figures_target.figure_scene(gallery, BENCH, None, False, folder),
            _signatures(found, shoots, folder),
            figures_target.figure_single_shot(gallery, BENCH, f"fig11-{BENCH}", folder),
        ]
    names = {s.key: s.label for s in SERIES}
    scored = list(zip(shoots, found.rows))
    sections: list[tuple[str, str, Sequence[Child]]] = [
        ("scores", "Scores", [_scores(scored, names)]),
        ("signatures", "Signatures of the reference points", _points(scored, names)),
        ("figures", "Figures", [figure(d) for d in drawn if d is not None]),
    ]
    text = plain_page(
        tab="optsim: the experiment",
        kicker=f"optsim {__version__} · the paper’s test bed, emulated · {found.config.size} × {found.config.size} × 24",
        title=_title(scored),
        lead=[tag("p", _setting(), class_="basis")],
        sections=sections,
        foot=f"Every number on this page stands in experiment.json beside it. Again: {command}",
    )
    with atomic_path(found.page) as temporary:
        Path(temporary).write_text(text, "utf-8")


def _setting() -> str:
    return (
        "Toy bricks before the default camera (traced prism, diffraction, leaking mirrors) with a monochrome sensor of 8 bits "
        "and 10 electrons of read noise, "
        "exposed to nine tenths of its well: alone, and behind red, green and blue model glass for the colour sensors. H knows "
        "where the prism lays each band; "
        "Eq. 4 by ADMM, tau from held-out detector pixels. One mask series; intervals over masks stand in the study of the "
        "paper’s claims."
    )  # fmt: skip


def _title(scored: Sequence[tuple[Shoot, dict[str, Any]]]) -> str:
    """Say how far the colour sensors lie above each reading of mono at the least R."""
    first = min(shoot.R for shoot, _ in scored)
    value = {shoot.series.key: row["psnr_db"] for shoot, row in scored if first == shoot.R}
    parts = [
        f"{name} {value[key] - value['mono-distinct']:+.1f} dB against three masks and {value[key] - value['mono-repeated']:+.1f} "
        f"dB against one"
        for key, name in (("bayer", "Bayer"), ("foveon", "Foveon"))
    ]
    return f"On the emulated test bed at R = {ratio_text(first)}, over mono: {'; '.join(parts)}.".replace("-", "−")


def _scores(scored: Sequence[tuple[Shoot, dict[str, Any]]], names: dict[str, str]) -> Child:
    header = ("sensor", "R", "shots", "PSNR, dB", "450–560 nm", "560–670 nm", "SSIM", "angle, °", "saturated pixels")
    rows = []
    for shoot, row in scored:
        bands = np.array(row["band_psnr_db"], np.float64)
        long = np.arange(bands.size) >= 15
        cells = (
            f"{row['psnr_db']:.2f}",
            f"{bands[~long].mean():.2f}",
            f"{bands[long].mean():.2f}",
            f"{row['ssim']:.3f}",
            f"{row['sam_deg']:.2f}",
        )
        rows.append((names[shoot.series.key], ratio_text(shoot.R), str(shoot.shots), *cells, str(row["saturated_pixels"])))
    return table(header, rows, class_="wide")


def _points(scored: Sequence[tuple[Shoot, dict[str, Any]]], names: dict[str, str]) -> list[Child]:
    header = ("sensor", "R", "point", "error, % rms", "background, % of the true mean", "gain", "angle, °")
    rows = [
        (
            names[shoot.series.key],
            ratio_text(shoot.R),
            point,
            f"{100 * at['error']:.1f}",
            f"{100 * at['background']:+.1f}".replace("-", "−"),
            f"{at['gain']:.2f}".replace("-", "−"),
            f"{at['angle_deg']:.2f}",
        )
        for shoot, row in scored
        for point, at in row["signatures"].items()
    ]
    told = "Background and gain are those of the line, seen = background + gain × true, that fits best over the 24 bands."
    return [tag("p", told), table(header, rows, class_="wide", numeric_from=3)]


def _signatures(found: Experiment, shoots: Sequence[Shoot], folder: Path) -> Drawn:
    seen = {p: {(s.series.key, s.R): spectra[s.name] for s in shoots} for p, spectra in found.signatures.items()}
    truths = {p: spectra["truth"] for p, spectra in found.signatures.items()}
    return figure_signatures(found.wavelength_nm, truths, seen, SERIES, sorted({s.R for s in shoots}), folder)


def _run_data(found: Experiment, shoots: Sequence[Shoot], store: Store) -> RunData:
    """Gather rows, estimates and frames as the report reads them."""
    rows = [
        {
            "target": BENCH,
            "model": SHOWN.model,
            "operator": SHOWN.operator,
            "solver": SHOWN.solver,
            "tau": None,
            "tau_rule": SHOWN.tau_rule,
            "seed": found.config.seed,
            "stop": "",
            **row,
        }
        for row in found.rows
    ]
    named = {(s.series.sensor, s.series.masks, s.R): s.name for s in shoots}

    def name_of(capture: Capture) -> str:
        return named[capture.sensor, capture.masks, capture.R]

    def estimate(solve: Solve) -> np.ndarray:
        cube: np.ndarray = store.load(f"estimates/{name_of(solve.capture)}.nc")["radiance"].values
        return cube

    def frames(capture: Capture) -> Frames | None:
        if (capture.sensor, capture.masks, capture.R) not in named:
            return None
        data = store.load(f"frames/{name_of(capture)}.nc")
        return Frames(data["frames"].values, data.attrs["units"], data["cfa"].values if "cfa" in data else None)

    cube = store.load(f"cubes/{BENCH}-{found.config.size}.nc")
    bands = bands_of(cube)
    truths = {BENCH: Truth(cube["radiance"].values, bands, light=SceneLight.of(cube.attrs.get("illuminant"), bands.count))}
    return RunData(summary={"rows": rows}, truths=truths, estimate=estimate, frames=frames)
