"""The dispersion that a prism is designed for: nm per pixel over wavelength (theory.md (C.73))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optsim.errors import InputError

_FINE = 4096


@dataclass(frozen=True, eq=False)
class WantedDispersion:
    """Say how many nm every pixel of the spectrum shall hold.

    Args:
        wavelength_nm: (n,) increasing, at least 3: where the design is compared, its ends are the spectrum's.
        position_px: (n,) increasing: where each shall land; only differences count.
        nm_per_px: (n,) the slope of the wanted curve there.
    """

    wavelength_nm: np.ndarray
    position_px: np.ndarray
    nm_per_px: np.ndarray

    def __post_init__(self) -> None:
        ordered = all(v.ndim == 1 and np.all(np.isfinite(v)) and np.all(np.diff(v) > 0) for v in (self.wavelength_nm, self.position_px))
        if not ordered or self.wavelength_nm.size < 3 or self.wavelength_nm[0] <= 0:
            raise InputError("wanted", self.wavelength_nm.size, "at least 3 increasing wavelengths above 0 nm at increasing positions")

    @classmethod
    def from_function(
        cls, nm_per_px: Callable[[np.ndarray], np.ndarray], lower_nm: float, upper_nm: float, samples: int = 45
    ) -> WantedDispersion:  # fmt: skip
        """Integrate d position = d wavelength / nm_per_px(wavelength) from ``lower_nm`` to ``upper_nm``.

        Raises:
            InputError: field ``nm_per_px`` when it is not finite and above 0 everywhere.
        """
        fine = np.linspace(lower_nm, upper_nm, _FINE)
        slope = np.broadcast_to(np.asarray(nm_per_px(fine), np.float64), fine.shape)
        if not np.all(np.isfinite(slope)) or slope.min() <= 0:
            raise InputError("nm_per_px", float(np.min(slope)), "finite and above 0 nm per px over the whole range")
        position = np.concatenate([[0.0], np.cumsum((1 / slope[1:] + 1 / slope[:-1]) / 2 * np.diff(fine))])
        wavelength = np.linspace(lower_nm, upper_nm, samples)
        return cls(wavelength, np.interp(wavelength, fine, position), np.interp(wavelength, fine, slope))

    @classmethod
    def equal(cls, lower_nm: float = 450.0, upper_nm: float = 670.0, pixels: float = 24.0) -> WantedDispersion:
        """Ask for the same width in nm on every pixel."""
        width = (upper_nm - lower_nm) / pixels
        return cls.from_function(lambda wavelength: np.full(wavelength.shape, width), lower_nm, upper_nm)

    @classmethod
    def proportional(cls, lower_nm: float = 450.0, upper_nm: float = 670.0, pixels: float = 24.0) -> WantedDispersion:
        """Ask for the same resolving power everywhere: nm per px in proportion to the wavelength."""
        factor = np.log(upper_nm / lower_nm) / pixels
        return cls.from_function(lambda wavelength: factor * wavelength, lower_nm, upper_nm)

    @property
    def pixels(self) -> float:
        """Return the length of the spectrum in px."""
        return float(self.position_px[-1] - self.position_px[0])
