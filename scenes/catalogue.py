"""The scenes that come with the program: being in ``SCENES`` is being listed, explained, rendered and tested."""

from __future__ import annotations

from typing import Protocol

from scenes.bricks import Bricks
from scenes.checker_bars import CheckerBars
from scenes.color_checker import ColorChecker
from scenes.cornell import Cornell
from scenes.dim_bright import DimBright
from scenes.errors import InputError
from scenes.glass import Glass
from scenes.metamers import Metamers
from scenes.model import did_you_mean
from scenes.procedural import Procedural
from scenes.relief import Relief
from scenes.scene import Scene
from scenes.textured import TexturedBoard


class SceneRecipe(Protocol):
    """A frozen config that builds a scene."""

    @property
    def name(self) -> str:
        """Return the name that the command line uses."""
        ...

    def build(self) -> Scene:
        """Return the scene."""
        ...


SCENES: tuple[SceneRecipe, ...] = (
    ColorChecker(),
    CheckerBars(),
    Relief(),
    Bricks(),
    Cornell(),
    Glass(),
    Glass(name="glass-dispersive", index=1.78472, abbe=25.68),  # SF11
    Metamers(),
    TexturedBoard(),
    DimBright(),
    Procedural(),
)


RANDOM = "procedural-"


def scene_by_name(name: str) -> SceneRecipe:
    """Return the recipe of that name with its default settings; procedural-N is the N-th random scene.

    Raises:
        InputError: field ``scene`` for an unknown name, listing all.
    """
    for recipe in SCENES:
        if recipe.name == name:
            return recipe
    if name.startswith(RANDOM) and name.removeprefix(RANDOM).isdecimal() and int(name.removeprefix(RANDOM)) < 2**63:
        return Procedural(seed=int(name.removeprefix(RANDOM)))
    names = [recipe.name for recipe in SCENES]
    raise InputError("scene", name, f"one of {', '.join(names)}, or a scene file (.toml, .json){did_you_mean(name, names)}")
