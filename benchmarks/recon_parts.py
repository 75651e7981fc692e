"""The parts of an l1 iteration against memory streaming, for ``benchmarks.recon``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from benchmarks.recon_peers import LEVEL, WAVELET, Race, best_ms, camera, race_of
from recon import Kronecker, threads
from recon.coded_aperture import CodedAperture, empty_cube
from recon.data_step import data_step
from recon.fista import Descent
from recon.spectral_kernels import copy_some
from recon.turning import turn


class Part(NamedTuple):
    """One part: ms, bytes it must read and write, and how many times longer it takes than a copy that moves as many."""

    ms: float
    megabytes: float
    times: float


@njit(nogil=True, cache=True)
def copy_slabs(first: int, last: int, source: Any, out: Any) -> None:
    """Copy rows of a flat array."""
    size = source.size // 64
    copy_some(source, first * size, (last - first) * size, out, first * size)


def stages(race: Race, repeats: int) -> dict[str, Part]:
    """Time the two stages of an l1 iteration and a whole one."""
    operator, penalty = race.turned.operator, race.turned.penalty
    assert isinstance(operator, CodedAperture)
    descent = Descent(race.turned, race.bound)
    cube = _bytes(operator.in_shape)
    frames = _bytes(operator.out_shape)
    x, old = empty_cube(operator.in_shape, np.float32), empty_cube(operator.in_shape, np.float32)
    x[...] = old[...] = 1
    seen = operator.forward(x)
    masks = operator.masks.size * 4
    tasks: dict[str, tuple[Callable[[], Any], float]] = {
        "rows: C^T, H, step, H^T, C": (
            lambda: operator.descend(x, old, seen, 0.5, 1e-3, race.turned.frames),
            3 * cube + 3 * frames + masks,  # reads x, old, g, H old, masks; writes old, H old
        ),
        "bands: W, threshold, W^T": (lambda: penalty.shrink(old, 1e-6), 2 * cube),
        "iteration": (lambda: descent.iterate(race.tau), 5 * cube + 3 * frames + masks),
    }
    return _against_streaming(tasks, cube, repeats)


def applications(size: int, bands: int, repeats: int) -> dict[str, Part]:
    """Time H and H^T of each kind of camera against the bytes of cube and frames."""
    kinds = {
        "mono x1": (1, 1, 1, False),
        "mono x3": (3, 1, 1, False),
        "Bayer x1": (1, 3, 1, True),
        "Foveon x1": (1, 3, 1, False),
        "mono x1, 3 columns a band": (1, 1, 3, False),
        "Foveon x1, 3 columns a band": (1, 3, 3, False),
    }
    x, back = empty_cube((size, size, bands), np.float32), empty_cube((size, size, bands), np.float32)
    x[...] = 1
    tasks: dict[str, tuple[Callable[[], Any], float]] = {}
    for name, kind in kinds.items():
        shots, channels, taps, mosaic = kind
        operator = camera(size, bands, shots, channels, taps, mosaic)
        frames = operator.forward(x)
        moved = _bytes(operator.in_shape) + frames.nbytes
        tasks[f"H   {name}"] = (lambda o=operator, f=frames: o.forward(x, f), moved)
        tasks[f"H^T {name}"] = (lambda o=operator, f=frames: o.adjoint(f, back), moved)
    return _against_streaming(tasks, x.nbytes, repeats)


def bases(size: int, bands: int, repeats: int) -> dict[str, Part]:
    """Time the threshold and the transforms alone."""
    cube, other = empty_cube((size, size, bands), np.float32), empty_cube((size, size, bands), np.float32)
    cube[...] = np.random.Generator(np.random.Philox(2)).random(cube.shape)
    memory = cube.transpose(2, 0, 1)
    tasks: dict[str, tuple[Callable[[], Any], float]] = {}
    for wavelet in ("haar", "db2", "db4", "sym8"):
        basis = Kronecker(wavelet=wavelet, level=LEVEL)
        tasks[f"{wavelet}: W, threshold, W^T"] = (lambda b=basis: b.shrink_bands(memory, 1e-7), 2 * cube.nbytes)
    basis = Kronecker(wavelet=WAVELET, level=LEVEL)
    matrix = basis.spectral.matrix(bands, np.float32)
    any_ = np.linalg.qr(np.random.Generator(np.random.Philox(3)).standard_normal((bands, bands)))[0].astype(np.float32)
    tasks["DCT of all spectra"] = (lambda: turn(matrix, memory, memory), 2 * cube.nbytes)
    tasks["learned basis of all spectra"] = (lambda: turn(any_, memory, memory), 2 * cube.nbytes)
    tasks[f"Psi^T ({WAVELET}), packed"] = (lambda: basis.analysis(cube, other), 4 * cube.nbytes)
    tasks[f"Psi ({WAVELET})"] = (lambda: basis.synthesis(cube, other), 6 * cube.nbytes)
    return _against_streaming(tasks, cube.nbytes, repeats)


def own_camera(size: int, bands: int, repeats: int) -> dict[str, float]:
    """Return the times of a camera that spreads a band over three columns over those of the matched one."""
    tasks: dict[str, Callable[[], Any]] = {}
    for name, taps in (("matched", 1), ("own", 3)):
        race = race_of(camera(size, bands, taps=taps))
        descent = Descent(race.turned, race.bound)
        step = data_step(race.turned.operator, race.turned.exact_frames, 0.0, mixed=True)
        z, w, x = (empty_cube(race.turned.operator.in_shape, np.float32).transpose(2, 0, 1) for _ in range(3))
        for cube in (z, w, x):
            cube[...] = 0

        def pursue(race: Race = race, step: Any = step, z: np.ndarray = z, w: np.ndarray = w, x: np.ndarray = x) -> None:
            race.turned.penalty.shrink(w.transpose(1, 2, 0), 1e-6)
            step.advance(z, w, x, 1.8)

        tasks[f"FISTA {name}"] = lambda d=descent, r=race: d.iterate(r.tau)
        tasks[f"basis pursuit {name}"] = pursue
    timed = best_ms(repeats, tasks)
    found = {f"{name} iteration, own / matched": timed[f"{name} own"] / timed[f"{name} matched"] for name in ("FISTA", "basis pursuit")}
    found["basis pursuit / FISTA iteration, matched"] = timed["basis pursuit matched"] / timed["FISTA matched"]
    return found


def scaling(sizes: tuple[int, ...], bands: int, repeats: int) -> dict[int, float]:
    """Return ns a voxel of one FISTA iteration by the picture's side."""
    found = {}
    for size in sizes:
        race = race_of(camera(size, bands))
        descent = Descent(race.turned, race.bound)
        took = best_ms(repeats, {"": lambda d=descent, r=race: d.iterate(r.tau)})[""]
        found[size] = took * 1e6 / (size * size * bands)
    return found


