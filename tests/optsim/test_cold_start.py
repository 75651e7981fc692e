"""What the command line loads before it answers: nothing that the answer does not need (seconds: benchmarks/cold_start.py)."""

import json
import subprocess
import sys

import pytest

ENGINES = ("mitsuba", "drjit", "numba")
HEAVY = ("matplotlib", "colour", "trimesh", "scipy", "pywt", "OpenEXR", "rich")
PROBE = """
import json, sys
sys.modules["dask"] = None  # xarray imports it where it is installed, and it SciPy; optsim does not ask for it
from optsim.cli.app import _code
code = _code(json.loads(sys.argv[1]))
print(json.dumps([code, sorted({name.partition(".")[0] for name in sys.modules})]))
"""


def loaded_by(*words, cwd=None):
    run = subprocess.run([sys.executable, "-c", PROBE, json.dumps(words)], capture_output=True, text=True, check=True, cwd=cwd)
    code, modules = json.loads(run.stdout.splitlines()[-1])
    assert code == 0, run.stderr
    return set(modules)


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("render", "--help"), ("run", "--help")], ids=" ".join)
def test_help_loads_neither_engines_nor_arrays(words):
    assert not loaded_by(*words) & ({*ENGINES, *HEAVY, "numpy", "xarray", "pandas", "pydantic"} - {"rich"})


def test_a_flat_picture_is_rendered_and_written_without_an_engine_or_a_compiler(tmp_path):
    loaded = loaded_by("render", "color-checker", "--size", "16", "-o", "cube.nc", cwd=tmp_path)
    assert not loaded & {*ENGINES, *HEAVY}
    assert (tmp_path / "cube.nc").is_file()


def test_a_question_about_a_scene_needs_no_engine():
    assert not loaded_by("explain", "color-checker") & {*ENGINES, "matplotlib", "colour", "xarray"}
    assert not loaded_by("scenes") & {*ENGINES, "matplotlib", "colour", "xarray"}
