"""Checks before a file is opened, and atomic writing."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from optsim.errors import InputError

MAX_BYTES = 8 << 30
"""Largest declared array (8 GiB) that a reader allocates for a file."""


def regular_file(path: Path, field: str = "file") -> Path:
    """Return ``path`` when it is a readable regular file of at least 4 bytes.

    Raises:
        InputError: for a missing file, a directory, a FIFO or a device.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(field, str(path), f"an existing file ({error.strerror})") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(field, str(path), "a regular file (not a folder, device or pipe)")
    if status.st_size < 4:
        raise InputError(field, str(path), "a file with contents (this one is empty or cut off)")
    return path


def declared_size(field: str, shape: tuple[int, ...], itemsize: int) -> None:
    """Refuse an array whose declared size is over 8 GiB, before anything is allocated."""
    total = itemsize
    for n in shape:
        total *= int(n)
    if total > MAX_BYTES:
        raise InputError(field, shape, f"at most {MAX_BYTES >> 30} GiB when unpacked")


def _umask() -> int:
    """Read the process's umask, which can only be read by setting it: once, at import, before there are threads."""
    current = os.umask(0o077)
    os.umask(current)
    return current


UMASK = _umask()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder, flushed to disk and renamed to ``path`` on success.

    A reader never sees half a file, and a crash leaves the old one.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".tmp-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~UMASK)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
