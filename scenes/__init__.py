"""What stands in front of the camera: typed, engine-free scenes and their spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenes.catalogue import SCENES, scene_by_name
    from scenes.scene import Scene
    from scenes.spectrum import Spectrum

__all__ = ["SCENES", "Scene", "Spectrum", "scene_by_name"]

_HOMES = {"SCENES": "scenes.catalogue", "scene_by_name": "scenes.catalogue", "Scene": "scenes.scene", "Spectrum": "scenes.spectrum"}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that ``import scenes`` costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'scenes' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
