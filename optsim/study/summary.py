"""What a run leaves for machines and for the report: summary.json, and the RunData behind the page."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim import __version__
from optsim.cube import bands_of
from optsim.study.config import StudyConfig
from optsim.study.plan import SolveTask, shootings
from optsim.study.store import Store
from recon.threads import cores

if TYPE_CHECKING:
    from optsim.report.data import Capture, Frames, Response, RunData, Solve

LIBRARIES = ("mitsuba", "drjit", "numpy", "scipy", "numba", "PyWavelets", "xarray", "OpenEXR", "colour-science")


def machine(variant: str | None) -> dict[str, Any]:
    """Describe where the run took place."""
    from optsim.render.backend import memory_gib

    return {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": cores(),
        "memory_gib": memory_gib(),
        "variant": variant,
        "versions": {name: importlib.metadata.version(name) for name in LIBRARIES},
    }


def make_summary(config: StudyConfig, rows: Sequence[Mapping[str, Any]], variant: str | None) -> dict[str, Any]:
    """Return the contents of summary.json."""
    return {"version": __version__, "config": config.model_dump(mode="json"), "machine": machine(variant), "rows": list(rows)}


def make_run_data(
    config: StudyConfig,
    store: Store,
    summary: Mapping[str, Any],
    worlds: Mapping[str, Mapping[str, Any]],
    solved: Mapping[SolveTask, Mapping[str, Any]],
    command: str,
    notes: Sequence[str],
) -> RunData:
    """Gather what the report may show; cubes and frames are read from the store when asked for."""
    from optsim.camera import prism_report
    from optsim.report.data import RunData, TauScore, Truth

    truths = {}
    for target in worlds:
        cube = store.load(f"cubes/{target}.nc")
        truths[target] = Truth(cube["radiance"].values, bands_of(cube), cube["stderr"].values if "stderr" in cube else None)
    found = _Files(config, store, solved)
    seconds = {f"{stage} {target}": float(s) for target, world in worlds.items() for stage, s in world["seconds"].items()}
    seconds |= {"reconstruct (thread-seconds)": sum(float(row["seconds"]) for row in summary["rows"] if row["tau_rule"] != "oracle")}
    return RunData(
        summary=summary,
        truths=truths,
        estimate=found.estimate,
        frames=found.frames,
        responses=_responses(),
        prism=prism_report(),
        explain={target: world["explain"] for target, world in worlds.items()},
        tau_path=[
            TauScore(**point, solver=task.solver, model=task.shooting.model, operator=task.operator)
            for task, result in solved.items()
            for point in result["tau_path"]
        ],
        lost_light=_lost(worlds),
        timings=seconds,
        notes=list(notes),
        command=command,
    )


class _Files:
    """Find estimates and frames by the report's identities."""

    def __init__(self, config: StudyConfig, store: Store, solved: Mapping[SolveTask, Mapping[str, Any]]) -> None:
        self.store = store
        self.shootings = {s.capture: s for target in config.targets for s in shootings(config, target)}
        self.tasks = {(t.shooting.capture, t.operator, t.solver): t for t in solved}

    def estimate(self, solve: Solve) -> np.ndarray | None:
        task = self.tasks.get((solve.capture, solve.operator, solve.solver))
        if task is None:
            return None
        rule = "" if solve.tau_rule is None else f"-{solve.tau_rule}"
        cube: np.ndarray = self.store.load(f"estimates/{task.name}{rule}.nc")["radiance"].values
        return cube

    def frames(self, capture: Capture) -> Frames | None:
        from optsim.report.data import Frames

        shooting = self.shootings.get(capture)
        if shooting is None:
            return None
        data = self.store.load(f"frames/{shooting.name}.nc")
        return Frames(data["frames"].values, data.attrs["units"], data["cfa"].values if "cfa" in data else None)


def _responses() -> dict[str, Response]:
    from optsim.camera import sensors
    from optsim.report.data import Response

    wavelength = np.arange(450.0, 670.5, 1.0)
    sources = {
        "mono": "flat by assumption",
        "bayer": "Nikon 5100, measured by NPL, from colour-science",
        "foveon": "Sigma SD Merrill (Foveon X3), measured by NPL, from colour-science",
    }
    return {
        sensor.name: Response(wavelength, dict(zip(sensor.curve_names, sensor.response(wavelength))), sources[sensor.name])
        for sensor in sensors()
    }


def _lost(worlds: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Return the shares of light lost, of the first target and the first monochrome capture: optics only, no sensor."""
    for world in worlds.values():
        for photons in world["photons"].values():
            sent = photons["sent"]
            if sent > 0:
                words = {
                    "missed_sensor": "falls beside the sensor",
                    "blocked": "stopped by the 450-670 nm band-pass filter",
                    "reflected": "reflected inside the prism",
                    "outside_bands": "detected, but outside the 24 bands that H knows",
                }
                return {text: photons[name] / sent for name, text in words.items() if name in photons}
    return {}
