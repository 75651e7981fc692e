"""Every optical effect that a camera file can state: what it is, how to leave it out, how large it is, and which of them an error requires.

A camera states facts, and :func:`optsim.camera.photograph` models all of them. To model less, give it a camera that
states less: :func:`reduced` sets facts to the values at which they do nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from optsim.camera import effect_sizes as sizes
from optsim.camera.camera import CameraConfig
from optsim.camera.effect_sizes import Size, View
from optsim.cube import Bands
from optsim.errors import InputError

PAPER_FIELD = (256, 256)


@dataclass(frozen=True, eq=False)
class Effect:
    """Name one optical effect and the facts of a camera file that state it.

    Args:
        name: as the command line calls it.
        what: what it is, in half a sentence.
        nothing: the values at which its facts do nothing, by table and field of the camera file.
        measure: its size in a camera, compared with the camera without it.
        rests_on: names of effects without which it is nothing.
        possible: whether the rest of the camera lets it occur at all.
    """

    name: str
    what: str
    nothing: Mapping[str, Mapping[str, Any]]
    measure: Callable[[View], Size]
    rests_on: tuple[str, ...] = ()
    possible: Callable[[CameraConfig], bool] = lambda camera: True

    def ideal(self, camera: CameraConfig) -> CameraConfig:
        """Return the camera with this effect switched off and everything else as it was."""
        changed = {}
        for table, values in self.nothing.items():
            model = getattr(camera, table)
            if model is not None:
                changed[table] = model.model_copy(update=dict(values))
        return camera.model_copy(update=changed)

    def present(self, camera: CameraConfig) -> bool:
        """Tell whether the camera states this effect at all."""
        return self.possible(camera) and self.ideal(camera) != camera

    def facts(self, camera: CameraConfig) -> dict[str, Any]:
        """Return the facts that state it and their values, by dotted key of the camera file."""
        tables = {table: getattr(camera, table) for table in self.nothing}
        return {
            f"{t}.{field}": getattr(tables[t], field) for t, values in self.nothing.items() if tables[t] is not None for field in values
        }

    def size(self, camera: CameraConfig, bands: Bands, field: tuple[int, int] = PAPER_FIELD) -> Size:
        """Return how far it moves light, at most over the field, and the share of light that is wrong without it; zeros when absent."""
        return self.measure(View(camera, self.ideal(camera), bands, field)) if self.present(camera) else Size(0.0, 0.0)


EFFECTS: tuple[Effect, ...] = (
    Effect("diffraction", "the relay's aperture blurs: an Airy pattern", {"relay": {"diffraction": False}}, sizes.diffraction),
    Effect("defocus", "the sensor stands off the focus: a disc", {"relay": {"defocus_mm": 0.0}}, sizes.geometry),
    Effect("distortion", "the relay's magnification changes with the field", {"relay": {"distortion_per_mm2": 0.0}}, sizes.geometry),
    Effect("converging", "the prism stands in a converging beam", {"relay": {"converging": False}}, sizes.geometry),
    Effect("tilt", "tilted mirrors are imaged anamorphic and with keystone", {"dmd": {"tilt_deg": 0.0}}, sizes.geometry),
    Effect(
        "tilt-defocus",
        "tilted mirrors are out of focus towards the corners",
        {"relay": {"scheimpflug": True}},
        sizes.geometry,
        rests_on=("tilt",),
        possible=lambda camera: camera.dmd.tilt_deg != 0,
    ),
    Effect(
        "registration",
        "the mirrors' image is displaced, turned or scaled on the sensor",
        {"dmd": {"offset_x_px": 0.0, "offset_y_px": 0.0, "rotation_deg": 0.0, "scale": 1.0}},
        sizes.geometry,
    ),
    Effect(
        "smile",
        "the field bends and stretches the spectrum: smile and the prism's own anamorphism",
        {"prism": {"field": False}},
        sizes.geometry,
        possible=lambda camera: not camera.relay.converging,
    ),
    Effect("fresnel", "the prism's faces reflect a part of the light", {"prism": {"fresnel": False}}, sizes.fresnel),
    Effect("leak", "mirrors that are off pass some light", {"dmd": {"leak": 0.0}}, sizes.leak),
    Effect("defects", "some mirrors are always off or always on", {"dmd": {"dead_share": 0.0, "stuck_share": 0.0}}, sizes.defects),
    Effect("band-pass-edges", "the band-pass filter has flanks", {"bandpass": {"edge_nm": 0.0}}, sizes.edges),
    Effect("crosstalk", "charge ends in neighbouring pixels", {"sensor": {"crosstalk": 0.0}}, sizes.crosstalk),
    Effect("prnu", "pixels respond differently", {"sensor": {"prnu": 0.0}}, sizes.prnu),
    Effect("dsnu", "pixels have different offsets", {"sensor": {"dsnu_e": 0.0}}, sizes.dsnu),
    Effect(
        "cos4",
        "the objective's illumination falls towards the corners",
        {"objective": {"cos4": False}},
        sizes.cos4,
        possible=lambda camera: camera.objective.focal_mm is not None,
    ),
    Effect("objective", "the objective blurs the scene on the mirrors", {"objective": {"psf_um": 0.0}}, sizes.objective),
)


@dataclass(frozen=True)
class Sized:
    """Hold an effect, its size in one camera, and whether an error requires it.

    Args:
        effect: which.
        size: its size.
        required: whether leaving it out would pass the error asked for.
    """

    effect: Effect
    size: Size
    required: bool


def effect_named(name: str) -> Effect:
    """Return the effect of that name.

    Raises:
        InputError: field ``effect`` with all names.
    """
    for effect in EFFECTS:
        if effect.name == name:
            return effect
    raise InputError("effect", name, f"one of {', '.join(e.name for e in EFFECTS)}")


def present(camera: CameraConfig) -> tuple[Effect, ...]:
    """Return the effects that a camera states."""
    return tuple(effect for effect in EFFECTS if effect.present(camera))


def reduced(camera: CameraConfig, keep: Collection[Effect]) -> CameraConfig:
    """Return the camera that states only these effects: the others' facts have the values at which they do nothing.

    Its design (glasses, angles, focal lengths, pitches, band-pass edges, transmission) stays.

    Raises:
        InputError: field ``keep`` when an effect is kept without one that it rests on.
    """
    names = {effect.name for effect in keep}
    for effect in keep:
        missing = [name for name in effect.rests_on if name not in names and effect_named(name).present(camera)]
        if missing:
            raise InputError("keep", sorted(names), f"with {', '.join(missing)}, on which {effect.name} rests")
    for effect in EFFECTS:
        if effect.name not in names:
            camera = effect.ideal(camera)
    return camera


def ranked(camera: CameraConfig, error: float, bands: Bands | None = None, field: tuple[int, int] = PAPER_FIELD) -> tuple[Sized, ...]:
    """Rank all effects by the share of light that is wrong without them, and say which the error requires (theory.md (C.69)).

    The smallest are left out as long as their shares add to at most ``error``; what another required effect rests on stays.

    Args:
        camera: what is judged.
        error: relative error of the frames that may come from what is left out, in [0, 1].
        bands: None: the paper's 24.
        field: (rows, columns) of mirrors.

    Raises:
        InputError: field ``--error``.
    """
    if not (np.isfinite(error) and 0 <= error <= 1):
        raise InputError("--error", error, "in [0, 1], relative")
    bands = Bands.paper() if bands is None else bands
    measured = {effect.name: effect.size(camera, bands, field) for effect in EFFECTS}
    spent, needed = 0.0, set()
    for effect in sorted(EFFECTS, key=lambda e: measured[e.name].relative):
        share = measured[effect.name].relative
        spent += share
        if share > 0 and spent > error:
            needed |= {effect.name, *(name for name in effect.rests_on if effect_named(name).present(camera))}
    rows = [Sized(effect, measured[effect.name], effect.name in needed) for effect in EFFECTS]
    return tuple(sorted(rows, key=lambda row: (-row.size.relative, -row.size.px)))


def required(camera: CameraConfig, error: float, bands: Bands | None = None, field: tuple[int, int] = PAPER_FIELD) -> tuple[Effect, ...]:
    """Return the effects that a photograph to this relative error has to model, largest first; see :func:`ranked`."""
    return tuple(row.effect for row in ranked(camera, error, bands, field) if row.required)
