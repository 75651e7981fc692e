"""Masks by gradient: from a random start to binary masks of small expected error (theory.md (C.77))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import model_validator

from optsim.camera.design.expected_error import ExpectedError
from optsim.camera.model import Model, ranged
from optsim.errors import InputError

OnStep = Callable[[int, float], None]
"""Called with the number of a step, from 0, and the expected error of the gray masks; what it raises ends the design."""
_STREAM = 0x64657367  # keeps the probes apart from the masks' own random numbers


@dataclass(frozen=True)
class DesignedMasks:
    """Hold designed masks.

    Args:
        masks: (L, M, N) uint8 of 0 and 1.
        errors: expected error of the gray masks at every step (share of the prior's energy; noisy, by few probes).
        gray: share of mirrors that stood between 0.1 and 0.9 at the last step.
    """

    masks: np.ndarray
    errors: tuple[float, ...]
    gray: float


class MaskDesign(Model):
    """Descend from random masks by Adam on t = sigmoid(b theta), with b rising, and take theta > 0 at the end.

    Args:
        steps: from 1 to 10000.
        probes: random probes of a step, from 1 to 64.
        rate: Adam's step in theta, in (0, 10].
        sharpness: (first, last) b, each in (0, 100]; rises geometrically.
        start: |theta| of the start, in (0, 2].
    """

    place: ClassVar[str] = "mask design"
    steps: Annotated[int, ranged(1, 10_000, "steps")] = 80
    probes: Annotated[int, ranged(1, 64, "probes")] = 2
    rate: Annotated[float, ranged(0, 10, "", "(]")] = 0.15
    sharpness: tuple[Annotated[float, ranged(0, 100, "", "(]")], Annotated[float, ranged(0, 100, "", "(]")]] = (1.0, 6.0)
    start: Annotated[float, ranged(0, 2, "", "(]")] = 0.7

    @model_validator(mode="after")
    def _rising(self) -> MaskDesign:
        if self.sharpness[1] < self.sharpness[0]:
            raise InputError("sharpness", self.sharpness, "rising: (first, last) with last >= first")
        return self

    def run(self, objective: ExpectedError, start: np.ndarray, seed: int, on_step: OnStep | None = None) -> DesignedMasks:
        """Design masks from a start.

        Args:
            objective: what falls.
            start: (L, M, N) of 0 and 1, for example Bernoulli masks: what the design is then compared with.
            seed: of the probes, from 0.
            on_step: told of every step.
        """
        rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_STREAM,))))
        theta = self.start * (2 * np.asarray(start, np.float64) - 1)
        mean, square, errors = np.zeros_like(theta), np.zeros_like(theta), []
        first, last = self.sharpness
        masks = theta
        for step in range(self.steps):
            b = first * (last / first) ** (step / max(1, self.steps - 1))
            masks = 1 / (1 + np.exp(-b * theta))
            found = objective.estimate(masks, rng, self.probes)
            errors.append(found.value)
            if on_step is not None:
                on_step(step, found.value)
            slope = found.by_masks * b * masks * (1 - masks)
            mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
            unbiased = mean / (1 - 0.9 ** (step + 1)), square / (1 - 0.99 ** (step + 1))
            theta = np.clip(theta - self.rate * unbiased[0] / np.sqrt(unbiased[1] + 1e-300), -2, 2)
        return DesignedMasks((theta > 0).astype(np.uint8), tuple(errors), float(np.mean((masks > 0.1) & (masks < 0.9))))
