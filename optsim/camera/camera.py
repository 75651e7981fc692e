"""The camera as one config: prism or table, relay, mirrors, sensor, band-pass; read from and written to TOML."""

from __future__ import annotations

import tomllib
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field, model_validator

from optsim.camera.center_table import CenterTable
from optsim.camera.glass import Glass
from optsim.camera.model import Model
from optsim.camera.optics import Optics
from optsim.camera.optics_config import BandpassConfig, DmdConfig, ObjectiveConfig, PrismConfig, SensorConfig, TableConfig
from optsim.camera.prism import DEFAULT_DESIGN_POSITION_PX, Dispersion
from optsim.camera.radiometry import etendue_m2_sr, smallest_cone_sr
from optsim.camera.relay import Relay
from optsim.errors import InputError


class CameraConfig(Model):
    """Describe the whole camera.

    Args:
        prism: glasses and angles; the default design if neither it nor ``table`` is given.
        table: measured band centres, in place of the prism.
        glass: glasses of your own, by name; they come before built-in ones of the same name.
        objective, dmd, relay, bandpass, sensor: see there.
    """

    place: ClassVar[str] = "camera"
    prism: PrismConfig | None = None
    table: TableConfig | None = None
    glass: dict[str, Glass] = Field(default_factory=dict)
    objective: ObjectiveConfig = ObjectiveConfig()
    dmd: DmdConfig = DmdConfig()
    relay: Relay = Relay()
    bandpass: BandpassConfig = BandpassConfig()
    sensor: SensorConfig = SensorConfig()

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        own = data.get("glass")
        if isinstance(own, dict):
            named = {name: {**table, "name": name} if isinstance(table, dict) else table for name, table in own.items()}
            data = {**data, "glass": named}
        if data.get("prism") is not None or data.get("table") is not None:
            return data
        return {**data, "prism": {"design_position_px": DEFAULT_DESIGN_POSITION_PX}}

    @model_validator(mode="after")
    def _consistent(self) -> CameraConfig:
        if self.prism is not None and self.table is not None:
            raise InputError("table", "given together with [prism]", "the only one of [prism] and [table]")
        if self.prism is not None:
            self.prism.media(self.glass)
        return self

    @property
    def dispersion(self) -> Dispersion:
        """Return where light lands: a traced prism or a table."""
        if self.table is not None:
            return CenterTable(centers_nm=self.table.centers_nm, relay=self.relay, pixel_um=self.sensor.pitch_um)
        assert self.prism is not None
        return self.prism.build(self.relay, self.sensor.pitch_um, self.glass)

    @property
    def optics(self) -> Optics:
        """Return the whole path from mirrors to sensor: the dispersion with tilt, registration, distortion and blur."""
        return Optics(self)

    def ideal(self) -> CameraConfig:
        """Return the same camera with nothing but its prism's dispersion and smile: perfect mirrors, lenses and pixels."""
        perfect = {
            "objective": ObjectiveConfig(),
            "dmd": DmdConfig(pitch_um=self.dmd.pitch_um, fill_factor=self.dmd.fill_factor, leak=0.0),
            "relay": Relay(
                collimator_mm=self.relay.collimator_mm,
                focal_mm=self.relay.focal_mm,
                f_number=self.relay.f_number,
                transmission=self.relay.transmission,
                diffraction=False,
            ),
            "bandpass": BandpassConfig(lower_nm=self.bandpass.lower_nm, upper_nm=self.bandpass.upper_nm),
            "sensor": SensorConfig(pitch_um=self.sensor.pitch_um, full_well_e=self.sensor.full_well_e, prnu=0.0),
            "prism": None if self.prism is None else self.prism.model_copy(update={"fresnel": False}),
        }
        return self.model_copy(update=perfect)

    @property
    def mirror_px(self) -> float:
        """Return the side of a mirror's image in sensor pixels."""
        return self.dmd.pitch_um * self.relay.magnification / self.sensor.pitch_um

    @property
    def throughput_m2_sr(self) -> float:
        """Return étendue x transmission of one mirror, in m^2 sr: it turns radiance x time into energy (theory.md (C.8)).

        The cone is the narrowest of the objective's (if there is one), the relay's and the mirrors'.
        """
        lenses = [self.relay.f_number] if self.objective.focal_mm is None else [self.relay.f_number, self.objective.f_number]
        return etendue_m2_sr(self.dmd.pitch_um, self.dmd.fill_factor, smallest_cone_sr(*lenses)) * self.relay.transmission

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

        tables = self.model_dump(mode="json", exclude_none=True)
        return tomli_w.dumps(tables if self.glass else {name: table for name, table in tables.items() if name != "glass"})
