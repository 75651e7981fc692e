"""The same photograph in NumPy, one wavelength at a time, for machines without a usable libLLVM and for fields that no polynomial holds."""

from __future__ import annotations

import numpy as np

from optsim.camera.gather import Rows
from optsim.camera.layout import Budget, Layout, Weights


class Scatter:
    """Lay every sample's square footprint on the pixels that it overlaps, by area (theory.md (C.17)); slow but plain.

    Args and results as :class:`optsim.camera.gather.Gather`; ``frames``, ``photons`` and ``budget`` are attributes.
    """

    def __init__(self, layout: Layout, weights: Weights, masks: np.ndarray, mosaic: np.ndarray | None, rows: Rows) -> None:
        self.layout, self.mosaic = layout, mosaic
        channels = 1 if mosaic is not None else len(weights.curves)
        self.frames = np.zeros((len(masks), channels, *layout.frame))
        self.photons = np.zeros(len(masks))
        totals = np.zeros((len(masks), 5))
        s, (height, columns) = layout.samples, layout.fine
        curve = None if mosaic is None else mosaic.ravel()
        for first in range(0, height, s):
            cube = rows(first, first + s).astype(np.float64) / s**2
            open_ = np.repeat(masks[:, first // s], s, axis=1)[:, None, :]
            eta = (np.arange(first, first + s) + 0.5) / (height / 2) - 1
            xi = (np.arange(columns) + 0.5) / (columns / 2) - 1
            x, y = layout.field.at(xi, eta[:, None])
            passes = layout.field.passes(xi, eta[:, None])
            for w in range(weights.arriving.size):
                all_light = open_ * cube[..., w]
                light = all_light * passes[w]
                spread, inside = self._spread(x[w] + layout.middle[1], y[w] + layout.middle[0], light)
                for c in range(channels):
                    chi = weights.curves[curve, w] if curve is not None else weights.curves[c, w]
                    self.frames[:, c] += (spread * chi).reshape(len(masks), *layout.frame)
                self.photons += spread.sum(1) * weights.arriving[w]
                total, kept, every = light.sum((1, 2)), (light * inside).sum((1, 2)), all_light.sum((1, 2))
                reflected = every * weights.reflected[w] + (every - total) * weights.arriving[w]
                sent = weights.arriving[w] + weights.blocked[w] + weights.reflected[w]
                parts = (
                    every * sent,
                    (total - kept) * weights.arriving[w],
                    every * weights.blocked[w],
                    reflected,
                    kept * weights.outside[w],
                )
                totals += np.stack(parts, axis=1)
        self.budget = [Budget(*map(float, row)) for row in totals]

    def _spread(self, x: np.ndarray, y: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (L, M W) light on the pixels and the share of each sample that falls on the frame."""
        height, width = self.layout.frame
        side = self.layout.side_px
        out, inside = np.zeros((len(light), height * width)), np.zeros(x.shape)
        column, row = (np.floor(p - side / 2 + 0.5).astype(np.int64) for p in (x, y))
        for dj in range(int(np.ceil(side)) + 1):
            part_x = np.clip((1 + side) / 2 - np.abs(x - (column + dj)), 0, min(side, 1.0)) / side
            for di in range(int(np.ceil(side)) + 1):
                part = part_x * np.clip((1 + side) / 2 - np.abs(y - (row + di)), 0, min(side, 1.0)) / side
                j, i = column + dj, row + di
                on = (part > 0) & (j >= 0) & (j < width) & (i >= 0) & (i < height)
                inside += np.where(on, part, 0)
                for l in range(len(light)):
                    out[l] += np.bincount((i * width + j)[on], (light[l] * part)[on], minlength=out.shape[1])
        return out, inside
