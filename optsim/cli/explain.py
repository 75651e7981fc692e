"""The verb explain: which physics a scene, or a camera, requires."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from optsim.cli.paths import FIGURES, target
from optsim.cli.words import Force, Json, Without, find_scene, physics_named, print_json, sensor_named
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.study.effect_cost import EffectCost
    from optsim.study.fine_scene import FineScene

FIELD = 256


def explain(
    scene: Annotated[
        str | None, Parameter(help="Name of a scene, or a scene file. With --camera: what the reconstructions look at.")
    ] = None,
    /,
    *,
    camera: Annotated[
        Path | None, Parameter(help="A camera as TOML (or `default`): rank its optical effects instead of the scene's.")
    ] = None,
    error: Annotated[float, Parameter(help="Relative error that the render, or the photograph, should meet.")] = 0.01,
    db: Annotated[
        bool, Parameter(help="With --camera: price every effect by small reconstructions with and without it in H.", negative="--no-db")
    ] = True,
    sensor: Annotated[
        Literal["mono", "bayer", "foveon", "all"], Parameter(help="With --camera: for which sensor effects are priced in dB.")
    ] = "mono",
    size: Annotated[int, Parameter(help="With --camera: mirrors along each side of the reconstructions, a multiple of 8.")] = 24,
    seeds: Annotated[int, Parameter(help="With --camera: sets of masks; two or more give intervals.")] = 3,
    force: Force = None,
    without: Without = None,
    plot: Annotated[Path | None, Parameter(help="With --camera: draw the ranking (PNG, PDF or SVG).")] = None,
    json: Json = False,
) -> None:
    """Tell which physical effects a scene, or a camera, requires, each with its size and the error of leaving it out."""
    chosen = {"--force": physics_named("--force", force or ()), "--without": physics_named("--without", without or ())}
    if camera is not None:
        for option in ("--force", "--without"):
            if chosen[option]:
                raise InputError(option, chosen[option][0].value, "given with a scene; `measure` chooses among a camera's effects")
        _explain_camera(camera, scene, error, (size, seeds, sensor) if db else None, plot, json)
        return
    if scene is None:
        raise InputError("SCENE", None, "given: the name of a scene or a scene file, or --camera FILE")
    if plot is not None:
        raise InputError("--plot", str(plot), "given with --camera")
    from optsim.render.choice import Choices
    from optsim.render.needs import explain as needs_of

    choices = Choices(frozenset(chosen["--force"]), frozenset(chosen["--without"]))
    needs = needs_of(find_scene(scene), error, choices)
    if json:
        print_json(needs.as_dict())
        return
    print(f"{needs.scene}, to a relative error of {error:g}")
    for effect in needs.effects:
        print(f"  {'on ' if effect.on else 'off'}  {effect.name:20s} {effect.reason} (error without it: {effect.error_without:.2g})")
    for sentence in needs.warnings:
        print(f"  {sentence}")


def _explain_camera(
    path: Path, scene: str | None, error: float, priced: tuple[int, int, str] | None, plot: Path | None, json: bool
) -> None:
    from optsim.camera import CameraConfig
    from optsim.camera.inverse import folds
    from optsim.study.effect_cost import EffectCostConfig, effect_costs, effect_sizes
    from optsim.study.fine_scene import TexturedField

    target(plot, "--plot", FIGURES)
    camera = CameraConfig() if str(path) == "default" else CameraConfig.from_toml(path)
    looked_at = TexturedField() if scene is None else _fine_scene(scene)
    size, seeds, word = priced or (EffectCostConfig().size, 0, "all")
    if priced is None:
        costs = effect_sizes(camera, error, (FIELD, FIELD), size)
    else:
        if not 16 <= size <= 256 or size % 8:
            raise InputError("--size", size, "a multiple of 8 from 16 to 256 mirrors")
        if not 1 <= seeds <= 100:
            raise InputError("--seeds", seeds, "from 1 to 100 sets of masks")
        config = EffectCostConfig(size=size, seeds=seeds)
        chosen = None if word == "all" else [sensor_named(word)]
        costs = effect_costs(camera, error, scene=looked_at, config=config, field=(FIELD, FIELD), chosen=chosen, quiet=json)
    report: dict[str, Any] = {
        "camera": str(path),
        "folds_nm": folds(camera.dispersion, (camera.bandpass.lower_nm, camera.bandpass.upper_nm)).tolist(),
        "error": error,
        "field": [FIELD, FIELD],
        "size": size,
        "seeds": seeds,
        "scene": None if priced is None else looked_at.name,
        "required": [cost.effect.name for cost in costs if cost.required],
        "effects": [cost.as_dict() for cost in costs],
    }
    if plot is not None:
        from optsim.report.figures_cost import draw_effects

        draw_effects(report, plot)
        print(f"{plot}: effects of {path}", file=sys.stderr)
    if json:
        print_json(report)
        return
    _print_costs(report, costs)


def _fine_scene(word: str) -> FineScene:
    from optsim.study.fine_scene import RenderedScene, TexturedField

    return TexturedField() if word == TexturedField().name else RenderedScene(find_scene(word))


def _print_costs(report: dict[str, Any], costs: list[EffectCost]) -> None:
    rows, columns = report["field"]
    print(f"{report['camera']}, to a relative error of {report['error']:g}; sizes over {rows} x {columns} mirrors, largest first")
    for turn in report["folds_nm"]:
        print(f"  the dispersion turns back at {turn:.2f} nm: wavelengths on both sides of it share pixels")
    sensors = list(dict.fromkeys(name for cost in costs for name in cost.loss_db))
    head = "".join(f"  {name + ' dB':>24s}" for name in sensors)
    print(f"  {'':8s}  {'effect':16s} {'px':>8s} {'light wrong':>12s}{head}")
    for cost in costs:
        if not cost.present:
            continue
        losses = "".join(f"  {cost.loss_db[name]!s:>24s}" for name in sensors if name in cost.loss_db)
        word = "required" if cost.required else "can go"
        note = f"  ({cost.note})" if cost.note else ""
        print(f"  {word:8s}  {cost.effect.name:16s} {cost.size.px:8.3g} {cost.size.relative:12.2g}{losses}{note}")
    absent = [cost.effect.name for cost in costs if not cost.present]
    if absent:
        print(f"  not in this camera: {', '.join(absent)}")
    if sensors:
        print(
            f"dB: what a reconstruction loses whose H leaves the effect out, mean and 95 % interval over {report['seeds']} sets of masks;\n"
            f"{report['scene']}, {report['size']} x {report['size']} mirrors: effects that grow with the field are smaller there than above"
        )
