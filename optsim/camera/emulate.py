"""Colour sensors emulated by a monochrome one behind coloured glass, as the paper's test bed did (theory.md (C.56))."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, field_validator

from optsim.camera.band_model import collected_light
from optsim.camera.camera import CameraConfig
from optsim.camera.frames import check_frames
from optsim.camera.knowledge import OwnShifts, Scope, Shifts
from optsim.camera.model import Model, ranged
from optsim.camera.physical import Exposure, photograph
from optsim.camera.sensor import COLOUR_NAMES, BayerPhase, Foveon, Mono
from optsim.camera.silicon import FrontFilter
from optsim.camera.spread import Landing
from optsim.cube import Bands
from optsim.errors import InputError
from scenes.spectrum import Spectrum

if TYPE_CHECKING:
    import xarray as xr

GRID_NM = (380.0, 780.0)
_SEED_STREAM = 0x676C6173


class GlassPlate(Model):
    """Model a plate of coloured glass: two logistic edges and the reflection of its faces.

    Args:
        edges: where absorption begins and ends.
        peak: transmission between the edges without reflection, in (0, 1].
        index: of the glass, in [1, 3]; both faces reflect ((n - 1) / (n + 1))^2.
    """

    place: ClassVar[str] = "glass_plate"
    edges: FrontFilter
    peak: Annotated[float, ranged(0, 1, "", "(]")] = 0.9
    index: Annotated[float, ranged(1, 3, "")] = 1.52

    def curve(self, name: str) -> Spectrum:
        """Return the transmission from 380 to 780 nm in steps of 1 nm."""
        grid = np.arange(GRID_NM[0], GRID_NM[1] + 0.5)
        faces = (4 * self.index / (self.index + 1) ** 2) ** 2
        return Spectrum(grid, faces * self.peak * self.edges.transmission(grid), f"{name} glass")


def _plate(low_nm: float, low_width_nm: float, high_nm: float, high_width_nm: float, peak: float, name: str) -> Spectrum:
    edges = FrontFilter(blue_nm=low_nm, blue_width_nm=low_width_nm, red_nm=high_nm, red_width_nm=high_width_nm)
    return GlassPlate(edges=edges, peak=peak).curve(name)


class GlassPlates(Model):
    """Hold the transmissions of a red, a green and a blue plate, in [0, 1].

    The defaults are model curves (the paper does not name its glasses): a long-pass glass with its edge at 590 nm, a green
    one from 495 to 575 nm and a blue one up to 505 nm. Give measured curves where they matter.
    """

    place: ClassVar[str] = "glass"
    red: Spectrum = Field(default_factory=lambda: _plate(590, 4, 1000, 10, 0.95, "red"))
    green: Spectrum = Field(default_factory=lambda: _plate(495, 9, 575, 11, 0.7, "green"))
    blue: Spectrum = Field(default_factory=lambda: _plate(300, 10, 505, 12, 0.75, "blue"))

    @field_validator(*COLOUR_NAMES)
    @classmethod
    def _in_range(cls, value: Spectrum) -> Spectrum:
        if value.minimum < 0 or value.maximum > 1:
            raise InputError("", value.minimum if value.minimum < 0 else value.maximum, "a transmission in [0, 1] at every wavelength")
        return value

    def before(self, sensor: Mono) -> tuple[Mono, Mono, Mono]:
        """Return the sensor behind the red, the green and the blue plate; curves are products, on all nodes and every nm."""
        red, green, blue = (Mono(curve=_product(sensor.curve, plate)) for plate in (self.red, self.green, self.blue))
        return red, green, blue


@dataclass(frozen=True)
class Together(OwnShifts):
    """Let H lay each band as the three plates together collect it: joined exposures share their weights, like a colour sensor's curves.

    Args:
        base: what H knows otherwise.
        sensor: with the curves behind the three plates.
    """

    base: Shifts
    sensor: Foveon

    @property
    def name(self) -> str:  # type: ignore[override]
        """Return the name of what H knows otherwise."""
        return self.base.name

    def land(self, scope: Scope) -> Landing:
        """Return the taps of ``base`` for the light of all three."""
        return self.base.land(replace(scope, passed=collected_light(scope.camera, self.sensor)))

    def mirrors(self, scope: Scope, masks: np.ndarray) -> np.ndarray:
        """Return the mirrors of ``base``."""
        return self.base.mirrors(scope, masks)

    def pixels(self, scope: Scope, width: int) -> tuple[np.ndarray | None, float]:
        """Return the pixels of ``base``."""
        return self.base.pixels(scope, width)


def plate_exposures(
    cube: xr.Dataset, bands: Bands, camera: CameraConfig, masks: np.ndarray, exposure: Exposure, sensors: tuple[Mono, Mono, Mono]
) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
    """Photograph a series three times: through the red, the green and the blue plate, with noise of its own each.

    Args:
        cube, bands, camera, masks, exposure: as for ``photograph``; without ``exposure.time_s`` each plate is exposed to
            ``exposure.fill`` by itself.
        sensors: of :meth:`GlassPlates.before`.

    Raises:
        InputError: as ``photograph``.
    """
    seeds = [int(np.random.SeedSequence(exposure.seed, spawn_key=(_SEED_STREAM, c)).generate_state(2, np.uint32)[0]) for c in range(3)]
    colours = Foveon(**{name: sensor.curve for name, sensor in zip(COLOUR_NAMES, sensors)})
    shared = exposure.model_copy(update={"shifts": Together(exposure.shifts, colours)})
    red, green, blue = (
        photograph(cube, bands, camera, sensor, masks, shared.model_copy(update={"seed": seed})).assign_attrs(seed=exposure.seed)
        for sensor, seed in zip(sensors, seeds)
    )
    return red, green, blue


def foveon_of(exposures: tuple[xr.Dataset, xr.Dataset, xr.Dataset]) -> xr.Dataset:
    """Return the frames of a sensor with all three colours in every pixel, from three exposures behind plates."""
    return _joined(exposures, None)


def bayer_of(exposures: tuple[xr.Dataset, xr.Dataset, xr.Dataset], phase: BayerPhase = BayerPhase.RGGB) -> xr.Dataset:
    """Return the frames of a mosaic: of each exposure behind a plate only the pixels of its colour.

    Raises:
        InputError: field ``camera.sensor.crosstalk`` when the files' H knows of crosstalk: a mosaic's neighbours would pass
            each other's colours on, those of one exposure their own.
    """
    crosstalk = float(exposures[0].attrs.get("crosstalk", 0.0))
    if crosstalk > 0:
        raise InputError("camera.sensor.crosstalk", crosstalk, "0 in the H of exposures from which a mosaic is put together")
    return _joined(exposures, phase)


def _joined(exposures: tuple[xr.Dataset, xr.Dataset, xr.Dataset], phase: BayerPhase | None) -> xr.Dataset:
    """Join three files: curves one below the other; pixels by colour, or all as channels."""
    import xarray as xr

    def along(name: str, dim: str) -> xr.DataArray:
        parts = [_above_dark(e, name).assign_coords({dim: [c]}) for e, c in zip(exposures, COLOUR_NAMES)]
        return xr.concat(parts, dim=dim).transpose(*exposures[0][name].dims)

    joined = exposures[0].drop_dims(("channel", "curve"))
    for name, variable in exposures[0].data_vars.items():
        if "curve" in variable.dims:
            joined[name] = along(str(name), "curve")
        elif "channel" in variable.dims and (name == "frames" or phase is None):
            joined[name] = along(str(name), "channel")
        elif "channel" in variable.dims:
            joined[name] = variable
    if phase is not None:
        stack = joined["frames"].values
        mosaic = phase.mosaic(*stack.shape[-2:])
        pixels = np.take_along_axis(stack, mosaic[None, None].astype(np.intp), axis=1)
        joined = joined.drop_dims("channel").assign(frames=(("shot", "channel", "y", "x"), pixels), cfa=(("y", "x"), mosaic))
        joined = joined.assign_coords(channel=["sensor"])
    joined = joined.assign_attrs(_attributes(exposures, "foveon" if phase is None else "bayer"))
    check_frames(joined)
    return joined


def _above_dark(exposure: xr.Dataset, name: str) -> xr.DataArray:
    """Return a variable; frames without their dark level, which may differ between the exposures."""
    values = exposure[name]
    return values - float(exposure.attrs.get("offset", 0.0)) if name == "frames" else values


def _attributes(exposures: tuple[xr.Dataset, ...], sensor: str) -> dict[str, Any]:
    """Return the attributes of the joined file: those that all share, the exposures' times, their sum of saturated pixels."""
    first = exposures[0].attrs
    shared = {key: value for key, value in first.items() if all(e.attrs.get(key) == value for e in exposures)}
    times = {f"exposure_{c}_s": float(e.attrs["exposure_s"]) for e, c in zip(exposures, COLOUR_NAMES)}
    more: dict[str, Any] = {"sensor": sensor, "offset": 0.0, "emulated": "mono behind red, green and blue glass", **times}
    if "saturated_pixels" in first:
        more["saturated_pixels"] = sum(int(e.attrs["saturated_pixels"]) for e in exposures)
    return shared | more


def _product(a: Spectrum, b: Spectrum) -> Spectrum:
    """Multiply two curves on all their nodes and every nm of the range that both cover."""
    low, high = max(a.range_nm[0], b.range_nm[0]), min(a.range_nm[1], b.range_nm[1])
    if low >= high:
        raise InputError("glass", b.name, f"a curve that shares wavelengths with {a.label}")
    nodes = np.concatenate([a.wavelength_nm, b.wavelength_nm, np.arange(np.ceil(low), high)])
    grid = np.unique(np.concatenate([nodes[(nodes > low) & (nodes < high)], [low, high]]))
    return Spectrum(grid, a.at(grid) * b.at(grid), f"{a.name} behind {b.name}")
