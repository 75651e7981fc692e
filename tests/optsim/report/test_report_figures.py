"""Figures show the run's data: matrices with the counts of closed forms, points inside patches, files that are pictures."""

import numpy as np
import pytest
from PIL import Image

from optsim.errors import InputError
from optsim.report.data import RunData
from optsim.report.figures import builders, draw_figures
from optsim.report.figures_more import frame_image, telling_points
from optsim.report.figures_scores import band_psnr
from optsim.report.figures_target import chosen_bands
from optsim.report.gallery import Gallery, finest_window
from optsim.report.matrices import BAYER_BANDS, FOVEON_BANDS, bayer_blocks, bayer_matrix, foveon_matrix, mono_matrices
from optsim.report.style import Drawn, new_figure, save, sci, slug, styled


def written_out(bands_of_color, mosaic=None):
    """Build the stacked H of the paper by its index formula alone: row m, column n, band k lands on (m, n + k)."""
    H = np.zeros((3 * 36, 96))
    for color, numbers in enumerate(bands_of_color):
        for k in (n - 1 for n in numbers):
            for n in range(4):
                for m in range(4):
                    if mosaic is None or mosaic(m, n + k) == color:
                        H[36 * color + 4 * (n + k) + m, 16 * k + 4 * n + m] = 1
    return H


def rggb(m, j):
    return {(0, 0): 0, (0, 1): 1, (1, 0): 1, (1, 1): 2}[m % 2, j % 2]


