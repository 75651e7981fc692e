"""The prism against closed forms, invariants, a vector Snell law and complex-step derivatives."""

import math

import numpy as np
import pytest

from optsim.camera import CenterTable, DoubleAmici, glass, glass_names
from optsim.camera.arrays import NUMPY, kernels
from optsim.camera.prism import direct_view_apex
from optsim.camera.trace import trace_faces
from optsim.errors import InputError

PAPER_NM = (
    455, 460, 465, 470, 476, 482, 488, 494, 500, 506, 512, 519, 527, 536, 545, 555, 565, 576, 587, 599, 612, 626, 643, 660,
)  # fmt: skip
BAND = np.linspace(450, 670, 23)


def tilts(*angles):
    return [(math.sin(t), math.cos(t)) for t in angles]


def amici(a1, a2, outer="N-FK5", inner="F5", **more):
    return DoubleAmici(outer=glass(outer), inner=glass(inner), apex_outer_rad=a1, apex_inner_rad=a2, **more)


def snell_3d(k, faces, indices):
    """Refract one unit vector by the textbook vector law, plane by plane, in three dimensions."""
    before = 1.0
    for tilt, after in zip(faces, indices):
        normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
        cosine = k @ normal
        tangent = (k - cosine * normal) * before / after
        k = tangent + np.sqrt(1 - tangent @ tangent) * normal
        before = after
    return k


def random_stack(rng):
    names = [str(n) for n in rng.choice(glass_names(), 3)]
    return rng.uniform(-0.25, 0.25, 4), [*names, None]


# --- direct view -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pair", [("N-FK5", "F5"), ("N-BK7", "F2"), ("N-SK2", "N-SF4"), ("N-BK7", "N-SF66"), ("F2", "N-BK7")])
@pytest.mark.parametrize("apex_deg", [0.0, 1e-6, 3.0, 13.1019, -13.1019, 40.0])
@pytest.mark.parametrize("design_nm", [480.0, 550.0, 640.0])
def test_P10_double_amici_leaves_the_design_wavelength_undeviated(pair, apex_deg, design_nm):
    outer, inner = map(glass, pair)
    a2 = math.radians(apex_deg)
    prism = amici(direct_view_apex(outer, inner, a2, design_nm), a2, *pair)
    traced = prism.directions(NUMPY, np.float64(design_nm), 0.0, 0.0, prism.values)
    assert traced.valid
    assert abs(math.atan2(traced.kx, traced.kz)) < 1e-12


