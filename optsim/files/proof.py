"""Files of optsim's own formats may come from strangers too: each is read in the limited child process before this one reads it.

HDF5 and OpenEXR are not hardened: a damaged file can end or stop the process that opens it. One child serves the whole process.
"""

from __future__ import annotations

import atexit
import os
import threading

from optsim.errors import InputError
from optsim.files.reader import Reader, Source


class _Shared:
    """Hold the process's reader; a fork gets its own."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._reader: Reader | None = None
        self._owner = 0

    def reader(self) -> Reader:
        if self._reader is None or self._owner != os.getpid():
            self._reader, self._owner = Reader(), os.getpid()
            atexit.register(self._reader.close)
        return self._reader


_SHARED = _Shared()


def prove(source: Source) -> None:
    """Read a file in the child, and forget it.

    Raises:
        InputError: field ``file``, when the child refuses it, dies of it or takes too long.
    """
    with _SHARED.lock:
        try:
            _SHARED.reader().prove(source)
        except InputError as error:
            if error.field == "file":
                raise
            raise InputError("file", str(source.paths[0]), f"a readable {source.title} file ({error.value}; {error.field})") from None
