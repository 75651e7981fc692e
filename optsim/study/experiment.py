"""The paper's experiment: toy bricks through the emulated test bed, and the spectra of two points against the truth (its Fig. 9 to 11)."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from optsim import __version__
from optsim.cube import make_cube
from optsim.report.data import SERIES, Series
from optsim.study.claims.bench import Bench
from optsim.study.claims.captures import Taken
from optsim.study.claims.methods import BENCH_FRACTIONS, BlindTau
from optsim.study.claims.run import unit_seconds
from optsim.study.claims.work import compared, reference_pixels, signature
from optsim.study.claims.worlds import BENCH, Cell, World
from optsim.study.plan import MONO_SHOTS_PER_GROUP, ratio_of, shots_of
from optsim.study.pool import Progress, run_all
from optsim.study.store import Store, digest, write_json
from optsim.study.world import PHYSICS_VERSION
from recon.threads import cores

if TYPE_CHECKING:
    import xarray as xr

EXPERIMENT_VERSION = 1
"""Raise when a change here or in recon changes estimates: old entries are then computed anew."""
UNITS_A_SHOT = 3.0
"""Expected time of a shot's share of a solve over that of a unit of work (``unit_seconds``), at 64 x 64."""


class ExperimentConfig(BaseModel):
    """Describe the experiment.

    Args:
        seed: of masks, noise and render, 0 to 2^32 - 1.
        size: mirrors along each side, 32 to 512.
        groups: colour shots, or groups of three monochrome shots; R = 3 groups / 24.
        render_error: relative error of the render.
        workers: solves side by side; None: one a core.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    seed: int = Field(0, ge=0, le=2**32 - 1)
    size: int = Field(256, ge=32, le=512)
    groups: tuple[Annotated[int, Field(ge=1, le=8)], ...] = Field((1, 4), min_length=1)
    render_error: float = Field(0.01, gt=1e-4, le=1)
    workers: int | None = Field(None, ge=1, le=256)

    @field_validator("groups")
    @classmethod
    def _rising(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if list(value) != sorted(set(value)):
            raise ValueError("must rise strictly")
        return value

    @classmethod
    def quick(cls, seed: int = 0) -> ExperimentConfig:
        """Return the quick form: 64 x 64."""
        return cls(seed=seed, size=64, render_error=0.02)


@dataclass(frozen=True)
class Shoot:
    """One sensor's measurement and its reconstruction."""

    series: Series
    groups: int
    size: int

    @property
    def name(self) -> str:
        """Return a name fit for files."""
        return f"{BENCH}-{self.series.key}-R{self.groups}of8"

    @property
    def R(self) -> float:
        """Return the compression ratio."""
        return ratio_of(self.groups)

    @property
    def shots(self) -> int:
        """Return the number of exposures."""
        return shots_of(self.series.sensor, self.groups)

    @property
    def cost(self) -> float:
        """Return its expected time in units of work."""
        numbers = self.groups * (1 if self.series.sensor == "bayer" else MONO_SHOTS_PER_GROUP)
        return UNITS_A_SHOT * (1 + numbers) * (self.size / 64) ** 2


@dataclass(frozen=True, eq=False)
class Experiment:
    """The experiment's answer.

    Args:
        config: what was run.
        rows: one a sensor, mask rule and R: scores, and the relative error of each point's signature.
        wavelength_nm: of the bands.
        signatures: point -> "truth" or name of a shoot -> (K,) radiance, W m^-2 sr^-1 nm^-1.
        folder: where everything lies.
        page: experiment.html.
        seconds: wall time of the call.
    """

    config: ExperimentConfig
    rows: list[dict[str, Any]]
    wavelength_nm: list[float]
    signatures: dict[str, dict[str, list[float]]]
    folder: Path
    page: Path
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            "version": __version__,
            "config": self.config.model_dump(mode="json"),
            "wavelength_nm": self.wavelength_nm,
            "rows": self.rows,
            "signatures": self.signatures,
        }


def run_experiment(
    config: ExperimentConfig, folder: Path, command: str = "optsim study experiment", quiet: bool = False
) -> Experiment:  # fmt: skip
    """Run the experiment, or what is left of it, into a folder.

    Args:
        config: what to run.
        folder: gets experiment.json, experiment.html, cubes/, frames/, estimates/ and figures/.
        command: the line that makes the run again, for the page.
        quiet: tell nothing.

    Raises:
        RuntimeError: when a reconstruction failed; the others are kept.
        KeyboardInterrupt: on Ctrl-C; finished work stays, and the same call goes on from there.
    """
    from threadpoolctl import threadpool_limits

    began = time.perf_counter()
    store = Store(folder)
    shoots = [Shoot(series, groups, config.size) for groups in config.groups for series in SERIES]
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            rows = _run(config, shoots, store, quiet)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"stopped; what is finished stays in {folder}, and the same command goes on from there") from None
    truth = store.load(f"{_cube_name(config)}.nc")
    signatures = _signatures(config, shoots, truth, store)
    found = Experiment(
        config, rows, truth["wavelength"].values.tolist(), signatures, folder, folder / "experiment.html", time.perf_counter() - began
    )
    write_json(found.as_dict(), folder / "experiment.json")
    from optsim.study.experiment_page import write_page

    write_page(found, shoots, store, command)
    return found


