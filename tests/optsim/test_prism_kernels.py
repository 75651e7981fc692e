"""The prism in Dr.Jit: no recompilation for new values, and finite, right gradients everywhere, losses included."""

import math

import numpy as np
import pytest

from optsim.camera import AIR, DoubleAmici, PrismStack, glass
from optsim.camera.arrays import NUMPY, kernels

STACK = PrismStack(glasses=(glass("N-SK2"), AIR, glass("N-SF10"), glass("N-SK2")), face_tilt_rad=(0.09, -0.2, -0.19, 0.41, -0.1))
NAMES = ("tilt_rad", "squared_shift", "collimator_mm", "focal_mm")


@pytest.fixture
def k():
    found = kernels()
    if found is None:
        pytest.skip("no usable libLLVM on this machine")
    return found


def rays_of(k, count=1000, seed=0):
    rng = np.random.default_rng(seed)
    return [k.backend.Float64(v) for v in (rng.uniform(450, 670, count), *rng.uniform(-3.5, 3.5, (2, count)))]


def changed(prism, step):
    """Return the prism with every number moved a little."""
    relay = prism.relay.model_copy(update={"collimator_mm": prism.relay.collimator_mm + step, "focal_mm": prism.relay.focal_mm - step})
    update = {"relay": relay}
    if isinstance(prism, PrismStack):
        update["face_tilt_rad"] = tuple(t * (1 + step) for t in prism.face_tilt_rad)
    else:
        update |= {"apex_outer_rad": prism.apex_outer_rad * (1 + step), "apex_inner_rad": prism.apex_inner_rad * (1 - step)}
    return prism.model_copy(update=update)


@pytest.mark.parametrize("prism", [DoubleAmici.default(), STACK], ids=["double Amici", "stack"])
def test_new_values_of_every_parameter_run_the_compiled_kernels_again(k, prism):
    dr = k.dr
    inputs = rays_of(k)

    def run(some):
        values = some.opaque_values(k, k.backend.Float64)
        x, y, valid = some.trace(k.ops, *inputs, values)
        dr.eval(x, y, valid, some.transmittance(k.ops, *inputs, values))

    def history(some):
        dr.sync_thread()
        dr.kernel_history_clear()
        run(some)
        dr.sync_thread()
        return [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        first = history(prism)
        again = [history(changed(prism, step)) for step in (1e-3, -2e-3, 5e-3)]
    assert len(first) >= 1
    for entries in again:
        assert [entry["hash"] for entry in entries] == [entry["hash"] for entry in first]
        assert all(entry["cache_hit"] for entry in entries)


def flatten(values):
    return [v for field in values for v in (field if isinstance(field, tuple) else (field,))]


def rebuilt(values, flat):
    flat, parts = list(flat), []
    for field in values:
        parts.append(tuple(flat.pop(0) for _ in field) if isinstance(field, tuple) else flat.pop(0))
    return type(values)(*parts)


def outputs(k, prism, inputs, values):
    x, y, _ = prism.trace(k.ops, *inputs, values)
    return x, y, prism.transmittance(k.ops, *inputs, values)


@pytest.mark.parametrize("prism", [DoubleAmici.default(), STACK], ids=["double Amici", "stack"])
@pytest.mark.parametrize("out", range(3), ids=["x", "y", "transmission"])
def test_reverse_and_forward_gradients_of_places_and_losses_are_the_central_differences(k, prism, out):
    dr, kind = k.dr, k.backend.Float64
    inputs = rays_of(k, 40)
    host = [np.array(v) for v in inputs]
    plain = flatten(prism.values)

    def result_of(flat):
        for array in flat:
            dr.enable_grad(array)
        return outputs(k, prism, inputs, rebuilt(prism.values, flat))[out]

    flat = [dr.opaque(kind, v, 40) for v in plain]
    dr.backward(dr.sum(result_of(flat)))
    reverse = [np.array(dr.grad(array)) for array in flat]
    flat = [dr.opaque(kind, v, 40) for v in plain]
    result = result_of(flat)
    weights = np.random.default_rng(1).normal(size=len(plain))
    for array, weight in zip(flat, weights):
        dr.set_grad(array, weight)
    forward = np.array(dr.forward_to(result))
    np.testing.assert_allclose(forward, weights @ np.array(reverse), rtol=1e-10, atol=1e-12 * np.abs(reverse).max())
    for which, value in enumerate(plain):
        step = 1e-5 * max(1.0, abs(value))
        sides = []
        for sign in (1, -1):
            moved = rebuilt(prism.values, [v + sign * step * (i == which) for i, v in enumerate(plain)])
            x, y, _ = prism.trace(NUMPY, *host, moved)
            sides.append((x, y, prism.transmittance(NUMPY, *host, moved))[out])
        expected = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(reverse[which], expected, rtol=2e-7, atol=1e-8 * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("names", [("N-BK7", "N-SF66", "N-BK7"), ("N-SF66", "air", "F2")])
def test_P16_gradients_are_finite_everywhere_and_zero_where_light_is_lost(k, names):
    dr, kind = k.dr, k.backend.Float64
    rng = np.random.default_rng(7)
    count = 3000
    prism = PrismStack(glasses=tuple(AIR if n == "air" else glass(n) for n in names), face_tilt_rad=(0.0,) * 4)
    inputs = [kind(rng.uniform(450, 670, count)), *(kind(v) for v in rng.uniform(-80, 80, (2, count)))]
    tilts = tuple(kind(v) for v in rng.uniform(-1.5, 1.5, (4, count)))  # every ray has a stack of its own
    values = prism.values._replace(tilt_rad=tilts, squared_shift=tuple(dr.opaque(kind, 0.0, count) for _ in range(3)))
    arrays = (*inputs, *tilts, *values.squared_shift)
    for array in arrays:
        dr.enable_grad(array)
    x, y, valid = prism.trace(k.ops, *inputs, values)
    share = prism.transmittance(k.ops, *inputs, values)
    dr.backward(dr.sum(x) + dr.sum(y) + dr.sum(share))
    gone = ~np.array(valid)
    assert 300 < gone.sum() < 2900
    assert (np.array(share)[gone] == 0).all()
    assert ((np.array(share) >= 0) & (np.array(share) <= 1 + 1e-15)).all()
    for array in arrays:
        gradient = np.array(dr.grad(array))
        assert np.isfinite(gradient).all()
        assert (gradient[gone] == 0).all()


def test_P6_gradients_within_16_ulp_of_the_critical_angle_are_finite(k):
    dr, kind = k.dr, k.backend.Float64
    n = float(glass("N-BK7").index(550.0))
    tilts = [math.asin(1 / n)]
    for direction in (0.0, 2.0):
        tilt = math.asin(1 / n)
        for _ in range(16):
            tilt = math.nextafter(tilt, direction)
            tilts.append(tilt)
    prism = PrismStack(glasses=(glass("N-BK7"),), face_tilt_rad=(0.0, 0.5), design_position_px=0.0)
    tilt = kind(np.array(sorted(tilts)))
    dr.enable_grad(tilt)
    values = prism.values._replace(tilt_rad=(kind(0.0), tilt))
    x, _, valid = prism.trace(k.ops, kind(550.0), kind(0.0), kind(0.0), values)
    dr.backward(dr.sum(x) + dr.sum(prism.transmittance(k.ops, kind(550.0), kind(0.0), kind(0.0), values)))
    assert np.isfinite(np.array(x)).all()
    assert np.isfinite(np.array(dr.grad(tilt))).all()
    assert (np.diff(np.array(valid).astype(int)) <= 0).all()
