"""Light budgets, the noise of unmixing colours, and the cone of light."""

import numpy as np
import pytest

from optsim.camera import Bayer, CameraConfig, Distinct, Foveon, Mono, Quattro, Repeated, SiliconLayers, sensors
from optsim.camera.absolute import AssumedEfficiencies
from optsim.camera.amplification import RED_GREEN_BLUE_NM, noise_amplification
from optsim.camera.budgets import EqualFill, EqualMasks, EqualPatterns, EqualScalars, EqualTime, PaperRatio, budgets, check_same_budget
from optsim.camera.radiometry import photon_integral, smallest_cone_sr
from optsim.errors import InputError
from scenes.library import illuminant
from scenes.spectrum import Spectrum

MONO, BAYER, FOVEON = sensors()
LAMP = Spectrum.constant(1.0, name="equal energy")


def plans(budget, groups=2, time_s=0.9):
    return [budget.plan(sensor, groups, time_s) for sensor in sensors()]


def test_the_six_budgets_are_A_to_F():
    assert [budget.name[0] for budget in budgets()] == list("ABCDEF")


def test_A_every_sensor_shows_the_same_masks_once_for_the_same_time():
    assert [(p.shots, p.exposure_s, p.patterns, p.scalars) for p in plans(EqualMasks())] == [(2, 0.9, 2, 2), (2, 0.9, 2, 2), (2, 0.9, 2, 6)]


def test_B_mono_takes_three_shots_and_three_times_the_light():
    mono, bayer, foveon = plans(PaperRatio())
    assert (mono.shots, bayer.shots, foveon.shots) == (6, 2, 2)
    assert mono.light_s == pytest.approx(3 * bayer.light_s)


def test_C_all_sensors_take_the_same_total_time_and_the_mirrors_changes_are_subtracted():
    mono, bayer, foveon = plans(EqualTime())
    assert mono.light_s == pytest.approx(bayer.light_s)
    assert foveon.light_s == bayer.light_s == pytest.approx(1.8)
    mono, bayer, _ = plans(EqualTime(switch_s=0.1))
    assert mono.light_s + 6 * 0.1 == pytest.approx(bayer.light_s + 2 * 0.1)
    assert mono.shots == 6
    with pytest.raises(InputError, match=r"switch_s.*below 0\.3 s"):
        EqualTime(switch_s=0.3).plan(MONO, 1, 0.9)


def test_D_every_sensor_fills_its_well_to_the_same_share():
    assert {(p.exposure_s, p.fill, p.light_s) for p in plans(EqualFill(fill=0.6))} == {(None, 0.6, None)}


def test_E_every_sensor_reads_the_same_number_of_scalars():
    everyone = [EqualScalars().plan(s, 2, 0.5) for s in (MONO, BAYER, FOVEON, Quattro.physical())]
    assert [p.scalars for p in everyone] == [6, 6, 6, 6]
    assert [p.shots for p in everyone] == [6, 6, 2, 4]


def test_F_the_mirrors_show_as_many_patterns_to_every_sensor():
    assert [(p.patterns, p.shots, type(p.rule)) for p in plans(EqualPatterns())] == [(2, 6, Repeated), (2, 2, Distinct), (2, 2, Distinct)]


def test_S9_three_mono_shots_and_one_colour_shot_have_the_papers_compression_ratio():
    mono, bayer, foveon = plans(PaperRatio(), groups=1)
    assert (mono.ratio_shots, bayer.ratio_shots, foveon.ratio_shots) == (3, 3, 3)
    assert PaperRatio().plan(MONO, 4, 1.0).ratio_shots == 12
    for budget in (PaperRatio(), EqualTime(), EqualFill(), EqualPatterns()):
        check_same_budget(plans(budget))


def test_S9_unequal_budgets_are_refused_unless_asked_for():
    for budget in (EqualMasks(), EqualScalars()):
        with pytest.raises(InputError, match=r"budget.*K : "):
            check_same_budget(plans(budget))
        check_same_budget(plans(budget), allow_unequal=True)
    with pytest.raises(InputError, match="A equal masks"):
        check_same_budget([EqualMasks().plan(BAYER, 1, 1.0), PaperRatio().plan(FOVEON, 1, 1.0)])


@pytest.mark.parametrize("budget", budgets(), ids=lambda b: b.name)
def test_groups_and_times_that_are_none_are_refused(budget):
    for groups in (0, -1, 1.5):
        with pytest.raises(InputError, match=r"budget\.groups"):
            budget.plan(BAYER, groups, 1.0)
    with pytest.raises(InputError, match=r"budget\.groups.* 32 shots"):
        budget.plan(MONO, 33, 1.0)


@pytest.mark.parametrize("sensor", [FOVEON, BAYER, Foveon.physical(SiliconLayers(front=None))], ids=["npl foveon", "nikon", "silicon"])
@pytest.mark.parametrize("read", [0.0, 30.0])
def test_the_noise_of_unmixed_colours_is_that_of_many_simulated_pixels(sensor, read):
    found = noise_amplification(sensor, illuminant("xenon"), 8000.0, read)
    mean = found.mixing.sum(1)
    assert mean.max() == pytest.approx(8000)
    rng = np.random.default_rng(0)
    draws = 40_000
    counts = rng.poisson(mean, (draws, 3)) + read * rng.standard_normal((draws, 3))
    weighted = found.mixing / np.sqrt(mean + read**2)[:, None]
    amounts = np.linalg.lstsq(weighted, (counts / np.sqrt(mean + read**2)).T, rcond=None)[0].T
    np.testing.assert_allclose(amounts.mean(0), 1, atol=5 * np.sqrt(found.variance / draws))
    assert amounts.var(0).sum() == pytest.approx(found.variance, rel=0.03)


