"""Patterns that the mirrors show, and what real mirrors make of them."""

import zlib

import numpy as np
import pytest
from PIL import Image

from optsim.camera import (
    Bernoulli,
    BlueNoise,
    Complementary,
    Distinct,
    FromFile,
    Repeated,
    Stratified,
    defects,
    masks_for,
    mirror_states,
    sensors,
)
from optsim.camera.dmd import check_masks
from optsim.camera.optics_config import DmdConfig
from optsim.camera.patterns import patterns
from optsim.errors import InputError

MONO, BAYER, FOVEON = sensors()
SIZE = (64, 48)
PERFECT = {"leak": 0.0}


def ring(mask, low, high):
    """Return the mean power of a mask at spatial frequencies between two radii, over that of white noise."""
    power = np.abs(np.fft.fft2(mask - mask.mean())) ** 2 / mask.size / mask.var()
    radius = np.hypot(np.fft.fftfreq(mask.shape[0])[:, None], np.fft.fftfreq(mask.shape[1]))
    return power[(radius >= low) & (radius < high)].mean()


@pytest.mark.parametrize("pattern", patterns(), ids=lambda p: p.name)
def test_every_pattern_is_binary_repeatable_and_half_open(pattern):
    first, again = (masks_for(FOVEON, 4, Distinct(), SIZE, 3, pattern) for _ in range(2))
    assert first.tobytes() == again.tobytes()
    assert first.dtype == np.uint8
    assert set(np.unique(first)) == {0, 1}
    assert abs(first.mean() - 0.5) < 4 * 0.5 / np.sqrt(first.size)
    assert masks_for(FOVEON, 4, Distinct(), SIZE, 4, pattern).tobytes() != first.tobytes()


@pytest.mark.parametrize("pattern", [Bernoulli(0.3), BlueNoise(0.3)], ids=lambda p: p.name)
def test_patterns_of_one_stream_a_mask_are_shared_between_the_sensors(pattern):
    size = (16, 12)
    mono, repeated = (masks_for(MONO, 6, rule, size, 5, pattern) for rule in (Distinct(), Repeated()))
    colour = masks_for(BAYER, 2, Distinct(), size, 5, pattern)
    np.testing.assert_array_equal(mono[::3], colour)
    np.testing.assert_array_equal(repeated[::3], colour)


@pytest.mark.parametrize("pattern", [Bernoulli, Stratified, Complementary, BlueNoise], ids=lambda p: p.name)
def test_D5_probabilities_0_and_1_close_and_open_all_and_others_are_refused(pattern):
    size = (6, 7)
    assert not masks_for(FOVEON, 1, Distinct(), size, 0, pattern(0.0)).any()
    assert masks_for(FOVEON, 1, Distinct(), size, 0, pattern(1.0)).all()
    for bad in (-0.1, 1.1, np.nan):
        with pytest.raises(InputError, match=r"masks\.p"):
            pattern(bad)


@pytest.mark.parametrize(("p", "shots"), [(0.5, 4), (0.5, 3), (0.3, 7), (0.25, 1)])
def test_stratified_masks_open_every_mirror_equally_often(p, shots):
    masks = masks_for(FOVEON, shots, Distinct(), (80, 90), 1, Stratified(p))
    times = masks.sum(0, dtype=int)
    assert set(np.unique(times)) <= {int(np.floor(p * shots)), int(np.ceil(p * shots))}
    share = p * shots - np.floor(p * shots)
    assert abs(times.mean() - p * shots) <= 4 * np.sqrt(share * (1 - share) / times.size) + 1e-12
    for mask in masks:
        assert abs(mask.mean() - p) < 4 * np.sqrt(p * (1 - p) / mask.size)


def test_complementary_pairs_add_to_one():
    masks = masks_for(FOVEON, 5, Distinct(), SIZE, 2, Complementary(0.3))
    assert (masks[0] + masks[1] == 1).all()
    assert (masks[2] + masks[3] == 1).all()
    assert abs(masks[4].mean() - 0.3) < 0.05
    np.testing.assert_array_equal(masks[:4], masks_for(FOVEON, 4, Distinct(), SIZE, 2, Complementary(0.3)))


