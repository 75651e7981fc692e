"""Vectors in kernels, judged by NumPy."""

import numpy as np
import pytest
from numba import njit

from recon.simd import (
    add,
    evens,
    fma,
    highest,
    lanes,
    load,
    load_some,
    lowest,
    magnitude,
    mul,
    odds,
    splat,
    store,
    store_some,
    sub,
    total,
    zip_high,
    zip_low,
)


@njit
def work(x, n, few, out):
    a, b = load(x, 1), load(x, 1 + n)
    results = (
        add(a, b), sub(a, b), mul(a, b), fma(a, b, a), lowest(a, b), highest(a, b), magnitude(a), evens(a, b), odds(a, b),
        zip_low(a, b), zip_high(a, b), splat(x[3]), load_some(x, 2, few),
    )  # fmt: skip
    at = 0
    for v in results:
        store(out, at, v)
        at += n
    store_some(out, at, a, few)
    return total(a)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("few", [-1, 0, 3, 100])
def test_every_intrinsic_does_what_numpy_does(dtype, few):
    n = lanes(dtype)
    x = np.random.Generator(np.random.Philox(1)).standard_normal(2 * n + 2).astype(dtype)
    a, b = x[1 : 1 + n], x[1 + n : 1 + 2 * n]
    both, some = np.concatenate([a, b]), min(max(few, 0), n)
    woven = np.stack([a, b], 1).ravel()
    rest = np.zeros(n, dtype)
    rest[:some] = x[2 : 2 + n][:some]
    expected = [a + b, a - b, a * b, a * b + a, np.minimum(a, b), np.maximum(a, b), np.abs(a), both[::2], both[1::2]]
    expected += [woven[:n], woven[n:], np.full(n, x[3]), rest]
    out = np.full(n * (len(expected) + 1), 7, dtype)
    assert work(x, n, few, out) == pytest.approx(a.sum(dtype=np.float64), rel=1e-5)
    np.testing.assert_allclose(out[: n * len(expected)].reshape(-1, n), expected, rtol=0, atol=10 * np.finfo(dtype).eps)
    np.testing.assert_array_equal(out[-n:], np.concatenate([a[:some], np.full(n - some, 7, dtype)]))
