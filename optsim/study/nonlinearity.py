"""What the prism's nonlinearity and the mask's registration cost a reconstruction, in dB (theory.md (C.70)).

The data are always exact and fine: every sample of every mirror at ten or more wavelengths a band, laid where the traced
prism sends it. Only what the reconstruction believes differs. Solver, rule for tau and masks are the same for all
beliefs, so that differences are paired.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny

from optsim import __version__
from optsim.camera.camera import CameraConfig
from optsim.camera.effects import effect_named, reduced
from optsim.camera.sensor import Sensor, sensors
from optsim.cube import Bands, band_mean, block_mean
from optsim.study.assumptions import ASSUMPTIONS, Assumption, ExactWeights
from optsim.study.fine_scene import FineScene, Rendered, TexturedField
from optsim.study.judge import JUDGE_VERSION, TAU_FRACTIONS, judge
from optsim.study.pairs import Interval, paired_loss
from optsim.study.pool import Progress, run_all
from optsim.study.store import Store, digest, write_json

if TYPE_CHECKING:
    import xarray as xr

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
    offsets_px: tuple[float, ...] = (0.05, 0.1, 0.2, 0.5, 1.0)
    subdivide: int = Field(10, ge=10, le=100)
    samples: int = Field(3, ge=2, le=8)
    workers: int | None = Field(None, ge=1, le=256)

    @classmethod
    def quick(cls) -> NonlinearityConfig:
        """Return a study of well under a minute: 32 x 32 mirrors, two seeds, two scenes, two offsets."""
        return cls(size=32, seeds=2, scenes=(TexturedField(), Rendered(name="color-checker")), offsets_px=(0.2, 1.0))


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


@dataclass(frozen=True, eq=False)
class Loss:
    """How much lower than with exact weights one case scores.

    Args:
        sensor, case, kind, amount_px: which.
        scene: its name, or None for all scenes together.
        loss_db: mean over seeds with its interval.
        psnr_db: mean score of the case itself.
    """

    sensor: str
    case: str
    kind: str
    amount_px: float
    scene: str | None
    loss_db: Interval
    psnr_db: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {**vars(self), "loss_db": self.loss_db._asdict()}


@dataclass(frozen=True, eq=False)
class Cost:
    """The study's answer.

    Args:
        config: what was run.
        camera: the camera that took the data (its dispersion only).
        rows: one a solve: scene, sensor, seed, case, kind, amount_px, psnr_db, tau_fraction, at_edge, residual, converged.
        losses: over all scenes and for each, paired with the exact weights.
        curve: ``wavelength_nm`` and, by assumption, ``error_px`` over it for the first seed.
    """

    config: NonlinearityConfig
    camera: CameraConfig
    rows: list[dict[str, Any]]
    losses: list[Loss]
    curve: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "version": __version__,
            "config": self.config.model_dump(mode="json"),
            "camera": self.camera.to_toml(),
            "curve": self.curve,
            "losses": [loss.as_dict() for loss in self.losses],
            "rows": self.rows,
        }


def run_nonlinearity(
    folder: Path,
    config: NonlinearityConfig | None = None,
    camera: CameraConfig | None = None,
    bands: Bands | None = None,
    *,
    chosen: Sequence[Sensor] | None = None,
    quiet: bool = False,
) -> Cost:
    """Run the study, or what is left of it, and write ``nonlinearity.json`` into the folder.

    Args:
        folder: gets one small file a solve, so that the same call goes on where it was stopped.
        config: None: the defaults.
        camera: None: the default. Only its dispersion and smile act: other effects are left out and the band-pass is that of the bands,
            so that beliefs about the dispersion are all that differs.
        bands: None: the paper's.
        chosen: sensors; None: mono, Bayer, Foveon.
        quiet: show no progress.

    Raises:
        RuntimeError: when solves failed; the others are kept.
        KeyboardInterrupt: on Ctrl-C; what is finished stays.
    """
    config = NonlinearityConfig() if config is None else config
    bands = Bands.paper() if bands is None else bands
    plain = nominal(CameraConfig() if camera is None else camera, bands)
    cases = list(all_cases(plain, config))
    chosen = sensors() if chosen is None else tuple(chosen)
    store = Store(folder)
    rows: list[dict[str, Any]] = []
    with Progress(len(config.scenes) * len(chosen) * config.seeds * len(cases), quiet) as progress:
        for scene in config.scenes:
            fine = _Lazy(scene, config, bands)
            for seed in range(config.first_seed, config.first_seed + config.seeds):
                for sensor in chosen:
                    rows += _one_set(config, store, fine, sensor, seed, bands, cases, progress)
    cost = Cost(config, plain, rows, summarise(rows), _curve(plain, bands, config.first_seed))
    write_json(cost.as_dict(), store.root / "nonlinearity.json")
    return cost


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


class _Lazy:
    """Hold a scene's fine cube and truth, made when first needed."""

    def __init__(self, scene: FineScene, config: NonlinearityConfig, bands: Bands) -> None:
        self.scene, self._config, self._bands = scene, config, bands
        self._cube: xr.Dataset | None = None

    @property
    def cube(self) -> xr.Dataset:
        if self._cube is None:
            c = self._config
            self._cube = self.scene.cube(self._bands.subdivide(c.subdivide), (c.size, c.size), c.samples)
        return self._cube

    @property
    def truth(self) -> np.ndarray:
        mean = band_mean(block_mean(self.cube, self._config.samples), self._bands)
        return np.asarray(mean["radiance"].values, np.float64)


