"""The child process that decodes foreign files: limited before the first byte is read, it gets open files and gives back raw numbers.

Over a socket pair. Asked: four bytes of length and JSON ``{"do": ..., "format": ..., "name": ...}`` (prepare, survey, read; extent,
prove), the open files beside it. Answered: eight bytes of length and JSON, for ``read`` followed by the array's bytes.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import resource
import socket
import struct
import time
from collections.abc import Sequence
from typing import IO, Any

from optsim.errors import LONGEST_SHOWN, InputError

MODULES = ("envi", "exr", "hdf5", "mat5", "npy", "png")
"""Formats, by the names of their modules."""
MOST_FILES = 2
CPU_S = 30
"""Processor seconds a request, beyond those that its declared size asks for."""
CPU_HARD_S = 3600
NOFILE = 64


def main(handle: int, memory: int, most_memory: int) -> None:
    """Serve requests until the socket closes.

    Args:
        handle: descriptor of the socket.
        memory: bytes of address space at first; the parent may raise it.
        most_memory: bytes up to which it may.
    """
    channel = socket.socket(fileno=handle)
    _confine(memory, most_memory)
    _answer(channel, {"ready": True})
    while True:
        request, descriptors = _asked(channel)
        if request is None:
            return
        with contextlib.ExitStack() as stack:
            files = [stack.enter_context(os.fdopen(descriptor, "rb")) for descriptor in descriptors]
            _limit_cpu(int(request.get("cpu_s", CPU_S)))
            _serve(channel, request, files)


def _confine(memory: int, most_memory: int) -> None:
    """Take away what a decoder has no need of: memory, time, files to write, core dumps."""
    _lower(resource.RLIMIT_AS, memory, most_memory)
    _lower(resource.RLIMIT_CPU, CPU_S, CPU_HARD_S)
    _lower(resource.RLIMIT_FSIZE, 0, 0)
    _lower(resource.RLIMIT_NOFILE, NOFILE, NOFILE)
    _lower(resource.RLIMIT_CORE, 0, 0)


def _lower(what: int, soft: int, hard: int) -> None:
    """Set a limit, never above the one that is there; where a system does not know it, the others remain."""
    _, present = resource.getrlimit(what)
    if present != resource.RLIM_INFINITY:
        hard = min(hard, present)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(what, (min(soft, hard), hard))


def _limit_cpu(seconds: int) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    used = int(time.process_time()) + 1
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (used + seconds if hard == resource.RLIM_INFINITY else min(used + seconds, hard), hard))


def _serve(channel: socket.socket, request: dict[str, Any], files: Sequence[IO[bytes]]) -> None:
    """Answer one request; whatever a decoder raises becomes a refusal."""
    try:
        if request["format"] not in MODULES:
            raise InputError("format", request["format"], f"one of {MODULES}")
        decoder = importlib.import_module(f"optsim.files.importers.{request['format']}")
        if request["do"] == "prepare":
            for library in decoder.LIBRARIES:
                importlib.import_module(library)
            _answer(channel, {"ready": True})
            return
        for file in files:
            file.seek(0)
        if request["do"] == "survey":
            _answer(channel, {"found": [found.model_dump() for found in decoder.survey(files)]})
            return
        if request["do"] == "extent":
            _answer(channel, {"bytes": decoder.extent(files)})
            return
        if request["do"] == "prove":
            decoder.prove(files)
            _answer(channel, {"proven": True})
            return
        values = decoder.read(files, request["name"])
        header = {"shape": values.shape, "dtype": values.dtype.str, "bytes": values.nbytes}
    except InputError as error:
        _answer(channel, {"refused": [error.field, _short(error.value), error.allowed]})
        return
    except MemoryError:
        _answer(channel, {"failed": "it asks for more memory than its declared size allows"})
        return
    except Exception as error:
        _answer(channel, {"failed": _short(f"{type(error).__name__}: {error}")})
        return
    _answer(channel, header)
    if values.nbytes:
        channel.sendall(memoryview(values).cast("B"))


def _short(value: object) -> str:
    """Return a value's text on one line, printable and not long."""
    text = value if isinstance(value, str) else repr(value)
    return "".join(c if c.isprintable() else " " for c in text[:LONGEST_SHOWN]).strip()


def _asked(channel: socket.socket) -> tuple[dict[str, Any] | None, list[int]]:
    """Return the next request and its open files; None when the parent has left."""
    first, descriptors, _, _ = socket.recv_fds(channel, 4, MOST_FILES)
    if not first:
        return None, []
    (length,) = struct.unpack("<I", first + _bytes(channel, 4 - len(first)))
    return json.loads(_bytes(channel, length)), list(descriptors)


def _bytes(channel: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = channel.recv(count - len(data))
        if not part:
            raise EOFError("the parent left in the middle of a request")
        data += part
    return data


def _answer(channel: socket.socket, header: dict[str, Any]) -> None:
    text = json.dumps(header).encode()
    channel.sendall(struct.pack("<Q", len(text)) + text)
