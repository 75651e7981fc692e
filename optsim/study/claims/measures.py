"""From rows to paired differences: how each claim is measured under one reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from optsim.cube import Bands
from optsim.study.claims.readings import Reading
from optsim.study.claims.worlds import BENCH, TARGET_1, TARGET_2

Differences = dict[str, list[float]]
"""Scene -> one value a mask."""
Look = Callable[[Mapping[str, Any]], float]
"""What of a row is compared."""
LEAST_BACKGROUND = 1e-3
"""Of the true mean: a background below counts as this, so that its size in dB stays finite."""


class Table:
    """The rows of one reading: by scene, mask, colour shots and sensor.

    Args:
        reading: which.
        size: mirrors along each side.
        rows: (scene, mask, groups, sensor) -> row.
    """

    def __init__(self, reading: Reading, size: int, rows: Mapping[tuple[str, int, int, str], Mapping[str, Any]]) -> None:
        self.reading, self.size = reading, size
        self._rows: dict[tuple[str, int, str], dict[int, Mapping[str, Any]]] = {}
        for (scene, mask, groups, sensor), row in rows.items():
            self._rows.setdefault((scene, groups, sensor), {})[mask] = row

    @property
    def scenes(self) -> list[str]:
        """Return the scenes that were run."""
        return list(dict.fromkeys(scene for scene, _, _ in self._rows))

    @property
    def random_scenes(self) -> tuple[str, ...]:
        """Return those that stand for scenes at large."""
        return tuple(scene for scene in self.scenes if scene not in (TARGET_1, TARGET_2, BENCH))

    def groups(self, scene: str) -> list[int]:
        """Return the numbers of colour shots run on a scene."""
        return sorted({groups for name, groups, _ in self._rows if name == scene})

    def values(self, scene: str, groups: int, sensor: str, look: Look) -> dict[int, float]:
        """Return mask -> value of a sensor."""
        return {mask: look(row) for mask, row in self._rows.get((scene, groups, sensor), {}).items()}

    def paired(self, scene: str, groups: int, a: str, b: str, look: Look) -> list[float]:
        """Return value of a minus value of b, one a mask that both saw."""
        left, right = self.values(scene, groups, a, look), self.values(scene, groups, b, look)
        return [left[m] - right[m] for m in sorted(left.keys() & right.keys())]


class Measure(Protocol):
    """A way to measure a claim; it may have several parts that all must hold."""

    @property
    def sensors(self) -> frozenset[str]:
        """Return the sensors that it compares."""
        ...

    @property
    def steady(self) -> bool:
        """Tell whether it is asked at every R by itself (else once, over several R)."""
        ...

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield the paired differences of each part, in dB; nothing where the reading was not run on what is asked."""
        ...


def psnr(row: Mapping[str, Any]) -> float:
    """Return the mean PSNR over bands."""
    return float(row["psnr_db"])


@dataclass(frozen=True)
class Gap:
    """How far one sensor lies above another on some scenes, in dB; without scenes: on the random ones.

    Args:
        above, below: sensors.
        scenes: where they are compared.
        look: what of a row is compared, in dB.
    """

    above: str
    below: str
    scenes: tuple[str, ...]
    look: Look = psnr
    steady = True

    @property
    def sensors(self) -> frozenset[str]:
        """Return both."""
        return frozenset((self.above, self.below))

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield one part."""
        found = {s: table.paired(s, groups, self.above, self.below, self.look) for s in self.scenes or table.random_scenes}
        found = {scene: values for scene, values in found.items() if values}
        if found:
            yield found


@dataclass(frozen=True)
class LargestGap:
    """The gap at the R, of those that were run, where it is largest."""

    above: str
    below: str
    scene: str
    steady = False

    @property
    def sensors(self) -> frozenset[str]:
        """Return both."""
        return frozenset((self.above, self.below))

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield one part, where more than one R was run."""
        found = [table.paired(self.scene, g, self.above, self.below, psnr) for g in table.groups(self.scene)]
        if len(found) > 1:
            yield {self.scene: max(found, key=lambda values: float(np.mean(values)))}


@dataclass(frozen=True)
class Drop:
    """How far target 2 scores below target 1, for each sensor, behind the same masks."""

    sensors = frozenset(("mono", "bayer", "foveon"))
    steady = True

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield a part for each sensor."""
        for sensor in sorted(self.sensors):
            first, second = (table.values(scene, groups, sensor, psnr) for scene in (TARGET_1, TARGET_2))
            drops = [first[m] - second[m] for m in sorted(first.keys() & second.keys())]
            if drops:
                yield {"targets": drops}


@dataclass(frozen=True)
class BandsBelow:
    """How far a sensor's error lies below mono's in each band of each target."""

    sensor: str
    steady = True

    @property
    def sensors(self) -> frozenset[str]:
        """Return the sensor and mono."""
        return frozenset((self.sensor, "mono"))

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield a part for each target and band."""
        for scene in (TARGET_1, TARGET_2):
            for k in range(Bands.paper().count):
                yield from Gap(self.sensor, "mono", (scene,), _band(k)).parts(table, groups)


@dataclass(frozen=True)
class MoreShots:
    """How much each sensor gains from one R to the next that was run."""

    sensors = frozenset(("mono", "bayer", "foveon"))
    steady = False

    def parts(self, table: Table, groups: int) -> Iterator[Differences]:
        """Yield a part for each target, sensor and step."""
        for scene in (TARGET_1, TARGET_2):
            for few, many in pairwise(table.groups(scene)):
                for sensor in sorted(self.sensors):
                    less, more = (table.values(scene, g, sensor, psnr) for g in (few, many))
                    gains = [more[m] - less[m] for m in sorted(less.keys() & more.keys())]
                    if gains:
                        yield {scene: gains}


def false_color_db(row: Mapping[str, Any]) -> float:
    """Return the false colour on the finest bars of target 2, in dB."""
    return 20 * math.log10(row["false_color"])


def tilt_from(wavelength_nm: float) -> Look:
    """Return a look at how far the bands from a wavelength on score above those below it, in dB."""
    long = Bands.paper().center >= wavelength_nm

    def tilt(row: Mapping[str, Any]) -> float:
        bands = np.array(row["band_psnr_db"], np.float64)
        return float(bands[long].mean() - bands[~long].mean())

    return tilt


def signature_db(row: Mapping[str, Any]) -> float:
    """Return how far the signatures' errors lie below the signatures, in dB, mean over the points."""
    return float(np.mean([-20 * math.log10(at["error"]) for at in row["signatures"].values()]))


def background_db(row: Mapping[str, Any]) -> float:
    """Return the size of the constant part of the signatures over the true mean, in dB, mean over the points; at least -60 dB."""
    return float(np.mean([20 * math.log10(max(abs(at["background"]), LEAST_BACKGROUND)) for at in row["signatures"].values()]))


def _band(k: int) -> Look:
    return lambda row: float(row["band_psnr_db"][k])