@dataclass(frozen=True, eq=False)
class _Solve:
    """One case with its frames, as the pool runs it."""

    name: str
    key: str
    case: Case
    signal: np.ndarray
    cost: float = 1.0


def _one_set(
    config: NonlinearityConfig,
    store: Store,
    fine: _Lazy,
    sensor: Sensor,
    seed: int,
    bands: Bands,
    cases: Sequence[Case],
    progress: Progress,
) -> list[dict[str, Any]]:
    """Run all cases of one scene, sensor and seed: they share the masks."""
    from optsim.camera import Distinct, masks_for, physical_model

    masks = masks_for(sensor, config.groups * sensor.shots_per_group, Distinct(), (config.size, config.size), seed)
    found: dict[str, dict[str, Any]] = {}
    waiting: list[tuple[str, str, Case]] = []
    for case in cases:
        name = f"solves/{fine.scene.name}-{sensor.name}-{seed}-{case.name.replace(' ', '-')}".replace("'", "")
        key = _key(config, fine.scene, sensor, seed, bands, case)
        done = store.finished(name, key)
        if done is None:
            waiting.append((name, key, case))
        else:
            found[case.name] = done
            progress.advance(1.0, f"{name}: found finished")
    if waiting:
        tasks = list(_with_frames(waiting, fine, sensor, masks, bands))
        truth = fine.truth

        def work(task: _Solve, tick: Callable[..., None]) -> str:
            believed = task.case.believed
            model = physical_model(believed, sensor, bands, masks, task.case.assumption.knowledge(believed, bands, seed))
            judged = judge(model.operator(np.float32), task.signal, truth, tick)
            found[task.case.name] = store.keep(task.name, task.key, judged.as_dict(), {})
            return f"{judged.psnr_db:.2f} dB"

        failures = run_all(tasks, work, config.workers, progress)
        if failures:
            name, error = next(iter(failures.items()))
            raise RuntimeError(f"{len(failures)} of {len(tasks)} solves failed; the first, {name}: {error}") from error
    identity = {"scene": fine.scene.name, "sensor": sensor.name, "seed": seed}
    return [{**identity, "case": c.name, "kind": c.kind, "amount_px": c.amount_px, **found[c.name]} for c in cases]


def _with_frames(
    waiting: Sequence[tuple[str, str, Case]], fine: _Lazy, sensor: Sensor, masks: np.ndarray, bands: Bands
) -> Iterator[_Solve]:  # fmt: skip
    """Photograph once for each camera: noise-free means of one second, in electrons."""
    from optsim.camera import Exposure, photograph, signal_of

    taken: dict[str, np.ndarray] = {}
    for name, key, case in waiting:
        text = case.camera.to_toml()
        if text not in taken:
            taken[text] = signal_of(photograph(fine.cube, bands, case.camera, sensor, masks, Exposure(time_s=1.0)))
        yield _Solve(name, key, case, taken[text])


def _key(config: NonlinearityConfig, scene: FineScene, sensor: Sensor, seed: int, bands: Bands, case: Case) -> str:
    settings = config.model_dump(mode="json", include={"size", "groups", "subdivide", "samples"})
    stands = scene.model_dump(mode="json") if isinstance(scene, BaseModel) else scene.name
    believes = case.assumption.model_dump(mode="json") if isinstance(case.assumption, BaseModel) else None
    return digest(
        {
            "stage": "nonlinearity",
            "version": [__version__, JUDGE_VERSION],
            "taus": TAU_FRACTIONS,
            "settings": settings,
            "scene": stands,
            "sensor": [sensor.name, sensor.band_mean(bands).tolist()],
            "seed": seed,
            "bands": [bands.lower.tolist(), bands.upper.tolist(), bands.center.tolist()],
            "case": [case.name, case.camera.to_toml(), case.believed.to_toml(), believes],
        }
    )


def summarise(rows: Sequence[dict[str, Any]]) -> list[Loss]:
    """Pair every case with exact weights on the same scene, sensor and masks; all scenes together first, then each."""
    scenes: list[str | None] = [None, *dict.fromkeys(row["scene"] for row in rows)]
    cases = dict.fromkeys((row["sensor"], row["case"], row["kind"], row["amount_px"]) for row in rows)
    losses = []
    for scene in scenes:
        kept = [row for row in rows if scene is None or row["scene"] == scene]
        for sensor, case, kind, amount in cases:
            best = _scores(kept, sensor, ExactWeights().name)
            other = _scores(kept, sensor, case)
            losses.append(Loss(sensor, case, kind, amount, scene, paired_loss(best, other), float(np.mean(list(other.values())))))
    return losses


def _scores(rows: Sequence[dict[str, Any]], sensor: str, case: str) -> dict[tuple[str, int], float]:
    return {(row["scene"], row["seed"]): row["psnr_db"] for row in rows if row["sensor"] == sensor and row["case"] == case}


def _curve(camera: CameraConfig, bands: Bands, seed: int) -> dict[str, Any]:
    """Return how far each belief places light from where it lands, over wavelength."""
    wavelength = np.linspace(bands.lower[0], bands.upper[-1], 217)
    exact = camera.dispersion.position_px(wavelength)[0]
    error = {a.name: (a.positions(camera, bands, wavelength, seed) - exact).tolist() for a in ASSUMPTIONS}
    return {"wavelength_nm": wavelength.tolist(), "error_px": error}
