"""Which physical effects a scene requires, each with its reason: decided from materials, geometry and lights, never from a name."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render.caustics import missing_caustics
from optsim.render.choice import EFFECTS, FREE, Choices, Physics
from optsim.render.depth import MAX_DEPTH, depth_for
from optsim.render.furnace import losses
from optsim.render.spectral import LightGroup, light_groups, material_spectra, transport_nodes
from scenes.lights import SKIES
from scenes.materials import Dielectric
from scenes.scene import Scene
from scenes.spectrum import Spectrum
from scenes.viewpoint import Perspective, ThinLens
from scenes.visibility import Coverage, coverage, first_pair_that_sees_each_other, is_diffuse, largest_albedo, used_materials

__all__ = ["EFFECTS", "TYPICAL_NM", "Effect", "Needs", "explain"]

TYPICAL_NM = (450.0, 670.0)
"""The camera's range, over which the size of a spectral effect is stated."""


@dataclass(frozen=True)
class Effect:
    """Say whether an effect is computed, why, and what leaving it out would cost.

    Args:
        name: one of ``EFFECTS``.
        on: whether the render computes it.
        reason: a sentence with its numbers.
        error_without: error of lit surfaces without it, relative to them (0 where leaving it out changes nothing): a bound for
            effects that the scene leaves off, but for lens and sky, whose reasons say that it is an estimate; an estimate for those on.
        decided_by: ``scene``, or ``force`` or ``without`` when it was chosen by hand.
    """

    name: str
    on: bool
    reason: str
    error_without: float
    decided_by: str = "scene"

    def chosen(self, choices: Choices) -> Effect:
        """Return the effect as decided by hand, or unchanged when nobody chose."""
        if self.name in choices.force:
            return replace(self, on=True, reason=f"forced; the scene says: {self.reason}", decided_by="force")
        if self.name in choices.without:
            return replace(self, on=False, reason=f"left out by hand; the scene says: {self.reason}", decided_by="without")
        return self


