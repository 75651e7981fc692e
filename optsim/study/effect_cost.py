"""What each optical effect costs a reconstruction whose H leaves it out, in dB (theory.md (C.70))."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from optsim.camera.camera import CameraConfig
from optsim.camera.effect_sizes import Size
from optsim.camera.effects import PAPER_FIELD, Effect, present, ranked
from optsim.camera.sensor import Sensor, sensors
from optsim.cube import Bands, band_mean, block_mean
from optsim.study.fine_scene import FineScene, TexturedField
from optsim.study.judge import FEW_FRACTIONS, judge
from optsim.study.pairs import Interval, interval
from optsim.study.pool import Progress, run_all

if TYPE_CHECKING:
    import xarray as xr

NOT_IN_H = {
    "cos4": "belongs to the truth: it acts before the mirrors",
    "objective": "belongs to the truth: it acts before the mirrors",
    "dsnu": "a noise of the pixels: no H can hold it",
}


class EffectCostConfig(BaseModel):
    """Describe the reconstructions that price effects.

    Args:
        size: mirrors along each side, 16 to 256, a multiple of 8.
        seeds: sets of masks, 1 to 100.
        groups: colour shots, or groups of three monochrome shots, 1 to 8.
        subdivide: wavelengths a band in the data, 10 to 100.
        samples: along each mirror side in the data, 2 to 8.
        error: share of light that H may misplace, in [1e-4, 0.1].
        workers: solves side by side; None: one a core.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    size: int = Field(24, ge=16, le=256, multiple_of=8)
    seeds: int = Field(3, ge=1, le=100)
    groups: int = Field(1, ge=1, le=8)
    subdivide: int = Field(10, ge=10, le=100)
    samples: int = Field(2, ge=2, le=8)
    error: float = Field(0.02, ge=1e-4, le=0.1)
    workers: int | None = Field(None, ge=1, le=256)


@dataclass(frozen=True, eq=False)
class EffectCost:
    """Hold all that is known of one effect in one camera.

    Args:
        effect: which.
        present: whether the camera states it.
        required: whether the error asked for needs it.
        size: over the whole field.
        small: over the field of the reconstructions.
        frames_change: ``||with - without|| / ||with||`` of noise-free frames, the first sensor and seed; None where not measured.
        loss_db: by sensor: the score with H that knows all, minus that with H that leaves the effect out.
        note: why there is no loss, or nothing.
    """

    effect: Effect
    present: bool
    required: bool
    size: Size
    small: Size
    frames_change: float | None
    loss_db: dict[str, Interval]
    note: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "name": self.effect.name,
            "what": self.effect.what,
            "present": self.present,
            "required": self.required,
            "px": self.size.px,
            "relative": self.size.relative,
            "px_small_field": self.small.px,
            "frames_change": self.frames_change,
            "loss_db": {name: loss._asdict() for name, loss in self.loss_db.items()},
            "note": self.note,
        }


@dataclass(frozen=True, eq=False)
class _Solve:
    """One inversion: frames of the whole camera, H of the camera ``believed``."""

    name: str
    sensor: Sensor
    seed: int
    effect: str
    believed: CameraConfig
    masks: np.ndarray
    signal: np.ndarray
    cost: float = 1.0


def effect_costs(
    camera: CameraConfig,
    error: float,
    *,
    scene: FineScene | None = None,
    config: EffectCostConfig | None = None,
    field: tuple[int, int] = PAPER_FIELD,
    chosen: Sequence[Sensor] | None = None,
    quiet: bool = False,
) -> list[EffectCost]:
    """Rank a camera's effects by size, and price each by reconstructions with and without it in H.

    The data always hold every fact. H either knows all or all but one effect; masks, solver and rule for tau are the same.

    Args:
        camera: what is judged.
        error: relative error that decides what is required, in [0, 1].
        scene: None: the textured field.
        config: of the reconstructions; its ``seeds`` = several give intervals.
        field: (rows, columns) of mirrors for the sizes.
        chosen: sensors; None: mono, Bayer, Foveon.
        quiet: show no progress.

    Raises:
        InputError: field ``--error``, or what the camera model refuses.
        RuntimeError: when a solve failed.
    """
    config = EffectCostConfig() if config is None else config
    scene = TexturedField() if scene is None else scene
    bands = Bands.paper()
    priced = [effect for effect in present(camera) if effect.name not in NOT_IN_H]
    chosen = sensors() if chosen is None else tuple(chosen)
    fine_bands = bands.subdivide(config.subdivide, (camera.bandpass.lower_nm, camera.bandpass.upper_nm))
    fine = scene.cube(fine_bands, (config.size, config.size), config.samples)
    scores, changes = _price(camera, priced, fine, bands, chosen, config, quiet)
    result = []
    for cost in effect_sizes(camera, error, field, config.size):
        name = cost.effect.name
        known = any(effect.name == name for effect in priced)
        loss = {sensor.name: _loss(scores, sensor.name, name, config.seeds) for sensor in chosen} if known else {}
        result.append(replace(cost, loss_db=loss, frames_change=changes.get(name)))
    return result