@pytest.mark.parametrize("p", [0.5, 0.1, 0.8])
def test_blue_noise_has_little_power_at_low_frequencies_and_exactly_its_share_open(p):
    masks = masks_for(FOVEON, 2, Distinct(), (64, 64), 7, BlueNoise(p))
    assert masks.sum((1, 2)).tolist() == [round(p * 64 * 64)] * 2
    white = masks_for(FOVEON, 1, Distinct(), (64, 64), 7, Bernoulli(p))[0]
    low = 0.3 * np.sqrt(min(p, 1 - p))
    assert ring(masks[0], 0.01, low) < 0.1
    assert 0.7 < ring(white, 0.01, low) < 1.4
    assert ring(masks[0], 0.35, 0.5) > 1.05
    assert abs(np.corrcoef(masks.reshape(2, -1))[0, 1]) < 4 / 64


@pytest.mark.parametrize("size", [(1, 1), (1, 30), (30, 1), (2, 3)])
def test_D8_blue_noise_on_a_line_and_on_one_mirror_is_valid(size):
    mask = masks_for(FOVEON, 1, Distinct(), size, 0, BlueNoise())[0]
    assert mask.shape == size
    assert mask.sum() == round(0.5 * mask.size)
    if size == (30, 1):
        assert (mask[::2] != mask[1::2]).mean() > 0.6


@pytest.mark.parametrize("kind", ["npy", "npy bool", "png 1", "png 8", "png rgb", "png 16"])
def test_masks_from_files_are_shown_as_they_stand(tmp_path, kind):
    masks = masks_for(FOVEON, 2, Distinct(), (9, 11), 0)
    if kind.startswith("npy"):
        np.save(tmp_path / "m.npy", masks.astype(bool) if "bool" in kind else masks.astype(float))
        paths = (tmp_path / "m.npy",)
    else:
        paths = tuple(tmp_path / f"{i}.png" for i in range(2))
        for path, mask in zip(paths, masks):
            if kind == "png 16":
                Image.fromarray(mask.astype(np.uint16) * np.uint16(65535)).save(path)
            else:
                Image.fromarray(mask * 255).convert({"png 1": "1", "png 8": "L", "png rgb": "RGB"}[kind]).save(path)
    shown = masks_for(FOVEON, 2, Distinct(), (9, 11), 0, FromFile(paths))
    assert shown.dtype == np.uint8
    np.testing.assert_array_equal(shown, masks)


def test_masks_of_a_file_follow_the_rule_of_groups(tmp_path):
    masks = masks_for(FOVEON, 2, Distinct(), (4, 5), 0)
    np.save(tmp_path / "m.npy", masks)
    repeated = masks_for(MONO, 6, Repeated(), (4, 5), 0, FromFile((tmp_path / "m.npy",)))
    np.testing.assert_array_equal(repeated, masks[[0, 0, 0, 1, 1, 1]])


def test_D6_gray_masks_of_a_file_are_refused_unless_allowed(tmp_path):
    gray = np.array([[0.0, 0.5], [1.0, 0.25]])
    np.save(tmp_path / "gray.npy", gray)
    with pytest.raises(InputError, match=r"0 or 1.*\(0, 0, 1\)"):
        masks_for(FOVEON, 1, Distinct(), (2, 2), 0, FromFile((tmp_path / "gray.npy",)))
    allowed = masks_for(FOVEON, 1, Distinct(), (2, 2), 0, FromFile((tmp_path / "gray.npy",), gray=True))
    np.testing.assert_array_equal(allowed[0], gray)
    Image.fromarray(np.array([[0, 51], [255, 0]], np.uint8)).save(tmp_path / "gray.png")
    allowed = masks_for(FOVEON, 1, Distinct(), (2, 2), 0, FromFile((tmp_path / "gray.png",), gray=True))
    np.testing.assert_allclose(allowed[0], [[0, 0.2], [1, 0]])


