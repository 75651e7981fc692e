"""The child process behind :class:`optsim.files.reader.Reader`: its start, its limits, and the socket to it."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

START_S = 60.0
LONGEST_ANSWER = 16 << 20
BOOT = "import json, sys; a = json.loads(sys.argv[1]); sys.path[:] = a[0]; from optsim.files.reader_child import main; main(*a[1:])"


class ChildProcess:
    """Hold one child, alive from the start to :meth:`close`.

    Args:
        memory: bytes of address space it may have at first.
        most_memory: bytes up to which :meth:`lift` may raise that.

    Raises:
        RuntimeError: when it does not start.
    """

    def __init__(self, memory: int, most_memory: int) -> None:
        self._channel, theirs = socket.socketpair()
        self._folder = tempfile.TemporaryDirectory(prefix="optsim-reader-")
        words = json.dumps([[path for path in sys.path if path], theirs.fileno(), memory, most_memory])
        # Nothing of the environment goes along but where the interpreter's own libraries may lie.
        kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ}
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-B", "-c", BOOT, words],
                env={**kept, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                cwd=self._folder.name,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        try:
            self._answer(time.monotonic() + START_S)
        except (OSError, ValueError) as error:
            code = self._process.poll()
            self.close()
            raise RuntimeError(f"the process that reads foreign files could not be started ({error}, exit code {code})") from None

    @property
    def alive(self) -> bool:
        """Tell whether it runs."""
        return self._process.poll() is None

    def lift(self, memory: int) -> None:
        """Allow it so many bytes of address space; it cannot go beyond its hard limit itself."""
        if hasattr(resource, "prlimit"):
            with suppress(OSError, ValueError):
                _, hard = resource.prlimit(self._process.pid, resource.RLIMIT_AS)
                soft = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
                resource.prlimit(self._process.pid, resource.RLIMIT_AS, (soft, hard))

    def ask(self, request: dict[str, Any], files: Sequence[int], patience_s: float) -> dict[str, Any]:
        """Send a request with open files, return the answer's header.

        Raises:
            OSError, ValueError: when it ends, is silent for too long (TimeoutError), or answers nonsense.
        """
        text = json.dumps(request).encode()
        self._channel.settimeout(patience_s)
        socket.send_fds(self._channel, [struct.pack("<I", len(text))], list(files))
        self._channel.sendall(text)
        return self._answer(time.monotonic() + patience_s)

    def receive(self, values: np.ndarray, patience_s: float) -> None:
        """Fill a C-contiguous array with what follows a header.

        Raises:
            OSError: as :meth:`ask`.
        """
        if values.size:
            self._fill(values.reshape(-1).view(np.uint8).data, time.monotonic() + patience_s)

    def cause(self) -> str:
        """Say how it came to its end."""
        with suppress(subprocess.TimeoutExpired):
            code = self._process.wait(1)
            if code >= 0:
                return f"reader stopped: exit code {code}"
            with suppress(ValueError):
                return f"reader stopped: signal {-code} ({signal.Signals(-code).name})"
            return f"reader stopped: signal {-code}"
        return "reader stopped"

    def close(self) -> None:
        """End it."""
        self._channel.close()
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def _answer(self, deadline: float) -> dict[str, Any]:
        head = bytearray(8)
        self._fill(memoryview(head), deadline)
        (length,) = struct.unpack("<Q", head)
        if length > LONGEST_ANSWER:
            raise ValueError("an answer that is too long")
        body = bytearray(length)
        self._fill(memoryview(body), deadline)
        answer = json.loads(body)
        if not isinstance(answer, dict):
            raise ValueError("an answer of another form")
        return answer

    def _fill(self, view: memoryview, deadline: float) -> None:
        while view:
            left = deadline - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._channel.settimeout(left)
            count = self._channel.recv_into(view)
            if count == 0:
                raise ConnectionResetError("the reader ended")
            view = view[count:]
