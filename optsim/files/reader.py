"""Foreign files, decoded in a child process with limits: a wrong or hostile file ends the child at worst, never this process.

The child (:mod:`optsim.files.reader_child`) first says what a file holds; only what is plausible for the file's size is then read, with as
much memory and time as that needs.
"""

from __future__ import annotations

import os
import re
import stat
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from optsim.errors import InputError
from optsim.files.guard import MAX_BYTES
from optsim.files.importers.found import MOST_ARRAYS, Found
from optsim.files.reader_process import START_S, ChildProcess

MEMORY = 2 << 30
"""Address space of the child before it knows a size, bytes; four times the declared size is added."""
MOST_MEMORY = MEMORY + 4 * MAX_BYTES
EXPANSION = 1000
"""A compressed file may be that much smaller than what it declares."""
SPARE = 256 << 20
"""A dark picture is compressed more than that."""
PATIENCE_S = 4.0
"""Wall seconds for each of the two requests, beyond a second for each 10 MB declared."""
BYTES_PER_S = 10e6
CPU_S = 30
HANDLE = re.compile(r"'/dev/fd/\d+'|<_io\.BufferedReader name=\d+>")
"""How a decoder names what it was given."""


@dataclass(frozen=True)
class Source:
    """Name a foreign file by its format and path; ENVI has two, the header first.

    Args:
        format: module of :mod:`optsim.files.importers`.
        title: of the format, for messages.
        paths: the files.
    """

    format: str
    title: str
    paths: tuple[Path, ...]

    @property
    def name(self) -> str:
        """Return the first file's name."""
        return self.paths[0].name


class Reader:
    """Decode foreign files in one child process, started when first needed and again after a file has ended it.

    Use it as a context manager; many files may be read in turn, by one thread.
    """

    def __init__(self) -> None:
        self._child: ChildProcess | None = None
        self._ready: set[str] = set()

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def survey(self, source: Source) -> tuple[Found, ...]:
        """List the numeric arrays of a file, without reading them.

        Raises:
            InputError: naming the file when it cannot be read as its format, or asks for too much time or memory.
        """
        answer = self._ask(self._running(source), source, {"do": "survey"}, PATIENCE_S, source.name)
        try:
            return tuple(TypeAdapter(list[Found]).validate_python(answer.get("found"))[: 2 * MOST_ARRAYS])
        except ValidationError as error:
            raise InputError("file", str(source.paths[0]), f"a readable {source.title} file ({error.error_count()} odd entries)") from None

    def read(self, source: Source, found: Found) -> np.ndarray:
        """Read one of the arrays that :meth:`survey` listed.

        Raises:
            InputError: naming file and array when it is larger than plausible or 8 GiB, or cannot be decoded.
        """
        field = f"{source.name}:{found.name}"
        plausible(source, found)
        patience = PATIENCE_S + found.size / BYTES_PER_S
        child = self._running(source)
        child.lift(MEMORY + 4 * found.size)
        header = self._ask(child, source, {"do": "read", "name": found.name, "cpu_s": int(patience) + CPU_S}, patience, field)
        told = (_listed(header.get("shape")), header.get("dtype"), header.get("bytes"))
        if told != (found.shape, found.dtype, found.size):
            self.close()
            raise InputError(field, f"{told[1]} {told[0]}", f"{found.dtype} {found.shape}, as the file's header says")
        values = np.empty(found.shape, found.dtype)
        try:
            child.receive(values, patience)
        except OSError as error:
            raise self._ended(child, source, field, error) from None
        return values

    def prove(self, source: Source) -> None:
        """Read a whole file of one of optsim's own formats in the child, to see that it ends neither by a signal nor never.

        Raises:
            InputError: naming the file.
        """
        child = self._running(source)
        told = self._ask(child, source, {"do": "extent"}, PATIENCE_S, source.name).get("bytes")
        length = sum(path.stat().st_size for path in source.paths)
        size = min(told if isinstance(told, int) else MAX_BYTES, EXPANSION * length + SPARE)
        child.lift(MEMORY + 4 * size)
        patience = PATIENCE_S + size / BYTES_PER_S
        self._ask(child, source, {"do": "prove", "cpu_s": int(patience) + CPU_S}, patience, source.name)

    def close(self) -> None:
        """End the child."""
        child, self._child, self._ready = self._child, None, set()
        if child is not None:
            child.close()

    def _running(self, source: Source) -> ChildProcess:
        """Return the child, with the libraries of a format loaded: that is no file's fault and not on its time."""
        if self._child is None or not self._child.alive:
            self.close()
            self._child = ChildProcess(MEMORY, MOST_MEMORY)
        if source.format not in self._ready:
            try:
                answer = self._child.ask({"do": "prepare", "format": source.format}, [], START_S)
            except (OSError, ValueError) as error:
                answer = {"failed": str(error)}
            if "ready" not in answer:
                self.close()
                raise RuntimeError(f"the process that reads foreign files cannot load what {source.title} needs: {answer}")
            self._ready.add(source.format)
        return self._child

    def _ask(self, child: ChildProcess, source: Source, request: dict[str, Any], patience: float, field: str) -> dict[str, Any]:
        """Send one request with the opened files; return the answer's header.

        Raises:
            InputError: naming ``field`` when the decoder refuses, fails, runs out of time or dies.
        """
        with ExitStack() as stack:
            files = [stack.enter_context(_Opened(path)).handle for path in source.paths]
            try:
                answer = child.ask({"format": source.format, **request}, files, patience)
            except (OSError, ValueError) as error:
                raise self._ended(child, source, field, error) from None
        if "refused" in answer:
            inner, value, allowed = [str(part)[:500] for part in (*_listed(answer["refused"]), "", "", "")][:3]
            raise InputError(f"{source.name}:{inner}", value, allowed)
        if "failed" in answer:
            said = HANDLE.sub("the file", str(answer["failed"])[:500])
            raise InputError(field, said, f"readable as {source.title}")
        return answer

    def _ended(self, child: ChildProcess, source: Source, field: str, error: Exception) -> InputError:
        how = "it took too long" if isinstance(error, TimeoutError) else child.cause()
        self.close()
        return InputError(field, how, f"readable as {source.title}")


def _listed(value: object) -> tuple[object, ...]:
    """Return what should be a list, and nothing if it is none: the child is not believed."""
    return tuple(value) if isinstance(value, list) else ()


def plausible(source: Source, found: Found) -> None:
    """Refuse a declared size that is over 8 GiB or cannot be in a file of that length.

    Raises:
        InputError: naming file and array.
    """
    length = sum(path.stat().st_size for path in source.paths)
    most = EXPANSION * length if found.compressed else length
    if found.size > MAX_BYTES:
        raise InputError(f"{source.name}:{found.name}", f"{found.shape} {found.dtype}", f"at most {MAX_BYTES >> 30} GiB when unpacked")
    if found.size > most:
        allowed = f"plausible for a file of {length} bytes ({found.size} bytes declared)"
        raise InputError(f"{source.name}:{found.name}", f"{found.shape} {found.dtype}", allowed)


class _Opened:
    """Open a regular file for reading; pipes and devices are refused without waiting for them."""

    def __init__(self, path: Path) -> None:
        try:
            self.handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            raise InputError("file", str(path), f"a file that can be read ({error.strerror})") from None
        if not stat.S_ISREG(os.fstat(self.handle).st_mode):
            os.close(self.handle)
            raise InputError("file", str(path), "a regular file (not a folder, device or pipe)")

    def __enter__(self) -> _Opened:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        os.close(self.handle)
