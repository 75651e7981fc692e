"""The list of work: which solves the readings need, each once, and how long they should take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from optsim.report.data import Series
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.readings import Depth, Reading, Recipe
from optsim.study.claims.worlds import BENCH, TARGET_1, TARGET_2, Cell


@dataclass(frozen=True)
class Task:
    """One solve: a recipe for one series on one trial."""

    cell: Cell
    series: Series
    groups: int
    recipe: Recipe

    @property
    def name(self) -> str:
        """Return the name of its entry."""
        return f"solves/{self.cell.name}/{self.series.key}-R{self.groups}of8-{self.recipe.name}"

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit of one Bayer shot at 64 x 64."""
        shots = self.groups * (self.series.sensor != "bayer") * 3
        return self.recipe.method.cost * (1 + 0.15 * shots) * (self.cell.size / 64) ** 2


def scene_names(config: ClaimsConfig) -> list[str]:
    """Return the random scenes: each seed has its own."""
    return [f"procedural-{config.seed * 1000 + i + 1}" for i in range(config.scenes)]


def cells(config: ClaimsConfig, depth: Depth) -> Iterator[tuple[Cell, tuple[int, ...]]]:
    """Yield a reading's trials with the groups of shots at each."""
    size = depth.size or config.size
    for scene in (BENCH,) if depth.bench else (TARGET_1, TARGET_2):
        for mask in range(depth.target_masks):
            yield Cell(scene, mask, size), depth.groups
    for scene in scene_names(config)[: depth.scenes]:
        for mask in range(depth.masks):
            yield Cell(scene, mask, size), depth.scene_groups


def tasks_of(config: ClaimsConfig, reading: Reading) -> Iterator[Task]:
    """Yield the solves that one reading looks at."""
    for cell, groups in cells(config, reading.depth):
        for series in reading.series():
            for group in groups:
                yield Task(cell, series, group, reading.recipes[series.sensor])


def all_tasks(config: ClaimsConfig, chosen: Sequence[Reading]) -> list[Task]:
    """List every solve once, world by world."""
    found = dict.fromkeys(task for reading in chosen for task in tasks_of(config, reading))
    return sorted(found, key=lambda task: (task.cell.size, task.cell.scene, -task.cost, task.name))
