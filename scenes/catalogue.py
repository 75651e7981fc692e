"""The scenes that come with the program: being in ``SCENES`` is being listed, explained, rendered and tested."""

from __future__ import annotations

from typing import Protocol

from scenes.checker_bars import CheckerBars
from scenes.color_checker import ColorChecker
from scenes.errors import InputError
from scenes.glass import Glass
from scenes.model import did_you_mean
from scenes.relief import Relief
from scenes.scene import Scene


class SceneRecipe(Protocol):
    """A frozen config that builds a scene."""

    @property
    def name(self) -> str:
        """Return the name that the command line uses."""
        ...

    def build(self) -> Scene:
        """Return the scene."""
        ...


SCENES: tuple[SceneRecipe, ...] = (ColorChecker(), CheckerBars(), Relief(), Glass())


def scene_by_name(name: str) -> SceneRecipe:
    """Return the recipe of that name with its default settings.

    Raises:
        InputError: field ``scene`` for an unknown name, listing all.
    """
    for recipe in SCENES:
        if recipe.name == name:
            return recipe
    names = [recipe.name for recipe in SCENES]
    raise InputError("scene", name, f"one of {', '.join(names)}, or a scene file (.toml, .json){did_you_mean(name, names)}")
