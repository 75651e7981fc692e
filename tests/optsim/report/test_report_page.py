"""The page shows the stored numbers, escapes every name, loads nothing from a network, and opens in a browser."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

from optsim.report import write_report
from optsim.report.data import RunData
from optsim.report.document import asset
from optsim.report.figures import builders
from optsim.report.gallery import Gallery
from optsim.report.html import Markup, tag
from optsim.report.page import COLUMNS, render_page
from optsim.report.page_origin import stop_reasons
from optsim.report.style import styled

VOID = {"meta", "img", "br", "hr", "input", "col"}
HOSTILE = "</title><script>alert('x')</script>\"'&<img src=x onerror=alert(1)>"


class Reader(HTMLParser):
    """Collect tables, texts and addresses, and check that elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.tables: dict[str, list[list[tuple[str, str | None]]]] = {}
        self.text = ""
        self.table = ""
        self.feed(text)
        assert self.stack == []

    def handle_starttag(self, name, attrs):
        given = dict(attrs)
        self.tags.append((name, given))
        if name not in VOID:
            self.stack.append(name)
        if name == "table":
            self.table = given.get("id", f"table{len(self.tables)}")
            self.tables[self.table] = []
        if name == "tr":
            self.tables[self.table].append([])
        if name in ("td", "th"):
            self.tables[self.table][-1].append(("", given.get("data-v")))

    def handle_endtag(self, name):
        assert self.stack.pop() == name

    def handle_data(self, data):
        if "script" not in self.stack and "style" not in self.stack:
            self.text += data
        if self.stack and set(self.stack) & {"td", "th"}:
            text, value = self.tables[self.table][-1][-1]
            self.tables[self.table][-1][-1] = (text + data, value)


@pytest.fixture(scope="module")
def written(make, tmp_path_factory):
    run = make(size=24, ratios=(0.125, 0.5))
    folder = tmp_path_factory.mktemp("report")
    with styled():
        plan = [build for name, build in builders(Gallery(run)) if name in ("Fig. 2", "PSNR by band", "prism")]
        figures = tuple(d for build in plan if (d := build(folder)) is not None)
    return run, figures, render_page(run, figures)


def test_the_report_is_one_page_and_a_folder_of_figures(tmp_path):
    page = write_report(RunData({"rows": []}, {}), tmp_path / "new" / "folder")
    assert page == tmp_path / "new" / "folder" / "report.html"
    assert sorted(p.name for p in page.parent.iterdir()) == ["figures", "report.html"]
    assert sorted(p.name for p in (page.parent / "figures").iterdir()) == ["fig02.pdf", "fig02.png", "fig04.pdf", "fig04.png"]
    assert "Nothing was reconstructed" in page.read_text("utf-8")


def test_every_row_is_shown_with_its_stored_numbers(written):
    run, _, page = written
    table = Reader(page).tables["all"]
    assert [text for text, _ in table[0]] == list(COLUMNS)
    assert len(table) - 1 == len(run.rows) > 50
    for cells, row in zip(table[1:], run.summary["rows"]):
        shown = dict(zip(COLUMNS, cells))
        for column, key in (
            ("PSNR, dB", "psnr_db"),
            ("SSIM", "ssim"),
            ("angle, °", "sam_deg"),
            ("s", "seconds"),
            ("R", "R"),
            ("seed", "seed"),
        ):
            text, stored = shown[column]
            assert float(stored) == pytest.approx(row[key], rel=1e-6)
            if column != "R":
                assert float(text) == pytest.approx(row[key], abs=0.5 * 10 ** -len(text.partition(".")[2]) + 1e-12)
        assert shown["tau"][1] == ("" if row["tau"] is None else repr(row["tau"]))
        assert shown["stopped because"][0] == row["stop"]


def test_the_peak_of_the_psnr_stands_in_the_header(written):
    run, _, page = written
    text = Reader(page).text
    for name, truth in run.truths.items():
        assert f"{name} {truth.peak:.6g}" in text


