"""One pool of threads for every kernel of this package.

Two pools on the same cores fight (an OpenMP pool beside a BLAS pool costs a factor 2.7), so kernels never open
their own: they release the interpreter's lock and work on a slab ``[first, last)`` of rows, bands or tiles, and
``run`` hands the slabs out. A kernel writes each element from one slab only and leaves sums as one number per
row, so the bytes of a result do not depend on how many threads there are.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise
from numbers import Integral
from typing import Any

from recon.errors import InputError

_limit: ContextVar[int] = ContextVar("recon_threads", default=0)
_pool: ThreadPoolExecutor | None = None


def cores() -> int:
    """Count the cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def current() -> int:
    """Tell how many threads the kernels use here: the innermost ``use`` or all cores."""
    return _limit.get() or cores()


@contextmanager
def use(threads: int | None) -> Iterator[int]:
    """Limit the kernels called inside to ``threads`` threads (None: leave as it is), and BLAS to one.

    Raises:
        InputError: field ``threads`` when it is not an integer of at least 1.
    """
    from threadpoolctl import threadpool_limits

    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 1):
        raise InputError("threads", threads, "an integer of at least 1, or None for all cores")
    token = _limit.set(int(threads) if threads is not None else _limit.get())
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield current()
    finally:
        _limit.reset(token)


def run(kernel: Callable[..., Any], count: int, *arguments: Any) -> None:
    """Call ``kernel(first, last, *arguments)`` over slabs that cover ``0..count``, on the threads allowed here."""
    parts = min(current(), count)
    if parts <= 1:
        if count > 0:
            kernel(0, count, *arguments)
        return
    edges = [count * i // parts for i in range(parts + 1)]
    waiting = [_shared_pool().submit(kernel, a, b, *arguments) for a, b in pairwise(edges[1:])]
    kernel(edges[0], edges[1], *arguments)
    for task in waiting:
        task.result()


def _shared_pool() -> ThreadPoolExecutor:
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(max_workers=max(1, cores()), thread_name_prefix="recon")
    return _pool


def _forget_pool() -> None:
    """Drop the pool in a forked child, whose copy has no threads behind it."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pool)
