"""The first stage of a study: render a target once, and photograph it every way the study needs.

One render gives the fine cube; the true cube is its average over mirrors and bands, and both kinds of data, matched
and physical, come from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optsim import __version__
from optsim.cube import Bands, band_mean, block_mean
from optsim.study.config import StudyConfig
from optsim.study.plan import Shooting, shootings
from optsim.study.store import Store, digest

if TYPE_CHECKING:
    import xarray as xr

    from scenes.scene import Scene

PHYSICS_VERSION = 1
"""Raise when a change of scenes, renderer or camera changes cubes or frames: old entries are then computed anew."""

Say = Callable[[float | None, str], None]


def world_key(config: StudyConfig, target: str) -> str:
    """Return the key of a target's cubes and frames: everything they depend on."""
    from optsim.camera import CameraConfig, sensors
    from scenes import scene_by_name
    from scenes.files import scene_to_data

    names = ("seed", "size", "groups", "gpsr_groups", "physical_groups", "render_error", "subdivide", "oversample")
    return digest(
        {
            "stage": "world",
            "version": __version__,
            "physics": PHYSICS_VERSION,
            "target": target,
            "scene": scene_to_data(scene_by_name(target).build()),
            "camera": CameraConfig().ideal().to_toml(),
            "sensors": {sensor.name: sensor.band_mean(Bands.paper()).tolist() for sensor in sensors()},
            **{name: config.model_dump(mode="json")[name] for name in names},
        }
    )


def make_world(config: StudyConfig, target: str, store: Store, say: Say) -> dict[str, Any]:
    """Render and photograph one target, or find it finished.

    Args:
        config: the study.
        target: scene name.
        store: where files go: ``cubes/TARGET.nc`` and ``.exr``, ``frames/*.nc``.
        say: told of progress.

    Returns:
        ``explain``, ``photons``, ``seconds`` by stage, ``error`` and ``variant`` of the render.
    """
    name, key = f"cubes/{target}", world_key(config, target)
    done = store.finished(name, key)
    if done is not None:
        return done
    from optsim.render.needs import explain
    from scenes import scene_by_name

    scene = scene_by_name(target).build()
    began = time.perf_counter()
    fine = _render(config, scene, store, say)
    rendered = time.perf_counter()
    bands = Bands.paper()
    mirrors = block_mean(fine, config.oversample)
    truth = band_mean(mirrors, bands).assign_attrs(scene=target, bands="paper")
    say(None, f"photographing {target}")
    datasets: dict[str, xr.Dataset] = {f"cubes/{target}.nc": truth, f"cubes/{target}.exr": truth}
    photons: dict[str, dict[str, float]] = {}
    for shooting in shootings(config, target):
        frames = photograph_as(shooting, fine, truth, config.seed)
        datasets[f"frames/{shooting.name}.nc"] = frames
        lost = {k.removeprefix("photons_"): float(v) for k, v in frames.attrs.items() if k.startswith("photons_")}
        if lost:
            photons[shooting.series.key] = lost
    result = {
        "explain": explain(scene, config.render_error).as_dict(),
        "photons": photons,
        "seconds": {"render": rendered - began, "photograph": time.perf_counter() - rendered},
        "error": float(fine.attrs["error"]),
        "variant": str(fine.attrs["variant"]),
    }
    store.keep(name, key, result, datasets)
    checkpoint = _checkpoint(store, target)
    checkpoint.unlink(missing_ok=True)
    with suppress(OSError):  # not empty, or gone already: another run works in the same folder
        checkpoint.parent.rmdir()
    return result


def photograph_as(shooting: Shooting, fine: xr.Dataset, truth: xr.Dataset, seed: int) -> xr.Dataset:
    """Photograph a target as one capture asks: matched from the true cube, physical from the fine one."""
    from optsim.camera import CameraConfig, Distinct, Exposure, Repeated, masks_for, measure_matched, photograph, sensors
    from optsim.cube import bands_of

    sensor = {s.name: s for s in sensors()}[shooting.series.sensor]
    rule = {r.name: r for r in (Distinct(), Repeated())}[shooting.series.masks]
    height, width = truth["radiance"].shape[:2]
    masks = masks_for(sensor, shooting.shots, rule, (height, width), seed)
    if shooting.physical:
        exposure = Exposure(seed=seed, masks_name=rule.name)
        return photograph(fine, bands_of(truth), CameraConfig().ideal(), sensor, masks, exposure)
    return measure_matched(truth, sensor, masks, masks_name=rule.name, seed=seed)


def _render(config: StudyConfig, scene: Scene, store: Store, say: Say) -> xr.Dataset:
    from optsim.camera import CameraConfig
    from optsim.render import RenderSettings, render

    passes = CameraConfig().bandpass
    fine_bands = Bands.paper().subdivide(config.subdivide, (passes.lower_nm, passes.upper_nm))
    settings = RenderSettings(oversample=config.oversample, error=config.render_error, seed=config.seed)
    checkpoint = _checkpoint(store, scene.name)
    checkpoint.parent.mkdir(parents=True, exist_ok=True)

    def progress(share: float, error: float | None) -> None:
        say(share, f"rendering {scene.name}" + ("" if error is None else f", error {error:.2g}"))

    return render(scene, fine_bands, (config.size, config.size), settings, progress, checkpoint)


def _checkpoint(store: Store, target: str) -> Path:
    return store.root / "checkpoints" / f"{target}.npz"
