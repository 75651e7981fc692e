"""What a solve is handed, by people and by programs: refused by name, with the value and its place, or taken as it is meant."""

import numpy as np
import pytest

from recon import (
    L1,
    Admm,
    AutoTau,
    BasisPursuit,
    Cosine,
    Discrepancy,
    FieldAperture,
    Fista,
    Gap,
    Gpsr,
    GramBands,
    GramBlocks,
    InputError,
    Kronecker,
    Mixture,
    PlugAndPlay,
    RowWeighted,
    Spread,
    TauFraction,
    TotalVariation,
    adjoint_error,
    estimate_error,
    learned,
    norm_squared,
    reconstruct,
    shift_taps,
)
from recon.metrics import psnr, rmse, score, spectral_angle
from recon.tau import Given, TauPath


class Matrix:
    """A dense matrix as an operator with forward and adjoint only."""

    def __init__(self, matrix, in_shape, dtype=np.float64):
        self.matrix, self.in_shape, self.out_shape, self.dtype = np.asarray(matrix), in_shape, (len(matrix),), dtype

    def forward(self, x):
        return self.matrix @ x.ravel()

    def adjoint(self, y):
        return (self.matrix.T @ y).reshape(self.in_shape)


@pytest.mark.parametrize("signs", [(1, 1), (1, -1)])
def test_X7_a_tiny_operator_in_which_signs_cancel_is_not_taken_for_dark(signs):
    found = reconstruct(Matrix([signs], (1, 1, 2)), np.array([3.0]))
    np.testing.assert_allclose(found.cube.ravel(), 1.5 * np.array(signs), atol=1e-12)
    with pytest.raises(InputError, match="sees nothing"):
        reconstruct(Matrix([(0, 0)], (1, 1, 2)), np.array([3.0]))


def masked(shape, *places):
    array = np.ma.masked_array(np.ones(shape), mask=np.zeros(shape, bool))
    for place in places:
        array[place] = np.ma.masked
    return array


def test_masked_values_are_refused_with_count_and_place_and_empty_masks_are_taken(camera_of):
    """NumPy forgets the mask on the way into a solve, which would then believe what lies beneath it."""
    operator = camera_of("mono", 2, 8, 3)
    frames = masked(operator.out_shape, (1, 0, 2, 3), (1, 0, 5, 6))
    place = r"first \(shot, channel, row, column\) is \(1, 0, 2, 3\).*noise=inf.*got '2 of 160 masked'"
    with pytest.raises(InputError, match=r"^frames: must be without masked values, " + place):
        reconstruct(operator, frames)
    with pytest.raises(InputError, match=r"^noise: must be without masked values, " + place):
        reconstruct(operator, np.ones(operator.out_shape), noise=frames)
    with pytest.raises(InputError, match=r"^start: must be without masked.*first \(row, column, band\) is \(4, 5, 2\)"):
        reconstruct(operator, np.ones(operator.out_shape), start=masked((8, 8, 3), (4, 5, 2)))
    plain = reconstruct(operator, np.ones(operator.out_shape))
    np.testing.assert_array_equal(reconstruct(operator, masked(operator.out_shape), noise=masked((8, 1))).cube, plain.cube)
    for metric in (score, psnr, rmse, spectral_angle):
        for pair, name in (
            ((masked((8, 8, 3), (4, 5, 2)), np.ones((8, 8, 3))), "estimate"),
            ((np.ones((8, 8, 3)), masked((8, 8, 3), (4, 5, 2))), "truth"),
        ):
            with pytest.raises(InputError, match=rf"^{name}: must be without masked values, first \(y, x, band\) is \(4, 5, 2\)"):
                metric(*pair)


def test_complex_numbers_are_refused_wherever_numbers_go_in(camera_of, cube_of):
    operator, cube = camera_of("mono", 1, 8, 3), cube_of(8, 3)
    frames = operator.forward(cube)
    for field, given in {"tau": {"tau": np.complex64(0.1)}, "start": {"start": cube + 0j}, "noise": {"noise": frames + 1j}}.items():
        with pytest.raises(InputError, match=rf"^{field}: must be "):
            reconstruct(operator, frames, **given)
    with pytest.raises(InputError, match=r"^tau: must be a finite number.*got 0\.1j"):
        reconstruct(operator, frames, tau=0.1j)
    with pytest.raises(InputError, match=r"^frames: must be real numbers, got 'an array of complex128'"):
        reconstruct(operator, frames + 1j)


