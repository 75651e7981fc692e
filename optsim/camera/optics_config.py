"""Fields of a camera file: which prism or table, which mirrors, which pixels, which band-pass (docs/files.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from optsim.camera.glass import Glass, medium
from optsim.camera.model import Model, ranged
from optsim.camera.prism import DEFAULT_APEX_INNER_DEG, DoubleAmici, direct_view_apex
from optsim.camera.relay import Relay
from optsim.camera.stack import DEFAULT_PIXEL_UM, DESIGN_NM, PrismStack
from optsim.cube import PAPER_CENTERS_NM
from optsim.errors import InputError

ANGLE = ranged(-90, 90, "deg", "()")


class PrismConfig(Model):
    """Describe the prism by its apex angles (a symmetric double Amici prism) or by its faces.

    Args:
        outer, inner: glasses of a double Amici prism; default N-FK5 and F5.
        apex_outer_deg: A1 in (-90, 90) deg; None: the one that leaves ``design_nm`` undeviated.
        apex_inner_deg: A2 in (-90, 90) deg; default 13.1019.
        glasses: what fills the spaces between faces, in the order of the light; "air" for a gap. In place of the four above.
        face_tilt_deg: of each face's normal against the optical axis, one more than glasses, in (-90, 90) deg.
        design_nm: wavelength in nm whose position is ``design_position_px``.
        design_position_px: counted from the 455 nm pixel; None: such that 455 nm lands at 0.
        fresnel: whether faces reflect part of the light.
        field: false keeps the axial curve for the whole field: no smile.

    Glasses are named as in the catalogue, as MAKER:NAME (refractiveindex.info), or as a table [glass.NAME] of the camera.
    """

    outer: str | None = None
    inner: str | None = None
    apex_outer_deg: Annotated[float, ANGLE] | None = None
    apex_inner_deg: Annotated[float, ANGLE] | None = None
    glasses: tuple[str, ...] | None = None
    face_tilt_deg: tuple[Annotated[float, ANGLE], ...] | None = None
    design_nm: Annotated[float, ranged(100, 1e4, "nm")] = DESIGN_NM
    design_position_px: Annotated[float, ranged(-1e6, 1e6, "px")] | None = None
    fresnel: bool = True
    field: bool = True

    @model_validator(mode="before")
    @classmethod
    def _double_amici(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("glasses") is not None or data.get("face_tilt_deg") is not None:
            return data
        given = {key: value for key, value in data.items() if value is not None}
        return {"outer": "N-FK5", "inner": "F5", "apex_inner_deg": DEFAULT_APEX_INNER_DEG, **given}

    @model_validator(mode="after")
    def _one_form(self) -> PrismConfig:
        if self.glasses is None and self.face_tilt_deg is None:
            return self
        if self.glasses is None or self.face_tilt_deg is None or not self.glasses or len(self.face_tilt_deg) != len(self.glasses) + 1:
            raise InputError("face_tilt_deg", self.face_tilt_deg, "given with glasses, one more than they (at least one glass)")
        for name in ("outer", "inner", "apex_outer_deg", "apex_inner_deg"):
            if getattr(self, name) is not None:
                raise InputError(name, getattr(self, name), "absent where glasses and face_tilt_deg describe the prism")
        return self

    def build(self, relay: Relay, pixel_um: float, own: Mapping[str, Glass]) -> DoubleAmici | PrismStack:
        """Return the prism between these lenses; ``own`` are the camera's [glass.NAME] tables.

        Raises:
            InputError: see :meth:`media`, or what the prism finds.
        """
        shared = {
            "relay": relay,
            "pixel_um": pixel_um,
            "design_nm": self.design_nm,
            "design_position_px": self.design_position_px,
            "fresnel": self.fresnel,
            "field": self.field,
        }
        media = self.media(own)
        if self.face_tilt_deg is not None:
            return PrismStack(glasses=media, face_tilt_rad=tuple(math.radians(t) for t in self.face_tilt_deg), **shared)
        assert self.apex_inner_deg is not None
        apex_inner = math.radians(self.apex_inner_deg)
        direct = self.apex_outer_deg is None
        outer, inner = media
        apex_outer = direct_view_apex(outer, inner, apex_inner, self.design_nm) if direct else math.radians(self.apex_outer_deg or 0.0)
        return DoubleAmici(outer=outer, inner=inner, apex_outer_rad=apex_outer, apex_inner_rad=apex_inner, **shared)

    def media(self, own: Mapping[str, Glass]) -> tuple[Glass, ...]:
        """Look up the glasses: (outer, inner), or those of the spaces between faces.

        Raises:
            InputError: ``prism.outer.glass`` and the like for an unknown name.
        """
        places = (
            {"outer": self.outer, "inner": self.inner} if self.glasses is None else {f"glasses.{i}": n for i, n in enumerate(self.glasses)}
        )
        found = []
        for place, name in places.items():
            try:
                found.append(medium(str(name), own))
            except InputError as error:
                raise InputError(f"prism.{place}.{error.field}", error.value, error.allowed) from None
        return tuple(found)


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
