"""The exposure chain against Poisson and normal statistics, the photon transfer curve and its own seeds."""

import numpy as np
import pytest
from scipy import stats

from optsim.camera import Mono, measure_matched, noise_variance
from optsim.camera.noise import Noise, expose
from optsim.cube import Bands, make_cube
from optsim.errors import InputError

QUIET = {"read_noise_e": 0.0}


def shoot(mean, noise, *, seed=0, full_well_e=1e12, exposure_s=0.0):
    return expose(np.asarray(mean, float), noise, full_well_e=full_well_e, exposure_s=exposure_s, seed=seed)


def flat(value, n=200_000):
    return np.full((1, 1, 1, n), float(value))


def test_N1_no_light_gives_exactly_no_electrons():
    assert (shoot(flat(0), Noise(**QUIET, gain_dn_per_e=1.0)).dn == 0).all()


def test_N2_a_mean_of_1e_12_in_a_million_pixels_gives_no_electron():
    count = shoot(flat(1e-12, 1_000_000), Noise(**QUIET, gain_dn_per_e=1.0)).dn.sum()
    assert stats.poisson.sf(count - 1, 1e-6) > 1e-3


@pytest.mark.parametrize(("mean", "gain"), [(0.3, 1.0), (5.0, 1.0), (9.9, 1.0), (10.1, 1.0), (1e3, 1.0), (1e10, 6e-6)])
def test_N3_N9_variance_is_the_mean_at_every_level_and_across_the_generators_own_switch(mean, gain):
    n = 200_000
    dn = shoot(flat(mean, n), Noise(**QUIET, bits=16, gain_dn_per_e=gain)).dn
    variance = dn.var(ddof=1) - (0 if gain == 1 else 1 / 12)  # Sheppard's correction where the step matters
    ratio = variance / gain**2 / mean
    assert abs(ratio - 1) < 4 * np.sqrt((2 + 1 / mean) / n) * dn.var() / variance
    assert abs(dn.mean() / gain - mean) < 4 * np.sqrt(dn.var() / n) / gain


@pytest.mark.parametrize("mean", [9.9, 10.1, 40.0])
def test_N9_counts_follow_the_poisson_law(mean):
    dn = shoot(flat(mean), Noise(**QUIET, bits=16, gain_dn_per_e=1.0)).dn.ravel()
    edges = stats.poisson.ppf(np.linspace(0.05, 0.95, 10), mean)
    edges = np.unique(edges)
    counts = np.bincount(np.searchsorted(edges, dn), minlength=edges.size + 1)
    shares = np.diff([0, *stats.poisson.cdf(edges, mean), 1])
    assert stats.chisquare(counts, shares * dn.size).pvalue > 1e-3


def test_N4_means_that_cannot_be_drawn_are_refused_with_the_largest_time():
    with pytest.raises(InputError, match=r"exposure_s.* at most") as caught:
        shoot(flat(1e19, 3), Noise(**QUIET), exposure_s=2.0)
    assert caught.value.field == "exposure_s"
    for bad in (-1e-9, np.nan, np.inf):
        with pytest.raises(InputError, match="radiance"):
            shoot([[[[1.0, bad]]]], Noise(**QUIET))


def test_N5_without_noise_the_chain_is_round_clip_gain_offset_to_the_bit():
    mean = np.random.default_rng(0).uniform(0, 30_000, (2, 3, 8, 9))
    chain = Noise(**QUIET, shot_noise=False, bits=10, offset_dn=12.5, gain_dn_per_e=0.0371)
    got = shoot(mean, chain, full_well_e=20_000).dn
    np.testing.assert_array_equal(got, np.rint(np.clip(0.0371 * np.minimum(mean, 20_000) + 12.5, 0, 1023)))


def test_N6_photon_transfer_has_slope_gain_and_intercept_read_noise_and_quantisation():
    gain, sigma = 0.25, 3.1
    chain = Noise(read_noise_e=sigma, bits=16, offset_dn=100.0, gain_dn_per_e=gain)
    levels = np.linspace(20, 4000, 12)
    signal, variance = [], []
    for i, level in enumerate(levels):
        dn = shoot(flat(level, 100_000), chain, seed=i).dn
        signal.append(dn.mean() - 100)
        variance.append(dn.var(ddof=1))
    weight = 1 / np.array(variance)
    fit, covariance = np.polyfit(signal, variance, 1, w=weight * np.sqrt(100_000 / 2), cov="unscaled")
    assert abs(fit[0] - gain) < 3.5 * np.sqrt(covariance[0, 0])
    assert abs(fit[1] - (gain**2 * sigma**2 + 1 / 12)) < 3.5 * np.sqrt(covariance[1, 1])


@pytest.mark.parametrize("mean", [0.05, 0.25, 0.49, 2.0])
def test_N7_the_quantisers_mean_without_read_noise_is_the_closed_form_with_half_to_even(mean):
    gain = 0.5  # whole and half numbers: rounding half to even decides
    dn = shoot(flat(mean), Noise(**QUIET, bits=8, gain_dn_per_e=gain)).dn
    k = np.arange(60)
    law = stats.poisson.pmf(k, mean)
    expected = law @ np.rint(gain * k)
    error = np.sqrt(law @ np.rint(gain * k) ** 2 - expected**2) / np.sqrt(dn.size)
    assert abs(dn.mean() - expected) < 4 * error


def test_N8_huge_read_noise_is_clipped_in_the_shares_of_the_normal_law():
    sigma = 1e6
    chain = Noise(read_noise_e=sigma, bits=12, gain_dn_per_e=1e-3)
    dn = shoot(flat(1e6), chain).dn
    for got, share in ((np.mean(dn == 0), stats.norm.cdf(0.5e3, 1e6, sigma)), (np.mean(dn == 4095), stats.norm.sf(4094.5e3, 1e6, sigma))):
        assert abs(got - share) < 4 * np.sqrt(share * (1 - share) / dn.size)