@pytest.mark.parametrize("value", [-1.0, np.nan, 1.5, np.inf])
def test_D6_gray_values_outside_0_to_1_are_refused_even_when_gray_is_allowed(value):
    masks = np.full((1, 2, 3), 0.5)
    masks[0, 1, 2] = value
    with pytest.raises(InputError, match=r"\(0, 1, 2\)"):
        check_masks(masks, gray=True)
    assert check_masks(np.full((1, 2, 3), 0.5), gray=True).dtype == np.float64
    assert check_masks(np.ones((1, 2, 3)), gray=True).dtype == np.uint8


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: np.save(p / "m.npy", np.ones((3, 4))), r"3 x 4|mirrors' size 4 x 4"),
        (lambda p: np.save(p / "m.npy", np.ones((2, 4, 4))), "1 masks, one for each"),
        (lambda p: np.save(p / "m.npy", np.ones(4)), "numbers of shape"),
        (lambda p: np.save(p / "m.npy", np.array([[None]]), allow_pickle=True), "readable NPY"),
        (lambda p: (p / "m.npy").write_bytes(b"no array"), "readable NPY"),
        (lambda p: (p / "m.npy").write_bytes(b""), "readable NPY"),
        (lambda p: None, "readable NPY"),
    ],
)
def test_D8_files_that_are_no_masks_of_this_size_are_refused_in_words(tmp_path, make, message):
    make(tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        masks_for(FOVEON, 1, Distinct(), (4, 4), 0, FromFile((tmp_path / "m.npy",)))
    assert caught.value.field == "--masks"


def test_files_that_claim_to_be_huge_are_refused_without_reading_them(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (40000000, 40000000), }"
    (tmp_path / "m.npy").write_bytes(b"\x93NUMPY\x01\x00" + (len(header) + 1).to_bytes(2, "little") + header + b"\n" + bytes(64))
    with pytest.raises(InputError, match="readable NPY"):
        masks_for(FOVEON, 1, Distinct(), (4, 4), 0, FromFile((tmp_path / "m.npy",)))
    chunk = b"IHDR" + (60_000).to_bytes(4, "big") * 2 + b"\x08\x00\x00\x00\x00"
    whole = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "m.png").write_bytes(whole + (0).to_bytes(4, "big") + b"IDAT" + zlib.crc32(b"IDAT").to_bytes(4, "big"))
    with pytest.raises(InputError, match="at most 67108864"):
        masks_for(FOVEON, 1, Distinct(), (4, 4), 0, FromFile((tmp_path / "m.png",)))


def test_coloured_and_broken_pictures_and_other_formats_are_no_masks(tmp_path):
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "red.png")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nrest")
    Image.new("L", (4, 4)).save(tmp_path / "m.bmp")
    for name, message in (("red.png", "without colours"), ("broken.png", "readable PNG"), ("m.bmp", r"\.png or \.npy")):
        with pytest.raises(InputError, match=message):
            masks_for(FOVEON, 1, Distinct(), (4, 4), 0, FromFile((tmp_path / name,)))


@pytest.mark.parametrize("leak", [0.0, 1 / 2000, 1.0])
def test_D9_off_mirrors_send_the_leaks_share_and_without_contrast_all_masks_are_alike(leak):
    masks = masks_for(FOVEON, 2, Distinct(), SIZE, 0)
    states = mirror_states(masks, DmdConfig(leak=leak))
    assert set(np.unique(states)) == {leak, 1.0}
    np.testing.assert_array_equal(states == 1, (masks == 1) | (leak == 1))


def test_D9_a_perfect_mirror_shows_its_mask():
    masks = masks_for(FOVEON, 1, Distinct(), SIZE, 0)
    assert mirror_states(masks, DmdConfig(**PERFECT)) is masks


def test_dead_and_stuck_mirrors_are_the_same_in_every_shot_in_exactly_their_shares():
    dmd = DmdConfig(**PERFECT, dead_share=0.02, stuck_share=0.05, defect_seed=4)
    dead, stuck = defects(dmd, (50, 40))
    assert (dead.sum(), stuck.sum(), (dead & stuck).sum()) == (40, 100, 0)
    masks = masks_for(FOVEON, 3, Distinct(), (50, 40), 1)
    states = mirror_states(masks, dmd)
    assert not states[:, dead].any()
    assert states[:, stuck].all()
    np.testing.assert_array_equal(states[:, ~(dead | stuck)], masks[:, ~(dead | stuck)])
    other = defects(DmdConfig(**PERFECT, dead_share=0.02, defect_seed=5), (50, 40))[0]
    assert (dead != other).any()


def test_more_defects_than_mirrors_are_refused():
    with pytest.raises(InputError, match="stuck_share"):
        defects(DmdConfig(dead_share=0.6, stuck_share=0.5), (4, 4))
    dead, stuck = defects(DmdConfig(dead_share=0.5, stuck_share=0.5), (1, 1))
    assert dead.sum() + stuck.sum() <= 1
