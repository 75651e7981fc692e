"""What the study of nonlinearity consists of: its settings, its cameras and its beliefs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, field_validator

from optsim.camera.camera import CameraConfig
from optsim.camera.effects import effect_named, reduced
from optsim.cube import Bands
from optsim.study.assumptions import ASSUMPTIONS, Assumption, ExactWeights
from optsim.study.fine_scene import Rendered, TexturedField

ASSUMPTION = "assumption"
DIRECTIONS = ("x", "y", "rotation", "scale")


class NonlinearityConfig(BaseModel):
    """Describe the study.

    Args:
        size: mirrors along each side, 16 to 512, a multiple of 8.
        seeds: how many sets of masks, each with a calibration of its own, 1 to 100.
        first_seed: the first of them.
        groups: colour shots, or groups of three monochrome shots, 1 to 8.
        scenes: what is photographed.
        offsets_px: registration errors to try, at the field's corner for rotation and scale; above 0, at most 4 px.
        subdivide: wavelengths a band in the data, 10 to 100.
        samples: along each mirror side in the data, 2 to 8.
        workers: solves side by side; None: one a core.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)

    size: int = Field(64, ge=16, le=512, multiple_of=8)
    seeds: int = Field(5, ge=1, le=100)
    first_seed: int = Field(1, ge=0, le=2**31)
    groups: int = Field(1, ge=1, le=8)
    scenes: tuple[SerializeAsAny[Rendered] | SerializeAsAny[TexturedField], ...] = Field(
        (TexturedField(), Rendered(name="color-checker"), Rendered(name="color-checker-bars")), min_length=1
    )
    offsets_px: tuple[Annotated[float, Field(gt=0, le=4)], ...] = (0.05, 0.1, 0.2, 0.5, 1.0)
    subdivide: int = Field(10, ge=10, le=100)
    samples: int = Field(3, ge=2, le=8)
    workers: int | None = Field(None, ge=1, le=256)

    @field_validator("scenes")
    @classmethod
    def _distinct(cls, scenes: tuple[Rendered | TexturedField, ...]) -> tuple[Rendered | TexturedField, ...]:
        names = [scene.name for scene in scenes]
        if len(set(names)) < len(names):
            raise ValueError(f"must not name a scene twice: {', '.join(names)}")
        return scenes

    @classmethod
    def quick(cls) -> NonlinearityConfig:
        """Return a study of 54 reconstructions instead of 1125: 32 x 32 mirrors, two sets of masks, the textured field, one offset."""
        return cls(size=32, seeds=2, scenes=(TexturedField(),), offsets_px=(0.5,))


@dataclass(frozen=True, eq=False)
class Case:
    """One belief about one camera.

    Args:
        name: of the belief or the registration error.
        kind: ``assumption``, or the direction of a registration error: x, y, rotation, scale.
        amount_px: of that error, at the corner for rotation and scale; 0 for assumptions.
        camera: what takes the data.
        believed: what the reconstruction takes it for.
        assumption: how it makes H of that.
    """

    name: str
    kind: str
    amount_px: float
    camera: CameraConfig
    believed: CameraConfig
    assumption: Assumption


def nominal(camera: CameraConfig, bands: Bands) -> CameraConfig:
    """Return the camera with its dispersion and smile alone, its band-pass cut to the bands."""
    plain = reduced(camera, [effect_named("smile")])
    bandpass = plain.bandpass.model_copy(update={"lower_nm": float(bands.lower[0]), "upper_nm": float(bands.upper[-1])})
    return plain.model_copy(update={"bandpass": bandpass})


def all_cases(camera: CameraConfig, config: NonlinearityConfig) -> Iterator[Case]:
    """Yield the five beliefs, then every registration error that H does not know of, at exact weights."""
    for assumption in ASSUMPTIONS:
        yield Case(assumption.name, ASSUMPTION, 0.0, camera, camera, assumption)
    corner_px = math.hypot(config.size, config.size) / 2 * camera.mirror_px
    for direction in DIRECTIONS:
        for amount in config.offsets_px:
            displaced = camera.model_copy(update={"dmd": camera.dmd.model_copy(update=_displaced(direction, amount, corner_px))})
            yield Case(f"{direction} {amount:g} px", direction, amount, displaced, camera, ExactWeights())


def _displaced(direction: str, amount_px: float, corner_px: float) -> dict[str, float]:
    return {
        "x": {"offset_x_px": amount_px},
        "y": {"offset_y_px": amount_px},
        "rotation": {"rotation_deg": math.degrees(amount_px / corner_px)},
        "scale": {"scale": 1 + amount_px / corner_px},
    }[direction]
