"""H against the printed formula, against pylops at full size, and its adjoint over generated cameras."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon import threads
from recon.coded_aperture import CodedAperture, empty_cube, shift_taps
from recon.errors import InputError
from recon.operator import RowWeighted, adjoint_error, norm_squared


def formula(operator: CodedAperture, cube: np.ndarray) -> np.ndarray:
    """g[l,c,m,j] = sum_k sum_t response[c,k] taps[k,t] mask[l,m,j-first_k-t] f[m,j-first_k-t,k], in plain Python."""
    frames = np.zeros(operator.out_shape)
    shots, channels, rows, width = operator.out_shape
    columns, bands = cube.shape[1:]
    for l in range(shots):
        for c in range(channels):
            for m in range(rows):
                for j in range(width):
                    curve = c if operator.mosaic is None else operator.mosaic[m, j]
                    for k in range(bands):
                        for t in range(operator.taps.shape[1]):
                            n = j - operator.first_column[k] - t
                            if 0 <= n < columns:
                                weight = operator.response[curve, k] * operator.taps[k, t]
                                frames[l, c, m, j] += weight * operator.masks[l, m, n] * cube[m, n, k]
    return frames


def column_order(cube: np.ndarray) -> np.ndarray:
    return cube.transpose(2, 1, 0).ravel()


def row_order(frames: np.ndarray) -> np.ndarray:
    return frames.transpose(0, 1, 3, 2).ravel()


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize("shots", [1, 2, 3])
@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_dense_matrix_equals_the_formula_entry_by_entry_on_6x5x4(sensor, shots, spread):
    draw = np.random.Generator(np.random.Philox(shots))
    first, taps = shift_taps(np.array([0.0, 0.7, 1.9, 3.25])) if spread else shift_taps(np.arange(4))
    width = 5 + 3 + taps.shape[1]
    mosaic = draw.integers(0, 3, (6, width)) if sensor == "bayer" else None
    response = draw.random((1 if sensor == "mono" else 3, 4))
    operator = CodedAperture(draw.integers(0, 2, (shots, 6, 5)), response, first, taps, mosaic=mosaic, width=width, dtype=np.float64)
    dense = operator.dense()
    for voxel in range(dense.shape[1]):
        unit = np.zeros((4, 5, 6))
        unit.ravel()[voxel] = 1
        np.testing.assert_array_equal(dense[:, voxel], row_order(formula(operator, unit.transpose(2, 1, 0))))
    cube = draw.standard_normal((6, 5, 4))
    np.testing.assert_allclose(row_order(operator.forward(cube)), dense @ column_order(cube), atol=1e-14)
    frames = draw.standard_normal(operator.out_shape)
    np.testing.assert_allclose(column_order(operator.adjoint(frames)), dense.T @ row_order(frames), atol=1e-14)


@st.composite
def cameras(draw: st.DrawFn) -> CodedAperture:
    shots, rows, columns, bands = (draw(st.integers(1, top)) for top in (8, 7, 9, 12))
    random = np.random.Generator(np.random.Philox(draw(st.integers(0, 2**32))))
    shifts = random.uniform(-3, 14, bands) if draw(st.booleans()) else random.integers(-3, 14, bands).astype(float)
    first, taps = shift_taps(shifts)
    if draw(st.booleans()):
        taps = np.concatenate([taps / 4, taps / 2, taps / 4], axis=1)
    sensor = draw(st.sampled_from(["mono", "bayer", "foveon"]))
    width = draw(st.integers(1, columns + 16))
    mosaic = random.integers(0, 3, (rows, width)) if sensor == "bayer" else None
    masks = random.integers(0, 2, (shots, rows, columns))
    masks[0, 0] = 1
    response = random.random((1 if sensor == "mono" else 3, bands)) + 0.01
    first[0] = 0  # at least one band lands on a sensor however small
    return CodedAperture(masks, response, first, taps, mosaic=mosaic, width=width, dtype=np.float64)


@settings(max_examples=200, deadline=None)
@given(cameras(), st.integers(0, 2**32))
def test_forward_and_adjoint_satisfy_the_dot_test_over_generated_cameras(operator, seed):
    assert adjoint_error(operator, seed) < 1e-12
    assert adjoint_error(operator.astype(np.float32), seed) < 1e-5


@settings(max_examples=60, deadline=None)
@given(cameras(), st.integers(0, 2**32))
def test_forward_equals_the_formula_over_generated_cameras(operator, seed):
    cube = np.random.Generator(np.random.Philox(seed)).standard_normal(operator.in_shape)
    np.testing.assert_allclose(operator.forward(cube), formula(operator, cube), atol=1e-13)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_gram_blocks_equal_the_dense_product(sensor, camera_of):
    for spread in (False, True):
        operator = camera_of(sensor, 2, 6, 5, spread=spread)
        size, width, rows = operator.measurements, operator.width, 6
        dense = operator.dense()
        product = (dense @ dense.T).reshape(size, width, rows, size, width, rows)
        rebuilt = np.zeros_like(product)
        for offset in range(operator.taps.shape[1]):
            blocks = operator.gram(offset)
            for m in range(rows):
                for j in range(width - offset):
                    rebuilt[:, j, m, :, j + offset, m] = blocks[m, :, :, j]
                    rebuilt[:, j + offset, m, :, j, m] = blocks[m, :, :, j].T
        np.testing.assert_allclose(rebuilt, product, atol=1e-13)
        np.testing.assert_array_equal(operator.gram(0, slice(2, 4)), operator.gram(0)[2:4])


def test_operator_equals_pylops_at_the_papers_full_size(camera_of):
    import pylops

    operator = camera_of("foveon", 2, 256, 24)
    rows, columns, bands = operator.in_shape
    shots = []
    for mask in operator.masks:
        for response in operator.response:
            one = []
            for k in range(bands):
                pad = pylops.Pad((rows, columns), ((0, 0), (k, operator.width - columns - k)))
                one.append(response[k] * (pad @ pylops.Diagonal(mask.ravel())))
            shots.append(pylops.HStack(one, forceflat=True))
    judge = pylops.VStack(shots, forceflat=True)
    draw = np.random.Generator(np.random.Philox(1))
    cube = draw.standard_normal((bands, rows, columns))
    frames = draw.standard_normal(operator.out_shape)
    np.testing.assert_allclose(operator.forward(cube.transpose(1, 2, 0)).ravel(), judge @ cube.ravel(), atol=1e-12)
    np.testing.assert_allclose(operator.adjoint(frames).transpose(2, 0, 1).ravel(), judge.H @ frames.ravel(), atol=1e-12)


def test_any_strides_and_given_outputs_give_the_same_numbers(camera_of):
    operator = camera_of("bayer", 2, 16, 6)
    draw = np.random.Generator(np.random.Philox(2))
    cube = draw.standard_normal(operator.in_shape)
    band_major = empty_cube(operator.in_shape, np.float64)
    band_major[...] = cube
    frames, out = np.empty(operator.out_shape), np.empty(operator.in_shape)
    assert operator.forward(band_major, frames) is frames
    np.testing.assert_allclose(operator.forward(cube), frames, atol=1e-14)
    np.testing.assert_allclose(operator.adjoint(frames, out), operator.adjoint(frames), atol=1e-14)


def test_bytes_do_not_depend_on_the_number_of_threads(camera_of):
    operator = camera_of("foveon", 2, 33, 7, dtype=np.float32)
    cube = np.random.Generator(np.random.Philox(3)).standard_normal(operator.in_shape).astype(np.float32)
    seen = []
    for count in (1, 2, 5):
        with threads.use(count):
            frames = operator.forward(cube)
            seen.append((frames.tobytes(), operator.adjoint(frames).tobytes(), operator.gram().tobytes()))
    assert seen[0] == seen[1] == seen[2]


def test_D3_one_open_mirror_gives_that_column_of_the_dense_matrix(camera_of):
    operator = camera_of("foveon", 1, 6, 4)
    open_all = operator.replace(masks=np.ones_like(operator.masks))
    mask = np.zeros_like(operator.masks)
    mask[0, 2, 3] = 1
    cube = np.zeros(operator.in_shape)
    cube[2, 3, 1] = 1
    one = operator.replace(masks=mask).forward(np.ones(operator.in_shape) * cube)
    np.testing.assert_array_equal(row_order(one), open_all.dense()[:, (1 * 6 + 3) * 6 + 2])


def test_D4_a_mask_and_its_complement_add_to_the_open_frame(camera_of, cube_of):
    operator, cube = camera_of("bayer", 1, 16, 8, spread=True), cube_of(16, 8)
    total = operator.forward(cube) + operator.replace(masks=1 - operator.masks).forward(cube)
    open_frame = operator.replace(masks=np.ones_like(operator.masks)).forward(cube)
    np.testing.assert_allclose(total, open_frame, rtol=1e-12)


@pytest.mark.parametrize("value", [0.5, -1.0, np.nan])
def test_D6_masks_between_0_and_1_need_gray_and_others_are_refused(value):
    masks = np.ones((1, 3, 4))
    masks[0, 1, 2] = value
    arguments = (np.ones((1, 2)), np.arange(2), np.ones((2, 1)))
    with pytest.raises(InputError, match=r"masks: must be 0 or 1.*\(0, 1, 2\)"):
        CodedAperture(masks, *arguments)
    if value == 0.5:
        assert CodedAperture(masks, *arguments, gray=True).forward(np.ones((3, 4, 2)))[0, 0, 1, 2] == 1.5
    else:
        with pytest.raises(InputError, match=r"masks: must be in \[0, 1\]"):
            CodedAperture(masks, *arguments, gray=True)


def test_X7_a_camera_that_sees_nothing_is_refused_by_name(camera_of):
    operator = camera_of("mono", 2, 5, 4)
    with pytest.raises(InputError, match=r"masks.*camera sees nothing.*shots \[0, 1\]"):
        operator.replace(masks=np.zeros_like(operator.masks))
    with pytest.raises(InputError, match=r"response.*camera sees nothing"):
        operator.replace(response=np.zeros((1, 4)))
    with pytest.raises(InputError, match=r"first_column.*camera sees nothing"):
        operator.replace(first_column=np.arange(4) + 1000)


def test_X7_masks_columns_and_mosaic_are_judged_together():
    """Each of them lets light through by itself; the dense H of what is accepted has an element, of what is refused none."""
    column0, blind_curve = np.zeros((1, 8, 8)), np.array([[0.0, 0, 0, 0], [1, 1, 1, 1]])
    column0[:, :, 0] = 1
    with pytest.raises(InputError, match=r"^masks: must be such that.*columns 0\.\.7.*camera sees nothing, got '8 mirrors"):
        CodedAperture(column0, np.ones((1, 2)), np.array([-3, -4]), np.ones((2, 1)), width=8)
    assert CodedAperture(column0, np.ones((1, 2)), np.array([-3, 0]), np.ones((2, 1)), width=8).dense().any()
    mosaic = np.zeros((8, 11), int)
    arguments = (np.ones((1, 8, 8)), blind_curve, np.arange(4), np.ones((4, 1)))
    with pytest.raises(InputError, match=r"^masks: must be such that.*camera sees nothing"):
        CodedAperture(*arguments, mosaic=mosaic)
    mosaic[7, 10] = 1
    assert np.count_nonzero(CodedAperture(*arguments, mosaic=mosaic).dense()) == 1
    mosaic[7, 10], mosaic[3, 5] = 0, 1
    with pytest.raises(InputError, match="camera sees nothing"):
        CodedAperture(column0, *arguments[1:], mosaic=mosaic)


def test_X7_every_random_camera_is_refused_exactly_when_its_matrix_is_zero():
    draw = np.random.Generator(np.random.Philox(8))
    refused = 0
    for _ in range(300):
        masks = draw.random((1, 2, 3)) < 0.25
        response, taps = draw.random((2, 2)) * (draw.random((2, 2)) < 0.4), draw.random((2, 2)) * (draw.random((2, 2)) < 0.5)
        first, mosaic = draw.integers(-3, 4, 2), draw.integers(0, 2, (2, 4))
        h = 0.0
        for m, n, k, t in np.ndindex(2, 3, 2, 2):
            j = n + first[k] + t
            h += masks[0, m, n] * taps[k, t] * response[mosaic[m, j], k] if 0 <= j < 4 else 0
        if h:
            CodedAperture(masks, response, first, taps, mosaic=mosaic, width=4)
        else:
            refused += 1
            with pytest.raises(InputError, match="sees nothing"):
                CodedAperture(masks, response, first, taps, mosaic=mosaic, width=4)
    assert 30 < refused < 270


def test_wrong_shapes_and_values_name_their_field(camera_of):
    operator = camera_of("bayer", 1, 6, 4)
    cases = {
        "masks": np.ones((6, 6)),
        "response": np.full((3, 4), np.nan),
        "first_column": np.arange(4) + 0.5,
        "taps": np.ones((3, 1)),
        "mosaic": np.full(operator.mosaic.shape, 3),
        "width": 0,
        "dtype": np.int32,
    }
    for field, value in cases.items():
        with pytest.raises(InputError, match=rf"^{field}: must be"):
            operator.replace(**{field: value})
    with pytest.raises(InputError, match=r"^x: must be"):
        operator.forward(np.ones((6, 6, 5)))
    with pytest.raises(InputError, match=r"^out: must be"):
        operator.adjoint(np.ones(operator.out_shape), np.ones((4, 6, 6)))
    with pytest.raises(InputError, match=r"^shift_px: must be"):
        shift_taps(np.array([0.0, np.inf]))
    with pytest.raises(InputError, match=r"^dense: must be"):
        camera_of("mono", 1, 64, 24).dense()


def test_shift_taps_place_the_centre_of_mass_at_the_shift():
    shift = np.array([-1.5, 0.0, 0.25, 3.999])
    first, taps = shift_taps(shift)
    np.testing.assert_allclose(taps.sum(1), 1)
    np.testing.assert_allclose(first + taps @ [0, 1], shift)
    assert shift_taps(np.array([0.0, 2.0]))[1].shape == (2, 1)


def test_one_nonzero_tap_a_band_counts_as_one_tap():
    masks, response = np.ones((1, 2, 5)), np.ones((1, 3))
    padded = CodedAperture(masks, response, np.arange(3), np.array([[1.0, 0], [0, 1], [1, 0]]), width=9)
    plain = CodedAperture(masks, response, np.array([0, 2, 2]), np.ones((3, 1)), width=9)
    assert padded.one_tap
    np.testing.assert_array_equal(padded.dense(), plain.dense())


def test_power_method_and_weights_agree_with_the_dense_matrix(camera_of):
    operator = camera_of("foveon", 2, 6, 5)
    weights = np.random.Generator(np.random.Philox(5)).random((1, 1, 6, operator.width))
    weighted = RowWeighted(operator, weights)
    dense = operator.dense() * row_order(np.broadcast_to(weights, operator.out_shape))[:, None]
    assert adjoint_error(weighted) < 1e-12
    assert norm_squared(weighted, 200) == pytest.approx(np.linalg.norm(dense, 2) ** 2, rel=2e-2)
    with pytest.raises(InputError, match=r"^weights"):
        RowWeighted(operator, -weights)