@pytest.mark.parametrize("kind", [complex, object, str])
def test_scores_of_what_are_no_real_numbers_are_refused(kind):
    cube = np.ones((8, 8, 2))
    for pair, name in (((cube.astype(kind), cube), "estimate"), ((cube, cube.astype(kind)), "truth")):
        for metric in (score, psnr, rmse, spectral_angle):
            with pytest.raises(InputError, match=rf"^{name}: must be real numbers, got 'an array of "):
                metric(*pair)
    for bad in (1j, "1", [1.0]):
        with pytest.raises(InputError, match=r"^data_range: must be one real number"):
            score(cube, cube, bad)
    assert score(cube.astype(np.int8), cube.tolist()).exact


WRONG_KINDS = {
    "solver: a name": ("solver", {"solver": "admm"}),
    "solver: a class": ("solver", {"solver": Admm, "tau": 0.1}),
    "solver: something else": ("solver", {"solver": L1()}),
    "prior: a name": ("prior", {"prior": "tv"}),
    "prior: a class": ("prior", {"prior": TotalVariation}),
    "prior: a basis": ("prior", {"prior": Kronecker()}),
    "tau: a class": ("tau", {"tau": TauFraction}),
    "tau: an array": ("tau", {"tau": np.array(0.1)}),
    "tau: a name": ("tau", {"tau": "auto"}),
    "tau: True": ("tau", {"tau": True}),
    "on_iteration": ("on_iteration", {"on_iteration": 3}),
    "noise": ("noise", {"noise": "x"}),
    "noise: ragged": ("noise", {"noise": [[1, 2], [3]]}),
    "start": ("start", {"start": "a"}),
    "start: ragged": ("start", {"start": [[1, 2], [3]]}),
}


@pytest.mark.parametrize("case", WRONG_KINDS)
def test_things_of_the_wrong_kind_are_refused_by_name(case, camera_of):
    operator = camera_of("mono", 1, 8, 3)
    field, given = WRONG_KINDS[case]
    with pytest.raises(InputError, match=rf"^{field}: must be .*, got "):
        reconstruct(operator, np.ones(operator.out_shape), **given)


@pytest.mark.parametrize("frames", ["frames", None, [[1, 2], [3]], np.ones((1, 1, 8, 10)).astype(object), np.ones((1, 1, 8, 10), bool)])
def test_frames_of_the_wrong_kind_are_refused_by_name(frames, camera_of):
    with pytest.raises(InputError, match=r"^frames: must be (real numbers|an array of real numbers, not ragged)"):
        reconstruct(camera_of("mono", 1, 8, 3), frames)


