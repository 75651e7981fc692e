"""Compiled kernels whose cache on disk may be shared by processes and outlives no change of any kernel."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import IndexDataCacheFile

FOLDER = Path(__file__).resolve().parent


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function without the interpreter's lock, kept on disk; ``options`` are those of ``numba.njit``.

    numba's own cache knows a kernel by its file's age alone, so that a caller in one file keeps the old code of what it calls in
    another; and two processes that compile at the same time can store one's code under the other's types, which ends in a crash
    later. Here every kernel's entry carries a digest of all kernels, and writers wait for each other.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = njit(nogil=True, cache=True, **options)(function)
        own: Any = getattr(dispatcher, "_cache", None)
        if isinstance(getattr(own, "_cache_file", None), IndexDataCacheFile):
            own._cache_file = SharedCacheFile(own._cache_path, own._impl.filename_base, sources())
        return dispatcher

    return compiled


class SharedCacheFile(IndexDataCacheFile):
    """An index of compiled code that one process at a time writes."""

    def save(self, key: Any, data: Any) -> None:
        """Save an entry; the index is read, changed and written under a lock."""
        with locked(Path(self._cache_path) / "kernels.lock"):
            super().save(key, data)


@cache
def sources() -> str:
    """Return a digest of all files that hold kernels."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.py")):
        if path.stem.endswith("_kernels") or path.stem in ("simd", "compiled"):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold an exclusive lock; where the system has none, go on without."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
