"""How a photograph is computed: for turned mirrors, in slabs, and without compiling a kernel anew for new values."""

import numpy as np
import pytest

from optsim.camera import CameraConfig, Distinct, Exposure, Mono, masks_for, photograph
from optsim.camera import collect as collect_module
from optsim.camera.arrays import kernels
from optsim.camera.optics_config import DmdConfig
from optsim.cube import Bands, make_cube

BANDS = Bands.from_edges([500, 520, 545])


def fine_cube(size, seed=0):
    fine = BANDS.subdivide(10)
    values = np.random.default_rng(seed).random((2 * size[0], 2 * size[1], fine.count)).astype(np.float32)
    return make_cube(values, fine)


def shot(camera, size=(8, 9), masks=1):
    return photograph(fine_cube(size), BANDS, camera, Mono(), masks_for(Mono(), masks, Distinct(), size, 1), Exposure(time_s=1.0))


def turned(degrees, blurred):
    camera = CameraConfig() if blurred else CameraConfig().ideal()
    return camera.model_copy(update={"dmd": DmdConfig(rotation_deg=degrees, scale=1.1)})


@pytest.mark.parametrize("degrees", [0.0, 3.0, -10.0])
@pytest.mark.parametrize("blurred", [False, True], ids=["sharp", "blurred"])
def test_turned_mirrors_give_the_photograph_that_numpy_gives(degrees, blurred, monkeypatch):
    camera = turned(degrees, blurred)
    fast = shot(camera)["frames"].values
    monkeypatch.setattr(collect_module, "kernels", lambda: None)
    plain = shot(camera)["frames"].values
    np.testing.assert_allclose(fast, plain, rtol=1e-10, atol=1e-12 * plain.max())


@pytest.mark.parametrize("blurred", [False, True], ids=["sharp", "blurred"])
def test_small_slabs_of_rows_give_the_same_bytes(blurred, monkeypatch):
    whole = shot(turned(2.0, blurred), (14, 9))["frames"].values
    monkeypatch.setattr("optsim.camera.gather.SLAB_BYTES", 20_000)
    assert shot(turned(2.0, blurred), (14, 9))["frames"].values.tobytes() == whole.tobytes()


@pytest.mark.parametrize("blurred", [False, True], ids=["sharp", "blurred"])
def test_no_kernel_is_compiled_for_new_values_of_the_camera_scene_mask_or_size(blurred):
    k = kernels()
    if k is None:
        pytest.skip("no usable libLLVM")

    def compiled(camera, size, seed):
        with k.dr.scoped_set_flag(k.dr.JitFlag.KernelHistory, True):
            k.dr.kernel_history_clear()
            masks = masks_for(Mono(), 1, Distinct(), size, seed)
            photograph(fine_cube(size, seed), BANDS, camera, Mono(), masks, Exposure(time_s=1.0 + seed))
            history = [entry for entry in k.dr.kernel_history() if entry["type"] == k.dr.KernelType.JIT]
        return sum(not entry["cache_hit"] for entry in history), len(history)

    compiled(turned(0.2, blurred), (8, 9), 0)
    for seed, (size, degrees) in enumerate([((8, 9), 0.25), ((11, 13), 0.15)], start=1):
        misses, launched = compiled(turned(degrees, blurred), size, seed)
        assert launched > 0
        assert misses == 0
