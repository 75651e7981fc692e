"""Fields of a camera file: which prism or table, which mirrors, which pixels, which band-pass (docs/files.md)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import field_validator, model_validator

from optsim.camera.glass import glass
from optsim.camera.model import Model, ranged
from optsim.camera.prism import DEFAULT_APEX_INNER_DEG, DEFAULT_PIXEL_UM, DESIGN_NM
from optsim.cube import PAPER_CENTERS_NM
from optsim.errors import InputError

ANGLE = ranged(-90, 90, "deg", "()")


class PrismConfig(Model):
    """Name the glasses and angles of a double Amici prism.

    Args:
        outer, inner: names of built-in glasses.
        apex_outer_deg: A1 in (-90, 90) deg; None: the one that leaves ``design_nm`` undeviated.
        apex_inner_deg: A2 in (-90, 90) deg.
        design_nm: wavelength in nm that leaves along the axis.
        design_position_px: where it lands, counted from the 455 nm pixel; None: such that 455 nm lands at 0.
    """

    outer: str = "N-FK5"
    inner: str = "F5"
    apex_outer_deg: Annotated[float, ANGLE] | None = None
    apex_inner_deg: Annotated[float, ANGLE] = DEFAULT_APEX_INNER_DEG
    design_nm: Annotated[float, ranged(100, 1e4, "nm")] = DESIGN_NM
    design_position_px: Annotated[float, ranged(-1e6, 1e6, "px")] | None = None

    @field_validator("outer", "inner")
    @classmethod
    def _known(cls, value: str) -> str:
        return glass(value).name


class TableConfig(Model):
    """Place the k-th of these wavelengths at pixel k, instead of tracing a prism."""

    centers_nm: tuple[float, ...] = PAPER_CENTERS_NM


class DmdConfig(Model):
    """Describe the mirrors.

    Args:
        pitch_um: in (0, 1e4] um.
        fill_factor: share of the pitch's area that reflects, in (0, 1].
        leak: light of a mirror that is off over that of one that is on (1 / contrast), in [0, 1].
        tilt_deg: angle of the mirrors' plane against the relay's axis, about the 45 degree diagonal, in (-60, 60) deg.
        offset_x_px, offset_y_px: how far the mirrors' image is displaced on the sensor, in [-1e4, 1e4] px.
        rotation_deg: of the mirrors' image on the sensor, in [-10, 10] deg.
        scale: of the mirrors' image, beside f2 / f1, in [0.01, 100].
        dead_share, stuck_share: shares of mirrors that are always off, always on, in [0, 1], placed at random.
        defect_seed: of their places.
    """

    pitch_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = 13.68
    fill_factor: Annotated[float, ranged(0, 1, "", "(]")] = 0.92
    leak: Annotated[float, ranged(0, 1, "")] = 1 / 2000
    tilt_deg: Annotated[float, ranged(-60, 60, "deg", "()")] = 0.0
    offset_x_px: Annotated[float, ranged(-1e4, 1e4, "px")] = 0.0
    offset_y_px: Annotated[float, ranged(-1e4, 1e4, "px")] = 0.0
    rotation_deg: Annotated[float, ranged(-10, 10, "deg")] = 0.0
    scale: Annotated[float, ranged(0.01, 100, "")] = 1.0
    dead_share: Annotated[float, ranged(0, 1, "")] = 0.0
    stuck_share: Annotated[float, ranged(0, 1, "")] = 0.0
    defect_seed: Annotated[int, ranged(0, 2**63 - 1, "")] = 0


class SensorConfig(Model):
    """Describe the pixels that all sensors share.

    Args:
        pitch_um: in (0, 1e4] um.
        full_well_e: electrons a pixel or layer holds, in (0, 1e12] (assumed).
        prnu: relative standard deviation of the pixels' response, in [0, 0.5].
        dsnu_e: standard deviation of the pixels' offset, in [0, 1e6] electrons.
        crosstalk: share of a pixel's charge that ends in each of its four neighbours, in [0, 0.2].
        pattern_seed: of the pixels' fixed patterns.
    """

    pitch_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM
    full_well_e: Annotated[float, ranged(0, 1e12, "electrons", "(]")] = 20_000.0
    prnu: Annotated[float, ranged(0, 0.5, "")] = 0.005
    dsnu_e: Annotated[float, ranged(0, 1e6, "electrons")] = 0.0
    crosstalk: Annotated[float, ranged(0, 0.2, "")] = 0.0
    pattern_seed: Annotated[int, ranged(0, 2**63 - 1, "")] = 0


class BandpassConfig(Model):
    """Describe a band-pass filter: transmission 1 between its edges and 0 outside, with linear flanks.

    Args:
        lower_nm, upper_nm: where the transmission is one half, in (0, 1e5] nm.
        edge_nm: width of each flank, from 0 to 1, in [0, 100] nm.
    """

    lower_nm: Annotated[float, ranged(0, 1e5, "nm", "(]")] = 450.0
    upper_nm: Annotated[float, ranged(0, 1e5, "nm", "(]")] = 670.0
    edge_nm: Annotated[float, ranged(0, 100, "nm")] = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> BandpassConfig:
        if self.upper_nm <= self.lower_nm:
            raise InputError("upper_nm", self.upper_nm, f"above lower_nm = {self.lower_nm:g} nm")
        return self

    def clip(self, lower_nm: np.ndarray, upper_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parts of bands inside the filter; upper = lower where nothing is left."""
        lower = np.clip(lower_nm, self.lower_nm, self.upper_nm)
        return lower, np.clip(upper_nm, self.lower_nm, self.upper_nm)


class ObjectiveConfig(Model):
    """Describe the lens that images the scene onto the mirrors; the truth is what arrives there.

    Args:
        focal_mm: in (0, 1e6] mm; None: an ideal lens, the cube is the truth.
        f_number: from 0.5 to 1e3.
        cos4: whether illumination falls as cos^4 of the field angle.
        psf_um: standard deviation of its Gaussian blur at the mirrors, in [0, 1e4] um.
    """

    focal_mm: Annotated[float, ranged(0, 1e6, "mm", "(]")] | None = None
    f_number: Annotated[float, ranged(0.5, 1e3, "")] = 8.0
    cos4: bool = True
    psf_um: Annotated[float, ranged(0, 1e4, "um")] = 0.0
