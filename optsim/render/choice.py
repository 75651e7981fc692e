"""The physical effects that a render can compute or leave out, and which of them are forced or left out by hand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from optsim.errors import InputError


class Physics(StrEnum):
    """Name one physical effect."""

    INTERREFLECTION = "interreflection"
    EMITTER_SAMPLING = "emitter_sampling"
    DISPERSION = "dispersion"
    ILLUMINANT_FACTORING = "illuminant_factoring"
    SPECTRAL_NODES = "spectral_nodes"
    LENS_BLUR = "lens_blur"
    SKY = "sky"


EFFECTS = tuple(effect.value for effect in Physics)


@dataclass(frozen=True)
class Choices:
    """Hold the effects that are computed, or left out, whatever the scene requires.

    Args:
        force: effects to compute.
        without: effects to leave out.

    Raises:
        InputError: ``without`` when an effect is in both.
    """

    force: frozenset[Physics] = frozenset()
    without: frozenset[Physics] = frozenset()

    def __post_init__(self) -> None:
        both = sorted(self.force & self.without)
        if both:
            raise InputError("without", both[0].value, "effects that are not forced as well")

    def __contains__(self, effect: Physics) -> bool:
        return effect in self.force or effect in self.without


FREE = Choices()
"""No effect is decided by hand."""


def effects_named(field: str, names: Iterable[str]) -> tuple[Physics, ...]:
    """Turn words into effects.

    Raises:
        InputError: ``field`` for an unknown name, listing all.
    """
    found = []
    for name in names:
        if name not in EFFECTS:
            raise InputError(field, name, f"one of {', '.join(EFFECTS)}")
        found.append(Physics(name))
    return tuple(found)
