"""The command line as a user meets it: files from verb to verb, JSON, exit codes, repeatability."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from optsim.cli.app import VERBS, _code
from optsim.files import read_cube


def optsim(*words: object) -> int:
    return _code([str(word) for word in words])


@pytest.fixture(scope="module")
def cube(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("cube") / "cube.nc"
    assert optsim("render", "color-checker", "--size", 32, "--error", 0.02, "-o", path) == 0
    return path


@pytest.fixture(scope="module")
def fine(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("fine") / "fine.nc"
    assert optsim("render", "color-checker", "--size", 24, "--subdivide", 10, "--oversample", 2, "--spp", 16, "-o", path) == 0
    return path


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_a_cube_goes_through_every_stage_and_comes_back_in_its_own_units(cube, tmp_path, capsys, sensor):
    frames, estimate = tmp_path / "frames.nc", tmp_path / "estimate.nc"
    assert optsim("measure", cube, "--sensor", sensor, "--shots", 3, "-o", frames) == 0
    assert optsim("reconstruct", frames, "-o", estimate) == 0
    capsys.readouterr()
    assert optsim("score", estimate, cube, "--json") == 0
    scores = json.loads(capsys.readouterr().out)
    assert {"psnr_db", "psnr_pooled_db", "ssim", "sam_deg", "rmse", "data_range", "band_psnr_db"} <= set(scores)
    assert len(scores["band_psnr_db"]) == 24
    assert scores["psnr_db"] > 18
    truth, found = read_cube(cube)["radiance"].values, read_cube(estimate)["radiance"].values
    assert np.mean(found) == pytest.approx(np.mean(truth), rel=0.1)


def test_the_same_seed_gives_the_same_bytes_of_cube_frames_and_estimate(tmp_path):
    digests = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        assert optsim("render", "color-checker-bars", "--size", 16, "--spp", 8, "--seed", 5, "-o", folder / "c.nc") == 0
        assert optsim("measure", folder / "c.nc", "--sensor", "bayer", "--shots", 2, "--seed", 5, "-o", folder / "f.nc") == 0
        assert optsim("reconstruct", folder / "f.nc", "-o", folder / "e.nc") == 0
        digests.append([hashlib.sha256((folder / f).read_bytes()).hexdigest() for f in ("c.nc", "f.nc", "e.nc")])
    assert digests[0] == digests[1]


def test_another_seed_gives_other_masks(cube, tmp_path):
    for seed in (1, 2):
        assert optsim("measure", cube, "--sensor", "mono", "--shots", 1, "--seed", seed, "-o", tmp_path / f"{seed}.nc") == 0
    assert (tmp_path / "1.nc").read_bytes() != (tmp_path / "2.nc").read_bytes()


def test_physical_frames_with_noise_come_back_in_the_cubes_units(fine, tmp_path, capsys):
    frames, estimate = tmp_path / "f.nc", tmp_path / "e.nc"
    assert optsim("measure", fine, "--sensor", "mono", "--shots", 6, "--physical", "--noise", "--bits", 16, "-o", frames) == 0
    assert optsim("reconstruct", frames, "--solver", "admm", "--tau", "1e-4", "-o", estimate) == 0
    capsys.readouterr()
    assert optsim("score", estimate, fine, "--json") == 0
    assert json.loads(capsys.readouterr().out)["psnr_db"] > 15


def test_matched_frames_with_noise_come_back_in_the_cubes_units(cube, tmp_path):
    frames, estimate = tmp_path / "f.nc", tmp_path / "e.nc"
    assert optsim("measure", cube, "--sensor", "mono", "--shots", 6, "--noise", "--bits", 14, "-o", frames) == 0
    assert optsim("reconstruct", frames, "--solver", "admm", "--tau", "1e-4", "-o", estimate) == 0
    truth, found = read_cube(cube)["radiance"].values, read_cube(estimate)["radiance"].values
    assert np.mean(found) == pytest.approx(np.mean(truth), rel=0.1)


def test_a_fine_cube_is_averaged_before_a_matched_measurement(fine, tmp_path):
    from optsim.files import read

    assert optsim("measure", fine, "--sensor", "foveon", "--shots", 1, "-o", tmp_path / "f.nc") == 0
    assert read(tmp_path / "f.nc")["frames"].shape == (1, 3, 24, 24 + 23)


def test_noisy_frames_are_not_fitted_exactly_unless_told_to(fine, tmp_path, capsys):
    words = ("--sensor", "mono", "--shots", 3, "--physical", "--knows", "camera", "--noise", "--bits", 8)
    assert optsim("measure", fine, *words, "-o", tmp_path / "f.nc") == 0
    scores = []
    for solver in ((), ("--solver", "basis-pursuit")):
        assert optsim("reconstruct", tmp_path / "f.nc", *solver, "-o", tmp_path / "e.nc") == 0
        capsys.readouterr()
        assert optsim("score", tmp_path / "e.nc", fine, "--json") == 0
        scores.append(json.loads(capsys.readouterr().out)["psnr_db"])
    assert scores[0] > 12
    assert scores[0] > scores[1] + 3


def test_physical_refuses_a_coarse_cube_and_interpolates_when_told(cube, tmp_path, capsys):
    words = ("measure", cube, "--sensor", "foveon", "--shots", 1, "--physical", "-o", tmp_path / "f.nc")
    assert optsim(*words) == 2
    assert "--subdivide 10 --oversample 2" in capsys.readouterr().err
    assert optsim(*words, "--interpolate") == 0
    from optsim.files import read

    assert read(tmp_path / "f.nc").attrs["model"] == "physical-interpolated"


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (("render", "color-cheker", "-o", "x.nc"), "scene"),
        (("render", "color-checker", "--size", "0", "-o", "x.nc"), "size"),
        (("render", "color-checker", "--spp", "0", "-o", "x.nc"), "render.spp"),
        (("render", "color-checker", "--seed", "-1", "-o", "x.nc"), "render.seed"),
        (("render", "color-checker", "--bands", "1:2", "-o", "x.nc"), "--bands"),
        (("render", "color-checker", "-o", "x.tiff"), "-o"),
        (("render", "color-checker", "--subdivide", "0", "-o", "x.nc"), "--subdivide"),
        (("measure", "absent.nc", "--sensor", "mono", "--shots", "1", "-o", "x.nc"), "absent.nc"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "4", "--masks", "repeated", "-o", "x.nc"), "--shots"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "0", "-o", "x.nc"), "--shots"),
        (("measure", "CUBE", "--sensor", "ccd", "--shots", "1", "-o", "x.nc"), "--sensor"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "1", "--bits", "12", "-o", "x.nc"), "--bits"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "1", "--noise", "--bits", "7", "-o", "x.nc"), "--bits"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "1", "--exposure", "1", "-o", "x.nc"), "--exposure"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "1", "--physical", "--matched", "-o", "x.nc"), "--matched"),
        (("reconstruct", "CUBE", "-o", "x.nc"), "must be frames, as measure"),
        (("score", "CUBE", "absent.nc"), "absent.nc"),
        (("explain", "nowhere"), "scene"),
        (("show", "absent.nc"), "absent.nc"),
        (("measure", "CUBE", "--sensor", "mono", "--shots", "1", "-o", "CUBE"), "-o"),
        (("render", "color-checker", "-o", "/proc/nowhere/x.nc"), "-o"),
        (("run", "--quick", "--config", "absent.toml"), "--quick"),
        (("run", "--config", "absent.toml"), "--config"),
        (("run", "--seed", "-1"), "seed"),
        (("nonsense",), "nonsense"),
        (("render",), "SCENE"),
    ],
)
def test_bad_usage_and_bad_input_exit_with_2_and_name_the_field(cube, tmp_path, monkeypatch, capsys, words, field):
    monkeypatch.chdir(tmp_path)
    assert optsim(*(cube if word == "CUBE" else word for word in words)) == 2
    error = capsys.readouterr().err
    assert field in error
    assert "Traceback" not in error


def test_json_verbs_print_one_object_and_nothing_else(capsys):
    wanted = {
        ("prism", "--json"): {"wavelength_nm", "position_px", "nm_per_px", "band_center_nm", "band_edge_nm", "residual_to_paper_nm"},
        ("explain", "color-checker", "--json"): {"scene", "effects"},
        ("doctor", "--json"): {"variant", "render_ok", "llvm_path", "llvm_version", "cores", "memory_gib", "versions"},
    }
    for words, keys in wanted.items():
        assert optsim(*words) == 0
        assert keys <= set(json.loads(capsys.readouterr().out))


def test_prism_json_has_24_bands_and_25_edges(capsys):
    assert optsim("prism", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert (len(report["band_center_nm"]), len(report["band_edge_nm"]), len(report["residual_to_paper_nm"])) == (24, 25, 24)


def test_explain_names_the_seven_effects(capsys):
    assert optsim("explain", "relief", "--json") == 0
    effects = json.loads(capsys.readouterr().out)["effects"]
    names = {"interreflection", "emitter_sampling", "dispersion", "illuminant_factoring", "spectral_nodes", "lens_blur", "sky"}
    assert {effect["name"] for effect in effects} == names
    assert all({"name", "on", "reason", "error_without"} <= set(effect) for effect in effects)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(verb, capsys):
    assert optsim(verb, "--help") == 0
    assert f"optsim {verb}" in capsys.readouterr().out.split("Example")[1]


def test_help_loads_no_engine_and_no_heavy_library():
    heavy = ("mitsuba", "drjit", "xarray", "numba", "scipy", "matplotlib", "colour", "pydantic", "numpy")
    code = "import sys\nfrom optsim.cli.app import _code\n_code(['--help'])\nprint(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(heavy) & set(done.stderr.split())
