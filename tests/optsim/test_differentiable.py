"""The differentiable measurement: equal to the photograph, with derivatives judged by complex and finite steps."""

import numpy as np
import pytest

from optsim.camera import CameraConfig, Exposure, Foveon, Mono, Quattro, photograph, physical_model, sensors
from optsim.camera.arrays import NUMPY, kernels
from optsim.camera.differentiable import DifferentiableMeasurement
from optsim.camera.differentiable_optics import DifferentiableOptics
from optsim.camera.optics_config import DmdConfig
from optsim.cube import Bands, make_cube
from optsim.errors import InputError

pytestmark = pytest.mark.skipif(kernels() is None, reason="no usable libLLVM")

BANDS = Bands.from_edges([500, 507, 515, 524])
FINE = BANDS.subdivide(10, cover=(450, 560))
CAMERA = CameraConfig(bandpass={"lower_nm": 450.0, "upper_nm": 560.0}).ideal()


def displaced(**dmd):
    """Return a camera whose samples' borders lie on no pixel border, so that frames are smooth in every number."""
    return CAMERA.model_copy(update={"dmd": DmdConfig(**({"leak": 0.0, "offset_x_px": 0.137, "offset_y_px": 0.291} | dmd))})


def inputs(size=(4, 5), samples=2, shots=2):
    rng = np.random.default_rng(3)
    cube = rng.random((size[0] * samples, size[1] * samples, FINE.count)).astype(np.float32)
    return cube.astype(np.float64), rng.random((shots, *size))


@pytest.mark.parametrize("sensor", sensors(), ids=lambda s: s.name)
@pytest.mark.parametrize("samples", [2, 3])
def test_the_differentiable_measurement_is_the_photograph(sensor, samples):
    cube, masks = inputs(samples=samples)
    binary = (masks < 0.5).astype(np.uint8)
    photo = photograph(make_cube(cube.astype(np.float32), FINE), BANDS, CAMERA, sensor, binary, Exposure(time_s=1.0))["frames"].values
    frames = np.array(DifferentiableMeasurement(CAMERA, sensor, FINE, (4, 5), samples, photo.shape[-1]).frames(cube, binary.astype(float)))
    assert np.abs(frames - photo).max() < 1e-7 * photo.max()  # the photograph holds the trace by polynomials, to 1e-7 px


def test_registration_leak_losses_of_the_faces_and_flanks_are_the_photograph_s_too():
    facts = {"dmd": {"leak": 0.01, "offset_x_px": 0.3, "offset_y_px": -0.2, "rotation_deg": 0.4, "scale": 1.02}}
    bandpass = {"lower_nm": 455.0, "upper_nm": 555.0, "edge_nm": 8.0}
    camera = CameraConfig(**facts, bandpass=bandpass, relay={"diffraction": False}, sensor={"prnu": 0.0})
    cube, masks = inputs()
    binary = (masks < 0.5).astype(np.uint8)
    photo = photograph(make_cube(cube.astype(np.float32), FINE), BANDS, camera, Mono(), binary, Exposure(time_s=1.0))["frames"].values
    frames = np.array(DifferentiableMeasurement(camera, Mono(), FINE, (4, 5), 2, photo.shape[-1]).frames(cube, binary.astype(float)))
    assert np.abs(frames - photo).max() < 1e-6 * photo.max()  # positions to 1e-7 px and transmission to 1e-7, by polynomials


def test_it_agrees_with_the_dense_band_model_as_far_as_bands_are_laid_in_pieces():
    """H knows no smile and no magnification other than 1, hence 1e-3."""
    masks = np.ones((1, 1, 3), np.uint8)
    model = physical_model(CAMERA, Mono(), BANDS, masks)
    fine = BANDS.subdivide(40)
    cube = np.repeat(np.repeat(np.random.default_rng(0).random((1, 3, 3)), 40, axis=2), 4, axis=0).repeat(4, axis=1)
    frames = np.array(DifferentiableMeasurement(CAMERA, Mono(), fine, (1, 3), 4, model.width).frames(cube, masks.astype(float)))
    expected = model.operator(np.float64).forward(cube[::4, ::4, ::40])
    assert np.abs(frames - expected).max() < 2e-3 * expected.max()