def effect_sizes(camera: CameraConfig, error: float, field: tuple[int, int] = PAPER_FIELD, size: int = 24) -> list[EffectCost]:
    """Rank a camera's effects by size alone; ``loss_db`` stays empty.

    Raises:
        InputError: field ``--error``, or what the camera model refuses.
    """
    bands = Bands.paper()
    return [
        EffectCost(
            effect=row.effect,
            present=row.effect.present(camera),
            required=row.required,
            size=row.size,
            small=row.effect.size(camera, bands, (size, size)),
            frames_change=None,
            loss_db={},
            note=NOT_IN_H.get(row.effect.name, "") if row.effect.present(camera) else "the camera does not state it",
        )
        for row in ranked(camera, error, bands, field)
    ]


def _price(
    camera: CameraConfig,
    priced: Sequence[Effect],
    fine: xr.Dataset,
    bands: Bands,
    chosen: Sequence[Sensor],
    config: EffectCostConfig,
    quiet: bool,
) -> tuple[dict[tuple[str, int, str], float], dict[str, float]]:
    """Return scores by (sensor, seed, effect left out or nothing), and how much each effect changes the frames."""
    from optsim.camera import Distinct, masks_for, photograph, signal_of
    from optsim.camera.physical import Exposure

    size = (config.size, config.size)
    truth = band_mean(block_mean(fine, config.samples), bands)["radiance"].values.astype(np.float64)
    tasks: list[_Solve] = []
    changes: dict[str, float] = {}
    for seed in range(1, config.seeds + 1):
        for sensor in chosen:
            masks = masks_for(sensor, config.groups * sensor.shots_per_group, Distinct(), size, seed)
            signal = signal_of(photograph(fine, bands, camera, sensor, masks, Exposure(time_s=1.0)))
            first = _Solve(f"{sensor.name}-{seed}-all", sensor, seed, "", camera, masks, signal)
            tasks += [
                first,
                *(replace(first, name=f"{sensor.name}-{seed}-{e.name}", effect=e.name, believed=e.ideal(camera)) for e in priced),
            ]
            if not changes:
                for effect in priced:
                    without = signal_of(photograph(fine, bands, effect.ideal(camera), sensor, masks, Exposure(time_s=1.0)))
                    changes[effect.name] = float(np.linalg.norm(signal - without) / np.linalg.norm(signal))
    return _solved(tasks, truth, bands, config, quiet), changes


def _solved(
    tasks: Sequence[_Solve], truth: np.ndarray, bands: Bands, config: EffectCostConfig, quiet: bool
) -> dict[tuple[str, int, str], float]:  # fmt: skip
    from optsim.camera import physical_model
    from optsim.camera.band_model import Exact

    scores: dict[tuple[str, int, str], float] = {}

    def work(task: _Solve, tick: Callable[..., None]) -> str:
        model = physical_model(task.believed, task.sensor, bands, task.masks, Exact(error=config.error))
        found = judge(model.operator(np.float32), task.signal, truth, tick, fractions=FEW_FRACTIONS, by_gradients=True)
        scores[task.sensor.name, task.seed, task.effect] = found.psnr_db
        return f"{found.psnr_db:.2f} dB"

    with Progress(len(tasks), quiet) as progress:
        failures = run_all(tasks, work, config.workers, progress)
    if failures:
        name, error = next(iter(failures.items()))
        raise RuntimeError(f"{len(failures)} of {len(tasks)} solves failed; the first, {name}: {error}") from error
    return scores


def _loss(scores: dict[tuple[str, int, str], float], sensor: str, effect: str, seeds: int) -> Interval:
    return interval([scores[sensor, seed, ""] - scores[sensor, seed, effect] for seed in range(1, seeds + 1)])
