"""Run tasks side by side in threads, with a progress bar, and stop cleanly on Ctrl-C."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Protocol, TypeVar

from recon.threads import cores


class Stopped(Exception):
    """Raised inside a task when the run is being stopped."""


class Stage(Protocol):
    """One named piece of work that knows its expected cost."""

    @property
    def name(self) -> str:
        """Name shown while it runs."""
        ...

    @property
    def cost(self) -> float:
        """Expected time, in any unit common to all."""
        ...


Task = TypeVar("Task", bound=Stage)


class Progress(AbstractContextManager["Progress"]):
    """Show a bar with the time left on a terminal, or a line a finished piece elsewhere.

    Args:
        total: sum of all costs.
        quiet: show nothing.
    """

    def __init__(self, total: float, quiet: bool = False) -> None:
        self.total, self.done, self.began = max(total, 1e-9), 0.0, time.monotonic()
        self.quiet = quiet
        self._bar: Any = None
        self._lock = threading.Lock()

    def __enter__(self) -> Progress:
        if not self.quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (
                BarColumn(),
                TextColumn("{task.percentage:3.0f} %"),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(True),
            )
            self._bar = Bar(*columns, TextColumn("{task.description}"), console=Console(stderr=True), speed_estimate_period=300)
            self._bar.start()
            self._id = self._bar.add_task("", total=self.total)
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def say(self, text: str) -> None:
        """Name what is running now."""
        if self._bar is not None:
            self._bar.update(self._id, description=text)

    def say_share(self, share: float | None, text: str) -> None:
        """Name what is running now, with how far it is."""
        self.say(text if share is None else f"{text} ({100 * share:.0f} %)")

    def advance(self, cost: float, text: str) -> None:
        """Count a finished piece of work."""
        with self._lock:
            self.done += cost
            if self._bar is not None:
                self._bar.update(self._id, completed=self.done, description=text)
            elif not self.quiet:
                share = self.done / self.total
                spent = time.monotonic() - self.began
                left = spent * (1 - share) / share if share > 0.02 else float("nan")
                tail = f", about {left:.0f} s left" if left == left and share < 1 else ""
                print(f"[{100 * share:3.0f} %, {spent:.0f} s{tail}] {text}", file=sys.stderr, flush=True)


def run_all(
    tasks: Sequence[Task], work: Callable[[Task, Callable[..., None]], str], workers: int | None, progress: Progress
) -> dict[str, BaseException]:  # fmt: skip
    """Call ``work(task, tick)`` for every task, ``workers`` at a time, in the order given.

    Args:
        tasks: pieces of work.
        work: returns one line about its result; calls ``tick()`` often, which raises Stopped when the run is being stopped.
        workers: how many at a time; None: one a core.
        progress: told of each finished task.

    Returns:
        The failures by task name; the other tasks are done.

    Raises:
        KeyboardInterrupt: after the running tasks have stopped; what is finished stays finished.
    """
    stop = threading.Event()

    def tick(*_: object) -> None:
        if stop.is_set():
            raise Stopped

    def one(task: Task) -> str:
        tick()
        return work(task, tick)

    failures: dict[str, BaseException] = {}
    with ThreadPoolExecutor(workers or cores(), thread_name_prefix="solve") as pool:
        waiting: dict[Future[str], Task] = {pool.submit(one, task): task for task in tasks}
        try:
            while waiting:
                for future in wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED).done:
                    task = waiting.pop(future)
                    error = future.exception()
                    if error is not None:
                        failures[task.name] = error
                    progress.advance(task.cost, f"{task.name}: {future.result() if error is None else f'FAILED: {error}'}")
        except BaseException:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return failures