@pytest.mark.parametrize("field", [True, False])
def test_positions_and_losses_are_those_of_the_camera_s_optics(field):
    dmd = {"offset_x_px": 1.3, "offset_y_px": -0.4, "rotation_deg": 0.7, "scale": 1.01}
    camera = CameraConfig(prism={"glasses": ["N-SK2", "air", "F2"], "face_tilt_deg": [4.0, -9.0, -8.0, 6.0], "field": field}, dmd=dmd)
    optics = DifferentiableOptics.of(camera)
    wavelength, X, Y = np.linspace(455, 660, 7), np.linspace(-2, 1.5, 7), np.linspace(1, -3, 7)
    for found, exact in zip(optics.position_px(optics.values, wavelength, X, Y), camera.optics.position_px(wavelength, X, Y)):
        assert np.abs(found * 1.0 - exact).max() < 1e-10
    share = optics.transmitted(NUMPY, optics.values, wavelength, X, Y)
    assert np.abs(share - camera.optics.transmission(wavelength, X, Y)).max() < 1e-14


def vector_snell(values, media, wavelength_nm, X, Y):
    """Trace by the vector form of Snell's law, unit directions, complex numbers allowed: shares nothing with the library."""
    c, s = np.cos(values.rotation_rad) * values.scale, np.sin(values.rotation_rad) * values.scale
    d = np.stack(np.broadcast_arrays(c * X - s * Y, s * X + c * Y, values.collimator_mm * np.ones_like(wavelength_nm))).astype(complex)
    d = d / np.sqrt((d * d).sum(0))
    before = np.ones_like(wavelength_nm, dtype=complex)
    l2 = (wavelength_nm / 1000) ** 2
    for t, glass, shift in zip(values.face_tilt_rad, [*media, None], [*values.index_shift, 0.0], strict=True):
        after = 1.0 + 0j
        if glass is not None:
            after = np.sqrt(1 + sum(b * l2 / (l2 - q) for b, q in zip(glass.sellmeier_b, glass.sellmeier_c_um2))) + shift
        normal = np.array([np.sin(t), 0, np.cos(t)])[:, None]
        mu, cosine = before / after, (d * normal).sum(0)
        d = mu * d + (np.sqrt(1 - mu**2 * (1 - cosine**2)) - mu * cosine) * normal
        before = after
    return values.focal_mm * d[0] / d[2], values.focal_mm * d[1] / d[2]


def test_derivatives_of_the_position_equal_complex_steps_of_an_independent_trace():
    k = kernels()
    optics = DifferentiableOptics.of(displaced(rotation_deg=0.7, scale=1.01))
    wavelength = np.linspace(455, 660, 7)
    X, Y = np.linspace(-2, 1.5, 7), np.linspace(1, -3, 7)
    leaves = optics.values.leaves()
    for i in range(len(leaves)):
        inputs_ = optics.inputs(k)
        k.dr.enable_grad(inputs_.leaves()[i])
        x, y, _ = optics.trace(k.ops, inputs_, *(k.backend.Float64(v) for v in (wavelength, X, Y)))
        k.dr.forward(inputs_.leaves()[i])
        found = np.array(k.dr.grad(x)), np.array(k.dr.grad(y))
        stepped = optics.values.with_leaves([leaf + 1e-30j * (i == j) for j, leaf in enumerate(leaves)])
        exact = [p.imag / 1e-30 * 1000 / optics.pixel_um for p in vector_snell(stepped, optics.media, wavelength, X, Y)]
        exact = [e + np.imag(shift) / 1e-30 for e, shift in zip(exact, (stepped.offset_x_px, stepped.offset_y_px))]
        for a, b in zip(found, exact):
            assert np.abs(a - b).max() < 1e-11 * max(1, np.abs(b).max())


