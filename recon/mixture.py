"""Several priors at once: the sum of their values, its proximal map by turns (theory.md (S.64))."""

from typing import Any

import numpy as np
from pydantic import Field, field_validator

from recon.config import Config
from recon.errors import InputError
from recon.prior import Penalty


class Mixture(Config):
    """``R(f) = sum of share[i] R_i(f)``: a cube that pleases every part (theory.md (S.64)).

    Args:
        parts: at least one prior.
        shares: one positive factor a part; None: all 1.
        rounds: how often a call goes through the parts at most; what is left over is taken up by the next call.
        accuracy: a call ends when a round changed the cube by this part of its norm.
    """

    parts: tuple[Any, ...] = Field(min_length=1)
    shares: tuple[float, ...] | None = None
    rounds: int = Field(default=1, ge=1, le=10**6)
    accuracy: float = Field(default=1e-5, ge=0, lt=1)

    @field_validator("parts")
    @classmethod
    def _are_priors(cls, parts: tuple[Any, ...]) -> tuple[Any, ...]:
        for part in parts:
            if not callable(getattr(part, "bind", None)):
                raise InputError("Mixture.parts", part, "priors, e.g. recon.L1() and recon.TotalVariation()")
        return parts

    @field_validator("shares")
    @classmethod
    def _positive(cls, shares: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if shares is not None and (not shares or min(shares) <= 0):
            raise InputError("Mixture.shares", shares, "positive numbers, one for each part")
        return shares

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "MixturePenalty":
        """See ``Prior.bind``.

        Raises:
            InputError: field ``Mixture.shares`` when they are not one a part; what the parts refuse.
        """
        shares = (1.0,) * len(self.parts) if self.shares is None else self.shares
        if len(shares) != len(self.parts):
            raise InputError("Mixture.shares", shares, f"as many numbers as parts, {len(self.parts)}")
        return MixturePenalty([part.bind(shape, dtype) for part in self.parts], shares, self.rounds, self.accuracy)


class MixturePenalty:
    """The sum bound to one solve.

    With a dual q_i for each part, u = f - sum q is the proximal map once u = prox_i(u + q_i) holds for every i. The parts take
    turns (block ascent of the dual problem: each turn can only raise it). The duals stay from one call to the next, in
    proportion to the threshold.
    """

    def __init__(self, parts: list[Penalty], shares: tuple[float, ...], rounds: int, accuracy: float) -> None:
        self._parts, self._shares, self._rounds, self._accuracy = parts, shares, rounds, accuracy
        self.levels = next((known for part in parts if (known := getattr(part, "levels", None)) is not None), None)
        self._duals: list[np.ndarray] = []
        self._threshold = 0.0

    def value(self, cube: np.ndarray) -> float:
        """See ``Penalty.value``."""
        return sum(share * part.value(cube) for part, share in zip(self._parts, self._shares))

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``; of the values, the parts before the last are those of their own turn."""
        if len(self._parts) == 1:
            return self._shares[0] * self._parts[0].shrink(cube, threshold * self._shares[0])
        duals = self._scaled_duals(cube, threshold)
        for dual in duals:
            cube -= dual
        total = 0.0
        for _ in range(self._rounds):
            before = cube.copy(order="K") if self._rounds > 1 else cube
            total = 0.0
            for part, share, dual in zip(self._parts, self._shares, duals):
                dual += cube
                np.copyto(cube, dual)
                total += share * part.shrink(cube, threshold * share)
                dual -= cube
            if self._rounds > 1:
                before -= cube
                if float(np.vdot(before, before)) <= self._accuracy**2 * float(np.vdot(cube, cube)):
                    break
        return total

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return the formula of a single part; sums have none."""
        known = self._parts[0].tau_max(correlation) if len(self._parts) == 1 else None
        return None if known is None else known / self._shares[0]

    def _scaled_duals(self, cube: np.ndarray, threshold: float) -> list[np.ndarray]:
        """Return the last duals in proportion to the threshold, as subgradients are."""
        if not self._duals:
            self._duals = [np.zeros_like(cube, order="K") for _ in self._parts]
        elif self._threshold > 0 and threshold != self._threshold:
            for dual in self._duals:
                dual *= cube.dtype.type(threshold / self._threshold)
        self._threshold = threshold
        return self._duals
