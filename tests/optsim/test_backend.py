"""libLLVM is proven before it is used; without one, rendering goes on in Mitsuba's scalar variant."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from optsim import llvm
from optsim.render import doctor

HERE = Path(__file__).resolve().parents[2]
REAL = list(llvm._from_wheel())


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """Leave no candidate but those a test names, and a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "_from_wheel", lambda: iter(()))
    monkeypatch.setattr(llvm, "_from_system", lambda: [])
    monkeypatch.setattr(llvm, "cache_dir", lambda: tmp_path / "cache" / "optsim")
    return monkeypatch


def compiled(tmp_path: Path, source: str) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler to build a fake libLLVM with")
    path = tmp_path / "libLLVM.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)], input=source, text=True, check=True)
    return path


def test_a_text_file_called_libllvm_is_refused_with_a_reason_and_a_warning(alone, tmp_path):
    fake = tmp_path / "libLLVM.so"
    fake.write_text("not a library")
    alone.setenv(llvm.VARIABLE, str(fake))
    with pytest.warns(UserWarning, match="is not used"):
        report = llvm.choose()
    assert not report.usable
    assert report.refused[0].path == str(fake)
    assert "cannot be loaded" in report.refused[0].reason


def test_a_missing_file_is_refused(alone, tmp_path):
    alone.setenv(llvm.VARIABLE, str(tmp_path / "nowhere.so"))
    with pytest.warns(UserWarning, match="is not used"):
        assert "cannot be loaded" in llvm.choose().refused[0].reason


def test_a_library_without_llvmgetversion_is_refused_as_too_old(alone, tmp_path):
    verdict = llvm.prove(compiled(tmp_path, "int nothing;"))
    assert not verdict["ok"]
    assert "17 or newer" in str(verdict["reason"])


def test_R21_a_library_of_version_15_is_refused_by_its_number_without_rendering(alone, tmp_path):
    version = "void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) { *a = 15; *b = 0; *c = 6; }"
    verdict = llvm.prove(compiled(tmp_path, version))
    assert (verdict["ok"], verdict["version"]) == (False, "15.0.6")
    assert "too old, 17 or newer is needed" in str(verdict["reason"])


@pytest.mark.parametrize("crash", ["abort();", "*(volatile int *)0 = 1;"])
def test_a_library_that_kills_the_process_is_a_refusal_and_the_parent_lives(alone, tmp_path, crash):
    source = f"#include <stdlib.h>\nvoid LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) {{ {crash} }}"
    verdict = llvm.prove(compiled(tmp_path, source))
    assert not verdict["ok"]
    assert "signal" in str(verdict["reason"])


def test_a_library_that_only_claims_a_good_version_fails_the_proof_render(alone, tmp_path):
    verdict = llvm.prove(compiled(tmp_path, "void LLVMGetVersion(unsigned *a, unsigned *b, unsigned *c) { *a = 23; *b = 1; *c = 4; }"))
    assert not verdict["ok"]
    assert verdict["reason"]


@pytest.mark.parametrize("path", sorted(Path("/usr/lib").glob("*/libLLVM-1[45].so.1")), ids=lambda p: p.name)
def test_R21_real_old_llvms_are_refused(alone, path):
    assert not llvm.prove(path)["ok"]


def test_verdicts_are_kept_until_the_file_changes(alone, tmp_path):
    fake = tmp_path / "libLLVM.so"
    fake.write_text("not a library")
    assert not llvm.prove(fake)["cached"]
    assert llvm.prove(fake)["cached"]
    assert not llvm.prove(fake, use_cache=False)["cached"]
    fake.write_text("something else")
    assert not llvm.prove(fake)["cached"]


def test_a_broken_or_unwritable_cache_costs_a_proof_and_nothing_else(alone, tmp_path):
    fake = tmp_path / "libLLVM.so"
    fake.write_text("not a library")
    alone.setattr(llvm, "cache_dir", lambda: tmp_path / "libLLVM.so" / "below a file")
    assert not llvm.prove(fake)["ok"]
    good = tmp_path / "cache"
    good.mkdir()
    (good / "llvm-proofs.json").write_text("{broken")
    alone.setattr(llvm, "cache_dir", lambda: good)
    assert not llvm.prove(fake)["cached"]
    assert json.loads((good / "llvm-proofs.json").read_text())


def test_a_proof_that_hangs_is_refused_and_not_kept(alone, tmp_path):
    alone.setattr(llvm, "PROOF_TIMEOUT_S", 0.01)
    fake = tmp_path / "libLLVM.so"
    fake.write_text("")
    assert "did not end" in str(llvm.prove(fake)["reason"])
    assert not (tmp_path / "cache" / "optsim" / "llvm-proofs.json").exists()


@pytest.mark.skipif(not REAL, reason="the pinned wheel is not installed")
def test_the_pinned_wheel_is_found_without_its_plain_link_and_trusted_without_a_child(monkeypatch):
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "prove", lambda *a, **k: pytest.fail("a child was started"))
    report = llvm.choose()
    assert report.version == "23.1.4"
    assert "trusted" in report.proof
    assert os.path.realpath(report.path) == str(REAL[0].resolve())


