"""Words of `measure` about what of the camera is modelled, which masks are shown, and under which light budget."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera import CameraConfig, Sensor
    from optsim.camera.budgets import Plan
    from optsim.camera.patterns import Pattern
    from optsim.cube import Bands


def modelled_camera(
    camera: CameraConfig, bands: Bands, field: tuple[int, int], error: float, force: Sequence[str], without: Sequence[str]
) -> CameraConfig:  # fmt: skip
    """Return the camera with the facts that the error requires, those forced, and none of those left out; say which.

    Raises:
        InputError: ``--error``, ``--force`` or ``--without``.
    """
    from optsim.camera.effects import EFFECTS, effect_named, present, reduced, required

    for option, names in (("--force", force), ("--without", without)):
        for name in names:
            if name not in {e.name for e in EFFECTS}:
                raise InputError(option, name, f"one of {', '.join(e.name for e in EFFECTS)}")
    both = set(force) & set(without)
    if both:
        raise InputError("--without", sorted(both)[0], "not given with --force too")
    there = {e.name for e in present(camera)}
    keep = there if error == 0 else {e.name for e in required(camera, error, bands, field)}
    keep |= set(force) | {base for name in force for base in effect_named(name).rests_on if base in there}
    keep -= set(without)
    for name in sorted(keep):
        missing = [base for base in effect_named(name).rests_on if base in without and base in there]
        if missing:
            raise InputError("--without", missing[0], f"given together with {name}, which rests on it")
    print(f"modelled: {', '.join(sorted(keep & there)) or 'dispersion only'}", file=sys.stderr)
    left = sorted(there - keep)
    if left:
        print(f"left out: {', '.join(left)} (--error {error:g}; `optsim explain --camera` ranks them)", file=sys.stderr)
    return reduced(camera, [effect_named(name) for name in sorted(keep)])


def pattern_named(word: str) -> Pattern:
    """Return the pattern of that name, or one from a PNG or NPY file.

    Raises:
        InputError: field ``--pattern``.
    """
    from optsim.camera.patterns import FromFile, patterns

    known = {p.name: p for p in patterns()}
    if word in known:
        return known[word]
    if word.lower().endswith((".png", ".npy")):
        return FromFile((Path(word),))
    raise InputError("--pattern", word, f"one of {', '.join(known)}, or a PNG or NPY file")


def budget_plan(letter: str, sensor: Sensor, groups: int, time_s: float | None) -> Plan:
    """Return how a sensor photographs under a light budget A to F; ``groups`` are colour shots.

    Raises:
        InputError: fields ``--budget`` and ``--exposure``.
    """
    from optsim.camera.budgets import budgets

    known = {b.name[0]: b for b in budgets()}
    if letter.upper() not in known:
        raise InputError("--budget", letter, f"one of {'; '.join(b.name for b in budgets())}")
    if time_s is None and letter.upper() != "D":
        raise InputError("--exposure", "absent", "the exposure of a colour shot in s, which budgets (but D) share out")
    plan = known[letter.upper()].plan(sensor, groups, 1.0 if time_s is None else time_s)
    print(f"budget {plan.budget}: {plan.shots} shot(s), {plan.scalars:g} numbers a pixel", file=sys.stderr)
    return plan


def warn_of_ratio(sensor: Sensor, shots: int, bands: int) -> None:
    """Warn when more numbers are measured than the cube has (R > 1)."""
    numbers = shots * (1 if sensor.shots_per_group > 1 else 3)
    if numbers > bands:
        print(f"warning: R = {numbers}/{bands} > 1: more is measured than the cube's {bands} bands", file=sys.stderr)
