"""What a render may be asked for, with ranges."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from optsim.errors import InputError
from optsim.render.choice import EFFECTS, Choices, Physics

DEFAULT_ERROR = 0.01
MAX_SAMPLES_PER_PIXEL = 2**24
MAX_SEED = 2**32 - 1
MAX_DEPTH = 2**16
MAX_SIDE = 2**15

_ALLOWED = {
    "oversample": "a whole number in [1, 64]",
    "error": "a relative RMS error in [1e-5, 1]",
    "samples_per_pixel": "a whole number of samples in [1, 2^24]",
    "seed": "a whole number in [0, 2^32 - 1]",
    "max_samples": "a whole number of samples in [4, 2^24]",
    "max_depth": "a whole number of emissions in [1, 2^16]",
}
_ALLOWED |= {name: f"a tuple of effects, from {', '.join(EFFECTS)}" for name in ("force", "without")}
_SHORT = {"samples_per_pixel": "spp"}


class RenderSettings(BaseModel):
    """Say how finely and how precisely to render.

    Args:
        oversample: picture samples along each mirror side, 1 to 64.
        error: stop when the estimated RMS error over the picture, divided by the picture's mean, is below this in every band
            (1e-5 to 1); None with no ``samples_per_pixel`` means 0.01.
        samples_per_pixel: render exactly this many paths a pixel instead, 1 to 2^24 (rounded up to whole passes).
        seed: 0 to 2^32 - 1; the same seed gives the same bytes on the same machine.
        max_samples: give up on ``error`` here, with a warning, 4 to 2^24 paths a pixel in any tile.
        max_depth: count emission and max_depth - 1 reflections, 1 to 2^16; None lets the scene decide.
        force: effects to compute whatever the scene requires.
        without: effects to leave out whatever the scene requires.

    Raises:
        InputError: ``render.FIELD`` with the allowed range; ``render.spp`` when both an error and a sample count are given;
            ``render.without`` for an effect that is forced as well, or interreflection beside a max_depth.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    oversample: Annotated[int, Field(ge=1, le=64)] = 1
    error: Annotated[float, Field(ge=1e-5, le=1)] | None = None
    samples_per_pixel: Annotated[int, Field(ge=1, le=MAX_SAMPLES_PER_PIXEL)] | None = None
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 0
    max_samples: Annotated[int, Field(ge=4, le=MAX_SAMPLES_PER_PIXEL)] = 2**16
    max_depth: Annotated[int, Field(ge=1, le=MAX_DEPTH)] | None = None
    force: tuple[Physics, ...] = ()
    without: tuple[Physics, ...] = ()

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            name = str(fault["loc"][0]) if fault["loc"] else "samples_per_pixel"
            inner = fault.get("ctx", {}).get("error")
            allowed = str(inner) if inner else _ALLOWED.get(name, f"one of the fields {', '.join(_ALLOWED)}")
            raise InputError(f"render.{_SHORT.get(name, name)}", fault.get("input") if fault["loc"] else data, allowed) from None

    @model_validator(mode="after")
    def _one_goal(self) -> RenderSettings:
        if self.error is not None and self.samples_per_pixel is not None:
            raise ValueError("given alone: either an error to reach or a number of samples, not both")
        return self

    @model_validator(mode="after")
    def _one_depth(self) -> RenderSettings:
        both = self.choices  # refuses an effect in both
        if self.max_depth is not None and Physics.INTERREFLECTION in both:
            raise ValueError("given alone: either max_depth or a choice about interreflection, not both")
        return self

    @property
    def choices(self) -> Choices:
        """Return the effects decided by hand."""
        return Choices(frozenset(self.force), frozenset(self.without))

    @property
    def target(self) -> float | None:
        """Return the error to reach, or None when a number of samples was asked for."""
        if self.samples_per_pixel is not None:
            return None
        return DEFAULT_ERROR if self.error is None else self.error

    @property
    def tolerance(self) -> float:
        """Return the relative error that decides which effects matter: the goal, never coarser than 0.1."""
        return min(self.target or DEFAULT_ERROR, 0.1)


def film_size(size: tuple[int, int], oversample: int) -> tuple[int, int]:
    """Return the picture's (height, width) in samples from the size in mirrors.

    Raises:
        InputError: ``render.size`` unless both sides, oversampled, are within 1 to 32768.
    """
    allowed = f"(height, width) in mirrors, whole numbers, each from 1 to {MAX_SIDE // oversample} at {oversample} samples a side"
    try:
        height, width = size
    except (TypeError, ValueError):
        raise InputError("render.size", size, allowed) from None
    for side in (height, width):
        if isinstance(side, bool) or not isinstance(side, int | np.integer) or not 1 <= side * oversample <= MAX_SIDE:
            raise InputError("render.size", tuple(size), allowed)
    return int(height) * oversample, int(width) * oversample