def test_P10_the_lay_out_is_antisymmetric():
    prism = DoubleAmici.default()
    mirrored = prism.model_copy(update={"apex_outer_rad": -prism.apex_outer_rad, "apex_inner_rad": -prism.apex_inner_rad})
    X = np.linspace(-5, 5, 11)[:, None]
    x, y, _ = prism.trace(NUMPY, BAND, X, 2.0, prism.values)
    back_x, back_y, _ = mirrored.trace(NUMPY, BAND, -X, 2.0, mirrored.values)
    np.testing.assert_allclose(back_x, -x, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(back_y, y)


def test_a_middle_wedge_too_steep_for_direct_view_is_refused():
    with pytest.raises(InputError, match=r"prism.apex_inner_rad"):
        direct_view_apex(glass("N-BK7"), glass("N-SF66"), 1.9, 550.0)


# --- closed forms of simple stacks -----------------------------------------------------------------------------


def test_P4_without_apex_all_wavelengths_land_on_one_pixel():
    prism = amici(0.0, 0.0)
    x, y, valid = prism.position_px(BAND, 1.3, -0.7)
    scale = 100 / 138.2 / 0.0099
    assert valid.all()
    np.testing.assert_allclose(x, 1.3 * scale, rtol=1e-13)
    np.testing.assert_allclose(y, -0.7 * scale, rtol=1e-13)


@pytest.mark.parametrize("apex", [0.01, 0.3, 1.0, 1.1])
def test_P7_minimum_deviation_of_one_wedge_is_two_asin_n_sin_half_apex_minus_apex(apex):
    n = float(glass("N-BK7").index(550.0))
    expected = 2 * math.asin(n * math.sin(apex / 2)) - apex
    incidence = (expected + apex) / 2 - apex / 2  # the entering ray's angle against the axis of the symmetric wedge
    traced = trace_faces(NUMPY, -math.sin(incidence), math.cos(incidence), 1.0, tilts(apex / 2, -apex / 2), (n * n - 1, 0.0))
    deviation = abs(math.atan2(traced.kx, traced.kz) + incidence)
    assert abs(deviation - expected) < 1e-12


def test_P8_thin_prism_error_falls_as_the_third_power_of_the_apex():
    n = 1.6
    apex = np.logspace(-4, -0.9, 8)
    error = []
    for a in apex:
        traced = trace_faces(NUMPY, 0.0, 1.0, 1.0, tilts(a / 2, -a / 2), (n * n - 1, 0.0))
        error.append(abs(abs(math.atan2(traced.kx, traced.kz)) - (n - 1) * a))
    seen = np.array(error) > 1e-14
    slope = np.polyfit(np.log(apex[seen]), np.log(np.array(error)[seen]), 1)[0]
    assert seen.sum() >= 5
    assert slope == pytest.approx(3, abs=0.1)


def test_P9_an_amici_of_one_glass_is_the_single_block_and_parallel_faces_do_not_disperse():
    inner_tilt = amici(0.2, 0.3, "N-BK7", "N-BK7")
    x, y, _ = inner_tilt.trace(NUMPY, BAND, 0.4, 0.2, inner_tilt.values)
    k = np.array([0.4, 0.2, 138.2])
    k /= np.linalg.norm(k)
    for i, wavelength in enumerate(BAND):
        n = float(glass("N-BK7").index(wavelength))
        out = snell_3d(k, (0.2 - 0.15, 0.15 - 0.2), (n, 1.0))
        assert x[i] == pytest.approx(100 * out[0] / out[2], abs=1e-12)
        assert y[i] == pytest.approx(100 * out[1] / out[2], abs=1e-12)
    parallel = amici(0.15, 0.3, "N-BK7", "N-BK7")
    x, _, _ = parallel.position_px(BAND, 0.4)
    assert np.ptp(x) < 1e-11


# --- invariants ------------------------------------------------------------------------------------------------


def test_k_y_is_conserved_and_the_trace_is_snells_law_in_three_dimensions():
    rng = np.random.default_rng(1)
    for _ in range(50):
        faces, names = random_stack(rng)
        indices = [1.0 if n is None else float(glass(n).index(550.0)) for n in names]
        k = np.array([*rng.uniform(-0.15, 0.15, 2), 1.0])
        k /= np.linalg.norm(k)
        traced = trace_faces(NUMPY, k[0], k[2], 1.0, tilts(*faces), [n * n - 1 for n in indices])
        out = snell_3d(k, faces, indices)
        assert out[1] == pytest.approx(k[1], abs=1e-15)
        assert traced.valid
        np.testing.assert_allclose([traced.kx, traced.kz], out[[0, 2]], atol=2e-15)
        assert traced.kx**2 + k[1] ** 2 + traced.kz**2 == pytest.approx(1, abs=1e-14)


def reversed_trace(k, kx, kz, norm2, faces, excess):
    """Send light back: mirrored in z, the stack comes in reverse order with opposite tilts."""
    return trace_faces(k, -kx, kz, norm2, tilts(*(-t for t in faces[::-1])), [*excess[:-1][::-1], 0.0])


def test_P11_light_sent_back_returns_to_its_start():
    rng = np.random.default_rng(2)
    for _ in range(50):
        faces, names = random_stack(rng)
        excess = [0.0 if n is None else float(glass(n).index(500.0)) ** 2 - 1 for n in names]
        kx, ky = rng.uniform(-0.2, 0.2, 2)
        kz = math.sqrt(1 - kx * kx - ky * ky)
        there = trace_faces(NUMPY, kx, kz, 1.0, tilts(*faces), excess)
        back = reversed_trace(NUMPY, there.kx, there.kz, 1.0, faces, excess)
        assert abs(back.kx + kx) < 1e-12
        assert abs(back.kz - kz) < 1e-12


def test_P11_light_sent_back_returns_to_its_start_in_float32():
    k = kernels_or_skip()
    faces, excess = (0.03, -0.11, 0.11, -0.03), [1.2, 1.6, 1.2, 0.0]
    Float = k.backend.Float
    kx = Float(np.linspace(-0.1, 0.1, 101, dtype=np.float32))
    kz = k.dr.sqrt(1 - kx * kx)
    there = trace_faces(k.ops, kx, kz, Float(1), tilts(*faces), excess)
    back = reversed_trace(k.ops, there.kx, there.kz, Float(1), faces, excess)
    assert np.abs(np.array(back.kx) + np.array(kx)).max() < 1e-6


# --- lost rays -------------------------------------------------------------------------------------------------


def test_P5_a_totally_reflected_wavelength_is_lost_without_nan():
    n = glass("N-SF66")
    prism = amici(
        0.37, 0.0, "N-SF66", "N-SF66", design_nm=670.0, design_position_px=0.0
    )  # one block whose faces stand +-0.37 rad: near critical in the blue
    x, y, valid = prism.position_px(np.linspace(450, 670, 221), 0.0, 0.1)
    assert not valid.all()
    assert valid.any()
    assert np.isfinite(x).all()
    assert np.isfinite(y).all()
    assert (x[~valid] == 0).all()
    wavelength = np.linspace(450, 670, 221)
    inside = np.arcsin(np.sin(0.37) / n.index(wavelength))
    transmitted = n.index(wavelength) * np.sin(2 * 0.37 - inside) < 1
    assert np.count_nonzero(valid != transmitted) <= 1  # the judge has no out-of-plane angle
    assert "total reflection" in prism.why_lost(450.0)
    assert prism.why_lost(670.0) is None


def test_P6_light_is_transmitted_and_lost_monotonically_around_the_critical_angle():
    n = 1.6
    critical = math.asin(1 / n)
    angles = [critical]
    for direction in (0.0, 1.0):
        a = critical
        for _ in range(16):
            a = math.nextafter(a, direction * 2)
            angles.append(a)
    angles = np.array(sorted([*angles, critical - 1e-8, critical + 1e-8]))
    traced = trace_faces(NUMPY, n * np.sin(angles), n * np.cos(angles), n * n, tilts(0.0), (1 / n**2 - 1,))
    assert np.isfinite(traced.kx).all()
    assert np.isfinite(traced.kz).all()
    assert traced.valid[0]
    assert not traced.valid[-1]
    assert (np.diff(traced.valid.astype(int)) <= 0).all()


@pytest.mark.parametrize(
    ("kx", "kz", "tilt"),
    [
        (1.0, 0.0, 0.0),
        (math.cos(0.3), math.sin(0.3), -0.3 - 1e-9),
        (0.0, 1.0, math.pi / 2 + 1e-12),
        (0.0, 1.0, math.radians(94)),
        (0.0, -1.0, 0.0),
    ],
    ids=["along the face", "grazing from behind", "face just beyond parallel to the axis", "turned beyond 90 deg", "backwards"],
)
def test_P12_a_ray_along_a_face_or_from_behind_it_is_lost_with_its_reason(kx, kz, tilt):
    traced = trace_faces(NUMPY, np.float64(kx), np.float64(kz), 1.0, tilts(tilt), (1.25,))
    assert not traced.valid
    assert np.isfinite([traced.kx, traced.kz]).all()
    if kz > 0 and tilt == math.radians(94):
        assert not traced.met


def test_P12_a_prism_says_why_a_ray_along_its_face_is_lost():
    prism = amici(math.radians(89), 0.0, "N-BK7", "N-BK7", design_position_px=0.0)
    assert "along a face" in prism.why_lost(550.0, X_mm=-1e5)


# --- precision and gradients -----------------------------------------------------------------------------------


def kernels_or_skip():
    k = kernels()
    if k is None:
        pytest.skip("no usable libLLVM on this machine")
    return k


def dr_positions(k, kind, prism, wavelength, X, Y):
    x, y, valid = prism.trace(k.ops, kind(wavelength), kind(X), kind(Y), prism.opaque_values(k, kind))
    return np.array(x) / 0.0099, np.array(y) / 0.0099, np.array(valid)


def test_P14_float32_moves_no_ray_by_a_thousandth_of_a_pixel():
    k = kernels_or_skip()
    prism = DoubleAmici.default()
    rng = np.random.default_rng(4)
    wavelength, X, Y = rng.uniform(450, 670, 20_000), *rng.uniform(-1.75, 1.75, (2, 20_000))
    single = dr_positions(k, k.backend.Float, prism, wavelength.astype(np.float32), X.astype(np.float32), Y.astype(np.float32))
    w, x, y = (v.astype(np.float32).astype(np.float64) for v in (wavelength, X, Y))
    double = dr_positions(k, k.backend.Float64, prism, w, x, y)
    host = prism.trace(NUMPY, w, x, y, prism.values)
    assert single[2].all()
    assert np.abs(single[0] - double[0]).max() < 1e-3
    assert np.abs(single[1] - double[1]).max() < 1e-3
    np.testing.assert_allclose(double[0], host[0] / 0.0099, rtol=0, atol=1e-11)


def complex_position(wavelength, X, Y, a1, a2, f1, f2):
    """Trace with complex numbers: written from the formulas, sharing no code; the imaginary part carries a derivative."""

    def excess(name, wavelength):
        g, l2 = glass(name), (wavelength / 1000) ** 2
        return sum(b * l2 / (l2 - c) for b, c in zip(g.sellmeier_b, g.sellmeier_c_um2))

    kx, kz, r2 = X + 0j, f1 + 0j, X * X + Y * Y + f1 * f1
    crown, flint = excess("N-FK5", wavelength), excess("F5", wavelength)
    before = 0.0
    for t, after in ((a1 - a2 / 2, crown), (-a2 / 2, flint), (a2 / 2, crown), (a2 / 2 - a1, 0.0)):
        s, c = np.sin(t), np.cos(t)
        along = kx * s + kz * c
        gain = np.sqrt((after - before) * r2 + along**2) - along
        kx, kz, before = kx + gain * s, kz + gain * c, after
    return f2 * kx / kz, f2 * Y / kz


@pytest.mark.parametrize("which", range(7), ids=["wavelength", "X", "Y", "apex_outer", "apex_inner", "collimator", "focal"])
def test_reverse_gradients_are_the_complex_step_derivatives(which):
    k = kernels_or_skip()
    dr, Float64 = k.dr, k.backend.Float64
    prism = DoubleAmici.default()
    rng = np.random.default_rng(5)
    inputs = [rng.uniform(450, 670, 50), rng.uniform(-5, 5, 50), rng.uniform(-5, 5, 50), *(np.full(50, v) for v in prism.values)]
    for output in range(2):
        arrays = [Float64(v) for v in inputs]
        dr.enable_grad(arrays[which])
        result = prism.trace(k.ops, *arrays[:3], type(prism.values)(*arrays[3:]))[output]
        dr.backward(dr.sum(result))
        step = [v + (1e-30j if i == which else 0) for i, v in enumerate(inputs)]
        expected = complex_position(*step)[output].imag / 1e-30
        np.testing.assert_allclose(np.array(dr.grad(arrays[which])), expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max() + 1e-16)


def test_P16_gradients_at_and_beyond_total_reflection_are_finite():
    k = kernels_or_skip()
    dr, Float64 = k.dr, k.backend.Float64
    n = 1.6
    angle = Float64(np.array([0.3, math.asin(1 / n) - 1e-9, math.asin(1 / n), math.asin(1 / n) + 1e-6, 1.2]))
    dr.enable_grad(angle)
    traced = trace_faces(k.ops, n * dr.sin(angle), n * dr.cos(angle), Float64(n * n), tilts(0.0), (1 / n**2 - 1,))
    dr.backward(dr.sum(k.ops.where(traced.valid, traced.kx + traced.kz, 0.0)))
    gradient = np.array(dr.grad(angle))
    assert np.isfinite(gradient).all()
    assert (gradient[3:] == 0).all()


def test_P16_a_prism_beyond_total_reflection_has_gradient_zero():
    k = kernels_or_skip()
    dr, Float64 = k.dr, k.backend.Float64
    prism = amici(0.56, 0.0, "N-SF66", "N-SF66", design_position_px=0.0)
    values = prism.opaque_values(k, Float64)
    dr.enable_grad(values.apex_outer_rad)
    x, _, valid = prism.trace(k.ops, Float64([450.0]), Float64([0.0]), Float64([0.0]), values)
    dr.backward(x)
    assert not np.array(valid).any()
    assert np.array(dr.grad(values.apex_outer_rad)).tolist() == [0.0]


# --- the table -------------------------------------------------------------------------------------------------


def test_the_table_places_every_paper_centre_on_its_own_pixel_and_stays_monotone():
    table = CenterTable()
    x, y, valid = table.position_px(PAPER_NM)
    np.testing.assert_array_equal(x, np.arange(24))
    assert valid.all()
    assert (y == 0).all()
    fine, _, _ = table.position_px(np.linspace(440, 680, 5000))
    assert (np.diff(fine) > 0).all()
    shifted, _, _ = table.position_px(555.0, 0.01368 * 7)
    assert shifted == pytest.approx(15 + 7 * 13.68 * 100 / 138.2 / 9.9, abs=1e-12)


@pytest.mark.parametrize("centers", [(500.0,), (500.0, 500.0), (600.0, 500.0), (-1.0, 500.0)])
def test_P15_a_table_that_does_not_increase_is_refused(centers):
    with pytest.raises(InputError, match=r"table\.centers_nm"):
        CenterTable(centers_nm=centers)
