"""Fixed patterns, and the whole exposure chain as the EMVA 1288 standard's own package measures it."""

import numpy as np
import pytest

from optsim.camera import fixed_pattern
from optsim.camera.noise import Noise, expose
from optsim.camera.optics_config import SensorConfig
from optsim.errors import InputError

SHAPE = (3, 200, 150)


def test_without_a_deviation_all_pixels_are_alike_to_the_bit():
    gain, offset = fixed_pattern(SHAPE, SensorConfig(prnu=0.0))
    assert gain.shape == SHAPE[1:]
    assert offset.shape == SHAPE
    assert (gain == 1).all()
    assert (offset == 0).all()


def test_the_patterns_deviations_are_those_asked_for_and_belong_to_the_seed():
    config = SensorConfig(prnu=0.02, dsnu_e=3.0, pattern_seed=5)
    gain, offset = fixed_pattern(SHAPE, config)
    n = gain.size
    assert abs(gain.mean() - 1) < 4 * 0.02 / np.sqrt(n)
    assert abs(gain.std() / 0.02 - 1) < 4 / np.sqrt(2 * n)
    assert abs(offset.mean()) < 4 * 3 / np.sqrt(3 * n)
    assert abs(offset.std() / 3 - 1) < 4 / np.sqrt(6 * n)
    assert np.abs(np.corrcoef([gain.ravel(), *offset.reshape(3, -1)]) - np.eye(4)).max() < 4.5 / np.sqrt(n)
    again = fixed_pattern(SHAPE, config)
    assert again[0].tobytes() == gain.tobytes()
    assert again[1].tobytes() == offset.tobytes()
    assert (fixed_pattern(SHAPE, SensorConfig(prnu=0.02, pattern_seed=6))[0] != gain).any()


def test_no_pixel_answers_light_with_less_than_nothing():
    assert fixed_pattern((1, 200, 200), SensorConfig(prnu=0.5))[0].min() == 0


def test_shapes_without_pixels_are_refused():
    with pytest.raises(InputError, match="shape"):
        fixed_pattern((1, 0, 4), SensorConfig())


def test_a_pixels_own_offset_is_added_in_electrons_after_the_well():
    quiet = Noise(read_noise_e=0.0, shot_noise=False, gain_dn_per_e=0.5, offset_dn=10.0, bits=16)
    offset = np.array([[[2.0, -4.0, 6.0]]])
    exposed = expose(np.array([[[[100.0, 100.0, 900.0]]]]), quiet, full_well_e=500, exposure_s=0.0, seed=0, offset_e=offset)
    assert exposed.dn.tolist() == [[[[61, 58, 263]]]]
    assert exposed.saturated == 1
    with pytest.raises(InputError, match="offset_e"):
        expose(np.zeros((1, 1, 1, 3)), quiet, full_well_e=500, exposure_s=0.0, seed=0, offset_e=offset * np.nan)


def test_pixels_that_a_layer_lacks_read_the_dark_level_without_noise():
    sites = np.zeros((1, 4, 6), bool)
    sites[:, ::2, ::2] = True
    noise = Noise(read_noise_e=5.0, dark_e_per_s=7.0, offset_dn=20.0, gain_dn_per_e=0.1, bits=12)
    exposed = expose(np.full((2, 1, 4, 6), 1e5), noise, full_well_e=30_000, exposure_s=1.0, seed=1, sites=sites)
    assert (exposed.dn[:, ~sites] == exposed.dark_dn).all()
    assert exposed.dark_dn == pytest.approx(20.7)
    assert exposed.saturated == 2 * sites.sum()
    whole = expose(np.full((2, 1, 4, 6), 1e5), noise, full_well_e=30_000, exposure_s=1.0, seed=1)
    np.testing.assert_array_equal(exposed.dn[:, sites], whole.dn[:, sites])


@pytest.mark.parametrize(
    ("field", "wrong"),
    [
        ("seed", {"seed": -1}),
        ("seed", {"seed": 1.5}),
        ("offset_e", {"offset_e": np.ones((2, 2))}),
        ("sites", {"sites": np.ones((3, 4, 6), bool)}),
        ("exposure_s", {"exposure_s": np.nan}),
    ],
)
def test_exposures_of_other_shapes_and_without_a_seed_are_refused_by_name(field, wrong):
    with pytest.raises(InputError, match=field):
        expose(np.ones((1, 1, 4, 6)), Noise(), **{"full_well_e": 1e4, "exposure_s": 1.0, "seed": 0, **wrong})


@pytest.fixture
def judge(monkeypatch):
    pytest.importorskip("emva1288")
    monkeypatch.setattr(np, "asfarray", lambda a: np.asarray(a, np.float64), raising=False)  # left NumPy 2; emva1288 1.0.2 calls it
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288
    from emva1288.process.routines import get_int_imgs

    def measure(shoot, photons, spatial_photons, repeats):
        """Feed the judge with images of a shoot(photons, seed) function, one exposure time."""

        def temporal(images):
            sums = get_int_imgs(images)
            return {"sum": sums["sum"].sum(), "pvar": sums["pvar"].sum(), "dmean": sums["dmean"]}

        seeds = iter(range(10**6))
        pairs = {float(p): temporal([shoot(p, next(seeds)) for _ in range(2)]) for p in photons}
        stacks = {float(p): get_int_imgs([shoot(p, next(seeds)) for _ in range(repeats)]) for p in (0.0, spatial_photons)}
        height, width = shoot(0.0, 0).shape
        data = {"width": width, "height": height, "temporal": {1.0: pairs}, "spatial": {1.0: stacks}}
        return Results1288(Data1288(data).data)

    return measure


def test_N6_emva1288_finds_gain_efficiency_dark_noise_full_well_prnu_and_dsnu(judge):
    efficiency, gain, read, prnu, dsnu, dark, well = 0.62, 0.08, 12.0, 0.012, 9.0, 40.0, 45_000.0
    chain = Noise(read_noise_e=read, dark_e_per_s=dark, bits=12, offset_dn=60.0, gain_dn_per_e=gain)
    response, offset = fixed_pattern((1, 160, 160), SensorConfig(prnu=prnu, dsnu_e=dsnu, pattern_seed=2))

    def shoot(photons, seed):
        mean = (efficiency * photons * response)[None, None]
        return expose(mean, chain, full_well_e=well, exposure_s=1.0, seed=seed, offset_e=offset).dn[0, 0].astype(np.int64)

    found = judge(shoot, np.linspace(0, 80_000, 26), 30_000.0, 24)
    n = response.size
    assert pytest.approx(gain, rel=0.01) == found.K
    assert pytest.approx(100 * efficiency, rel=0.01) == found.QE
    assert found.sigma_d == pytest.approx(np.hypot(read, np.sqrt(dark)), rel=4 / np.sqrt(n))
    assert found.u_e_sat == pytest.approx(min(well, (4095 - 60) / gain), rel=0.06)
    assert pytest.approx(dsnu, rel=0.02) == found.DSNU1288
    assert pytest.approx(100 * prnu, rel=0.03) == found.PRNU1288
    assert max(abs(found.LE_min), abs(found.LE_max)) < 0.1  # per cent
