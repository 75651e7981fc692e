"""Wavelengths of well-known sets, in nm, for files that do not say theirs; and which numbers can be nanometres at all."""

from __future__ import annotations

import numpy as np

from optsim.errors import InputError

LOWEST_NM, HIGHEST_NM = 100.0, 20_000.0
"""From the vacuum ultraviolet to the thermal infrared; micrometres are below, many Angstroms above."""
DOUBTFUL_NM = 2_600.0
"""Few spectral cameras reach beyond; visible light in Angstrom does."""

TSA_TENTHS_NM = (
    453.3, 457.6, 462.1, 466.8, 471.6, 476.5, 481.6, 486.9, 492.4, 498.0, 503.9, 509.9, 516.2, 522.7,
    529.5, 536.5, 543.8, 551.4, 558.6, 567.5, 575.3, 584.3, 594.4, 604.2, 614.4, 625.1, 636.3, 648.1,
)  # fmt: skip
"""The 28 bands of the TSA-Net set-up (Meng, Ma, Yuan, ECCV 2020) as some of its users list them."""

TSA_HALVES_NM = (
    453.5, 457.5, 462.0, 466.0, 471.5, 476.5, 481.5, 487.0, 492.5, 498.0, 504.0, 510.0, 516.0, 522.5,
    529.5, 536.5, 544.0, 551.5, 558.5, 567.5, 575.5, 584.5, 594.5, 604.0, 614.5, 625.0, 636.5, 648.0,
)  # fmt: skip
"""The same bands rounded to half nanometres, as the plotting code of later solvers (MST and its heirs) has them."""


def require_nanometres(field: str, centers: np.ndarray) -> None:
    """Refuse band centres that are not finite numbers from 100 to 20000 nm.

    Raises:
        InputError: ``field``.
    """
    if centers.size and np.isfinite(centers).all() and centers.min() >= LOWEST_NM and centers.max() <= HIGHEST_NM:
        return
    remedy = ""
    if centers.size and np.isfinite(centers).all():
        remedy = ": um times 1000" if centers.max() < LOWEST_NM else ": Angstrom over 10" if centers.min() > DOUBTFUL_NM else ""
    raise InputError(field, centers.tolist()[:8], f"centres from {LOWEST_NM:g} to {HIGHEST_NM:g} nm{remedy}")


def doubtful(centers: np.ndarray) -> list[str]:
    """Say in a sentence when band centres may be in another unit than nm."""
    if centers.max() <= DOUBTFUL_NM:
        return []
    return [f"bands from {centers.min():g} to {centers.max():g} nm, beyond {DOUBTFUL_NM:g}: if these are Angstrom, state a tenth of them"]