def test_the_page_loads_nothing(written):
    page = written[2]
    assert not re.search(r"https?://|//[a-z0-9-]+\.[a-z]", page)
    assert "@import" not in page
    assert "url(" not in page
    for name, attributes in Reader(page).tags:
        for key in ("src", "href", "data", "action", "poster", "srcset"):
            if key in attributes:
                assert attributes[key].startswith(("data:", "#")), (name, attributes[key][:60])
    policy = next(a["content"] for name, a in Reader(page).tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")


def test_every_picture_has_words_for_those_who_cannot_see_it(written):
    page = Reader(written[2])
    pictures = [a for name, a in page.tags if name == "img" and a["src"] != "data:,"]
    assert len(pictures) == len(written[1])
    assert all(len(a["alt"]) > 20 for a in pictures)
    assert all(a.get("aria-label") for name, a in page.tags if name == "svg")
    assert [name for name, _ in page.tags].count("h1") == 1


def test_I15_names_with_markup_are_shown_escaped(make):
    run = make(size=8, ratios=(0.125,), rename=lambda t: f"{t}{HOSTILE}")
    summary = json.loads(json.dumps(run.summary))
    summary["config"][HOSTILE] = {HOSTILE: HOSTILE}
    summary["rows"][0]["stop"] = HOSTILE
    hostile = RunData(
        summary, run.truths, run.estimate, run.frames, explain={HOSTILE: {"effects": [{"name": HOSTILE, "on": True, "reason": HOSTILE}]}},
        lost_light={HOSTILE: 0.1}, timings={HOSTILE: 1.0}, notes=[HOSTILE], command=HOSTILE,
    )  # fmt: skip
    page = Reader(render_page(hostile, ()))
    plain = Reader(render_page(make(size=8, ratios=(0.125,)), ()))
    assert page.text.count(HOSTILE) > 10
    for name in ("script", "img", "title", "style"):
        assert [n for n, _ in page.tags].count(name) == [n for n, _ in plain.tags].count(name)
    assert not [a for _, a in page.tags if any(key.startswith("on") for key in a)]


def test_I15_markup_that_was_not_built_here_is_escaped():
    assert tag("p", "<b>", title='"><') == '<p title="&quot;&gt;&lt;">&lt;b&gt;</p>'
    assert tag("p", Markup("<b>x</b>"), ["&", None]) == "<p><b>x</b>&amp;</p>"


def test_an_empty_run_still_gives_a_page_that_says_so():
    page = Reader(render_page(RunData({"rows": []}, {}), ()))
    for words in ("Nothing was reconstructed", "No row was written", "not run", "Not recorded"):
        assert words in page.text


def test_a_run_without_the_second_target_says_what_was_not_run(make):
    quick = make(size=8, targets=("color-checker",), ratios=(0.125, 0.5), gpsr=False, physical=False)
    text = Reader(render_page(quick, ())).text
    assert "color-checker-bars was not run" in text
    assert "Physical data were not run" in text
    assert "Eq. 4 with a finite tau was not run" in text


def test_exact_estimates_and_pictures_too_small_for_ssim_are_named(make):
    run = make(size=8, ratios=(0.125,))
    rows = [dict(row, psnr_db=None, ssim=None) for row in run.summary["rows"]]
    table = Reader(render_page(RunData({"rows": rows}, run.truths), ())).tables["all"]
    shown = dict(zip(COLUMNS, table[1]))
    assert shown["PSNR, dB"] == ("exact", "")
    assert shown["SSIM"] == ("–", "")


def test_the_script_and_the_style_hold_no_end_of_their_element():
    assert "</script" not in asset("page.js").lower()
    assert "</style" not in asset("page.css").lower()


def test_solves_that_stopped_early_are_tinted(written):
    run, _, page = written
    tinted = [a for name, a in Reader(page).tags if name == "tr" and a.get("class") == "early"]
    assert len(tinted) == sum(row.converged is False for row in run.rows) > 0


@pytest.mark.slow
def test_the_page_opens_in_a_browser_without_an_error(written, tmp_path):
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    page = tmp_path / "report.html"
    page.write_text(written[2], "utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", "--enable-logging=stderr", "--v=0"]
    command += ["--virtual-time-budget=3000", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert console == []
    assert done.stdout.count('<button type="button">') == len(COLUMNS)
    assert f"{written[0].rows[0].psnr_db:.2f}" in done.stdout


def test_reasons_that_differ_in_numbers_alone_are_counted_together(make):
    run = make(size=8, targets=("color-checker",), ratios=(0.125,), gpsr=False, physical=False)
    rows = [dict(row, stop=f"residual {i}.5e-0{i} is below 1e-4") for i, row in enumerate(run.summary["rows"])]
    assert stop_reasons(RunData({"rows": rows}, {})) == [("4", "converged", "residual 0.5e-00 is below 1e-4")]


@pytest.mark.parametrize("key", ["reconstruct (sum over solves)", "reconstruct (thread-seconds)"])
def test_seconds_summed_over_threads_are_never_added_to_wall_seconds(key):
    run = RunData(
        {"rows": [], "machine": {"cores": 2, "wall time of this call": 50.0}}, {}, timings={"render": 3.0, "measure": 0.5, key: 90.0}
    )
    page = Reader(render_page(run, ()))
    tables = [[[cell for cell, _ in line] for line in t] for t in page.tables.values()]
    wall = next(t for t in tables if t[0][0] == "stage")
    assert wall[1:] == [["render", "3.0 s"], ["measure", "0.5 s"], ["sum of these stages", "3.5 s"], ["wall time of this call", "50.0 s"]]
    apart = next(t for t in tables if t[0][0] == "summed over threads")
    assert apart[1:] == [[key.removesuffix(" (thread-seconds)"), "90.0 thread-seconds"]]


def test_the_wall_time_of_the_call_may_stand_among_the_timings():
    page = Reader(render_page(RunData({"rows": []}, {}, timings={"render": 3.0, "measure": 1.0, "wall time of this call": 9.0}), ()))
    assert "4.0 s" in page.text
    assert "9.0 s" in page.text
    assert "13.0 s" not in page.text


def test_light_that_is_detected_is_not_called_lost_and_what_was_not_rendered_is_said():
    shares = {
        "falls beside the sensor": 0.01,
        "stopped by the 450-670 nm band-pass filter": 0.0,
        "detected, but outside the 24 bands": 0.03,
    }
    page = Reader(render_page(RunData({"rows": []}, {}, lost_light=shares), ()))
    tables = {t[0][0][0]: [[cell for cell, _ in line] for line in t[1:]] for t in page.tables.values() if t}
    assert tables["lost before a pixel"] == [
        ["falls beside the sensor", "1 %"],
        ["stopped by the 450-670 nm band-pass filter", "not rendered"],
    ]
    assert tables["reaches a pixel"] == [["detected, but outside the 24 bands", "3 %"]]
    assert "The fine cube covers 450-670 nm, so what the filter stops was not rendered." in page.text
    assert "Where the light goes" in page.text