@pytest.mark.parametrize("value", [np.nan, -1.0, 0.0, -np.inf])
def test_X6_a_variance_that_cannot_be_is_refused_with_count_and_place(value, camera_of):
    operator = camera_of("foveon", 2, 8, 3)
    noise = np.ones(operator.out_shape)
    noise[1, 2, 3, 4] = noise[1, 2, 5, 6] = value
    place = r"positive variances in squared units.*; 2 values are not, first \(shot, channel, row, column\) is \(1, 2, 3, 4\), got "
    with pytest.raises(InputError, match=rf"^noise: must be {place}{value}"):
        reconstruct(operator, np.ones(operator.out_shape), noise=noise)
    with pytest.raises(InputError, match=r"^noise: must be .*; 1 value is not, first is \(1, 0\), got "):
        reconstruct(operator, np.ones(operator.out_shape), noise=np.array([[1.0], [value], *[[1.0]] * 6]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_X6_a_start_that_is_not_finite_is_refused_with_count_and_place(value, camera_of):
    operator, start = camera_of("mono", 1, 8, 3), np.zeros((8, 8, 3))
    start[6, 5, 2] = start[7, 0, 0] = value
    with pytest.raises(
        InputError, match=rf"^start: must be a finite cube; 2 values are not, first \(row, column, band\) is \(6, 5, 2\), got {value}"
    ):
        reconstruct(operator, np.ones(operator.out_shape), start=start)


def spoiled(array, *places):
    array = np.array(array, float)
    for place in places:
        array[place] = np.nan
    return array


def test_what_makes_an_operator_or_a_basis_is_refused_with_count_and_place(camera_of):
    camera = camera_of("foveon", 2, 8, 3)
    cases = {
        r"^response: must be finite; 1 value is not, first \(curve, band\) is \(2, 1\), got nan": lambda: camera.replace(
            response=spoiled(camera.response, (2, 1))
        ),
        r"^taps: must be finite; 2 values are not, first \(band, tap\) is \(0, 0\), got nan": lambda: camera.replace(
            taps=spoiled(camera.taps, (0, 0), (2, 0))
        ),
        r"^masks: must be 0 or 1 .*; 2 values are not, first \(shot, row, column\) is \(1, 2, 3\), got nan": lambda: camera.replace(
            masks=spoiled(camera.masks, (1, 2, 3), (1, 7, 7))
        ),
        r"^weights: must be finite and at least 0; 1 value is not, first \(shot, .*\) is \(0, 1, 2, 3\), got nan": lambda: RowWeighted(
            camera, spoiled(np.ones(camera.out_shape), (0, 1, 2, 3))
        ),
        r"^samples: must be finite; 1 value is not, first \(sample, band\) is \(3, 1\), got nan": lambda: learned(
            spoiled(np.ones((5, 4)), (3, 1))
        ),
        r"^shift_px: must be .*; 1 value is not, first \(band\) is \(2,\), got nan": lambda: shift_taps(spoiled(np.ones(4), 2)),
        "^shift_px: must be real numbers, got 'abc'": lambda: shift_taps("abc"),
        "^response: must be real numbers": lambda: camera.replace(response=camera.response * 1j),
        "^masks: must be without masked values": lambda: camera.replace(masks=masked(camera.masks.shape, (0, 1, 1))),
    }
    for message, make in cases.items():
        with pytest.raises(InputError, match=message):
            make()
    assert camera.replace(masks=camera.masks.astype(bool)).masks.dtype == np.float64


@pytest.mark.parametrize("threads", [np.int64(1), np.uint8(2)])
def test_numpy_integers_are_numbers_of_threads(threads, camera_of):
    operator = camera_of("mono", 1, 8, 3)
    frames = np.ones(operator.out_shape)
    np.testing.assert_array_equal(
        reconstruct(operator, frames, threads=threads).cube, reconstruct(operator, frames, threads=int(threads)).cube
    )
    for bad in (np.int64(0), np.float64(1), np.bool_(True), "2"):
        with pytest.raises(InputError, match=r"^threads: must be an integer of at least 1"):
            reconstruct(operator, frames, threads=bad)


@pytest.mark.parametrize("bad", ["no", 0, None, np.ones(2, bool)])
def test_nonnegative_is_yes_or_no(bad, camera_of):
    operator = camera_of("mono", 1, 8, 3)
    with pytest.raises(InputError, match=r"^nonnegative: must be True or False, got "):
        reconstruct(operator, np.ones(operator.out_shape), nonnegative=bad)
    assert reconstruct(operator, np.ones(operator.out_shape), nonnegative=np.bool_(True)).cube.min() >= 0


@pytest.mark.parametrize("part", ["forward", "adjoint"])
@pytest.mark.parametrize("solver", [Fista(), Gpsr(), Admm(), BasisPursuit(), Gap()], ids=lambda s: type(s).__name__)
def test_an_operator_that_works_in_place_is_stopped_before_it_spoils_the_solve(part, solver):
    operator = Matrix(np.random.Generator(np.random.Philox(3)).random((20, 24)), (2, 4, 3))
    right = getattr(operator, part)

    def in_place(array):
        array *= 2
        return right(array)

    setattr(operator, part, in_place)
    with pytest.raises(ValueError, match="read-only"):
        reconstruct(operator, np.ones(20), solver=solver, tau=0.1 if solver.needs_tau else None)


class Knowing(Matrix):
    """A dense matrix that also tells its H H^T: in blocks where ``reach`` is 1, else in bands."""

    def __init__(self, reach, dtype=np.float64):
        draw = np.random.Generator(np.random.Philox(reach))
        chains = np.zeros((30, 36))  # 5 groups of 6 measurements: of one pixel, or of a row whose neighbours share voxels
        for b in range(5):
            for i in range(6):
                chains[6 * b + i, 7 * b : 7 * b + 7] = draw.random(7) * (1 if reach == 1 else (np.abs(np.arange(7) - i) < reach / 2))
        super().__init__(chains, (3, 4, 3), dtype)
        self.index, self.gram = np.arange(30).reshape(5, 6), chains @ chains.T
        self.reach = reach

    def gram_blocks(self):
        blocks = self.gram[self.index[:, :, None], self.index[:, None, :]]
        if self.reach == 1:
            return GramBlocks(self.index, blocks)
        bands = np.zeros((5, 6, self.reach))
        for d in range(self.reach):
            bands[:, d:, d] = np.diagonal(blocks, -d, 1, 2)
        return GramBands(self.index, bands)


def without_neighbours(operator):
    operator.gram = np.diag(np.diag(operator.gram))


def in_another_order(operator):
    right = operator.gram_blocks()
    matrix = right.matrix if operator.reach == 1 else right.bands
    operator.gram_blocks = lambda: type(right)(np.roll(operator.index, 1), matrix)


def twice_too_large(operator):
    operator.gram = 2 * operator.gram


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("reach", [1, 3])
@pytest.mark.parametrize("wrong", [None, twice_too_large, without_neighbours, in_another_order])
def test_a_gram_that_is_not_h_ht_is_told_and_not_used(wrong, reach, dtype):
    operator, plain = Knowing(reach, dtype), Matrix(Knowing(reach).matrix, (3, 4, 3), dtype)
    frames = operator.forward(np.random.Generator(np.random.Philox(1)).random(operator.in_shape))
    if wrong is not None:
        wrong(operator)
    for solver, tau in ((Admm(), 0.05), (BasisPursuit(max_iterations=30), None), (Gap(max_iterations=30), None)):
        for noise in (None, np.ones(30)):
            found = reconstruct(operator, frames, solver=solver, tau=tau, noise=noise)
            assert (wrong is not None) == any(note.startswith("gram_blocks is not H H^T") for note in found.notes[:1])
            if wrong is not None:
                without = reconstruct(plain, frames, solver=solver, tau=tau, noise=noise)
                np.testing.assert_array_equal(found.cube, without.cube)
                assert found.stop == without.stop
    assert not any("gram_blocks" in note for note in reconstruct(operator, frames, solver=Fista(), tau=0.05).notes)
    own = reconstruct(RowWeighted(operator, np.full(30, 2.0)), frames, tau=0.05)
    assert (wrong is not None) == ("gram_blocks is not H H^T" in str(own))


@pytest.mark.parametrize(("dtype", "off"), [(np.float32, 1.01), (np.float64, 1.0001)])
def test_a_wrong_adjoint_is_told_first_and_nothing_is_called_converged(dtype, off):
    operator = Knowing(1, dtype)
    frames = operator.forward(np.random.Generator(np.random.Philox(1)).random(operator.in_shape))
    assert reconstruct(operator, frames, tau=0.05).stop.converged
    right, seen = operator.adjoint, []
    operator.adjoint = lambda y: right(y) * off
    weighted = RowWeighted(operator, np.full(30, 2.0))
    for given in ({"tau": 0.05}, {"tau": 0.05, "solver": Fista()}, {"solver": Gap()}, {"tau": 0.05, "noise": np.ones(30)}):
        for taken in (operator, weighted):
            found = reconstruct(taken, frames, on_iteration=lambda i, value: seen.append(value), **given)
            assert found.notes[0].startswith("adjoint is not the transpose of forward")
            assert not found.stop.converged
    assert seen


CONFIGURATIONS = {
    r"^TauFraction: must be given keyword arguments only: fraction=\.\.\., got \(0\.001,\)": lambda: TauFraction(1e-3),
    r"^Gpsr\.max_iteration: must be a field of Gpsr, which are .*tolerance; did you mean max_iterations\?, got 3": lambda: Gpsr(
        max_iteration=3
    ),
    r"^Cosine\.size: must be left out: Cosine has no fields, got 1": lambda: Cosine(size=1),
    r"^PlugAndPlay\.denoiser: must be given: it has no default": lambda: PlugAndPlay(),
    r"^Mixture\.parts: must be a tuple with at least 1 item": lambda: Mixture(parts=()),
    r"^Admm\.tolerance: must be less than 1, got 2": lambda: Admm(tolerance=2),
    r"^L1\.weights\.1: must be a finite number, got nan": lambda: L1(weights=(1.0, np.nan)),
}


@pytest.mark.parametrize("message", CONFIGURATIONS)
def test_a_configuration_says_in_a_sentence_what_is_wrong_with_it(message):
    with pytest.raises(InputError, match=message):
        CONFIGURATIONS[message]()


def test_what_is_given_to_rules_and_error_estimates_is_checked_for_its_kind(camera_of):
    operator = camera_of("mono", 1, 8, 3)
    frames, variance = np.ones(operator.out_shape), np.ones(operator.out_shape)
    for call in (
        lambda: estimate_error(operator, frames, variance),
        lambda: AutoTau().choose(operator, frames, variance),
        lambda: Discrepancy().choose(operator, frames, variance),
        lambda: TauFraction(fraction=0.1).choose(operator, frames, variance),
        lambda: TauPath().follow(operator, frames, variance),
    ):
        with pytest.raises(InputError, match=r"^given: must be recon\.tau\.Given"):
            call()
    for field, make in {
        "prior": lambda: Given(variance),
        "noise": lambda: Given(noise="x"),
        "nonnegative": lambda: Given(nonnegative="no"),
    }.items():
        with pytest.raises(InputError, match=rf"^{field}: must be "):
            make()


def test_the_adjoint_and_the_norm_of_any_operator_can_be_measured():
    class Bare:
        in_shape, out_shape = (2, 4, 3), (20,)
        matrix = np.random.Generator(np.random.Philox(3)).random((20, 24))

        def forward(self, x):
            return self.matrix @ x.ravel()

        def adjoint(self, y):
            return (self.matrix.T @ y).reshape(2, 4, 3)

    assert adjoint_error(Bare()) < 1e-6
    assert norm_squared(Bare()) == pytest.approx(np.linalg.norm(Bare.matrix, 2) ** 2, rel=1e-3)
    with pytest.raises(InputError, match="adjoint missing"):
        adjoint_error(type("Half", (), {"in_shape": (1, 1, 1), "out_shape": (1,), "forward": None})())


@pytest.mark.parametrize("solver", [BasisPursuit(), Gap()], ids=["basis-pursuit", "gap"])
def test_frames_that_h_cannot_explain_raise_the_question_why(solver, camera_of, cube_of):
    camera = camera_of("mono", 6, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    assert not any("explains" in note for note in reconstruct(camera, frames, solver=solver).notes)
    shifted = camera.replace(first_column=np.array([0, 1, 2, 4]), width=camera.width)
    for wrong, given in (
        (reconstruct(shifted, frames, solver=solver), frames),
        (reconstruct(camera, frames + 0.1, solver=solver), frames + 0.1),
    ):
        left = np.linalg.norm(given - (shifted if given is frames else camera).forward(wrong.cube)) / np.linalg.norm(given)
        assert left > 1e-3
        assert any(note.startswith(f"H explains all but {100 * left:.2g} % of the frames") for note in wrong.notes)
        assert wrong.stop.converged


def test_X7_a_field_camera_whose_pixels_are_all_blind_is_refused_when_it_is_used():
    spread = Spread(taps=np.ones((2, 1, 1, 1, 1)), first_row=np.zeros((2, 1, 1), int), first_column=np.arange(2)[:, None, None])
    mosaic = np.zeros((4, 5), int)
    response = np.array([[0.0, 0.0], [1.0, 1.0]])
    blind = FieldAperture(np.ones((1, 4, 4)), response, spread, mosaic=mosaic)
    with pytest.raises(InputError, match=r"^operator: must be different from 0 on the sensor: the camera sees nothing"):
        reconstruct(blind, np.ones(blind.out_shape))
    mosaic[2, 3] = 1
    assert reconstruct(blind.replace(mosaic=mosaic), np.ones(blind.out_shape)).cube.any()
