"""Readings of the paper: four stated bases, and one factor changed at a time from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from optsim.camera.budgets import EqualFill, EqualTime, PaperRatio, budgets
from optsim.camera.dmd import Repeated
from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, Series
from optsim.study.claims.bench import Bench
from optsim.study.claims.captures import Capture, Demosaiced, KnowsNothing, KnowsSpots, Lit, Matched, Physical
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.curves import GLASS_FOVEON, PHOTONS, PHYSICAL_FOVEON, PUBLISHED, Curves
from optsim.study.claims.methods import (
    BENCH_FRACTIONS,
    INTERPOLATED_FRACTIONS,
    MATCHED_FRACTIONS,
    BlindTau,
    KnownNoise,
    Method,
    OracleTau,
    Pursuit,
)

SENSOR_WORDS = {"mono": "mono", "bayer": "Bayer", "foveon": "Foveon"}
"""Sensors as sentences name them."""
SENSORS = tuple(SENSOR_WORDS)


@dataclass(frozen=True)
class Recipe:
    """Say how one sensor's estimate is made."""

    capture: Capture
    method: Method

    @property
    def name(self) -> str:
        """Return a name fit for files."""
        return f"{self.capture.name}-{self.method.name}"


@dataclass(frozen=True)
class Depth:
    """Say on which trials a reading is run.

    Args:
        scenes, masks: random scenes, and masks of each.
        target_masks: of the two targets.
        groups: colour shots on the targets.
        scene_groups: colour shots on random scenes.
        size: mirrors along each side; None: the study's.
        bench: whether it is run on the test bed's scene instead.
    """

    scenes: int
    masks: int
    target_masks: int
    groups: tuple[int, ...] = (1,)
    scene_groups: tuple[int, ...] = (1,)
    size: int | None = None
    bench: bool = False


@dataclass(frozen=True)
class Reading:
    """One way to read the paper.

    Args:
        mono: what "three monochrome shots" means.
        data: the base's data: matched, physical, matched with noise, test bed.
        change: the one factor that differs from the base; empty for a base.
        recipes: by sensor.
        depth: where it is run.
        touched: sensors whose recipe differs from the base's; claims about others alone are not judged again.
    """

    mono: Series
    data: str
    change: str
    recipes: Mapping[str, Recipe] = field(hash=False)
    depth: Depth
    touched: frozenset[str] = frozenset(SENSORS)

    @property
    def name(self) -> str:
        """Return what a table calls it."""
        return f"{self.mono.masks} masks, {self.data}" + (f": {self.change}" if self.change else "")

    @property
    def base(self) -> bool:
        """Tell whether nothing is changed."""
        return not self.change

    def series(self) -> tuple[Series, Series, Series]:
        """Return the curves that it compares."""
        return (self.mono, BAYER, FOVEON)


MATCHED, PHYSICAL, NOISY, BENCH = "matched", "physical", "matched with noise", "test bed"
MONOS = (MONO_DISTINCT, MONO_REPEATED)


def readings(config: ClaimsConfig) -> list[Reading]:
    """List every reading of the study, the bases first."""
    found = [*_bases(config), *_large(config)]
    for mono in MONOS:
        found += _changed(config, mono)
        found += _lit(config, mono)
        found.append(_bench(config, mono))
    return found


def alike(recipe: Recipe) -> dict[str, Recipe]:
    """Return one recipe for all sensors."""
    return dict.fromkeys(SENSORS, recipe)


def base_recipe(data: str) -> Recipe:
    """Return the recipe of a base: noise-free matched data need no tau; physical data lie in the range of no H, so they have one."""
    return Recipe(Matched(), Pursuit()) if data == MATCHED else Recipe(Physical(), BlindTau())


def _bases(config: ClaimsConfig) -> Iterator[Reading]:
    everywhere = Depth(config.scenes, config.masks, config.target_masks, config.groups, config.groups)
    physical = Depth(config.scenes, config.masks, config.target_masks, config.physical_groups)
    for mono in MONOS:
        yield Reading(mono, MATCHED, "", alike(base_recipe(MATCHED)), everywhere)
        yield Reading(mono, PHYSICAL, "", alike(base_recipe(PHYSICAL)), physical)


def _large(config: ClaimsConfig) -> Iterator[Reading]:
    if config.large is None:
        return
    for mono in MONOS:
        for data, groups in ((MATCHED, config.groups), (PHYSICAL, config.physical_groups)):
            depth = Depth(config.large_scenes, 1, config.large_masks, groups, size=config.large)
            yield Reading(mono, data, "", alike(base_recipe(data)), depth)


