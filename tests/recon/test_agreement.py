"""Solvers agree with each other and with pylops and pyproximal; scale, single bands, many bands, threads and memory change nothing."""

import numpy as np
import pytest

from recon import (
    L1,
    Admm,
    BasisPursuit,
    CodedAperture,
    Fista,
    Gap,
    Gpsr,
    GroupL1,
    InputError,
    Kronecker,
    Quality,
    SpectralTotalVariation,
    TotalVariation,
    reconstruct,
)

TIGHT = {
    "admm": Admm(tolerance=2e-7, max_iterations=20000),
    "fista": Fista(tolerance=1e-10, max_iterations=20000),
    "gpsr-bb": Gpsr(tolerance=1e-10, max_iterations=20000),
    "gpsr-basic": Gpsr(tolerance=1e-10, max_iterations=20000, barzilai_borwein=False),
    "gpsr-free": Gpsr(tolerance=1e-10, max_iterations=20000, monotone=False, continuation_steps=1),
}


def slow(value):
    """Mark a case that repeats what others show already."""
    return pytest.param(value, marks=pytest.mark.slow)


def flat(cube):
    """Band-major, as pylops gets it."""
    return np.ascontiguousarray(cube.transpose(2, 0, 1)).ravel()


class Theirs:
    """The camera and the basis as pylops operators, from pylops' own parts."""

    def __init__(self, camera, wavelet, level):
        import pylops

        rows, columns, bands = camera.in_shape
        blocks = []
        for mask in camera.masks:
            for curve in camera.response:
                pads = []
                for k in range(bands):
                    pad = pylops.Pad((rows, columns), ((0, 0), (k, camera.width - columns - k)))
                    pads.append(curve[k] * (pad @ pylops.Diagonal(mask.ravel())))
                blocks.append(pylops.HStack(pads, forceflat=True))
        self.h = pylops.VStack(blocks, forceflat=True)
        transform = pylops.signalprocessing.DWT2D((bands, rows, columns), axes=(1, 2), wavelet=wavelet, level=level)
        self.psi = pylops.signalprocessing.DCT(transform.dimsd, axes=0) @ transform
        self.step = 1 / np.linalg.norm(camera.dense(), 2) ** 2


@pytest.fixture(scope="module")
def peers(camera_of, cube_of):
    """A camera, its frames, tau, basis, and what a tight solve of ours says."""
    camera = camera_of("foveon", 1, 16, 6)
    frames = camera.forward(cube_of(16, 6))
    basis = Kronecker(wavelet="db2", level=2)
    tau = 3e-2 * reconstruct(camera, frames, prior=L1(basis=basis), tau=1e9).tau_max
    ours = reconstruct(camera, frames, prior=L1(basis=basis), tau=tau, solver=TIGHT["admm"])
    return camera, frames, tau, basis, ours.objective, Theirs(camera, "db2", 2)


def eq4(peers, vector):
    camera, frames, tau, basis = peers[:4]
    rows, columns, bands = camera.in_shape
    cube = np.asarray(vector).reshape(bands, rows, columns).transpose(1, 2, 0)
    return ((frames - camera.forward(cube)) ** 2).sum() + tau * np.abs(basis.analysis(cube)).sum()


@pytest.mark.slow
def test_pylops_fista_reaches_the_same_objective_to_1e_5(peers):
    import pylops

    _, frames, tau, _, ours, theirs = peers
    settings = {"niter": 600, "eps": tau, "alpha": theirs.step, "tol": 0}
    found = pylops.optimization.sparsity.fista(theirs.h, frames.ravel(), SOp=theirs.psi.H, **settings)[0]
    assert eq4(peers, found) == pytest.approx(ours, rel=1e-5)