def test_disjoint_curves_amplify_nothing_and_overlapping_ones_do():
    edges = [(449.0, 500.0), (500.001, 600.0), (600.001, 671.0)]
    names = ("blue", "green", "red")
    box = {
        name: Spectrum([400, low - 1e-3, low, high, high + 1e-3, 700], [0, 0, 0.4, 0.4, 0, 0]) for name, (low, high) in zip(names, edges)
    }
    colours = ((605.0, 670.0), (505.0, 595.0), (450.0, 495.0))
    assert noise_amplification(Foveon(**box), LAMP, 1e4, 5.0, colours).ratio == pytest.approx(1, abs=1e-9)
    ratios = [noise_amplification(s, LAMP, 1e4).ratio for s in (BAYER, FOVEON)]
    assert 1 < ratios[0] < ratios[1]


def test_a_shared_readout_of_two_alike_colours_amplifies_by_the_closed_form():
    """Two curves see both colours with shares 1-x and x: C^T S^-1 C has eigenvalues n and n (1-2x)^2."""
    x, n = 0.2, 5000.0
    lower, upper = (500.0, 550.0), (600.0, 650.0)
    low = Spectrum([499, 500, 550, 551, 599, 600, 650, 651], [0, 1 - x, 1 - x, 0, 0, x, x, 0])
    high = Spectrum([499, 500, 550, 551, 599, 600, 650, 651], [0, x, x, 0, 0, 1 - x, 1 - x, 0])
    dark = Spectrum([499, 651], [0, 0])
    flat_photons = Spectrum(np.linspace(499, 651, 2000), 1 / np.linspace(499, 651, 2000))  # equal photons in both colours
    found = noise_amplification(Foveon(red=high, green=dark, blue=low), flat_photons, n, 1e-3, (lower, upper))
    assert found.variance == pytest.approx(1 / n + 1 / n / (1 - 2 * x) ** 2, rel=1e-3)
    assert found.disjoint_variance == pytest.approx(2 / n, rel=1e-3)


def test_curves_that_cannot_tell_colours_apart_are_refused():
    grey = Spectrum.constant(0.5)
    with pytest.raises(InputError, match="tell the 3 colours apart"):
        noise_amplification(Foveon(red=grey, green=grey, blue=grey), LAMP, 1e3)
    with pytest.raises(InputError, match="tell the 3 colours apart"):
        noise_amplification(Mono(), LAMP, 1e3)
    for bad in (0.0, np.nan):
        with pytest.raises(InputError, match="brightest_e"):
            noise_amplification(FOVEON, LAMP, bad)
    assert [len(c) for c in RED_GREEN_BLUE_NM] == [2, 2, 2]


def test_electrons_through_a_filter_agree_with_quadrature():
    from scipy.integrate import quad

    curve, glass = Bayer.nikon().green, Spectrum([400, 505, 520, 700], [0.1, 0.1, 0.9, 0.7])
    nodes = sorted({*curve.wavelength_nm[(curve.wavelength_nm > 481) & (curve.wavelength_nm < 577)], 505.0, 520.0})
    both = quad(lambda x: curve.at(x) * glass.at(x) * x, 481, 577, points=nodes, epsabs=0, epsrel=1e-12)[0] / (
        6.62607015e-34 * 299792458.0 * 1e9
    )
    assert photon_integral(curve, np.array([481.0]), np.array([577.0]), glass)[0] == pytest.approx(both, rel=1e-11)


def test_the_cone_is_the_narrowest_of_objective_relay_and_mirrors():
    assert smallest_cone_sr(8.0) == pytest.approx(np.pi / 256)
    assert smallest_cone_sr(8.0, 11.0, 4.0) == pytest.approx(np.pi / 484)
    assert smallest_cone_sr(1.0) == pytest.approx(np.pi * np.sin(np.radians(12)) ** 2)
    camera = CameraConfig(relay={"f_number": 4.0}, objective={"f_number": 8.0})
    stopped = CameraConfig(relay={"f_number": 4.0}, objective={"f_number": 8.0, "focal_mm": 50.0})
    assert camera.throughput_m2_sr == pytest.approx(4 * stopped.throughput_m2_sr)


def test_assumed_efficiencies_are_the_curves_maxima_and_the_layers_largest_sum():
    mono, bayer, foveon = AssumedEfficiencies().sensors()
    assert mono.curve.maximum == pytest.approx(0.5)
    assert max(curve.maximum for curve in bayer.curves) == pytest.approx(0.5)
    assert foveon.response(np.linspace(400, 680, 281)).sum(0).max() == pytest.approx(0.6)
    swept = AssumedEfficiencies().swept(1.3).sensors()
    assert swept[0].curve.maximum == pytest.approx(0.5)
    assert swept[1].green.maximum == pytest.approx(0.65)


@pytest.mark.parametrize("factor", [np.nan, 0.0, -1.0, 1.7])
def test_efficiencies_are_not_swept_below_0_or_above_1(factor):
    with pytest.raises(InputError, match=r"factor.*\(0, 1\.66667\]"):
        AssumedEfficiencies().swept(factor)


@pytest.mark.parametrize("number", [np.nan, 0.0, -8.0, 0.4])
def test_a_cone_wider_than_a_hemisphere_is_refused(number):
    with pytest.raises(InputError, match="f_number"):
        smallest_cone_sr(8.0, number)


@pytest.mark.parametrize("colours", [(), [(600.0, 500.0)], [(np.nan, 500.0)]])
def test_colours_without_edges_in_order_are_refused(colours):
    with pytest.raises(InputError, match="colours_nm"):
        noise_amplification(FOVEON, LAMP, 1000.0, colours_nm=colours)
