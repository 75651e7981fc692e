"""What one path carries: all nodes at once, or a single node where every wavelength goes its own way."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from optsim.render.engine import dr, mi
from optsim.render.materials import MaterialTable
from optsim.render.translate import NODE_OFFSET


class Bundle(Protocol):
    """Say how many nodes a thread follows and where it finds their material data.

    A thread carries ``groups`` spectra that hold ``nodes`` nodes; ``lanes`` threads share a pixel, each with other nodes.
    """

    lanes: int
    nodes: int
    groups: int

    def dark(self) -> Any:
        """Return one spectrum of zeros."""
        ...

    def split(self, spectra: list[Any]) -> list[Any]:
        """Return one float per node from the spectra of all groups."""
        ...

    def own(self, spectrum: Any) -> Any:
        """Return what the path keeps of the four values that Mitsuba returns."""
        ...

    def wavelengths(self, lane: Any) -> list[Any]:
        """Return each group's node numbers as Mitsuba's wavelengths."""
        ...

    def reflectance(self, row: Any, group: int, lane: Any, active: Any) -> Any:
        """Return a diffuse material's reflectance at the nodes of a group."""
        ...

    def largest(self, spectra: list[Any]) -> Any:
        """Return the largest value over all nodes."""
        ...

    def mean(self, spectra: list[Any]) -> Any:
        """Return the mean over all nodes."""
        ...

    def only(self, node: Any, group: int) -> Any:
        """Return a group's spectrum that is 1 at one node of the table and 0 elsewhere."""
        ...

    def value(self, spectra: list[Any], node: Any) -> Any:
        """Return the value at one node of the table."""
        ...


class AllNodes:
    """Carry all nodes of a table along one path, four to a spectrum."""

    def __init__(self, table: MaterialTable) -> None:
        self.table, self.lanes, self.nodes, self.groups = table, 1, table.nodes, table.groups
        numbers = NODE_OFFSET + table.first + np.minimum(np.arange(4 * self.groups), self.nodes - 1)
        self._numbers = [[dr.opaque(mi.Float, float(x)) for x in four] for four in numbers.reshape(-1, 4)]

    def dark(self) -> Any:
        """Return four nodes of zero."""
        return mi.Spectrum(0)

    def split(self, spectra: list[Any]) -> list[Any]:
        """Return one float per node; the padding of the last group is dropped."""
        return [spectra[n // 4][n % 4] for n in range(self.nodes)]

    def own(self, spectrum: Any) -> Any:
        """Return all four values."""
        return spectrum

    def wavelengths(self, lane: Any) -> list[Any]:
        """Return each group's node numbers; ``lane`` is always 0."""
        return [mi.Spectrum(*four) for four in self._numbers]

    def reflectance(self, row: Any, group: int, lane: Any, active: Any) -> Any:
        """Return the reflectance at the four nodes of a group; ``lane`` is always 0."""
        return self.table.at(row, group, active)

    def largest(self, spectra: list[Any]) -> Any:
        """Return the largest value over all nodes."""
        most = dr.max(spectra[0])
        for more in spectra[1:]:
            most = dr.maximum(most, dr.max(more))
        return most

    def mean(self, spectra: list[Any]) -> Any:
        """Return the mean over all nodes, without the padding of the last group."""
        total = mi.Float(0)
        for value in self.split(spectra):
            total += value
        return total / self.nodes

    def only(self, node: Any, group: int) -> Any:
        """Return 1 at one node of the table and 0 elsewhere."""
        return mi.Spectrum(*[dr.select(node == 4 * group + i, mi.Float(1), 0) for i in range(4)])

    def value(self, spectra: list[Any], node: Any) -> Any:
        """Return the value at one node of the table."""
        found = mi.Float(0)
        for n, value in enumerate(self.split(spectra)):
            found = dr.select(node == n, value, found)
        return found


class OneNode:
    """Carry one node per path; the thread's lane is the number of the node in the table."""

    def __init__(self, table: MaterialTable) -> None:
        self.table, self.lanes, self.nodes, self.groups = table, table.nodes, 1, 1

    def dark(self) -> Any:
        """Return one node of zero."""
        return mi.Float(0)

    def split(self, spectra: list[Any]) -> list[Any]:
        """Return the one float."""
        return spectra

    def own(self, spectrum: Any) -> Any:
        """Return the first of four equal values."""
        return spectrum[0]

    def wavelengths(self, lane: Any) -> list[Any]:
        """Return the one node's number."""
        return [mi.Spectrum(NODE_OFFSET + self.table.first + mi.Float(lane))]

    def reflectance(self, row: Any, group: int, lane: Any, active: Any) -> Any:
        """Return the reflectance at the lane's node."""
        return self.table.at_node(row, lane, active)

    def largest(self, spectra: list[Any]) -> Any:
        """Return the one value."""
        return spectra[0]

    def mean(self, spectra: list[Any]) -> Any:
        """Return the one value."""
        return spectra[0]

    def only(self, node: Any, group: int) -> Any:
        """Return 1: there is no other node."""
        return mi.Float(1)

    def value(self, spectra: list[Any], node: Any) -> Any:
        """Return the one value."""
        return spectra[0]