@pytest.mark.filterwarnings("ignore:AcceleratedProximalGradient:FutureWarning")
def test_pyproximal_accelerated_gradient_reaches_the_same_objective_to_1e_5(peers):
    import pyproximal

    camera, frames, tau, _, ours, theirs = peers
    g, size = frames.ravel(), int(np.prod(camera.in_shape))
    misfit = pyproximal.L2(Op=theirs.h, b=g, sigma=2.0, niter=200, warm=True)
    prior = pyproximal.Orthogonal(pyproximal.L1(sigma=tau), theirs.psi)
    solve = pyproximal.optimization.primal.AcceleratedProximalGradient
    found = solve(misfit, prior, x0=np.zeros(size), tau=theirs.step / 2, niter=600, acceleration="fista", show=False)
    assert eq4(peers, found) == pytest.approx(ours, rel=1e-5)


@pytest.mark.parametrize("name", ["fista", "gpsr-bb", slow("gpsr-basic"), slow("gpsr-free")])
@pytest.mark.parametrize(
    ("sensor", "shots", "spread", "shape"),
    [("mono", 3, False, (16, 16)), ("bayer", 2, False, (16, 16)), ("foveon", 1, True, (16, 16)), ("mono", 2, False, (15, 13))],
)
def test_every_solver_reaches_the_same_objective_to_1e_5(name, sensor, shots, spread, shape, camera_of, cube_of):
    camera = camera_of(sensor, shots, 16, 6, spread=spread)
    if shape != (16, 16):
        camera = camera.replace(masks=camera.masks[:, : shape[0], : shape[1]])
    frames = camera.forward(cube_of(16, 6)[: shape[0], : shape[1]])
    tau = 1e-2 * reconstruct(camera, frames, tau=1e9).tau_max
    judge = reconstruct(camera, frames, tau=tau, solver=TIGHT["admm"])
    found = reconstruct(camera, frames, tau=tau, solver=TIGHT[name])
    assert judge.stop.converged
    assert found.stop.converged
    assert found.objective == pytest.approx(judge.objective, rel=1e-5)


EXACT = [
    (BasisPursuit(), None),
    (Gap(), None),
    (Admm(), 0),
    (Fista(tolerance=1e-13, max_iterations=20000), 0),
    (Gpsr(tolerance=1e-13), 0),
    (Gpsr(tolerance=1e-13, barzilai_borwein=False, debias=True), 0),
]
EXACT_NAMES = ["basis-pursuit", "gap", "admm", "fista", "gpsr-bb", "gpsr-basic"]


@pytest.mark.parametrize(("solver", "tau"), EXACT, ids=EXACT_NAMES)
def test_X1_one_band_and_an_open_mask_are_the_identity_for_every_solver(solver, tau, cube_of):
    camera, truth = CodedAperture(np.ones((1, 8, 8)), np.ones((1, 1)), np.zeros(1, int), np.ones((1, 1))), cube_of(8, 1)
    found = reconstruct(camera.astype(np.float64), camera.astype(np.float64).forward(truth), solver=solver, tau=tau)
    np.testing.assert_allclose(found.cube, truth, atol=1e-12)


@pytest.mark.parametrize("generic", [False, True])
@pytest.mark.parametrize(("solver", "tau"), EXACT, ids=EXACT_NAMES)
def test_X2_an_invertible_system_gives_the_truth_by_every_solver(solver, tau, generic):
    draw = np.random.Generator(np.random.Philox(4))
    masks = np.stack([np.ones((4, 3)), draw.integers(0, 2, (4, 3)), 1 - np.eye(4, 3), np.eye(4, 3)])
    response = draw.random((3, 4)) + 2 * np.eye(3, 4)
    camera = CodedAperture(masks, response, np.arange(4), np.ones((4, 1)), dtype=np.float64)
    truth = draw.random(camera.in_shape)
    frames = camera.forward(truth)
    dense, g = camera.dense(), frames.transpose(0, 1, 3, 2).ravel()
    assert np.linalg.matrix_rank(dense) == truth.size
    cube = reconstruct(Foreign(camera) if generic else camera, frames, solver=solver, tau=tau).cube
    np.testing.assert_allclose(cube, truth, atol=1e-8)
    np.testing.assert_allclose(cube.transpose(2, 1, 0).ravel(), np.linalg.lstsq(dense, g, rcond=None)[0], atol=1e-8)