@pytest.mark.parametrize("sensor", [Mono(), Foveon.sigma()], ids=lambda s: s.name)
def test_reverse_derivatives_of_frames_equal_finite_steps_for_every_number(sensor):
    measurement = DifferentiableMeasurement(displaced(rotation_deg=0.3), sensor, FINE, (4, 5), 2)
    cube, masks = inputs()
    k = kernels()
    norm = float((np.array(measurement.frames(cube, masks)) ** 2).sum())
    gradient = measurement.gradient(lambda frames: k.dr.sum(k.dr.square(frames)) / norm, cube, masks)
    assert abs(gradient.value - 1) < 1e-13
    base = measurement.optics.values
    size = [1e-10] * 4 + [1e-9] * 3 + [1e-5, 1e-5, 1e-6, 1e-6, 1e-8, 1e-8]  # steps of about 1e-6 px: few samples pass a border
    for i, (name, step) in enumerate(zip(base.names(), size)):
        value = []
        for sign in (1, -1):
            leaves = list(base.leaves())
            leaves[i] += sign * step
            frames = np.array(measurement.frames(cube, masks, measurement.optics.inputs(k, base.with_leaves(leaves))))
            value.append(float((frames**2).sum()) / norm)
        slope, found = (value[0] - value[1]) / (2 * step), gradient.optics.leaves()[i]
        assert abs(slope - found) < 1e-4 * abs(slope) + 1e-5, name


def test_derivatives_by_mirrors_are_the_columns_of_a_linear_map():
    """Frames are linear in the masks: the gradient of <u, frames> is u photographed by each mirror alone."""
    measurement = DifferentiableMeasurement(displaced(), Mono(), FINE, (3, 4), 2)
    cube, masks = inputs((3, 4))
    k = kernels()
    u = np.random.default_rng(1).random((len(masks), *measurement.shape))
    tensor = k.backend.TensorXf64(u)
    found = measurement.gradient(lambda frames: k.dr.sum(frames * tensor), cube, masks).masks
    for place in np.ndindex(masks.shape):
        one = np.zeros_like(masks)
        one[place] = 1
        assert found[place] == pytest.approx(float((np.array(measurement.frames(cube, one)) * u).sum()), rel=1e-12)


def test_P16_derivatives_are_finite_and_those_of_lost_light_are_zero():
    """In a prism so steep that blue light is totally reflected, blue light has no derivative and red light has."""
    prism = {"outer": "N-BK7", "inner": "N-SF66", "apex_outer_deg": 60.0, "apex_inner_deg": 89.0}
    camera = CameraConfig(prism={**prism, "design_nm": 660.0, "design_position_px": 10.0, "fresnel": True})
    wavelength = np.linspace(452, 668, 60)
    _, _, valid = camera.dispersion.position_px(wavelength)
    assert 5 < valid.sum() < 55
    edges = np.linspace(452, 668, 61)
    measurement = DifferentiableMeasurement(camera, Mono(), Bands.from_edges(edges), (2, 2), 1, 300)
    k = kernels()
    for part, lit in ((valid, True), (~valid, False)):
        cube = np.broadcast_to(part * 1.0, (2, 2, 60)).copy()
        gradient = measurement.gradient(lambda frames: k.dr.sum(frames), cube, np.ones((1, 2, 2)))
        numbers = np.array([*gradient.optics.leaves(), *gradient.masks.ravel(), gradient.value])
        assert np.isfinite(numbers).all()
        assert np.any(gradient.masks > 0) == lit
        assert np.any(np.array(gradient.optics.leaves()) != 0) == lit


