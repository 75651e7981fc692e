"""The cameras and the peers of ``benchmarks.recon``: pylops and pyproximal on the same operator, basis, step and tau."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from recon import L1, Kronecker, coordinates
from recon.coded_aperture import CodedAperture
from recon.data_step import largest_eigenvalue
from recon.fista import Descent
from recon.problem import Problem, pose

WAVELET, LEVEL = "db2", 5
FRACTION = 1e-3
"""tau of the race, of tau_max."""


def best_ms(repeats: int, tasks: dict[str, Callable[[], Any]], clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
    """Time tasks in turn, ``repeats`` rounds, and keep each one's shortest time in ms."""
    for task in tasks.values():
        task()
    best = dict.fromkeys(tasks, np.inf)
    for _ in range(repeats):
        for name, task in tasks.items():
            began = clock()
            task()
            best[name] = min(best[name], (clock() - began) * 1e3)
    return best


def camera(size: int, bands: int, shots: int = 1, channels: int = 1, taps: int = 1, mosaic: bool = False) -> CodedAperture:
    """Return a matched camera; ``taps`` = 3 spreads each band over three columns, as the camera's own optics do."""
    draw = np.random.Generator(np.random.Philox(0))
    response = np.ones((1, bands)) if channels == 1 else draw.random((channels, bands))
    weights = np.ones((bands, 1)) if taps == 1 else np.tile([0.125, 0.75, 0.125], (bands, 1))
    width = size + bands - 2 + taps
    pattern = np.array([[0, 1], [1, 2]])[np.arange(size)[:, None] % 2, np.arange(width) % 2] if mosaic else None
    masks = draw.integers(0, 2, (shots, size, size))
    return CodedAperture(masks, response, np.arange(bands), weights, mosaic=pattern, width=width, dtype=np.float32)


def patches(size: int, bands: int) -> np.ndarray:
    """Return patches of smooth spectra, peak 1."""
    draw = np.random.Generator(np.random.Philox(1))
    position = np.linspace(0, 1, bands)
    cube = np.zeros((size, size, bands), np.float32)
    for y in range(0, size, size // 4):
        for x in range(0, size, size // 4):
            cube[y : y + size // 4 - 3, x : x + size // 4 - 3] = np.exp(-(((position - draw.random()) / draw.uniform(0.2, 0.6)) ** 2))
    return cube / cube.max()


@dataclass(frozen=True)
class Race:
    """One l1 problem for all: normalised, as recon's solvers see it, in bands and in the coordinates they use."""

    problem: Problem
    turned: Problem
    bound: float
    tau: float


def race_of(operator: CodedAperture) -> Race:
    """Return the race on a camera's frames of ``patches``."""
    size, _, bands = operator.in_shape
    prior = L1(basis=Kronecker(wavelet=WAVELET, level=LEVEL))
    problem = pose(operator, operator.forward(patches(size, bands)), prior)
    assert problem is not None
    matrix = coordinates.shared_matrix(problem)
    assert matrix is not None
    tau = FRACTION * problem.reference_tau()
    return Race(problem, coordinates.turned(problem, matrix), largest_eigenvalue(problem.operator), tau)


def ours(race: Race, iterations: int) -> np.ndarray:
    """Run recon's FISTA and return its last iterate in bands."""
    descent = Descent(race.turned, race.bound)
    for _ in range(iterations + 1):
        descent.iterate(race.tau)
    matrix = coordinates.shared_matrix(race.problem)
    assert matrix is not None
    return np.asarray(descent.best @ matrix)


def peers(race: Race) -> dict[str, Callable[[int], np.ndarray]]:
    """Return ``run(iterations) -> cube`` of each peer."""
    import pylops
    from pylops.optimization.sparsity import fista
    from pyproximal import L1 as ProximalL1
    from pyproximal import L2
    from pyproximal.optimization.primal import AcceleratedProximalGradient

    operator = race.problem.operator
    assert isinstance(operator, CodedAperture)
    h, psi = pylops_operator(operator), pylops_basis(operator.in_shape)
    data = race.problem.frames.ravel().astype(np.float32)
    rows, columns, bands = operator.in_shape

    def as_cube(flat: np.ndarray) -> np.ndarray:
        return np.asarray(flat).reshape(bands, rows, columns).transpose(1, 2, 0)

    def run_pylops(iterations: int) -> np.ndarray:
        return as_cube(fista(h, data, niter=iterations, eps=race.tau, alpha=1 / race.bound, SOp=psi.H, tol=0)[0])

    def run_pyproximal(iterations: int) -> np.ndarray:
        # ||g - A theta||^2 / 2 + tau / 2 ||theta||_1 with A = H Psi: half of Eq. 4, step 1 / L
        misfit, norm = L2(Op=h @ psi.H, b=data), ProximalL1(sigma=race.tau / 2)
        theta = AcceleratedProximalGradient(
            misfit, norm, x0=np.zeros(psi.shape[0], np.float32), tau=1 / race.bound, niter=iterations, acceleration="fista"
        )
        return as_cube(psi.H @ theta)

    assert pylops.__version__
    return {"pylops": run_pylops, "pyproximal": run_pyproximal}


def pylops_operator(operator: CodedAperture) -> Any:
    """Return H of a one-tap monochrome camera from pylops' own parts, band-major."""
    import pylops

    rows, columns, bands = operator.in_shape
    shots = []
    for mask in operator.masks:
        pads = [pylops.Pad((rows, columns), ((0, 0), (k, operator.width - columns - k)), dtype=np.float32) for k in range(bands)]
        diagonal = pylops.Diagonal(mask.ravel().astype(np.float32), dtype=np.float32)
        shots.append(pylops.HStack([pad @ diagonal for pad in pads], forceflat=True, dtype=np.float32))
    return shots[0] if len(shots) == 1 else pylops.VStack(shots, forceflat=True, dtype=np.float32)


def pylops_basis(shape: tuple[int, ...]) -> Any:
    """Return Psi^T from pylops' DWT2D and DCT."""
    import pylops

    rows, columns, bands = shape
    wavelet = pylops.signalprocessing.DWT2D((bands, rows, columns), axes=(1, 2), wavelet=WAVELET, level=LEVEL, dtype=np.float32)
    return pylops.signalprocessing.DCT(wavelet.dimsd, axes=0, dtype=np.float32) @ wavelet