def memory(size: int, bands: int) -> dict[str, float]:
    """Return the peak memory of a solve of each kind in cubes of float32, frames and cube given (tracemalloc, 4 iterations)."""
    import tracemalloc

    from recon import Admm, BasisPursuit, Fista, Gpsr, reconstruct

    operator = camera(size, bands)
    frames = operator.forward(np.ones(operator.in_shape, np.float32))
    solvers = {"basis pursuit": BasisPursuit, "FISTA": Fista, "ADMM": Admm, "GPSR": Gpsr}
    found = {}
    for name, solver in solvers.items():
        arguments = {"solver": solver(max_iterations=4), "tau": None if solver is BasisPursuit else 0.01}
        reconstruct(operator, frames, **arguments)
        tracemalloc.start()
        reconstruct(operator, frames, **arguments)
        found[name] = tracemalloc.get_traced_memory()[1] / (size * size * bands * 4)
        tracemalloc.stop()
    return found


def _against_streaming(tasks: dict[str, tuple[Callable[[], Any], float]], size: float, repeats: int) -> dict[str, Part]:
    """Time tasks beside a copy of ``size`` bytes on the same threads; ``times`` is relative to a copy that moves as many bytes."""
    source, target = (empty_cube((64, int(size) // 256, 1), np.float32).transpose(2, 0, 1).reshape(-1) for _ in range(2))
    source[:] = 1
    every: dict[str, Callable[[], Any]] = {"copy": lambda: threads.run(copy_slabs, 64, source, target)}
    every |= {name: task for name, (task, _) in tasks.items()}
    timed = best_ms(repeats, every)
    rate = timed["copy"] / (2 * source.nbytes)
    found = {"copy of a cube": Part(timed["copy"], 2 * source.nbytes / 1e6, 1.0)}
    return found | {name: Part(timed[name], moved / 1e6, timed[name] / (moved * rate)) for name, (_, moved) in tasks.items()}


def _bytes(shape: tuple[int, ...]) -> float:
    return float(np.prod(shape)) * 4
