"""Finished work on disk: an entry counts when its record exists and carries the key of its inputs.

A record is written last, by rename, so a run stopped anywhere leaves whole entries or none. The same command
finds them by key and goes on with the rest; an entry whose inputs changed is computed anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optsim.errors import InputError
from optsim.files import read, write
from optsim.files.guard import atomic_path
from optsim.files.netcdf import netcdf_bytes_digest

if TYPE_CHECKING:
    import xarray as xr


def canonical(value: Any) -> str:
    """Return JSON with sorted keys and no spaces; refuses NaN and infinity."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def digest(value: Any) -> str:
    """Return the SHA-256 of the canonical JSON of a value, as hex."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def write_json(value: Any, path: Path) -> None:
    """Write indented JSON atomically; refuses NaN and infinity."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", "utf-8")


class Store:
    """Keep a run's files under one folder, by readable name and by key.

    Args:
        root: the run's folder; made when absent.
    """

    def __init__(self, root: Path) -> None:
        try:
            root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError("--out", str(root), f"a folder that can be written ({error.strerror})") from None
        self.root = root

    def path(self, name: str, suffix: str = ".nc") -> Path:
        """Return the file of an entry, e.g. ``estimates/color-checker-bayer.nc``."""
        return self.root / f"{name}{suffix}"

    def finished(self, name: str, key: str) -> dict[str, Any] | None:
        """Return the record of a finished entry with this key whose file is whole, else None."""
        try:
            record = json.loads(self.path(name, ".json").read_text("utf-8"))
            whole = record["key"] == key and all(netcdf_bytes_digest(self.root / f) == d for f, d in record["files"].items())
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return record["result"] if whole else None

    def keep(self, name: str, key: str, result: Mapping[str, Any], datasets: Mapping[str, xr.Dataset]) -> dict[str, Any]:
        """Write an entry's files, then its record.

        Args:
            name: readable name, unique in the run.
            key: digest of everything that the entry depends on.
            result: JSON values.
            datasets: files of the entry, by path relative to the run's folder.
        """
        for relative, dataset in datasets.items():
            write(dataset, self.root / relative)
        files = {relative: netcdf_bytes_digest(self.root / relative) for relative in datasets}
        write_json({"key": key, "files": files, "result": dict(result)}, self.path(name, ".json"))
        return dict(result)

    def load(self, relative: str) -> xr.Dataset:
        """Read one of the run's files."""
        return read(self.root / relative, trusted=True)