class Foreign:
    """One of our cameras of which only forward and adjoint show."""

    def __init__(self, camera):
        self.in_shape, self.out_shape, self.dtype = camera.in_shape, camera.out_shape, camera.dtype
        self.forward, self.adjoint = lambda x: camera.forward(x), lambda y: camera.adjoint(y)


OTHERS = [
    L1(weights=(1.0, 1.5, 2.0, 2.5, 3.0, 3.5)),
    GroupL1(),
    TotalVariation(),
    SpectralTotalVariation(weights=(1.0, 1.5, 2.0, 2.5, 3.0, 3.5)),
    Quality(),
]


@pytest.mark.parametrize("prior", OTHERS, ids=lambda p: type(p).__name__)
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("foveon", 1)])
def test_admm_and_fista_agree_to_1e_5_under_every_prior(sensor, shots, prior, camera_of, cube_of):
    camera = camera_of(sensor, shots, 16, 6)
    frames = camera.forward(cube_of(16, 6))
    tau = 1e-2 * 2 * np.abs(camera.adjoint(frames)).max()
    values = []
    for solver in (Admm(tolerance=1e-6, max_iterations=5000), Fista(tolerance=1e-9, max_iterations=5000)):
        found = reconstruct(camera, frames, prior=prior, tau=tau, solver=solver)
        judge = prior.bind(found.cube.shape, np.float64)
        values.append(((frames - camera.forward(found.cube)) ** 2).sum() + tau * judge.value(found.cube))
        assert found.objective == pytest.approx(values[-1], rel=1e-6)
    assert values[0] == pytest.approx(values[1], rel=1e-5)


METHODS = {
    "gap-tv": {"prior": TotalVariation(), "solver": Gap()},
    "gap-l1": {"solver": Gap()},
    "quality": {"prior": Quality()},
    "quality-tau": {"prior": Quality(), "tau": 0.02},
    "tv-admm": {"prior": TotalVariation(), "tau": 0.02},
    "tv-fista": {"prior": TotalVariation(), "tau": 0.02, "solver": Fista()},
    "gpsr-basic": {"tau": 0.02, "solver": Gpsr(barzilai_borwein=False)},
    "gpsr-debias": {"tau": 0.5, "solver": Gpsr(debias=True)},
    "bounded": {"tau": 0.02, "nonnegative": True},
    "weighted": {"tau": 0.02, "noise": True},
}


@pytest.mark.parametrize("settings", METHODS.values(), ids=METHODS)
def test_every_method_serves_an_operator_that_has_forward_and_adjoint_only(settings, camera_of, cube_of):
    camera, truth = camera_of("mono", 3, 16, 6), cube_of(16, 6)
    frames = camera.forward(truth)
    asked = dict(settings)
    if "noise" in asked:
        asked["noise"] = np.random.Generator(np.random.Philox(2)).uniform(0.5, 2, frames.shape)
    ours, theirs = (reconstruct(h, frames, **asked) for h in (camera, Foreign(camera)))
    assert ours.stop.converged
    assert theirs.stop.converged
    assert theirs.objective == pytest.approx(ours.objective, rel=1e-3)
    assert np.linalg.norm(theirs.cube - ours.cube) < 0.02 * np.linalg.norm(ours.cube)


PRIORS = [L1(), L1(weights=(1.0, 1.5, 2.0, 2.5, 3.0, 3.5)), GroupL1(), TotalVariation(), SpectralTotalVariation()]


