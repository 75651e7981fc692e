"""What a finished (or half-finished) run hands to the report: the contract between study and report.

The study builds one :class:`RunData`; figures, verdict and page read nothing else. A part that was not run is
absent (an empty mapping, or a getter that returns None), never a placeholder: the report says what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.report.color import SceneLight

SENSORS = ("mono", "bayer", "foveon")
MASKS = ("distinct", "repeated")
MODELS = ("matched", "physical", "physical-interpolated")
OPERATORS = ("unit-shift", "camera")
TAU_RULES = (None, "auto", "oracle")

R_TOLERANCE = 1e-6
"""Two compression ratios closer than this are the same ratio."""


@dataclass(frozen=True)
class Series:
    """Name one curve of the comparison: a sensor and how its masks are drawn."""

    key: str
    sensor: str
    masks: str
    label: str
    short: str


MONO_DISTINCT = Series("mono-distinct", "mono", "distinct", "Mono, distinct masks", "mono distinct")
MONO_REPEATED = Series("mono-repeated", "mono", "repeated", "Mono, repeated mask", "mono repeated")
BAYER = Series("bayer", "bayer", "distinct", "Bayer", "Bayer")
FOVEON = Series("foveon", "foveon", "distinct", "Foveon", "Foveon")
SERIES = (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON)


@dataclass(frozen=True)
class Capture:
    """Identify one measurement.

    Args:
        target: scene name, e.g. ``color-checker``.
        sensor: ``mono``, ``bayer`` or ``foveon``.
        masks: ``distinct`` or ``repeated`` (colour sensors: ``distinct``).
        R: compression ratio, e.g. 0.125.
        model: ``matched``, ``physical`` or ``physical-interpolated``.
    """

    target: str
    sensor: str
    masks: str
    R: float
    model: str


@dataclass(frozen=True)
class Solve:
    """Identify one reconstruction of a capture.

    Args:
        capture: the measurement.
        operator: ``unit-shift`` or ``camera``.
        solver: e.g. ``basis-pursuit`` or ``gpsr``.
        tau_rule: None (no tau), ``auto`` or ``oracle``.
        seed: the row's seed.
    """

    capture: Capture
    operator: str
    solver: str
    tau_rule: str | None
    seed: int


@dataclass(frozen=True)
class Row:
    """Hold one row of ``summary.json``; keys that are not listed here stay in ``extra``.

    ``psnr_db`` is None when the estimate is exact, ``ssim`` when the picture is under 7 x 7, ``sam_deg`` when no
    spectrum has a direction. ``tau`` is absolute (Eq. 4 without a factor 1/2) and None for basis pursuit.
    """

    target: str
    sensor: str
    masks: str
    R: float
    shots: int
    model: str
    operator: str
    solver: str
    tau: float | None
    tau_rule: str | None
    psnr_db: float | None
    ssim: float | None
    sam_deg: float | None
    seconds: float | None
    iterations: int | None
    stop: str
    seed: int
    extra: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any], index: int = 0) -> Row:
        """Read one JSON row.

        Raises:
            InputError: naming ``rows[index].KEY`` when a key is missing, of an unknown word, or not finite.
        """
        where = f"rows[{index}]"
        known = [name for name in cls.__dataclass_fields__ if name != "extra"]
        for name in known:
            if name not in raw:
                raise InputError(f"{where}.{name}", sorted(map(str, raw)), "present")
        for name, words in (("sensor", SENSORS), ("masks", MASKS), ("model", MODELS), ("operator", OPERATORS), ("tau_rule", TAU_RULES)):
            if raw[name] not in words:
                raise InputError(f"{where}.{name}", raw[name], f"one of {words}")
        for name in ("R", "tau", "psnr_db", "ssim", "sam_deg", "seconds"):
            value = raw[name]
            if value is None and name != "R":
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise InputError(f"{where}.{name}", value, "a finite number" + ("" if name == "R" else " or null"))
        extra = {str(k): v for k, v in raw.items() if k not in known}
        return cls(**{name: raw[name] for name in known}, extra=extra)

    @property
    def series(self) -> Series | None:
        """Return the curve this row lies on, or None for a combination outside :data:`SERIES`."""
        return next((s for s in SERIES if (s.sensor, s.masks) == (self.sensor, self.masks)), None)

    @property
    def converged(self) -> bool | None:
        """Tell whether the solver reached its tolerance; None when the row does not say."""
        value = self.extra.get("converged")
        return value if isinstance(value, bool) else None

    @property
    def solve(self) -> Solve:
        """Return the identity of this row's reconstruction."""
        return Solve(
            Capture(self.target, self.sensor, self.masks, self.R, self.model), self.operator, self.solver, self.tau_rule, self.seed
        )


