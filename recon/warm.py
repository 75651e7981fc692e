"""Kernels compiled before they are needed: the first solve of a fresh checkout would wait for most of a minute else."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HALVES = ("solves", "transforms")


def warm_up(dtype: Any = np.float32) -> None:
    """Compile the kernels of all solvers on a cube of 8 x 8 x 2, so that the first real solve starts at once.

    numba keeps what it compiles on disk, for this machine and as long as no kernel changes; then it takes a second.
    """
    transforms(dtype)
    solves(dtype)
    _done().touch()


def warm_up_beside() -> Callable[[], None]:
    """Compile in two processes of their own, which share the disk's cache with this one; at once when all is there.

    Returns:
        A call that waits for them. Whatever may have gone wrong there is compiled here when it is needed.
    """
    if _done().exists():
        return lambda: None
    code = "import sys, recon.warm; getattr(recon.warm, sys.argv[1])()"
    silent = subprocess.DEVNULL
    children = [subprocess.Popen([sys.executable, "-c", code, half], stdin=silent, stdout=silent, stderr=silent) for half in HALVES]

    def wait() -> None:
        try:
            codes = [child.wait() for child in children]
            if not any(codes):
                _done().touch()
        except BaseException:
            for child in children:
                child.kill()
            raise

    return wait


def solves(dtype: Any = np.float32) -> None:
    """Compile what basis pursuit, ADMM and tau need, the camera's kernels first."""
    from recon.admm import Admm
    from recon.solve import reconstruct
    from recon.tau import Given, tune

    for spread in (1, 2):
        camera, frames = _camera(spread, dtype)
        reconstruct(camera, frames, threads=1)
        tune(camera, frames, Given(threads=1), refine=Admm())


def transforms(dtype: Any = np.float32) -> None:
    """Compile what is independent of the camera in ``dtype``: H in float64, wavelets, and then GPSR."""
    from recon.basis import Kronecker
    from recon.coded_aperture import empty_cube
    from recon.gpsr import Gpsr
    from recon.solve import reconstruct

    _camera(1, np.float64)
    cube = empty_cube((8, 8, 2), dtype)
    cube[...] = 1
    basis = Kronecker.for_shape(cube.shape)
    basis.shrink_bands(cube.transpose(2, 0, 1), 0.1)
    basis.synthesis(basis.analysis(cube))
    basis.shrink(cube, 0.1)
    camera, frames = _camera(1, dtype)
    reconstruct(camera, frames, solver=Gpsr(max_iterations=2), tau=1e-3, threads=1)


def _camera(spread: int, dtype: Any) -> tuple[Any, np.ndarray]:
    """Return a camera of 8 x 8 mirrors whose bands fall on ``spread`` columns, and what it sees of a bright cube."""
    from recon.coded_aperture import CodedAperture

    masks = np.indices((1, 8, 8)).sum(0) % 2
    camera = CodedAperture(masks, np.ones((1, 2)), np.arange(2), np.ones((2, spread)), dtype=dtype)
    return camera, camera.forward(np.ones(camera.in_shape, dtype))


def _done() -> Path:
    """Return the file beside the kernels on disk that says that these have all been compiled."""
    from recon.aperture_kernels import forward_rows
    from recon.compiled import sources

    folder = Path(forward_rows._cache.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"kernels-{sources()[:16]}.done"
