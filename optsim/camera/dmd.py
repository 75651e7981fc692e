"""The mirrors: which masks they show, each drawn from its own stream of random numbers, and what the mirrors do (theory.md (C.9))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from optsim.camera.patterns import Bernoulli, Pattern, check_values
from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.camera.optics_config import DmdConfig

MONO_SHOTS_PER_GROUP = 3
"""The paper sets three monochrome shots against one colour shot."""
MAX_SHOTS = 32
MAX_SEED = 2**63 - 1
_STREAM = 0x6D61736B  # keeps mask streams apart from every other use of the same seed
_DEFECT_STREAM = 0x64656164


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
    sensor: HasGroups, shots: int, kind: MaskRule, size: tuple[int, int], seed: int, pattern: Pattern | None = None
) -> np.ndarray:  # fmt: skip
    """Draw the masks of a series of shots.

    The stream of a mask is keyed by (seed, group, member in the group) alone. With Bernoulli and blue-noise masks,
    which depend on their own stream only, shot i of a colour sensor, the first mask of the i-th group of three
    monochrome shots and, repeated, the whole group share one mask; and a longer series begins with the shorter one.

    Args:
        sensor: only its ``shots_per_group`` is read.
        shots: L, from 1 to 32.
        kind: Distinct() or Repeated().
        size: (M, N) mirrors, each at least 1.
        seed: from 0 to 2^63 - 1.
        pattern: what is drawn; Bernoulli(0.5) when None.

    Returns:
        (L, M, N) uint8 of 0 and 1; float64 only for gray masks from a file that allow it.

    Raises:
        InputError: ``--shots``, ``--masks``, ``--size`` or ``--seed``.
    """
    if not isinstance(shots, int | np.integer) or not 1 <= shots <= MAX_SHOTS:
        raise InputError("--shots", shots, f"from 1 to {MAX_SHOTS} exposures")
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
        raise InputError("--seed", seed, "an integer from 0 to 2^63 - 1")
    if len(size) != 2 or min(size) < 1 or max(size) > 2**15:
        raise InputError("--size", size, "(rows, columns) of mirrors, each from 1 to 32768")
    group = sensor.shots_per_group
    kind.check(int(shots), group)
    keys = [(shot // group, kind.member(shot, group)) for shot in range(shots)]
    distinct = list(dict.fromkeys(keys))
    streams = [np.random.Generator(np.random.Philox(np.random.SeedSequence(int(seed), spawn_key=(_STREAM, *key)))) for key in distinct]
    drawn = (Bernoulli() if pattern is None else pattern).draw(streams, (int(size[0]), int(size[1])))
    return drawn[[distinct.index(key) for key in keys]]


def check_masks(masks: ArrayLike, gray: bool = False) -> np.ndarray:
    """Return masks as (L, M, N) uint8 if every value is 0 or 1; with ``gray`` also values between, then as float64.

    Raises:
        InputError: field ``masks`` with the first bad (shot, row, column).
    """
    values = np.asarray(masks)
    if values.ndim != 3 or 0 in values.shape or values.shape[0] > MAX_SHOTS:
        raise InputError("masks", values.shape, f"of shape (shots, rows, columns), each at least 1, at most {MAX_SHOTS} shots")
    return check_values(values, gray)


def mirror_states(masks: np.ndarray, dmd: DmdConfig) -> np.ndarray:
    """Return the light that each mirror really sends to the sensor, over that of a perfect open one (theory.md (C.47)).

    Dead mirrors are off and stuck mirrors on in every shot; a mirror that is off leaks.

    Args:
        masks: (L, M, N), from 0 to 1.
        dmd: its ``leak``, ``dead_share``, ``stuck_share`` and ``defect_seed`` are read.

    Returns:
        ``masks`` itself for perfect mirrors, else (L, M, N) float64 from ``leak`` to 1.
    """
    if dmd.leak == 0 and dmd.dead_share == 0 and dmd.stuck_share == 0:
        return masks
    dead, stuck = defects(dmd, (masks.shape[1], masks.shape[2]))
    shown = np.where(dead, 0.0, np.where(stuck, 1.0, masks))
    return dmd.leak + (1 - dmd.leak) * shown


def defects(dmd: DmdConfig, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (dead, stuck), (M, N) bool: round(share M N) mirrors each, at random places, none both.

    Raises:
        InputError: field ``camera.dmd.stuck_share`` when the two shares add to more than 1.
    """
    total = size[0] * size[1]
    if dmd.dead_share + dmd.stuck_share > 1:
        raise InputError(
            "camera.dmd.stuck_share", dmd.stuck_share, f"at most {1 - dmd.dead_share:g}: dead and stuck mirrors are different ones"
        )
    order = np.random.Generator(np.random.Philox(np.random.SeedSequence(dmd.defect_seed, spawn_key=(_DEFECT_STREAM,)))).permutation(total)
    dead = round(dmd.dead_share * total)
    stuck = min(round(dmd.stuck_share * total), total - dead)
    rank = np.empty(total, np.int64)
    rank[order] = np.arange(total)
    place = rank.reshape(size)
    return place < dead, (place >= dead) & (place < dead + stuck)
