"""Light budgets: what each sensor is given when sensors are compared, A to F (theory.md (C.53)).

Give every comparison its budget's name: with noise, which sensor wins can hang on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

from optsim.camera.dmd import MAX_SHOTS, Distinct, MaskRule, Repeated
from optsim.camera.model import Model, ranged
from optsim.camera.sensor import Sensor
from optsim.errors import InputError

SCALARS_PER_GROUP = 3
"""Numbers a pixel in one of the paper's groups: three monochrome shots or one Foveon shot."""


@dataclass(frozen=True)
class Plan:
    """Say how one sensor photographs under a budget.

    Args:
        budget: letter and name.
        sensor: its name.
        shots: L.
        exposure_s: of each shot; None: as long as the brightest pixel takes to reach ``fill`` of the full well.
        fill: in (0, 1], only for ``exposure_s`` None.
        rule: whether shots share masks.
        patterns: different masks shown.
        scalars: numbers read, per pixel of the grid.
        ratio_shots: R K: L for a monochrome sensor, 3 L for a colour sensor (the paper's compression ratio is K : this).
    """

    budget: str
    sensor: str
    shots: int
    exposure_s: float | None
    fill: float
    rule: MaskRule
    patterns: int
    scalars: float
    ratio_shots: int

    @property
    def light_s(self) -> float | None:
        """Return the time during which light is collected, in s; None when it depends on the scene."""
        return None if self.exposure_s is None else self.shots * self.exposure_s


class Budget(Protocol):
    """Turn a sensor into a plan."""

    name: ClassVar[str]

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return how the sensor photographs.

        Args:
            sensor: any.
            groups: of the paper: 1 colour shot or 3 monochrome shots each, from 1 up.
            time_s: exposure of a colour shot, above 0 s.
        """


class EqualMasks(Model):
    """A: every sensor takes one shot a group, with the same mask and exposure."""

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "A equal masks"

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return one shot a group."""
        return _plan(self.name, sensor, groups, groups, time_s)


class PaperRatio(Model):
    """B: three monochrome shots against one colour shot, all of the same exposure: mono gets three times the light."""

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "B paper's 3 : 1"

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return the sensor's own number of shots a group."""
        return _plan(self.name, sensor, groups, groups * sensor.shots_per_group, time_s)


class EqualTime(Model):
    """C: three monochrome shots in the time of one colour shot; each shot also pays for the mirrors' change.

    Args:
        switch_s: during which the mirrors change before a shot and no light counts, in [0, 10] s.
    """

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "C equal time"
    switch_s: Annotated[float, ranged(0, 10, "s")] = 0.0

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return the sensor's own number of shots a group, each with its share of ``time_s`` less ``switch_s``.

        Raises:
            InputError: field ``budget.switch_s`` when nothing is left of a share.
        """
        _check(groups, time_s)
        share = time_s / sensor.shots_per_group
        if share <= self.switch_s:
            raise InputError("budget.switch_s", self.switch_s, f"below {share:g} s, a shot's share of the time")
        return _plan(self.name, sensor, groups, groups * sensor.shots_per_group, share - self.switch_s)


class EqualFill(Model):
    """D: every shot is exposed until the sensor's brightest pixel reaches the same share of its full well.

    Args:
        fill: in (0, 1].
    """

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "D equal well fill"
    fill: Annotated[float, ranged(0, 1, "", "(]")] = 0.9

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return the sensor's own number of shots a group, exposed by the scene; ``time_s`` is not used."""
        return _plan(self.name, sensor, groups, groups * sensor.shots_per_group, None, fill=self.fill)


class EqualScalars(Model):
    """E: every sensor reads three numbers a pixel and group: mono and Bayer take three shots, Foveon one, a Quattro two."""

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "E equal scalars"

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return as many shots as read three numbers a pixel and group.

        Raises:
            InputError: field ``budget.groups`` when that is no whole number of shots.
        """
        shots = groups * SCALARS_PER_GROUP / scalars_per_pixel(sensor)
        if shots != int(shots):
            raise InputError(
                "budget.groups", groups, f"such that {SCALARS_PER_GROUP} numbers a pixel and group are whole shots of {sensor.name}"
            )
        return _plan(self.name, sensor, groups, int(shots), time_s)


class EqualPatterns(Model):
    """F: the mirrors show the same patterns to every sensor, one a group; mono exposes each of them three times."""

    place: ClassVar[str] = "budget"
    name: ClassVar[str] = "F equal patterns"

    def plan(self, sensor: Sensor, groups: int, time_s: float) -> Plan:
        """Return the sensor's own number of shots a group, all of a group with one mask."""
        rule = Distinct() if sensor.shots_per_group == 1 else Repeated()
        return _plan(self.name, sensor, groups, groups * sensor.shots_per_group, time_s, rule=rule)


def budgets() -> tuple[Budget, ...]:
    """Return the six budgets, A to F, with their defaults."""
    return (EqualMasks(), PaperRatio(), EqualTime(), EqualFill(), EqualScalars(), EqualPatterns())


def scalars_per_pixel(sensor: Sensor) -> float:
    """Return how many numbers one shot reads per pixel of the grid: 1, 3 (Foveon) or 1.5 (Quattro)."""
    return 1.0 if sensor.channels == 1 else sum(1 / side**2 for side in sensor.layer_bins)


def check_same_budget(plans: Sequence[Plan], allow_unequal: bool = False) -> None:
    """Refuse to set plans side by side that differ in more than the sensor, unless asked to.

    Plans are alike when they come from one budget and have the same compression ratio (as the paper counts it:
    K : L for a monochrome sensor, K : 3 L for a colour sensor). Budgets A and E give unequal ratios on purpose: ask.

    Raises:
        InputError: field ``budget`` naming the first two plans that differ.
    """
    for plan in plans[1:]:
        first = plans[0]
        if allow_unequal or (plan.budget == first.budget and plan.ratio_shots == first.ratio_shots):
            continue
        found = " against ".join(f"{p.sensor}: {p.budget}, K : {p.ratio_shots}" for p in (first, plan))
        raise InputError("budget", found, "of one budget with equal compression ratios, unless unequal budgets are asked for")


def _plan(
    budget: str, sensor: Sensor, groups: int, shots: int, exposure_s: float | None, *, fill: float = 0.9, rule: MaskRule | None = None
) -> Plan:
    _check(groups, 1.0 if exposure_s is None else exposure_s)
    if shots > MAX_SHOTS:
        raise InputError("budget.groups", groups, f"such that {sensor.name} takes at most {MAX_SHOTS} shots (here {shots})")
    chosen: MaskRule = Distinct() if rule is None else rule
    patterns = groups if isinstance(chosen, Repeated) else shots
    ratio = shots if len(sensor.curves) == 1 else 3 * shots
    return Plan(budget, sensor.name, shots, exposure_s, fill, chosen, patterns, shots * scalars_per_pixel(sensor), ratio)


def _check(groups: int, time_s: float) -> None:
    if not isinstance(groups, int) or groups < 1:
        raise InputError("budget.groups", groups, "a whole number from 1 up")
    if not 0 < time_s <= 1e9:
        raise InputError("budget.time_s", time_s, "in (0, 1e9] s")
