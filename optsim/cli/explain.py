"""The verb explain: which physics a scene, or a camera, requires."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from optsim.cli.words import Json, find_scene, print_json


def explain(
    scene: Annotated[str, Parameter(help="Name of a scene, or a scene file.")],
    /,
    *,
    error: Annotated[float, Parameter(help="Relative error that the render should meet.")] = 0.01,
    json: Json = False,
) -> None:
    """Tell which physical effects a scene requires, each on or off with its reason and the error of leaving it out."""
    from optsim.render.needs import explain as needs_of

    needs = needs_of(find_scene(scene), error)
    if json:
        print_json(needs.as_dict())
        return
    print(f"{needs.scene}, to a relative error of {error:g}")
    for effect in needs.effects:
        without = "" if effect.error_without is None else f" (error without it: {effect.error_without:.2g})"
        print(f"  {'on ' if effect.on else 'off'}  {effect.name:20s} {effect.reason}{without}")
