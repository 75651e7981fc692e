"""Random numbers for paths: a randomly shifted Kronecker sequence for the first dimensions, PCG32 for the rest.

Kronecker points fill the square of pixel and light far more evenly than random ones; each pass shifts them anew in each
pixel, so that passes are independent replicates and their scatter is an honest standard error (theory.md (R.27)).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from optsim.render.engine import dr, mi

DIMENSIONS = 6
"""Pixel, light sample and scattered ray at the first smooth surface, two numbers each; a lens has two more, dispersing glass one."""


def increments(dimensions: int) -> list[int]:
    """Return the powers of the generalised golden ratio, x^(d+1) = x + 1, as 32-bit fractions."""
    x = 1.5
    for _ in range(64):
        x = (1 + x) ** (1 / (dimensions + 1))
    return [round(x ** -(j + 1) * 2**32) for j in range(dimensions)]


def seed_words(*key: int) -> tuple[int, int]:
    """Mix whole numbers (seed, light group, pass, ...) into two 32-bit words."""
    a, b = np.random.SeedSequence(list(key)).generate_state(2)
    return int(a), int(b)


class PathSampler:
    """Draw the random numbers of one path per thread.

    Args:
        pixel: number of each thread's pixel in the whole picture: tiles of one pass never share numbers.
        shift: two words that select the replicate's shifts.
        words: two words that select its PCG32 stream.
        lens: whether two more numbers are drawn, for a place on the lens.
        wave: whether one more is drawn, for a wavelength.
    """

    def __init__(self, pixel: Any, shift: tuple[int, int], words: tuple[int, int], lens: bool, wave: bool) -> None:
        shifts = _stream(pixel, shift)
        self.steps = increments(DIMENSIONS + 2 * lens + wave)
        self._wave = wave
        self.shift = [shifts.next_uint32() for _ in self.steps]
        self.stream = _stream(pixel, words)

    def first(self, index: Any) -> tuple[Any, Any, FirstNumbers, list[Any]]:
        """Return the Kronecker point of sample ``index`` (UInt32), in [0, 1): two for the pixel, four for the path, two for a lens."""
        x, y, *rest = [mi.Float((s + index * mi.UInt32(step)) >> 8) * 2.0**-24 for s, step in zip(self.shift, self.steps)]
        wave = rest.pop() if self._wave else mi.Float(0)
        return x, y, FirstNumbers(rest[:4], wave), rest[4:]


class FirstNumbers:
    """Hold the evenly spread numbers that a path's first smooth surface uses; later surfaces draw from the stream.

    Args:
        numbers: four floats in [0, 1).
        wave: one more, for the wavelength that a path follows after dispersing glass (0 where none is needed).
    """

    def __init__(self, numbers: list[Any], wave: Any) -> None:
        self._numbers, self.wave = numbers, wave

    def take(self, stream: Any, first: Any) -> list[Any]:
        """Return two numbers for the light sample and two for the scattered ray; ``first`` tells who may use the even ones."""
        return [dr.select(first, even, stream.next_float32()) for even in self._numbers]


def _stream(pixel: Any, words: tuple[int, int]) -> Any:
    a: Any = dr.opaque(mi.UInt32, words[0])
    b: Any = dr.opaque(mi.UInt32, words[1])
    engine: Any = mi
    wide = engine.UInt64
    low, high = engine.sample_tea_32(pixel, a)
    return engine.PCG32(initstate=wide(low) | (wide(high) << 32), initseq=(wide(b) << 32) | wide(pixel))