def _run(config: ExperimentConfig, shoots: list[Shoot], store: Store, quiet: bool) -> list[dict[str, Any]]:
    waiting = [s for s in shoots if store.finished(f"estimates/{s.name}", _key(config, s)) is None]
    world = World(BENCH, config.size, config.render_error, config.seed)
    if waiting and not quiet:
        workers = config.workers or cores()
        unit = unit_seconds()
        seconds = unit * sum(s.cost for s in waiting) / workers + 30 * (config.size / 128) ** 2 + 20
        print(
            f"plan: {len(shoots)} reconstructions at {config.size} x {config.size}, {len(waiting)} to do; expected time: "
            f"{seconds / 60:.1f} min on {workers} cores (a unit of work took {unit:.2f} s just now)",
            file=sys.stderr,
            flush=True,
        )
    rows: dict[str, dict[str, Any]] = {}

    def work(shoot: Shoot, tick: Callable[..., None]) -> str:
        rows[shoot.name] = _solve(config, shoot, world, store, tick)
        return f"{rows[shoot.name]['psnr_db']:.2f} dB"

    with Progress(sum(s.cost for s in waiting), quiet) as progress:
        name, key = _cube_name(config), digest({"stage": "experiment cube", **_inputs(config)})
        if store.finished(name, key) is None:
            progress.say(f"rendering {BENCH} at {config.size} x {config.size}")
            store.keep(name, key, {}, {f"{name}.nc": world.cube})
        failures = run_all(sorted(waiting, key=lambda s: -s.cost), work, config.workers, progress)
    if failures:
        first, error = next(iter(failures.items()))
        raise RuntimeError(f"{len(failures)} of {len(waiting)} reconstructions failed; the first, {first}: {error}") from error
    done = {s.name: store.finished(f"estimates/{s.name}", _key(config, s)) for s in shoots}
    return [dict(done[s.name] or rows[s.name]) for s in shoots]


def _inputs(config: ExperimentConfig) -> dict[str, Any]:
    return {
        "version": [__version__, EXPERIMENT_VERSION, PHYSICS_VERSION],
        "config": config.model_dump(mode="json", include={"seed", "size", "render_error"}),
    }


def _key(config: ExperimentConfig, shoot: Shoot) -> str:
    return digest({"stage": "experiment", "shoot": shoot.name, "fractions": BENCH_FRACTIONS, **_inputs(config)})


def _cube_name(config: ExperimentConfig) -> str:
    return f"cubes/{BENCH}-{config.size}"


def _solve(config: ExperimentConfig, shoot: Shoot, world: World, store: Store, tick: Callable[..., None]) -> dict[str, Any]:
    """Photograph, invert, score and keep one sensor's measurement."""
    from optsim.camera import band_model_of, signal_of
    from recon.metrics import score

    began = time.perf_counter()
    frames = Bench().frames(world, shoot.series, shoot.groups, Cell(BENCH, 0, config.size).seed(config.seed))
    taken = Taken(band_model_of(frames).operator(np.float32), signal_of(frames))
    method = BlindTau(BENCH_FRACTIONS)
    solved = method.invert(taken, world.truth, tick)
    cube = np.asarray(solved.cube, np.float64)
    scores = score(cube, world.truth)
    row = {
        "sensor": shoot.series.sensor,
        "masks": shoot.series.masks,
        "R": shoot.R,
        "shots": shoot.shots,
        "saturated_pixels": int(frames.attrs["saturated_pixels"]),
        "psnr_db": scores.psnr_db,
        "ssim": scores.ssim,
        "sam_deg": scores.sam_deg,
        "band_psnr_db": list(scores.band_psnr_db),
        "signatures": {name: compared(cube, world.truth, place) for name, place in reference_pixels(config.size).items()},
        "tau_fraction": solved.tau_fraction,
        "at_edge": solved.at_edge,
        "converged": solved.converged,
        "iterations": solved.iterations,
        "seconds": time.perf_counter() - began,
    }
    estimate = make_cube(np.ascontiguousarray(solved.cube, np.float32), world.bands)
    files = {f"frames/{shoot.name}.nc": frames, f"estimates/{shoot.name}.nc": estimate}
    return store.keep(f"estimates/{shoot.name}", _key(config, shoot), row, files)


def _signatures(config: ExperimentConfig, shoots: list[Shoot], truth: xr.Dataset, store: Store) -> dict[str, dict[str, list[float]]]:
    places = reference_pixels(config.size)
    cubes = {"truth": truth["radiance"].values} | {s.name: store.load(f"estimates/{s.name}.nc")["radiance"].values for s in shoots}
    return {point: {name: signature(cube, place).tolist() for name, cube in cubes.items()} for point, place in places.items()}
