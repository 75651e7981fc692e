"""The camera as one config: prism or table, relay, mirrors, sensor, band-pass; read from and written to TOML."""

from __future__ import annotations

import math
import tomllib
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import field_validator, model_validator

from optsim.camera.center_table import CenterTable
from optsim.camera.glass import glass
from optsim.camera.model import Model, ranged
from optsim.camera.prism import (
    DEFAULT_APEX_INNER_DEG,
    DEFAULT_DESIGN_POSITION_PX,
    DEFAULT_PIXEL_UM,
    DESIGN_NM,
    Dispersion,
    DoubleAmici,
    direct_view_apex,
)
from optsim.camera.radiometry import etendue_m2_sr
from optsim.camera.relay import Relay
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
    """Describe ideal mirrors: their pitch in um and the share of the pitch's area that reflects, in (0, 1]."""

    pitch_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = 13.68
    fill_factor: Annotated[float, ranged(0, 1, "", "(]")] = 0.92


class SensorConfig(Model):
    """Describe the pixels that all three sensors share: pitch in um, full well in electrons a pixel or layer (assumed)."""

    pitch_um: Annotated[float, ranged(0, 1e4, "um", "(]")] = DEFAULT_PIXEL_UM
    full_well_e: Annotated[float, ranged(0, 1e12, "electrons", "(]")] = 20_000.0


class BandpassConfig(Model):
    """Describe an ideal band-pass filter: transmission 1 from lower_nm to upper_nm, 0 elsewhere."""

    lower_nm: Annotated[float, ranged(0, 1e5, "nm", "(]")] = 450.0
    upper_nm: Annotated[float, ranged(0, 1e5, "nm", "(]")] = 670.0

    @model_validator(mode="after")
    def _ordered(self) -> BandpassConfig:
        if self.upper_nm <= self.lower_nm:
            raise InputError("upper_nm", self.upper_nm, f"above lower_nm = {self.lower_nm:g} nm")
        return self

    def clip(self, lower_nm: np.ndarray, upper_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parts of bands inside the filter; upper = lower where nothing is left."""
        lower = np.clip(lower_nm, self.lower_nm, self.upper_nm)
        return lower, np.clip(upper_nm, self.lower_nm, self.upper_nm)


class CameraConfig(Model):
    """Describe the whole camera.

    Args:
        prism: glasses and angles; the default design if neither it nor ``table`` is given.
        table: measured band centres, in place of the prism.
        relay, dmd, sensor, bandpass: see there.
    """

    place: ClassVar[str] = "camera"
    prism: PrismConfig | None = None
    table: TableConfig | None = None
    relay: Relay = Relay()
    dmd: DmdConfig = DmdConfig()
    sensor: SensorConfig = SensorConfig()
    bandpass: BandpassConfig = BandpassConfig()

    @model_validator(mode="before")
    @classmethod
    def _one_dispersion(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("prism") is not None or data.get("table") is not None:
            return data
        return {**data, "prism": {"design_position_px": DEFAULT_DESIGN_POSITION_PX}}

    @model_validator(mode="after")
    def _not_both(self) -> CameraConfig:
        if self.prism is not None and self.table is not None:
            raise InputError("table", "given together with [prism]", "the only one of [prism] and [table]")
        return self

    @property
    def dispersion(self) -> Dispersion:
        """Return where light lands: a traced prism or a table."""
        if self.table is not None:
            return CenterTable(centers_nm=self.table.centers_nm, relay=self.relay, pixel_um=self.sensor.pitch_um)
        assert self.prism is not None
        p, outer, inner = self.prism, glass(self.prism.outer), glass(self.prism.inner)
        apex_inner = math.radians(p.apex_inner_deg)
        apex_outer = direct_view_apex(outer, inner, apex_inner, p.design_nm) if p.apex_outer_deg is None else math.radians(p.apex_outer_deg)
        return DoubleAmici(
            outer=outer,
            inner=inner,
            apex_outer_rad=apex_outer,
            apex_inner_rad=apex_inner,
            relay=self.relay,
            pixel_um=self.sensor.pitch_um,
            design_nm=p.design_nm,
            design_position_px=p.design_position_px,
        )

    @property
    def mirror_px(self) -> float:
        """Return the side of a mirror's image in sensor pixels."""
        return self.dmd.pitch_um * self.relay.magnification / self.sensor.pitch_um

    @property
    def throughput_m2_sr(self) -> float:
        """Return étendue x transmission of one mirror, in m^2 sr: it turns radiance x time into energy (theory.md (C.8))."""
        return etendue_m2_sr(self.dmd.pitch_um, self.dmd.fill_factor, self.relay.projected_solid_angle_sr) * self.relay.transmission

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> CameraConfig:
        """Read a camera from a TOML file with tables [prism] or [table], [relay], [dmd], [sensor], [bandpass].

        Raises:
            InputError: field ``--camera`` when the file cannot be read, else the dotted key.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError("--camera", str(path), f"a readable TOML file ({error.__class__.__name__})") from None
        return cls.parse_toml(text)

    @classmethod
    def parse_toml(cls, text: str) -> CameraConfig:
        """Read a camera from TOML text; see :meth:`from_toml`."""
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError("--camera", text[:60], f"valid TOML ({error})") from None
        return cls(**data)

    def to_toml(self) -> str:
        """Write the camera as TOML that reads back as an equal config."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))