def test_figure_2_has_the_non_zeros_of_the_closed_form():
    one, flat, dispersed = mono_matrices()
    assert np.array_equal(one, np.eye(16))
    assert np.array_equal(flat, np.tile(np.eye(16), (1, 6)))
    assert dispersed.shape == (4 * (4 + 6 - 1), 4 * 4 * 6)
    assert np.count_nonzero(dispersed) == 4 * 4 * 6
    rows, columns = np.nonzero(dispersed.T)[::-1]
    assert np.array_equal(columns, np.arange(96))
    assert np.array_equal(rows, np.arange(96) % 16 + 4 * (np.arange(96) // 16))


def test_figure_4_equals_the_index_formula_entry_by_entry():
    assert np.array_equal(foveon_matrix(), written_out(FOVEON_BANDS))
    assert np.array_equal(bayer_blocks(), written_out(BAYER_BANDS, rggb))
    assert np.count_nonzero(foveon_matrix()) == 16 * (4 + 3 + 2)


def test_the_bayer_blocks_of_figure_4_add_up_to_the_operator_that_reconstructs():
    assert np.array_equal(bayer_blocks().reshape(3, 36, 96).sum(0), bayer_matrix())


@pytest.fixture(scope="module")
def drawn(make, tmp_path_factory):
    run = make(size=40)
    return run, draw_figures(run, tmp_path_factory.mktemp("figures"))


def test_every_figure_is_written_twice_and_is_not_blank(drawn):
    _, figures = drawn
    names = [d.name for d in figures]
    assert len(set(names)) == len(names)
    assert {
        "fig02",
        "fig03",
        "fig04",
        "fig05",
        "fig06",
        "fig07",
        "fig11",
        "frames",
        "spectra",
        "band-psnr",
        "tau",
        "matched",
        "prism",
    } <= set(names)
    for d in figures:
        picture = np.asarray(Image.open(d.png).convert("RGB"), float)
        assert min(picture.shape[:2]) > 400, d.name
        assert picture.std() > 10, d.name
        assert np.mean(picture.min(-1) < 250) > 0.02, d.name
        assert d.pdf.read_bytes().startswith(b"%PDF"), d.name
        assert d.caption.endswith(".")
        assert d.alt


def draw_some(run, directory, wanted):
    """Draw the figures whose names begin as wanted."""
    with styled():
        plan = [build for name, build in builders(Gallery(run)) if name.startswith(wanted)]
        return [d for build in plan if (d := build(directory)) is not None]


def test_files_carry_no_date(drawn):
    for d in drawn[1]:
        assert b"CreationDate" not in d.pdf.read_bytes()
        assert "Software" not in Image.open(d.png).info


def test_captions_carry_the_numbers_of_the_run(drawn):
    run, figures = drawn
    fig7 = next(d for d in figures if d.name == "fig07")
    row = next(
        r
        for r in run.rows
        if r.target == "color-checker" and r.sensor == "foveon" and r.R == 0.125 and r.model == "matched" and not r.tau_rule
    )
    bands = [n - 1 for n in (4, 8, 12, 16, 20, 24)]
    error = np.abs(run.cube_of(row) - run.truths["color-checker"].radiance)[..., bands].mean()
    assert f"Foveon {sci(float(error))}" in fig7.caption
    prism = next(d for d in figures if d.name == "prism")
    assert f"at most {np.abs(run.prism['residual_to_paper_nm']).max():.2f} nm" in prism.caption


def test_a_run_with_nothing_in_it_still_draws_the_two_matrices(tmp_path):
    figures = draw_figures(RunData({"rows": []}, {}), tmp_path)
    assert [d.name for d in figures] == ["fig02", "fig04"]
    assert all(isinstance(d, Drawn) for d in figures)


def test_a_quick_run_draws_what_it_has(make, tmp_path):
    quick = make(size=24, targets=("color-checker",), ratios=(0.125, 0.5), gpsr=False, physical=False)
    assert [d.name for d in draw_some(quick, tmp_path, ("Fig. 5", "Fig. 6", "tau", "matched"))] == ["fig05"]


def test_a_run_of_one_pixel_draws(make, tmp_path):
    tiny = make(size=1, targets=("color-checker",), ratios=(0.125,), gpsr=False, physical=False)
    names = [d.name for d in draw_some(tiny, tmp_path, ("Fig. 5", "Fig. 7", "frames", "spectra"))]
    assert names == ["fig05", "fig07", "frames", "spectra"]


def test_I15_a_target_with_a_strange_name_is_drawn_into_safe_files(make, tmp_path):
    run = make(size=24, ratios=(0.125,), gpsr=False, physical=False, rename=lambda t: f"../../<script>$\\frac{{{t}}}$")
    folder = tmp_path / "inside"
    figures = draw_some(run, folder, ("scene", "Fig. 7"))
    assert len(figures) == 4
    assert len({d.name for d in figures}) == 4
    for d in figures:
        assert d.png.parent == folder
        assert set(d.name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-")
    assert [p.name for p in tmp_path.iterdir()] == ["inside"]


@pytest.mark.parametrize("name", ["../x", "a/b", "", "<script>", "x.png"])
def test_I15_a_figure_with_an_unsafe_name_is_refused(name, tmp_path):
    with styled(), pytest.raises(InputError, match=r"figure\.name"):
        save(new_figure(2, 2), tmp_path, name)


def test_a_slug_is_never_empty():
    assert slug("") == slug("///") == "unnamed"
    assert slug("Color Checker 24") == "color-checker-24"


def test_bands_of_the_paper_are_chosen_for_24_bands():
    assert chosen_bands(24, 6) == [4, 8, 12, 16, 20, 24]
    assert chosen_bands(24, 4) == [6, 12, 18, 24]
    assert chosen_bands(1, 6) == [1]


def test_band_psnr_of_a_constant_offset_is_its_closed_form():
    truth = np.random.Generator(np.random.Philox(2)).uniform(0, 1, (9, 9, 5))
    truth[0, 0, 0] = 2.0
    assert band_psnr(truth + 0.02, truth) == pytest.approx(np.full(5, 40.0))


def test_points_lie_in_flat_patches_and_differ(make):
    truth = make(size=96, targets=("color-checker",), ratios=(0.125,), gpsr=False, physical=False).truths["color-checker"].radiance
    points = telling_points(truth)
    assert len(points) == 6
    spectra = []
    for y, x in points:
        window = truth[y - 2 : y + 3, x - 2 : x + 3]
        assert np.ptp(window, axis=(0, 1)).max() < 1e-12
        spectra.append(truth[y, x] / np.linalg.norm(truth[y, x]))
    similarity = np.array(spectra) @ np.array(spectra).T
    assert np.all(similarity[~np.eye(6, dtype=bool)] < 0.999)


def test_the_enlarged_window_finds_one_pixel_bars():
    picture = np.zeros((64, 64, 2))
    picture[:, :32] = np.arange(32)[None, :, None] // 4 % 2
    picture[40:, 40:] = (np.arange(24) % 2)[None, :, None]
    rows, columns = finest_window(picture)
    assert rows.start >= 38
    assert columns.start >= 38


def test_a_mosaic_is_shown_in_the_colours_of_its_pixels():
    from optsim.report.data import Frames

    values = np.full((1, 1, 4, 6), 3.0)
    cfa = np.tile([[0, 1], [1, 2]], (2, 3))
    image = frame_image(Frames(values, "DN", cfa))
    assert np.array_equal(image.argmax(-1), cfa)
    assert np.array_equal(image.sum(-1), np.ones((4, 6)))