def test_a_new_value_of_any_number_compiles_nothing():
    k = kernels()
    measurement = DifferentiableMeasurement(displaced(), Mono(), FINE, (3, 4), 2)
    cube, masks = inputs((3, 4))

    def compiled(values):
        with k.dr.scoped_set_flag(k.dr.JitFlag.KernelHistory, True):
            k.dr.kernel_history_clear()
            measurement.gradient(lambda frames: k.dr.sum(k.dr.square(frames)), cube, masks, values)
            history = k.dr.kernel_history((k.dr.KernelType.JIT,))
        return sum(not entry["cache_hit"] for entry in history), len(history)

    compiled(None)
    kept = []
    for step in (1e-6, 2e-6, 3e-6, 4e-6):
        kept.append(np.ones(int(step * 1e6) * 13))  # memory lies elsewhere each time
        values = measurement.optics.values
        misses, launched = compiled(values.with_leaves([leaf * (1 + step) for leaf in values.leaves()]))
        assert misses == 0
        assert launched > 0


def test_frames_have_the_same_bits_every_time():
    measurement = DifferentiableMeasurement(displaced(), Foveon.sigma(), FINE, (4, 5), 2)
    cube, masks = inputs()
    assert np.array(measurement.frames(cube, masks)).tobytes() == np.array(measurement.frames(cube, masks)).tobytes()


def test_any_stack_with_air_gaps_and_fresnel_losses_serves():
    """Sent light = transmission x laid light, wavelength by wavelength; derivatives equal finite steps."""
    camera = CameraConfig(prism={"glasses": ["N-SK2", "air", "F2"], "face_tilt_deg": [4.0, -9.0, -8.0, 6.0]}, dmd={"offset_x_px": 20.0})
    measurement = DifferentiableMeasurement(camera, Mono(), FINE, (1, 1), 2, 60)
    k = kernels()
    cube = np.ones((2, 2, FINE.count))
    found = measurement.gradient(lambda frames: k.dr.sum(frames), cube, np.ones((1, 1, 1)))
    share = camera.dispersion.transmission(measurement.wavelength_nm)
    assert 0.7 < share.min() < share.max() < 0.9  # four faces to air
    assert found.value == pytest.approx(float((measurement.curves[0] * share).sum()), rel=1e-6)  # the field is 0.014 mm wide
    base = measurement.optics.values
    for i in range(4):
        value = [
            float(np.array(measurement.frames(cube, np.ones((1, 1, 1)), base.with_leaves(moved))).sum())
            for moved in ([leaf + sign * 1e-6 * (i == j) for j, leaf in enumerate(base.leaves())] for sign in (1, -1))
        ]
        slope = (value[0] - value[1]) / 2e-6
        assert found.optics.leaves()[i] == pytest.approx(slope, rel=1e-4, abs=1e-6 * found.value)


def test_leak_lets_part_of_the_light_past_closed_mirrors():
    cube, masks = inputs()
    plain, leaking = (DifferentiableMeasurement(displaced(leak=leak), Mono(), FINE, (4, 5), 2) for leak in (0.0, 0.01))
    everything = np.array(plain.frames(cube, np.ones_like(masks)))
    expected = 0.01 * everything + 0.99 * np.array(plain.frames(cube, masks))
    assert np.allclose(np.array(leaking.frames(cube, masks)), expected, rtol=1e-12, atol=0)


def test_cameras_without_a_traced_prism_and_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"camera\.table"):
        DifferentiableOptics.of(CameraConfig(table={}))
    with pytest.raises(InputError, match="converging"):
        DifferentiableOptics.of(CameraConfig(relay={"converging": True}))
    measurement = DifferentiableMeasurement(CAMERA, Mono(), FINE, (4, 5), 2)
    cube, masks = inputs()
    with pytest.raises(InputError, match="cube"):
        measurement.frames(cube[1:], masks)
    with pytest.raises(InputError, match="masks"):
        measurement.frames(cube, masks[:, 1:])
    assert measurement.left_out == ()
    assert DifferentiableMeasurement(CameraConfig(), Mono(), FINE, (4, 5), 2).left_out == ("relay.diffraction", "sensor.prnu")
    with pytest.raises(InputError, match="sensor"):
        DifferentiableMeasurement(CAMERA, Quattro.physical(), FINE, (4, 5), 2)
