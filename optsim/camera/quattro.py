"""The Quattro: three layers of silicon, of which the top one has twice the resolution along both sides (theory.md (C.52))."""

from __future__ import annotations

import functools

from optsim.camera.sensor import Foveon, Mono, Sensor, sensors


class Quattro(Foveon):
    """A Foveon whose pixel grid is that of the top (blue) layer; the pixels of the two lower layers are 2 x 2 of it.

    Curves are those of one pixel of the grid; a lower layer's number is the sum over its block and stands in the
    block's first pixel (even row, even column), its other pixels hold 0. On odd sizes the last blocks are cut.
    """

    name = "quattro"

    @property
    def layer_bins(self) -> tuple[int, ...]:
        """Return 2, 2, 1: sides of the pixels of the red, green and blue layer."""
        return (2, 2, 1)


@functools.cache
def every_sensor() -> tuple[Sensor, ...]:
    """Return the three sensors that are compared, and the modelled ones: silicon mono, physical Foveon, Quattro."""
    return (*sensors(), Mono.silicon(), Foveon.physical(), Quattro.physical())
