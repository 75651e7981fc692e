"""The second target: the chart with white diagonal lines above and fine white bars below, made for 256 x 256 mirrors."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from scenes.color_checker import HAIR, ColorChecker, Region
from scenes.model import vector
from scenes.scene import Scene
from scenes.shapes import Rectangle, Shape

MIRRORS = 256
"""The bars' borders lie on multiples of 1/256 of the picture."""
BAR_ROWS = (160, 228)
"""Top and bottom of all bars, in mirrors."""
WIDE_BARS = (12, 2, 26)
"""First column, width and number of the left bars, in mirrors; gaps are as wide as bars."""
NARROW_BARS = (140, 1, 52)
"""The same for the right bars."""
LINE_ROWS = (12, 124)
"""Top and bottom of the diagonal lines, in mirrors."""
LINE_STARTS = (12, 36, 60, 84, 108, 132)
"""Columns where the lines start at the bottom; they rise to the right at 45 degrees."""
LINE_WIDTH = 2.0
"""Across the lines, in mirrors."""


class BarGroup(NamedTuple):
    """Bars of one width: the picture rows they cover and (left, right) of each, all in picture fractions."""

    top: float
    bottom: float
    columns: tuple[tuple[float, float], ...]


class CheckerBars(ColorChecker):
    """The chart with white lines and bars painted over it, one hair thick: no surface sees another."""

    place: ClassVar[str] = "checker_bars"
    name: str = "color-checker-bars"

    def bar_columns(self) -> dict[str, BarGroup]:
        """Return the bars: "wide" (2 mirrors, bottom left) and "narrow" (1 mirror, bottom right)."""
        groups = {}
        for name, (first, width, count) in {"wide": WIDE_BARS, "narrow": NARROW_BARS}.items():
            lefts = [first + 2 * width * i for i in range(count)]
            columns = tuple((left / MIRRORS, (left + width) / MIRRORS) for left in lefts)
            groups[name] = BarGroup(BAR_ROWS[0] / MIRRORS, BAR_ROWS[1] / MIRRORS, columns)
        return groups

    def shapes(self) -> tuple[Shape, ...]:
        """Return the chart, the lines and the bars."""
        white = next(name for name in self.patch_boxes() if name.startswith("white"))
        bars: list[Shape] = []
        for group, (top, bottom, columns) in self.bar_columns().items():
            bars += [self.flat(f"{group} bar {i}", white, Region(left, top, right, bottom), 2) for i, (left, right) in enumerate(columns)]
        lines = [self._line(f"line {i}", white, start) for i, start in enumerate(LINE_STARTS)]
        return (*super().shapes(), *lines, *bars)

    def build(self) -> Scene:
        """Return the scene."""
        text = "The colour checker with white lines above and white bars of 2 mirrors (left) and 1 mirror (right, at 256 x 256) below."
        return super().build().model_copy(update={"description": text})

    def _line(self, name: str, material: str, start: int) -> Rectangle:
        mirror = self.side_m / MIRRORS
        rise = LINE_ROWS[1] - LINE_ROWS[0]
        along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
        across = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2)
        center = np.array([start + rise / 2 - MIRRORS / 2, MIRRORS / 2 - LINE_ROWS[0] - rise / 2, 0.0]) * mirror + [
            0,
            0,
            2 * HAIR * self.side_m,
        ]
        half_u, half_v = along * rise / np.sqrt(2) * mirror, across * LINE_WIDTH / 2 * mirror
        return Rectangle(name=name, material=material, center=vector(center), half_u=vector(half_u), half_v=vector(half_v))
