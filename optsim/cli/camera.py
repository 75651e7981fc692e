"""The verb camera: the default camera as a file to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def camera(
    file: Annotated[Path | None, Parameter(help="A camera file to check and print in full; the default camera when absent.")] = None,
    /,
) -> None:
    """Print a camera as TOML with all its fields."""
    from optsim.camera import CameraConfig

    config = CameraConfig() if file is None else CameraConfig.from_toml(file)
    print(config.to_toml(), end="")
