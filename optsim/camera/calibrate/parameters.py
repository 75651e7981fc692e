"""The numbers of a camera that its drawing states and a calibration corrects, with how far to trust the drawing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from optsim.camera.model import Model, ranged

OFFSET_X, OFFSET_Y, ROTATION, SCALE = "offset_x_px", "offset_y_px", "rotation_deg", "scale"
REGISTRATION = (OFFSET_X, OFFSET_Y, ROTATION, SCALE)
TILT, COLLIMATOR, FOCAL = "tilt_deg", "collimator_mm", "focal_mm"


@dataclass(frozen=True)
class Parameter:
    """Name one number of the camera.

    Args:
        name: ends in its unit, e.g. ``apex_1_deg``; relative numbers have none.
        value: as drawn.
        tolerance: standard deviation of the real number round the drawn one, in the same unit, above 0.
        unit: deg, mm, px or "" (a ratio, or an index).
    """

    name: str
    value: float
    tolerance: float
    unit: str


class Tolerances(Model):
    """State how far a built camera strays from its drawing: standard deviations, of the order of catalogue grades (assumed).

    Args:
        apex_deg: of each wedge's angle, in (0, 10] deg (one arc minute).
        tilt_deg: of the whole prism's mount, in (0, 10] deg.
        focal: of each focal length, relative, in (0, 0.5].
        index: of each glass's refractive index, the same at all wavelengths, in (0, 0.1].
        dispersion: of each glass's n - n_d, relative (the Abbe number), in (0, 0.5].
        offset_px: of the mirrors' image on the sensor before registration, in (0, 1e4] px.
        rotation_deg: of that image, in (0, 10] deg.
        scale: of that image beside f2 / f1, in (0, 0.5].
    """

    place: ClassVar[str] = "tolerances"
    apex_deg: Annotated[float, ranged(0, 10, "deg", "(]")] = 1 / 60
    tilt_deg: Annotated[float, ranged(0, 10, "deg", "(]")] = 0.1
    focal: Annotated[float, ranged(0, 0.5, "", "(]")] = 0.01
    index: Annotated[float, ranged(0, 0.1, "", "(]")] = 5e-4
    dispersion: Annotated[float, ranged(0, 0.5, "", "(]")] = 5e-3
    offset_px: Annotated[float, ranged(0, 1e4, "px", "(]")] = 5.0
    rotation_deg: Annotated[float, ranged(0, 10, "deg", "(]")] = 0.5
    scale: Annotated[float, ranged(0, 0.5, "", "(]")] = 0.01


def is_registration(name: str) -> bool:
    """Tell whether a parameter places the mirrors' image, rather than shaping the prism or the lenses."""
    return name in REGISTRATION