def test_N10_a_frames_noise_depends_on_its_own_place_only():
    mean = np.random.default_rng(1).uniform(0, 500, (4, 3, 6, 7))
    whole = shoot(mean, Noise(gain_dn_per_e=1.0, bits=16), seed=3).dn
    assert whole.tobytes() == shoot(mean, Noise(gain_dn_per_e=1.0, bits=16), seed=3).dn.tobytes()
    assert whole[:2].tobytes() == shoot(mean[:2], Noise(gain_dn_per_e=1.0, bits=16), seed=3).dn.tobytes()
    assert whole[:, :1].tobytes() == shoot(mean[:, :1], Noise(gain_dn_per_e=1.0, bits=16), seed=3).dn.tobytes()


def test_N11_seeds_shots_and_channels_have_independent_noise():
    n = 40_000
    mean = np.full((2, 2, 1, n), 100.0)
    chain = Noise(gain_dn_per_e=1.0, bits=16)
    draws = np.concatenate([shoot(mean, chain, seed=s).dn.reshape(4, n) for s in (0, 1)])
    correlation = np.corrcoef(draws) - np.eye(8)
    assert np.abs(correlation).max() < 4 / np.sqrt(n)


def test_N12_dark_current_that_fills_the_well_saturates_with_a_warning():
    chain = Noise(dark_e_per_s=1.0, bits=8)
    with pytest.warns(UserWarning, match="dark current alone fills the well"):
        exposed = shoot(flat(0, 50), chain, full_well_e=20_000, exposure_s=1e6)
    assert exposed.saturated == 50
    assert exposed.dn.mean() > 254


@pytest.mark.parametrize("bits", [1, 8, 12, 16])
def test_S4_saturation_is_2_to_the_bits_minus_1_counted_and_never_wraps(bits):
    exposed = shoot(flat(70_000, 10), Noise(**QUIET, shot_noise=False, bits=bits, gain_dn_per_e=1.0))
    assert (exposed.dn == 2**bits - 1).all()
    assert exposed.saturated == 10


@pytest.mark.parametrize("bits", [0, 17, 32])
def test_S5_converters_have_1_to_16_bits(bits):
    with pytest.raises(InputError, match=r"noise\.bits"):
        Noise(bits=bits)


def test_S6_gain_0_and_full_well_0_are_refused():
    with pytest.raises(InputError, match="gain_dn_per_e"):
        Noise(gain_dn_per_e=0.0)
    with pytest.raises(InputError, match="full_well_e"):
        shoot(flat(1, 2), Noise(), full_well_e=0.0)
    with pytest.raises(InputError, match="offset_dn"):
        shoot(flat(1, 2), Noise(bits=8, offset_dn=255.0))


def test_S6_exposure_0_is_a_dark_frame():
    exposed = shoot(flat(0, 1000), Noise(read_noise_e=0.0, dark_e_per_s=1e5, offset_dn=7.0, gain_dn_per_e=1.0), exposure_s=0.0)
    assert (exposed.dn == 7).all()
    assert exposed.dark_dn == 7


def test_the_dark_level_is_offset_plus_dark_current():
    exposed = shoot(flat(0), Noise(read_noise_e=2.0, dark_e_per_s=50.0, offset_dn=20.0, gain_dn_per_e=0.8, bits=12), exposure_s=2.0)
    assert exposed.dark_dn == pytest.approx(20 + 0.8 * 100)
    assert abs(exposed.dn.mean() - exposed.dark_dn) < 4 * 0.8 * np.sqrt(104) / np.sqrt(200_000)


def test_without_a_gain_the_full_well_reaches_the_largest_number():
    chain = Noise(**QUIET, shot_noise=False, bits=12, offset_dn=95.0)
    assert shoot(flat(20_000, 2), chain, full_well_e=20_000).dn.tolist() == [[[[4095, 4095]]]]
    assert shoot(flat(0, 1), chain, full_well_e=20_000).dn.tolist() == [[[[95]]]]


def test_the_full_well_limits_the_charge():
    exposed = shoot(flat(1e5, 20), Noise(**QUIET, shot_noise=False, bits=16, gain_dn_per_e=1.0), full_well_e=3000)
    assert (exposed.dn == 3000).all()
    assert exposed.saturated == 20


@pytest.mark.parametrize("well", [300, 20_000])
def test_the_variance_that_frames_tell_is_that_of_repeated_exposures(well):
    masks = np.indices((1, 12, 16)).sum(0) % 2
    bands = Bands.paper()
    cube = make_cube(np.random.Generator(np.random.Philox(3)).random((12, 16, bands.count)), bands)
    noise = Noise(read_noise_e=10.0)

    def taken(seed):
        return measure_matched(cube, Mono(), masks, masks_name="distinct", seed=seed, noise=noise, full_well_e=well)

    shots = np.stack([taken(seed)["frames"].values for seed in range(300)])
    told = np.mean([noise_variance(taken(seed)) for seed in range(10)], axis=0)
    assert told.mean() / shots.var(axis=0, ddof=1).mean() == pytest.approx(1, abs=0.03)
    bright = shots.mean(axis=0) > np.quantile(shots.mean(axis=0), 0.9)
    assert told[bright].mean() / shots.var(axis=0, ddof=1)[bright].mean() == pytest.approx(1, abs=0.05)


def test_frames_without_noise_tell_none():
    bands = Bands.paper()
    cube = make_cube(np.ones((8, 8, bands.count)), bands)
    assert noise_variance(measure_matched(cube, Mono(), np.ones((1, 8, 8)), masks_name="distinct", seed=0)) is None
