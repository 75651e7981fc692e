"""What the prism's nonlinearity and the mask's registration cost a reconstruction, in dB (theory.md (C.70)).

The data are always exact and fine: every sample of every mirror at ten or more wavelengths a band, laid where the traced
prism sends it. Only what the reconstruction believes differs. Solver, rule for tau and masks are the same for all
beliefs, so that differences are paired.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from optsim import __version__
from optsim.camera.camera import CameraConfig
from optsim.camera.sensor import Sensor, sensors
from optsim.cube import Bands, band_mean, block_mean
from optsim.study.assumptions import ASSUMPTIONS, ExactWeights
from optsim.study.fine_scene import FineScene
from optsim.study.judge import JUDGE_VERSION, TAU_FRACTIONS, judge
from optsim.study.nonlinearity_plan import Case, NonlinearityConfig, all_cases, nominal
from optsim.study.pairs import Interval, paired_loss
from optsim.study.pool import Progress, run_all
from optsim.study.store import Store, digest, write_json

if TYPE_CHECKING:
    import xarray as xr


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