@dataclass(frozen=True)
class Needs:
    """Hold what a scene requires at a relative error, effect by effect, and the decisions that follow.

    Args:
        source: the scene.
        error: relative error asked for.
        seen: names of two reflecting shapes that can exchange light; None when it is proven that no two can.
        covered: how much of the light that leaves surfaces lands on surfaces again.
        choices: effects decided by hand.
    """

    source: Scene
    error: float
    seen: tuple[str, str] | None
    covered: Coverage
    choices: Choices = FREE

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
        return depth_for(self.source, not self.on(Physics.INTERREFLECTION), self.error)

    def on(self, effect: Physics) -> bool:
        """Tell whether an effect is computed."""
        return self._on[effect]

    @cached_property
    def _on(self) -> dict[Physics, bool]:
        return {Physics(effect.name): effect.on for effect in self.effects}

    @cached_property
    def modelled(self) -> Scene:
        """Return the scene without what is left out: skies, the lens's aperture, the glass's change of index with the wavelength."""
        scene, changes = self.source, dict[str, Any]()
        if not self.on(Physics.SKY):
            changes["lights"] = tuple(light for light in scene.lights if not isinstance(light, SKIES))
        view = scene.viewpoint
        if isinstance(view, ThinLens) and not self.on(Physics.LENS_BLUR):
            changes["viewpoint"] = Perspective(origin=view.origin, target=view.target, up=view.up, fov_deg=view.fov_deg)
        if self.dispersive and not self.on(Physics.DISPERSION):
            changes["materials"] = {
                name: m.model_copy(update={"abbe": None, "glass": None}) if isinstance(m, Dielectric) else m
                for name, m in scene.materials.items()
            }
        return scene.model_copy(update=changes) if changes else scene

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

        One wavelength, the middle, when spectral nodes are left out by hand.

        Raises:
            InputError: a material whose data do not cover the bands.
        """
        low, high = float(bands.lower.min()), float(bands.upper.max())
        once = not self.on(Physics.INTERREFLECTION)
        nodes = transport_nodes(self.modelled, low, high, linear=once and self.all_diffuse)
        return np.array([(low + high) / 2]) if Physics.SPECTRAL_NODES in self.choices.without else nodes

    def weights(self, group: LightGroup, nodes_nm: np.ndarray, bands: Bands) -> np.ndarray:
        """Return the (K, n) matrix that takes transport at the nodes to mean radiance of the bands (theory.md (R.24)).

        When illuminant factoring is left out by hand the light is read at the centres of the bands.
        """
        nodes = nodes_nm
        if nodes.size == 1:
            nodes = np.array([bands.lower.min(), bands.upper.max()])
        if Physics.ILLUMINANT_FACTORING in self.choices.without:
            flat = Spectrum.constant(1.0, float(bands.lower.min()), float(bands.upper.max()))
            weights = flat.hat_weights(nodes, bands.lower, bands.upper) * group.spectrum.at(bands.center)[:, None]
        else:
            weights = group.weights(nodes, bands)
        return weights.sum(1, keepdims=True) if nodes_nm.size == 1 else weights

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return one Effect for each name in ``EFFECTS``, in that order."""
        from optsim.render.reasons import effects_of

        return tuple(effect.chosen(self.choices) for effect in effects_of(self))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what the render cannot do as asked, each with a number and a remedy."""
        return (*self.material_warnings, *self._depth_warnings)

    @property
    def material_warnings(self) -> tuple[str, ...]:
        """Return a sentence for each material that the renderer lets lose more light than asked for, and one for each light missed."""
        aimed = next(e for e in self.effects if e.name == Physics.EMITTER_SAMPLING)
        missed = aimed.decided_by == "without" and aimed.error_without > self.error
        found = ("rays are not aimed at lights, by hand: the error told knows only of light that was met by chance",) if missed else ()
        return (*losses(self.source, self.error), *missing_caustics(self.source), *found)

    @property
    def _depth_warnings(self) -> tuple[str, ...]:
        left = min(1.0, largest_albedo(self.source) * self.covered.mean)
        if not self.on(Physics.INTERREFLECTION) or left**MAX_DEPTH < self.error:
            return ()
        wanted = f"depth {int(np.ceil(np.log(self.error) / np.log(left)))}" if left < 1 else "more than any depth"
        return (
            f"max_depth {MAX_DEPTH} leaves out up to {left**MAX_DEPTH:.3g} of the light: {left:.6g} of it survives a reflection in this "
            f"nearly closed room; an error of {self.error:g} needs {wanted}",
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON: scene, effects (name, on, reason, error_without, decided_by) and warnings."""
        rows = [asdict(effect) for effect in self.effects]
        return {"scene": self.scene, "effects": rows, "warnings": list(self.warnings)}


def explain(scene: Scene, error: float = 0.01, choices: Choices = FREE) -> Needs:
    """Tell which effects a scene requires when its picture may be wrong by a relative error.

    Args:
        scene: a built scene.
        error: relative error of the radiance, above 0 and below 1. An effect may be left off for a tenth of it.
        choices: effects forced or left out by hand.

    Raises:
        InputError: ``error`` out of range.
    """
    if not (np.isfinite(error) and 0 < error < 1):
        raise InputError("error", error, "in (0, 1), relative")
    return Needs(scene, float(error), *_exchange(scene), choices)


_last_exchange: list[tuple[Scene, tuple[tuple[str, str] | None, Coverage]]] = []


def _exchange(scene: Scene) -> tuple[tuple[str, str] | None, Coverage]:
    """Return which two shapes exchange light, and how much of it there is; the last scene's answer is kept, as a render asks twice."""
    for known, answer in _last_exchange:
        if known is scene:
            return answer
    seen = first_pair_that_sees_each_other(scene)
    answer = seen, Coverage(0.0, 0.0) if seen is None else coverage(scene)
    _last_exchange[:] = [(scene, answer)]
    return answer
