"""Which physical effects a scene requires, each with its reason: decided from materials, geometry and lights, never from a name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render.depth import MAX_DEPTH, depth_for
from optsim.render.spectral import light_groups, material_spectra, transport_nodes
from scenes.materials import Dielectric
from scenes.scene import Scene
from scenes.visibility import Coverage, coverage, first_pair_that_sees_each_other, is_diffuse, largest_albedo, used_materials

EFFECTS = ("interreflection", "emitter_sampling", "dispersion", "illuminant_factoring", "spectral_nodes", "lens_blur", "sky")
TYPICAL_NM = (450.0, 670.0)
"""The camera's range, over which the size of a spectral effect is stated."""


@dataclass(frozen=True)
class Effect:
    """Say whether an effect is computed, why, and what leaving it out would cost.

    Args:
        name: one of ``EFFECTS``.
        on: whether the render computes it.
        reason: a sentence with its numbers.
        error_without: relative error in radiance without it (0 where leaving it out changes nothing); an estimate, see the reason.
    """

    name: str
    on: bool
    reason: str
    error_without: float


@dataclass(frozen=True)
class Needs:
    """Hold what a scene requires at a relative error, effect by effect, and the decisions that follow.

    Args:
        source: the scene.
        error: relative error asked for.
        seen: names of two reflecting shapes that can exchange light; None when it is proven that no two can.
        covered: how much of the light that leaves surfaces lands on surfaces again.
    """

    source: Scene
    error: float
    seen: tuple[str, str] | None
    covered: Coverage

    @property
    def scene(self) -> str:
        """Return the scene's name."""
        return self.source.name

    @property
    def all_diffuse(self) -> bool:
        """Tell whether every shape is Lambertian."""
        return is_diffuse(self.source)

    @property
    def reflects_once(self) -> bool:
        """Tell whether it is proven that light meets at most one surface between lamp and camera."""
        return self.seen is None

    @property
    def max_depth(self) -> int:
        """Return how many emissions a path counts: 2 is light reflected once."""
        return depth_for(self.source, self.reflects_once, self.error)

    @property
    def single_illuminant(self) -> bool:
        """Tell whether all lights that shine have one spectral shape (or none shines)."""
        return self.illuminant_count <= 1

    @cached_property
    def illuminant_count(self) -> int:
        """Return the number of different spectral shapes among the lights, over 450 to 670 nm as far as all their data go."""
        low, high = self.common_range_nm
        return len(light_groups(self.source, low, high, 1.0))

    @property
    def dispersive(self) -> bool:
        """Tell whether glass with an Abbe number is in the scene."""
        return any(isinstance(m, Dielectric) and m.abbe is not None for m in used_materials(self.source).values())

    @property
    def common_range_nm(self) -> tuple[float, float]:
        """Return the part of 450 to 670 nm, or else of all wavelengths, that all of the scene's data cover."""
        ranges = [spectrum.range_nm for _, spectrum in self.spectra()]
        low, high = max((r[0] for r in ranges), default=0.0), min((r[1] for r in ranges), default=np.inf)
        if max(low, TYPICAL_NM[0]) < min(high, TYPICAL_NM[1]):
            low, high = max(low, TYPICAL_NM[0]), min(high, TYPICAL_NM[1])
        if low >= high:
            raise InputError(
                "scene", [(name, s.range_nm) for name, s in self.spectra()], "made of spectra whose data share some wavelengths"
            )
        return low, high

    def spectra(self) -> list[tuple[str, Any]]:
        """Return (dotted name, Spectrum) of every light and every used material."""
        lights = [(f"lights[{i}]", light.spectrum) for i, light in enumerate(self.source.lights)]
        materials = used_materials(self.source).items()
        return lights + [(f"materials.{name}.{field}", s) for name, m in materials for field, s in material_spectra(m).items()]

    def nodes_nm(self, bands: Bands) -> np.ndarray:
        """Return the wavelengths in nm at which transport is rendered for these bands (theory.md (R.10), (R.11)).

        Raises:
            InputError: a material whose data do not cover the bands.
        """
        low, high = float(bands.lower.min()), float(bands.upper.max())
        return transport_nodes(self.source, low, high, linear=self.reflects_once and self.all_diffuse)

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return one Effect for each name in ``EFFECTS``, in that order."""
        from optsim.render.reasons import effects_of

        return tuple(effects_of(self))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what the render cannot do as asked, each with a number and a remedy."""
        left = min(1.0, largest_albedo(self.source) * self.covered.mean)
        if self.reflects_once or left**MAX_DEPTH < self.error:
            return ()
        wanted = f"depth {int(np.ceil(np.log(self.error) / np.log(left)))}" if left < 1 else "more than any depth"
        return (
            f"max_depth {MAX_DEPTH} leaves out up to {left**MAX_DEPTH:.3g} of the light: {left:.6g} of it survives a reflection in this "
            f"nearly closed room; an error of {self.error:g} needs {wanted}",
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON: scene, effects (name, on, reason, error_without) and warnings."""
        rows = [{"name": e.name, "on": e.on, "reason": e.reason, "error_without": e.error_without} for e in self.effects]
        return {"scene": self.scene, "effects": rows, "warnings": list(self.warnings)}


def explain(scene: Scene, error: float = 0.01) -> Needs:
    """Tell which effects a scene requires when its picture may be wrong by a relative error.

    Args:
        scene: a built scene.
        error: relative error of the radiance, above 0 and below 1.

    Raises:
        InputError: ``error`` out of range.
    """
    if not (np.isfinite(error) and 0 < error < 1):
        raise InputError("error", error, "in (0, 1), relative")
    seen = first_pair_that_sees_each_other(scene)
    return Needs(scene, float(error), seen, Coverage(0.0, 0.0) if seen is None else coverage(scene))