def _changed(config: ClaimsConfig, mono: Series) -> Iterator[Reading]:
    """Yield the readings without noise that differ from a base in one factor."""
    few = Depth(config.scenes, config.few_masks, config.few_target_masks)
    for data in (MATCHED, PHYSICAL):
        base = base_recipe(data)
        every = [(change, Recipe(base.capture, method)) for change, method in _methods(data)]
        every.append(("photon scaling of the responses", Recipe(_with_curves(data, PHOTONS), base.method)))
        if data == PHYSICAL:
            every += [
                ("unit-shift H", Recipe(Physical(belief=KnowsNothing()), base.method)),
                ("calibrated H", Recipe(Physical(belief=KnowsSpots()), base.method)),
            ]
        for change, recipe in every:
            yield Reading(mono, data, change, alike(recipe), few)
        interpolated = Recipe(Demosaiced(_with_curves(data, PUBLISHED)), OracleTau(INTERPOLATED_FRACTIONS))
        for change, sensor, other in (
            ("Foveon's layers by silicon's absorption", "foveon", Recipe(_with_curves(data, PHYSICAL_FOVEON), base.method)),
            ("Foveon emulated by glass plates", "foveon", Recipe(_with_curves(data, GLASS_FOVEON), base.method)),
            ("Bayer demosaiced first, its tau by an oracle", "bayer", interpolated),
        ):
            changed = alike(base) | {sensor: other}
            yield Reading(mono, data, change, changed, few, frozenset((sensor,)))


def _methods(data: str) -> list[tuple[str, Method]]:
    """Return the other ways to invert a base's data."""
    if data == MATCHED:
        return [
            ("Eq. 4 with oracle tau", OracleTau(MATCHED_FRACTIONS)),
            ("Eq. 4 with automatic tau", BlindTau(MATCHED_FRACTIONS)),
            ("quality mode", Pursuit(quality=True)),
        ]
    return [("Eq. 4 with oracle tau", OracleTau()), ("basis pursuit", Pursuit()), ("quality mode", BlindTau(quality=True))]


def _with_curves(data: str, curves: Curves) -> Matched | Physical:
    return Matched(curves) if data == MATCHED else Physical(curves)


def _lit(config: ClaimsConfig, mono: Series) -> Iterator[Reading]:
    """Yield the light budgets at their levels, and what else is changed under noise."""
    depth = Depth(config.light_scenes, 1, config.few_target_masks)
    raw, weighted = KnownNoise(), KnownNoise(weighted=True)
    for budget in budgets():
        levels = config.light_e if isinstance(budget, EqualTime) else config.budget_e
        for level in levels:
            captures = lit_captures(budget, level, mono)
            if captures is not None:
                light = "electrons in every sensor's brightest pixel" if isinstance(budget, EqualFill) else "electrons"
                change = f"budget {budget.name}, {level:g} {light}"
                yield Reading(mono, NOISY, change, {s: Recipe(c, raw) for s, c in captures.items()}, depth)
    for change, curves, method in (
        ("noise-weighted layers", PHOTONS, weighted),
        ("peak scaling of the responses", PUBLISHED, raw),
        ("quality mode", PHOTONS, KnownNoise(quality=True)),
    ):
        captures = lit_captures(PaperRatio(), config.noise_e, mono, curves)
        assert captures is not None
        told = f"budget {PaperRatio.name}, {config.noise_e:g} electrons, {change}"
        yield Reading(mono, NOISY, told, {s: Recipe(c, method) for s, c in captures.items()}, depth)


def lit_captures(budget: object, level: float, mono: Series, curves: Curves = PHOTONS) -> dict[str, Lit] | None:
    """Return each sensor's capture under a budget, or None when the budget does not let mono's masks be read so."""
    captures = {}
    for name in SENSORS:
        plan = budget.plan(curves.of(name), 1, 1.0)  # type: ignore[attr-defined]
        if name == "mono":
            if isinstance(plan.rule, Repeated) and mono is not MONO_REPEATED:
                return None
            if plan.shots == 1 and mono is MONO_REPEATED:
                return None
        captures[name] = Lit(level, plan.shots, plan.exposure_s or 1.0, plan.exposure_s is None, curves)
    return captures


def _bench(config: ClaimsConfig, mono: Series) -> Reading:
    depth = Depth(0, 0, config.bench_masks, config.bench_groups, size=config.bench_size, bench=True)
    return Reading(mono, BENCH, "", alike(bench_recipe()), depth)


def bench_recipe() -> Recipe:
    """Return how the test bed's frames are made and inverted."""
    return Recipe(Bench(), BlindTau(BENCH_FRACTIONS))
