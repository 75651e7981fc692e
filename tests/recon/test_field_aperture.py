"""The operator with field-dependent weights against its printed formula, its transpose, and the simple operator that it contains."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon import FieldAperture, Readout, Spread, threads
from recon.coded_aperture import CodedAperture, shift_taps
from recon.errors import InputError
from recon.operator import adjoint_error


def formula(h: FieldAperture, cube: np.ndarray) -> np.ndarray:
    """Light, crosstalk, bins and gains one number at a time, in plain Python."""
    shots, channels, rows, width = h.out_shape
    mirrors, columns, bands = cube.shape
    taps, row0, column0 = h.spread.taps, h.spread.first_row, h.spread.first_column
    light = np.zeros(h.out_shape)
    for l, m, n, k, s, t in np.ndindex(shots, mirrors, columns, bands, *taps.shape[3:]):
        i = m + row0[k, m % row0.shape[1], n % row0.shape[2]] + s
        j = n + column0[k, m % column0.shape[1], n % column0.shape[2]] + t
        if 0 <= i < rows and 0 <= j < width:
            share = taps[k, m % taps.shape[1], n % taps.shape[2], s, t] * h.masks[l, m, n] * cube[m, n, k]
            for c in range(channels):
                light[l, c, i, j] += h.response[c if h.mosaic is None else h.mosaic[i, j], k] * share
    a = h.readout.crosstalk
    moved = np.zeros_like(light)
    for l, c, i, j in np.ndindex(*h.out_shape):
        moved[l, c, i, j] += (1 - 4 * a) * light[l, c, i, j]
        for u, v in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if 0 <= u < rows and 0 <= v < width:
                moved[l, c, u, v] += a * light[l, c, i, j]
    frames = np.zeros_like(light)
    for l, c, i, j in np.ndindex(*h.out_shape):
        b = 1 if h.readout.bins is None else h.readout.bins[c]
        frames[l, c, i // b * b, j // b * b] += moved[l, c, i, j]
    return frames if h.readout.gain is None else frames * h.readout.gain


def camera(
    seed, *, sensor="mono", shots=2, size=(5, 6), bands=3, taps=(2, 3), field=(True, True), dtype=np.float64, readout=None, row=True
):
    draw = np.random.Generator(np.random.Philox(seed))
    rows, columns = size
    place = (bands, rows if field[0] else 1, columns if field[1] else 1)
    first_row = draw.integers(-2, 2, place) if row else np.zeros(place, int)
    first_column = np.arange(bands)[:, None, None] + draw.integers(-1, 2, place)
    first_row[0, 0, 0] = first_column[0, 0, 0] = 0  # some light lands on the sensor
    spread = Spread(first_row, first_column, draw.standard_normal((*place, *taps)))
    width = columns + bands
    mosaic = draw.integers(0, 3, (rows, width)) if sensor == "bayer" else None
    masks = draw.random((shots, rows, columns)) * (draw.random((shots, rows, columns)) < 0.7)
    masks[0, 0, 0] = 1
    response = draw.random((1 if sensor == "mono" else 3, bands)) + 0.1
    if readout == "all":
        channels = 3 if sensor == "foveon" else 1
        readout = Readout(draw.random((channels, rows, width)), (2, 3, 1)[:channels], 0.07)
    return FieldAperture(masks, response, spread, mosaic=mosaic, readout=readout, width=width, dtype=dtype)


def column_order(cube):
    return cube.transpose(2, 1, 0).ravel()


def row_order(frames):
    return frames.transpose(0, 1, 3, 2).ravel()


@pytest.mark.parametrize("readout", [None, "all"])
@pytest.mark.parametrize("field", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_field_operator_and_its_dense_matrix_are_the_formula_entry_by_entry(sensor, field, readout):
    h = camera(3, sensor=sensor, field=field, readout=readout)
    draw = np.random.Generator(np.random.Philox(4))
    cube, frames = draw.standard_normal(h.in_shape), draw.standard_normal(h.out_shape)
    expected = formula(h, cube)
    np.testing.assert_allclose(h.forward(cube), expected, atol=1e-13)
    dense = h.dense()
    np.testing.assert_allclose(dense @ column_order(cube), row_order(expected), atol=1e-13)
    np.testing.assert_allclose(column_order(h.adjoint(frames)), dense.T @ row_order(frames), atol=1e-13)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["mono", "bayer", "foveon"]), st.sampled_from([None, "all"]), st.data())
def test_field_operators_adjoint_is_exact(seed, sensor, readout, data):
    size = (data.draw(st.integers(1, 9)), data.draw(st.integers(1, 9)))
    taps = (data.draw(st.integers(1, 4)), data.draw(st.integers(1, 5)))
    field = (data.draw(st.booleans()), data.draw(st.booleans()))
    h = camera(seed, sensor=sensor, size=size, taps=taps, field=field, readout=readout, bands=data.draw(st.integers(1, 5)))
    assert adjoint_error(h, seed) < 1e-14 * max(1, np.sqrt(np.prod(h.in_shape)))


def test_constant_taps_in_the_row_are_the_simple_operator():
    draw = np.random.Generator(np.random.Philox(0))
    masks, response = draw.integers(0, 2, (2, 7, 8)), draw.random((3, 5))
    first, taps = shift_taps(np.array([0.0, 0.7, 1.9, 3.25, 4.5]))
    simple = CodedAperture(masks, response, first, taps, dtype=np.float64)
    field = FieldAperture(masks, response, Spread(np.zeros(5, int), first, taps[:, None, None, None, :]), dtype=np.float64)
    cube, frames = draw.standard_normal(simple.in_shape), draw.standard_normal(simple.out_shape)
    assert field.out_shape == simple.out_shape
    np.testing.assert_allclose(field.forward(cube), simple.forward(cube), atol=1e-14)
    np.testing.assert_allclose(field.adjoint(frames), simple.adjoint(frames), atol=1e-14)
    for offset in range(3):
        np.testing.assert_allclose(field.gram(offset), simple.gram(offset), atol=1e-13)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_blocks_of_h_ht_are_those_of_the_dense_matrix(sensor):
    gains = Readout(np.random.default_rng(1).random((5, 9)))
    h = camera(5, sensor=sensor, taps=(1, 3), row=False, readout=gains)
    shots, channels, rows, width = h.out_shape
    normal = (h.dense() @ h.dense().T).reshape(shots * channels, width, rows, shots * channels, width, rows)
    for offset in range(4):
        blocks = h.gram(offset)
        for m in range(rows):
            for j in range(width - offset):
                np.testing.assert_allclose(blocks[m, :, :, j], normal[:, j, m, :, j + offset, m], atol=1e-12)
    others = normal.transpose(2, 5, 0, 1, 3, 4)[~np.eye(rows, dtype=bool)]
    assert np.abs(others).max() == 0
    np.testing.assert_array_equal(h.gram(1, slice(1, 3)), h.gram(1)[1:3])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_field_operator_gives_the_same_bytes_for_any_number_of_threads(dtype):
    h = camera(6, sensor="foveon", size=(23, 17), bands=4, taps=(3, 4), dtype=dtype, readout="all")
    draw = np.random.Generator(np.random.Philox(1))
    cube, frames = draw.standard_normal(h.in_shape).astype(dtype), draw.standard_normal(h.out_shape).astype(dtype)
    results = []
    for count in (1, 2, 5):
        with threads.use(count):
            results.append((h.forward(cube).tobytes(), h.adjoint(frames).tobytes()))
    assert results[0] == results[1] == results[2]
    assert h.forward(cube).dtype == dtype


def test_binned_layers_keep_their_sum_also_in_partial_blocks():
    light = np.random.default_rng(0).random((2, 3, 5, 7))
    read = Readout(bins=(2, 2, 1)).apply(light.copy())
    np.testing.assert_allclose(read.sum((2, 3)), light.sum((2, 3)), rtol=1e-13)
    assert not read[:, :2, 1::2].any()
    assert not read[:, :2, :, 1::2].any()
    np.testing.assert_array_equal(read[:, 2], light[:, 2])
    assert read[0, 0, 4, 6] == light[0, 0, 4, 6]


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("taps", {"spread": Spread(np.zeros(2, int), np.zeros(2, int), np.ones((2, 1, 1, 1, 1)))}),
        ("first_row", {"spread": Spread(np.zeros((3, 2, 1), int), np.zeros(3, int), np.ones((3, 1, 1, 1, 1)))}),
        ("gain", {"readout": Readout(gain=np.ones((4, 4)))}),
        ("bins", {"readout": Readout(bins=(1, 2))}),
        ("masks", {"masks": np.zeros((2, 5, 6))}),
        ("masks", {"masks": np.full((2, 5, 6), 1.5)}),
        ("mosaic", {"mosaic": np.zeros((5, 5), int)}),
        ("first_column", {"spread": Spread(np.zeros(3, int), np.full(3, 10**6), np.ones((3, 1, 1, 1, 1)))}),
        ("first_column", {"spread": Spread(np.full(3, -5), np.zeros(3, int), np.ones((3, 1, 1, 1, 1)))}),
        ("gain", {"readout": Readout(gain=np.zeros((5, 8)))}),
    ],
)
def test_misuse_of_the_field_operator_names_the_field(field, change):
    with pytest.raises(InputError) as refused:
        camera(0).replace(**change)
    assert refused.value.field == field


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("gain", lambda: Readout(gain=np.array([-1.0]))),
        ("bins", lambda: Readout(bins=(0,))),
        ("crosstalk", lambda: Readout(crosstalk=0.3)),
        ("taps", lambda: Spread(np.zeros(1, int), np.zeros(1, int), np.ones((1, 1)))),
        ("first_column", lambda: Spread(np.zeros(1, int), np.zeros(1), np.ones((1, 1, 1, 1, 1)))),
    ],
)
def test_broken_parts_are_refused_by_name(field, make):
    with pytest.raises(InputError) as refused:
        make()
    assert refused.value.field == field
