"""The choice of arrays: Dr.Jit where a libLLVM is usable, NumPy where not, and never an abort."""

import subprocess
import sys

import numpy as np

import optsim.llvm
from optsim.camera import arrays


def test_R21_without_a_usable_libllvm_drjit_is_not_even_imported(monkeypatch):
    monkeypatch.setattr(optsim.llvm, "_chosen", optsim.llvm.LlvmReport(None, None, "none for this test"))
    assert arrays.kernels.__wrapped__() is None


def test_the_whole_camera_works_in_a_process_without_libllvm():
    code = """
import sys
import numpy as np
import optsim.llvm
optsim.llvm._chosen = optsim.llvm.LlvmReport(None, None, "none for this test")
from optsim.camera import CameraConfig, Mono, photograph, prism_report
from optsim.cube import Bands, make_cube
bands = Bands.from_edges([500, 520, 540])
cube = make_cube(np.ones((4, 6, 20)), bands.subdivide(10))
frames = photograph(cube, bands, CameraConfig().ideal(), Mono(), np.ones((1, 2, 3)))
assert len(prism_report()["band_center_nm"]) == 24
assert "drjit" not in sys.modules and "mitsuba" not in sys.modules
print(frames["frames"].values.max())
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert float(run.stdout) == 18000


def test_importing_the_camera_loads_no_heavy_library():
    heavy = {"drjit", "mitsuba", "xarray", "colour", "matplotlib", "scipy", "numba"}
    code = f"import sys, optsim.camera; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_an_opaque_scalar_keeps_its_value_and_a_new_one_reuses_the_kernel():
    k = arrays.kernels()
    if k is None:
        return
    Float64 = k.backend.Float64
    x = Float64(np.arange(5.0))
    for value in (2.0, 3.0):
        assert np.array(x * k.opaque(Float64, value)).tolist() == (value * np.arange(5)).tolist()
