"""Output paths of verbs, checked before the work."""

from __future__ import annotations

import os
from pathlib import Path

from optsim.errors import InputError

FIGURES = (".png", ".pdf", ".svg")


def target(path: Path | None, field: str, suffixes: tuple[str, ...], source: Path | None = None) -> None:
    """Check that a file can be written.

    Args:
        path: what the user gave; None passes.
        field: the option, named in errors.
        suffixes: the endings allowed.
        source: a file that is read and must not be overwritten.

    Raises:
        InputError: naming ``field``.
    """
    if path is None:
        return
    if path.suffix not in suffixes:
        raise InputError(field, str(path), f"a file path that ends in {' or '.join(suffixes)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(field, str(path), "a file in a folder that exists and can be written")
    if source is not None and source.exists() and path.exists() and path.samefile(source):
        raise InputError(field, str(path), "another file than the one that is read")
