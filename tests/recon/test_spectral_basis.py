"""Bases along wavelength: orthonormal, learned without the mean removed, the same bytes every time."""

import numpy as np
import pytest
import scipy.fft

from recon import InputError
from recon.spectral_basis import Cosine, Learned, learned


def spectra(count: int, bands: int, seed: int = 0) -> np.ndarray:
    draw = np.random.Generator(np.random.Philox(seed))
    position = np.linspace(0, 1, bands)
    centers, widths = draw.random((2, count, 1))
    return 0.1 + np.exp(-(((position - centers) / (0.2 + widths)) ** 2))


@pytest.mark.parametrize("bands", [1, 2, 7, 24])
def test_cosines_are_scipys_orthonormal_dct(bands):
    np.testing.assert_allclose(Cosine().matrix(bands, np.float64), scipy.fft.dct(np.eye(bands), axis=0, norm="ortho"), atol=1e-14)


@pytest.mark.parametrize(("count", "bands"), [(50, 24), (5, 24), (1, 6), (30, 1)])
def test_learned_rows_are_orthonormal_even_with_fewer_samples_than_bands(count, bands):
    basis = learned(spectra(count, bands))
    matrix = basis.matrix(bands, np.float64)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(bands), atol=1e-13)
    assert basis.matrix(bands, np.float32).dtype == np.float32
    assert len(basis.strengths) == bands


def test_learned_rows_are_the_eigenvectors_of_the_second_moment_strongest_first():
    samples = spectra(40, 8)
    basis = learned(samples)
    value, vector = np.linalg.eigh(samples.T @ samples / 40)  # the mean stays in: second moment, not covariance
    np.testing.assert_allclose(np.array(basis.strengths) * np.abs(samples).max(), np.sqrt(value[::-1]), rtol=1e-6)
    matrix = basis.matrix(8, np.float64)
    for q in range(8):
        assert abs(matrix[q] @ vector[:, 7 - q]) == pytest.approx(1, abs=1e-8)
        assert matrix[q][np.abs(matrix[q]).argmax()] > 0


def test_the_first_rows_leave_the_least_of_the_library():
    samples = spectra(60, 12)
    matrix = learned(samples).matrix(12, np.float64)
    for rank in (1, 3, 6):
        left = samples - samples @ matrix[:rank].T @ matrix[:rank]
        assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(np.linalg.svd(samples, compute_uv=False)[rank:]), rel=1e-9)


@pytest.mark.parametrize("scale", [1e-30, 1, 1e30])
def test_the_scale_of_the_library_does_not_matter_and_it_survives_json(scale):
    basis = learned(spectra(20, 6))
    same = learned(spectra(20, 6) * scale)
    np.testing.assert_allclose(same.rows, basis.rows, atol=1e-12)
    np.testing.assert_allclose(same.weights(6), basis.weights(6), rtol=1e-9)
    assert Learned.model_validate_json(basis.model_dump_json()) == basis


def test_weights_follow_the_strengths_and_stop_at_the_faintest():
    basis = Learned(rows=((1, 0, 0), (0, 1, 0), (0, 0, 1)), strengths=(2.0, 0.5, 0.0))
    assert basis.weights(3, 0) == (1, 1, 1)
    assert basis.weights(3, 1) == pytest.approx((1, 4, 1000))
    assert basis.weights(3, 0.5) == pytest.approx((1, 2, 1000**0.5))
    assert Cosine().weights(4, 0.5) == pytest.approx((1, 2, 3, 4))
    for power in (-1, np.nan, 3):
        with pytest.raises(InputError, match=r"^power: must be"):
            basis.weights(3, power)


@pytest.mark.parametrize("bad", [np.zeros((3, 4)), np.full((3, 4), np.nan), np.ones(4), np.ones((0, 4))])
def test_samples_that_teach_nothing_are_refused(bad):
    with pytest.raises(InputError, match=r"^samples: must be"):
        learned(bad)


def test_rows_that_are_not_orthonormal_and_other_numbers_of_bands_are_refused():
    with pytest.raises(InputError, match=r"^Learned\.rows: must be orthonormal"):
        Learned(rows=((1, 0), (0.1, 1)), strengths=(1, 1))
    with pytest.raises(InputError, match=r"^Learned\.strengths: must be falling"):
        Learned(rows=((1, 0), (0, 1)), strengths=(1, 2))
    with pytest.raises(InputError, match="2 bands that it was learned for"):
        Learned(rows=((1, 0), (0, 1)), strengths=(1, 1)).matrix(3, np.float64)
