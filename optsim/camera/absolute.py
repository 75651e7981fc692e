"""Absolute quantum efficiencies: stated, not known, for published curves are relative (theory.md C.g)."""

from __future__ import annotations

from typing import Annotated, ClassVar

from optsim.camera.model import Model, ranged
from optsim.camera.sensor import Bayer, Foveon, Mono
from optsim.errors import InputError


class AssumedEfficiencies(Model):
    """State the peak efficiencies that turn relative curves into electrons.

    Args:
        mono: largest value of the monochrome sensor's curve (5 um of silicon), in (0, 1].
        bayer: largest value of the mosaic's three curves, in (0, 1].
        foveon_sum: largest value of the sum of the three layers' curves, in (0, 1].
    """

    place: ClassVar[str] = "efficiencies"
    mono: Annotated[float, ranged(0, 1, "", "(]")] = 0.5
    bayer: Annotated[float, ranged(0, 1, "", "(]")] = 0.5
    foveon_sum: Annotated[float, ranged(0, 1, "", "(]")] = 0.6

    def sensors(self) -> tuple[Mono, Bayer, Foveon]:
        """Return the three sensors with absolute curves."""
        layers = Foveon.sigma()
        grid = layers.red.wavelength_nm  # all three share it, so that the sum is largest at one of its nodes
        peak = max(curve.maximum for curve in layers.curves) / float(layers.response(grid).sum(0).max())
        return Mono.silicon().with_peak_qe(self.mono), Bayer.nikon().with_peak_qe(self.bayer), layers.with_peak_qe(self.foveon_sum * peak)

    def swept(self, factor: float) -> AssumedEfficiencies:
        """Return the same with the colour sensors' values times a factor: the comparison hangs on their ratio to mono.

        Raises:
            InputError: field ``factor`` not above 0, or when it asks for an efficiency above 1.
        """
        most = 1 / max(self.bayer, self.foveon_sum)
        if not 0 < factor <= most:
            raise InputError("factor", factor, f"in (0, {most:.6g}], efficiencies up to 1")
        return AssumedEfficiencies(mono=self.mono, bayer=self.bayer * factor, foveon_sum=self.foveon_sum * factor)