@dataclass(frozen=True, eq=False)
class Truth:
    """Hold the true cube of one target.

    Args:
        radiance: (y, x, K), W m^-2 sr^-1 nm^-1, finite.
        bands: the K bands.
        stderr: Monte Carlo standard error of the same shape, or None.
        light: of the scene, when it is known: its colour is then the pictures' white.
    """

    radiance: np.ndarray
    bands: Bands
    stderr: np.ndarray | None = None
    light: SceneLight | None = None

    def __post_init__(self) -> None:
        if self.radiance.ndim != 3 or 0 in self.radiance.shape or self.radiance.shape[2] != self.bands.count:
            raise InputError("truth.radiance", self.radiance.shape, f"of shape (y, x, {self.bands.count})")
        for name in ("radiance", "stderr"):
            array = getattr(self, name)
            if array is not None and (array.shape != self.radiance.shape or not np.all(np.isfinite(array))):
                raise InputError(f"truth.{name}", array.shape, f"finite and of shape {self.radiance.shape}")

    @property
    def peak(self) -> float:
        """Return the maximum of the cube: the peak of every PSNR."""
        return float(self.radiance.max())


@dataclass(frozen=True, eq=False)
class Frames:
    """Hold what a sensor recorded.

    Args:
        values: (shot, channel, y, x); channel has size 1 (mono, Bayer) or 3 (Foveon: red, green, blue).
        units: ``relative``, ``electron`` or ``DN``.
        cfa: (y, x) index of the response curve at each pixel (Bayer only: 0 red, 1 green, 2 blue), else None.
    """

    values: np.ndarray
    units: str
    cfa: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Response:
    """Hold the response curves of one sensor.

    Args:
        wavelength_nm: (n,) strictly increasing.
        curves: name ("mono", or "red", "green", "blue") -> (n,) relative response.
        source: where the curves come from, one phrase.
    """

    wavelength_nm: np.ndarray
    curves: Mapping[str, np.ndarray]
    source: str = ""


@dataclass(frozen=True)
class TauScore:
    """Hold one point of a tau path.

    Args:
        target, sensor, masks, R: the capture.
        tau: absolute tau of Eq. 4.
        tau_fraction: tau / tau_max.
        psnr_db: score of this point's cube against the truth, or None when exact.
        heldout: held-out error that the automatic rule looks at, or None.
        solver, model, operator: which path this point lies on, in the words of :class:`Row`.
    """

    target: str
    sensor: str
    masks: str
    R: float
    tau: float
    tau_fraction: float
    psnr_db: float | None
    heldout: float | None = None
    solver: str = "gpsr"
    model: str = "matched"
    operator: str = "unit-shift"


@dataclass(frozen=True, eq=False)
class RunData:
    """Hold everything the report may show.

    Args:
        summary: ``summary.json`` as a mapping: version, config, machine, rows (and any further keys).
        truths: target name -> true cube, in the order in which the targets are shown (the paper's first).
        estimate: returns the (y, x, K) cube of a reconstruction in the truth's units, or None when not run.
        frames: returns what a sensor recorded, or None.
        responses: ``mono``, ``bayer``, ``foveon`` -> curves as published (before any scaling by the band model).
        prism: the JSON of ``optsim prism``, or None.
        explain: target -> the JSON of ``optsim explain``.
        tau_path: every point of every tau path.
        lost_light: sentence-like name -> fraction of the light at the mirrors (0..1) that never reaches a pixel.
        timings: stage -> wall seconds, in the order in which the stages ran.
        notes: sentences to print (warnings, fall-backs, interruptions).
        command: the line that makes this run again.
    """

    summary: Mapping[str, Any]
    truths: Mapping[str, Truth]
    estimate: Callable[[Solve], np.ndarray | None] = lambda solve: None
    frames: Callable[[Capture], Frames | None] = lambda capture: None
    responses: Mapping[str, Response] = field(default_factory=dict)
    prism: Mapping[str, Any] | None = None
    explain: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    tau_path: Sequence[TauScore] = ()
    lost_light: Mapping[str, float] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)
    notes: Sequence[str] = ()
    command: str = "optsim run"
    rows: tuple[Row, ...] = field(init=False)

    def __post_init__(self) -> None:
        raw = self.summary.get("rows", ())
        object.__setattr__(self, "rows", tuple(Row.from_mapping(row, i) for i, row in enumerate(raw)))

    @property
    def targets(self) -> tuple[str, ...]:
        """Return the targets in order: those with a true cube first, then any that only rows mention."""
        names = dict.fromkeys(self.truths)
        names.update(dict.fromkeys(row.target for row in self.rows))
        return tuple(names)

    def cube_of(self, row: Row) -> np.ndarray | None:
        """Return the estimate of a row in float64, checked against its truth's shape, or None.

        Raises:
            InputError: when the estimate is not finite or not of the truth's shape.
        """
        cube = self.estimate(row.solve)
        truth = self.truths.get(row.target)
        if cube is None or truth is None:
            return None
        if cube.shape != truth.radiance.shape or not np.all(np.isfinite(cube)):
            raise InputError("estimate", cube.shape, f"finite and of shape {truth.radiance.shape}")
        return np.asarray(cube, np.float64)
