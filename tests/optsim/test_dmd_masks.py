"""Masks: the rule that lets sensors be compared under the same codes."""

import numpy as np
import pytest

from optsim.camera import Bernoulli, Distinct, Mono, Repeated, masks_for, matched_model, sensors
from optsim.camera.dmd import check_masks
from optsim.cube import Bands
from optsim.errors import InputError

MONO, BAYER, FOVEON = sensors()
SIZE = (17, 23)


def test_colour_shot_i_and_the_first_mask_of_mono_group_i_share_one_mask():
    for seed in (0, 1, 2**63 - 1):
        distinct = masks_for(MONO, 12, Distinct(), SIZE, seed)
        repeated = masks_for(MONO, 12, Repeated(), SIZE, seed)
        bayer, foveon = (masks_for(s, 4, Distinct(), SIZE, seed) for s in (BAYER, FOVEON))
        np.testing.assert_array_equal(bayer, foveon)
        np.testing.assert_array_equal(distinct[::3], bayer)
        for member in range(3):
            np.testing.assert_array_equal(repeated[member::3], bayer)


def test_all_distinct_masks_differ_and_are_uncorrelated():
    masks = masks_for(MONO, 12, Distinct(), (128, 128), 5).reshape(12, -1).astype(float)
    correlation = np.corrcoef(masks) - np.eye(12)
    assert np.abs(correlation).max() < 5 / 128


def test_a_longer_series_begins_with_the_shorter_one():
    np.testing.assert_array_equal(masks_for(MONO, 9, Distinct(), SIZE, 3)[:4], masks_for(MONO, 4, Distinct(), SIZE, 3))


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_masks():
    first, again, other = (masks_for(FOVEON, 2, Distinct(), SIZE, seed) for seed in (7, 7, 8))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    assert first.dtype == np.uint8


@pytest.mark.parametrize("p", [0.0, 1.0, 0.5, 0.1])
def test_D5_the_open_fraction_is_p_within_four_standard_errors(p):
    open_share = masks_for(BAYER, 4, Distinct(), (100, 100), 11, Bernoulli(p)).mean()
    assert abs(open_share - p) <= 4 * np.sqrt(p * (1 - p) / 40_000)


def test_repeated_masks_need_whole_groups_of_three():
    for shots in (1, 2, 4, 7):
        with pytest.raises(InputError, match="divisible by 3") as caught:
            masks_for(MONO, shots, Repeated(), SIZE, 0)
        assert caught.value.field == "--shots"
    with pytest.raises(InputError, match="distinct for a colour sensor") as caught:
        masks_for(BAYER, 3, Repeated(), SIZE, 0)
    assert caught.value.field == "--masks"


@pytest.mark.parametrize("shots", [0, -1, 33, 1.5])
def test_the_number_of_shots_is_an_integer_from_1_to_32(shots):
    with pytest.raises(InputError, match="--shots"):
        masks_for(MONO, shots, Distinct(), SIZE, 0)


@pytest.mark.parametrize("seed", [-1, 2**63, 0.5])
def test_the_seed_is_an_integer_from_0_to_2_63(seed):
    with pytest.raises(InputError, match="--seed"):
        masks_for(MONO, 1, Distinct(), SIZE, seed)


@pytest.mark.parametrize("size", [(0, 4), (4, 0), (4,), (1, 40_000)])
def test_D8_sizes_without_mirrors_are_refused(size):
    with pytest.raises(InputError, match="--size"):
        masks_for(MONO, 1, Distinct(), size, 0)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1)])
def test_D8_one_mirror_and_one_line_are_valid(size):
    assert masks_for(Mono(), 2, Distinct(), size, 0).shape == (2, *size)


@pytest.mark.parametrize("value", [0.5, -1.0, np.nan, np.inf, 2.0])
def test_D6_mask_values_other_than_0_and_1_are_refused_with_their_place(value):
    masks = np.ones((2, 3, 4))
    masks[1, 2, 0] = value
    with pytest.raises(InputError, match=r"\(1, 2, 0\)"):
        check_masks(masks)


def test_probabilities_outside_0_to_1_are_refused():
    with pytest.raises(InputError, match=r"masks\.p"):
        masks_for(MONO, 1, Distinct(), SIZE, 0, Bernoulli(1.1))


def test_D10_repeated_masks_add_light_but_no_rank():
    bands = Bands.from_edges([460, 500, 560, 610])
    ranks = []
    for rule, shots in ((Distinct(), 1), (Repeated(), 3), (Distinct(), 3)):
        operator = matched_model(MONO, bands, masks_for(MONO, shots, rule, (5, 6), 1)).operator(np.float64)
        ranks.append(np.linalg.matrix_rank(operator.dense()))
        assert operator.repeated_shots() == (2 if isinstance(rule, Repeated) else 0)
    assert ranks[0] == ranks[1] < ranks[2]
