"""The mirrors: binary masks, each shot's drawn from its own stream of random numbers (theory.md (C.9))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from optsim.errors import InputError

MONO_SHOTS_PER_GROUP = 3
"""The paper sets three monochrome shots against one colour shot."""
MAX_SHOTS = 32
MAX_SEED = 2**63 - 1
_STREAM = 0x6D61736B  # keeps mask streams apart from every other use of the same seed


class HasGroups(Protocol):
    """Say how many shots of a sensor count as one of the paper's measurements."""

    @property
    def shots_per_group(self) -> int:
        """Return 3 for a monochrome sensor, 1 for a colour sensor."""


@dataclass(frozen=True)
class Distinct:
    """Give every shot a mask of its own."""

    name = "distinct"

    def member(self, shot: int, group_size: int) -> int:
        """Return which mask of its group a shot uses."""
        return shot % group_size

    def check(self, shots: int, group_size: int) -> None:
        """Accept any number of shots."""


@dataclass(frozen=True)
class Repeated:
    """Let the three shots of a monochrome group share one mask."""

    name = "repeated"

    def member(self, shot: int, group_size: int) -> int:
        """Return which mask of its group a shot uses: always the first."""
        return 0

    def check(self, shots: int, group_size: int) -> None:
        """Refuse sensors without groups of three, and incomplete groups."""
        if group_size == 1:
            raise InputError("--masks", self.name, "distinct for a colour sensor, whose group is a single shot")
        if shots % group_size:
            raise InputError("--shots", shots, f"divisible by {group_size} when masks are repeated")


MaskRule = Distinct | Repeated


def masks_for(
    sensor: HasGroups, shots: int, kind: MaskRule, size: tuple[int, int], seed: int, open_fraction: float = 0.5
) -> np.ndarray:  # fmt: skip
    """Draw the masks of a series of shots, each mirror open with the same probability, independently.

    The stream of a mask is keyed by (seed, group, member in the group) alone: shot i of a colour sensor, the first
    mask of the i-th group of three monochrome shots and, repeated, the whole group share one mask; and a longer
    series begins with the shorter one.

    Args:
        sensor: only its ``shots_per_group`` is read.
        shots: L, from 1 to 32.
        kind: Distinct() or Repeated().
        size: (M, N) mirrors, each at least 1.
        seed: from 0 to 2^63 - 1.
        open_fraction: probability of an open mirror, in [0, 1].

    Returns:
        (L, M, N) uint8 of 0 and 1.

    Raises:
        InputError: ``--shots``, ``--masks``, ``--size``, ``--seed`` or ``open_fraction``.
    """
    if not isinstance(shots, int | np.integer) or not 1 <= shots <= MAX_SHOTS:
        raise InputError("--shots", shots, f"from 1 to {MAX_SHOTS} exposures")
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
        raise InputError("--seed", seed, "an integer from 0 to 2^63 - 1")
    if len(size) != 2 or min(size) < 1 or max(size) > 2**15:
        raise InputError("--size", size, "(rows, columns) of mirrors, each from 1 to 32768")
    if not 0 <= open_fraction <= 1:
        raise InputError("open_fraction", open_fraction, "a probability in [0, 1]")
    group = sensor.shots_per_group
    kind.check(int(shots), group)
    keys = [(shot // group, kind.member(shot, group)) for shot in range(shots)]
    drawn = {key: _draw(int(seed), key, size, open_fraction) for key in dict.fromkeys(keys)}
    return np.stack([drawn[key] for key in keys])


def check_masks(masks: ArrayLike) -> np.ndarray:
    """Return masks as (L, M, N) uint8 if every value is 0 or 1.

    Raises:
        InputError: field ``masks`` with the first bad (shot, row, column).
    """
    values = np.asarray(masks)
    if values.ndim != 3 or 0 in values.shape or values.shape[0] > MAX_SHOTS:
        raise InputError("masks", values.shape, f"of shape (shots, rows, columns), each at least 1, at most {MAX_SHOTS} shots")
    bad = ~((values == 0) | (values == 1))
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError("masks", float(values[where]), f"0 or 1; first bad (shot, row, column) is {where}")
    return np.ascontiguousarray(values, np.uint8)


def _draw(seed: int, key: tuple[int, int], size: tuple[int, int], open_fraction: float) -> np.ndarray:
    sequence = np.random.SeedSequence(seed, spawn_key=(_STREAM, *key))
    return (np.random.Generator(np.random.Philox(sequence)).random(size) < open_fraction).astype(np.uint8)