@pytest.mark.skipif(not REAL, reason="the pinned wheel is not installed")
def test_a_good_library_that_is_not_the_pinned_wheels_is_proven_by_a_render_once(alone):
    alone.setattr(llvm, "_pinned_version", lambda path: None)
    alone.setenv(llvm.VARIABLE, str(REAL[0]))
    report = llvm.choose()
    assert (report.path, report.version) == (str(REAL[0]), "23.1.4")
    assert "child process" in report.proof
    assert "earlier" in llvm.choose().proof


def test_candidates_are_named_libraries_only_and_newest_first():
    names = ["libLLVM.so", "libLLVM-19.so.1", "libLLVM.so.23.1", "libLLVM.dylib", "LLVM-C.dll", "libLLVM-15.so"]
    assert all(llvm._NAME.match(name) for name in names)
    assert not any(llvm._NAME.match(name) for name in ("libLLVMSupport.a", "libLLVM.so.txt", "libLTO.so", "libLLVMCore.so"))
    assert llvm._numbers("/usr/lib/libLLVM.so.19.1") > llvm._numbers("/usr/lib/libLLVM-15.so.1")


def test_R21_doctor_without_any_llvm_reports_the_version_needed_and_the_scalar_variant(alone):
    report = doctor()
    assert report["variant"] == "scalar_spectral"
    assert report["render_ok"] is True
    assert report["llvm_path"] is None
    assert "17 or newer" in str(report["advice"])


@pytest.mark.skipif(not REAL, reason="the pinned wheel is not installed")
def test_doctor_proves_by_a_render_and_tells_the_machine(monkeypatch):
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    report = doctor()
    assert {"variant", "render_ok", "llvm_path", "llvm_version", "cores", "memory_gib", "versions"} <= set(report)
    assert report["variant"] == "llvm_ad_spectral"
    assert report["render_ok"] is True
    assert report["llvm_version"] == "23.1.4"
    assert "spectral scene" in str(report["llvm_proof"])
    assert report["cores"] >= 1
    assert json.dumps(report)


SCALAR = """
import warnings, numpy as np
from optsim import llvm
llvm._from_wheel = lambda: iter(())
llvm._from_system = lambda: []
from optsim.render import RenderSettings, render
from optsim.cube import Bands
from scenes.scene import ConstantSky, Diffuse, Orthographic, Rectangle, Scene
from scenes.library import illuminant, reflectance, reflectances
rho = reflectance(tuple(reflectances())[14])
plane = Rectangle(name="p", material="m", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
view = Orthographic(origin=(0, 0, 3), target=(0, 0, 0), half_height=0.5)
sky = ConstantSky(radiance=illuminant("D65"))
scene = Scene(name="s", shapes=(plane,), materials={"m": Diffuse(reflectance=rho)}, lights=(sky,), viewpoint=view)
bands = Bands.from_edges(np.linspace(450, 670, 45))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    cube = render(scene, bands, (8, 8), RenderSettings(samples_per_pixel=1024))
assert any("4 to 48" in str(w.message) for w in caught), caught
assert cube.attrs["variant"] == "scalar_spectral"
grid = np.unique(np.concatenate([rho.wavelength_nm, illuminant("D65").wavelength_nm]))
grid = grid[(grid >= 440) & (grid <= 680)]
expected = illuminant("D65").hat_weights(grid, bands.lower, bands.upper) @ rho.at(grid)
error = np.sqrt((cube.stderr.values ** 2).mean((0, 1))) / 8
assert np.all(error < 0.1 * expected)
assert np.all(np.abs(cube.radiance.values.mean((0, 1)) - expected) < 5 * error + 2e-4 * expected)
again = render(scene, bands, (8, 8), RenderSettings(samples_per_pixel=1024))
assert again.radiance.values.tobytes() == cube.radiance.values.tobytes()
print("fine")
"""


def test_R21_without_llvm_a_render_goes_on_in_the_scalar_variant_and_says_what_it_costs():
    environment = {k: v for k, v in os.environ.items() if k != llvm.VARIABLE}
    run = subprocess.run([sys.executable, "-c", SCALAR], capture_output=True, text=True, cwd=HERE, env=environment, check=False)
    assert run.stdout.strip() == "fine", run.stderr


EARLY = """
import drjit
from optsim.llvm import use_llvm
report = use_llvm()
loaded = drjit.detail.llvm_version()[0]
assert report.usable == (loaded >= 17), (report, loaded)
if not report.usable:
    assert "imported before" in report.refused[0].reason
print("fine")
"""


def test_a_libllvm_that_drjit_loaded_before_us_is_asked_for_its_version():
    environment = {k: v for k, v in os.environ.items() if k != llvm.VARIABLE}
    run = subprocess.run([sys.executable, "-c", EARLY], capture_output=True, text=True, cwd=HERE, env=environment, check=False)
    assert run.stdout.strip() == "fine", run.stderr


def test_importing_the_renderer_loads_neither_mitsuba_nor_drjit():
    code = "import sys, optsim.render; print([m for m in ('mitsuba', 'drjit', 'colour', 'xarray') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=HERE, check=True)
    assert run.stdout.strip() == "[]"
