"""What a user says of a foreign cube file, where the file leaves it open."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Axis(BaseModel):
    """Name an axis of a stored array, and say whether it runs backwards.

    Args:
        name: y, x or wavelength.
        reverse: whether the file has it from bottom to top, from right to left, from red to blue.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(pattern="^(y|x|wavelength)$")]
    reverse: bool = False


class Crop(BaseModel):
    """Choose a part of the picture, in pixels.

    Args:
        top: first row.
        left: first column.
        height: rows.
        width: columns.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    top: Annotated[int, Field(ge=0)] = 0
    left: Annotated[int, Field(ge=0)] = 0
    height: Annotated[int, Field(ge=1)]
    width: Annotated[int, Field(ge=1)]


class CubeImport(BaseModel):
    """Say what a file leaves open.

    Args:
        variable: which array of the file; None: the only one of three axes, or the one that a known set keeps its cubes under.
        axes: of the stored array, in its order; None: as format or file have it, for MATLAB y, x, wavelength.
        wavelengths_nm: band centres in nm in the order of the file; None: those of the file.
        scale: factor from the file's values to W m^-2 sr^-1 nm^-1, above 0. Reflectances become the radiance under an
            equal-energy light that makes white as bright as this.
        crop: part of the picture; None: all of it.
        range_nm: lowest and highest band centre to keep, in nm; None: all bands.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    variable: str | None = None
    axes: tuple[Axis, Axis, Axis] | None = None
    wavelengths_nm: tuple[Annotated[float, Field(gt=0)], ...] | None = None
    scale: Annotated[float, Field(gt=0)] = 1.0
    crop: Crop | None = None
    range_nm: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] | None = None