@pytest.mark.parametrize("scale", [1e-30, slow(1e-9), slow(1e9), 1e30])
@pytest.mark.parametrize("prior", PRIORS, ids=lambda p: type(p).__name__)
def test_X8_every_prior_scales_from_1e_30_to_1e30(prior, scale, camera_of, cube_of):
    camera = camera_of("foveon", 1, 16, 6, dtype=np.float32)
    frames = camera.astype(np.float64).forward(cube_of(16, 6))
    for solver, tau in ((BasisPursuit(max_iterations=60), None), (Admm(max_iterations=60), 0.02), (Fista(max_iterations=60), 0.02)):
        plain = reconstruct(camera, frames, prior=prior, solver=solver, tau=tau, nonnegative=True, noise=1.0)
        scaled = reconstruct(
            camera, frames * scale, prior=prior, solver=solver, tau=None if tau is None else tau * scale, nonnegative=True, noise=scale**2
        )
        np.testing.assert_allclose(scaled.cube.astype(np.float64) / scale, plain.cube, atol=1e-6 * plain.cube.max())
        assert scaled.objective == pytest.approx(plain.objective * (scale if tau is None else scale**2), rel=1e-5)
        assert scaled.iterations == plain.iterations


@pytest.mark.parametrize("prior", PRIORS[::2], ids=lambda p: type(p).__name__)
@pytest.mark.parametrize(("solver", "tau"), [(BasisPursuit(), None), (Admm(), 0.01), (Fista(), 0.01), (Gpsr(), 0.01)])
@pytest.mark.parametrize("shape", [(16, 12, 1), (6, 8, 20), (1, 1, 3), slow((1, 9, 4)), slow((13, 7, 2))])
def test_single_bands_more_bands_than_columns_and_odd_sides_are_solved(shape, solver, tau, prior, camera_of):
    rows, columns, bands = shape
    masks = np.random.Generator(np.random.Philox(8)).integers(0, 2, (2, rows, columns))
    masks[0] |= 1 - masks[1]
    camera = CodedAperture(masks, np.ones((1, bands)), np.arange(bands), np.ones((bands, 1)))
    assert camera.width == columns + bands - 1
    truth = np.full(shape, 0.7)
    frames = camera.forward(truth)
    if isinstance(solver, Gpsr) and not isinstance(prior, L1):
        with pytest.raises(InputError, match=r"^prior: must be L1"):
            reconstruct(camera, frames, prior=prior, solver=solver, tau=tau)
        return
    found = reconstruct(camera, frames, prior=prior, solver=solver, tau=tau)
    assert found.cube.shape == shape
    assert np.isfinite(found.cube).all()
    assert found.residual < 0.1
    if bands == 1 and tau is None:
        np.testing.assert_allclose(found.cube, truth, atol=1e-10)


SETTINGS = {
    "basis-pursuit": {},
    "bounded": {"nonnegative": True},
    "weighted": {"tau": 0.02, "noise": True},
    "group": {"tau": 0.02, "prior": GroupL1()},
    "fista": {"tau": 0.02, "solver": Fista(max_iterations=25), "nonnegative": True},
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("generic", [False, slow(True)])
def test_bytes_depend_on_neither_threads_nor_the_place_in_memory(settings, generic, camera_of, cube_of):
    camera = camera_of("bayer", 2, 24, 6, dtype=np.float32)
    frames = camera.astype(np.float64).forward(cube_of(24, 6))
    variance = np.random.Generator(np.random.Philox(2)).uniform(0.5, 2, frames.shape)

    class Foreign:
        in_shape, out_shape = camera.in_shape, camera.out_shape
        forward, adjoint = staticmethod(lambda x: camera.forward(x)), staticmethod(lambda y: camera.adjoint(y))

    elsewhere, answers = [], set()
    asked = dict(settings) | ({"noise": variance} if "noise" in settings else {})
    asked.setdefault("solver", BasisPursuit(max_iterations=25) if "tau" not in asked else Admm(max_iterations=25))
    for threads in (1, 2, 3, 1, 2):
        elsewhere.append(np.empty(1237 * threads, np.uint8))
        answers.add(reconstruct(Foreign() if generic else camera, frames.copy(), threads=threads, **asked).cube.tobytes())
    assert len(answers) == 1
