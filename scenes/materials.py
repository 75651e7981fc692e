"""What surfaces are made of. Opaque materials answer on the front side only; their backs are black."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, BeforeValidator, InstanceOf, model_validator

from scenes.errors import InputError
from scenes.glasses import glass_index
from scenes.model import Model, ranged
from scenes.spectrum import Spectrum

LINE_D_NM, LINE_F_NM, LINE_C_NM = 587.5618, 486.1327, 656.2725
"""The Fraunhofer lines that define an Abbe number."""


def as_spectrum(value: Any) -> Any:
    """Turn a finite number into the spectrum that has it everywhere; pass everything else on."""
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        if not np.isfinite(value):
            raise InputError("", float(value), "finite")
        return Spectrum.constant(float(value))
    return value


def _within(low: float, high: float, unit: str) -> Any:
    def check(spectrum: Spectrum) -> Spectrum:
        bad = (spectrum.value < low) | (spectrum.value > high)
        if np.any(bad):
            i = int(np.argmax(bad))
            where = f"in [{low:g}, {high:g}]{unit}; {spectrum.label} leaves it at {spectrum.wavelength_nm[i]:g} nm"
            raise InputError("", float(spectrum.value[i]), where)
        return spectrum

    return AfterValidator(check)


Reflectance = Annotated[InstanceOf[Spectrum], BeforeValidator(as_spectrum), _within(0.0, 1.0, "")]
"""A spectrum within [0, 1], or one number for all wavelengths."""
OpticalConstant = Annotated[InstanceOf[Spectrum], BeforeValidator(as_spectrum), _within(0.0, 100.0, "")]
"""A real or imaginary part of a refractive index."""
Emission = Annotated[InstanceOf[Spectrum], BeforeValidator(as_spectrum), _within(0.0, 1e30, " (any unit of light)")]
"""A light's spectrum, or one number for all wavelengths. Tiny values (1e-40) are accepted: light is normalised before
rendering and its scale is applied afterwards in float64."""


class Material(Model):
    """A surface's material; abstract, see ``scenes.scene.MATERIALS`` for the final ones."""

    place: ClassVar[str] = "material"


class Lambertian(Material):
    """A surface that looks equally bright from all directions on its front side, black on its back; abstract."""

    @property
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the spectra of which the surface's reflectances are mixtures."""
        raise NotImplementedError

    @property
    def largest(self) -> float:
        """Return a bound of the reflectance over places and wavelengths."""
        raise NotImplementedError


class Diffuse(Lambertian):
    """A Lambertian surface on its front side, black on its back.

    Args:
        reflectance: spectrum within [0, 1], or one number for all wavelengths.

    Raises:
        InputError: ``material.reflectance`` outside [0, 1] or not finite.
    """

    reflectance: Reflectance

    @property
    def curves(self) -> tuple[Spectrum, ...]:
        """Return the reflectance."""
        return (self.reflectance,)

    @property
    def largest(self) -> float:
        """Return the reflectance's maximum."""
        return self.reflectance.maximum


class Dielectric(Material):
    """Smooth clear glass in air, for closed shapes.

    Args:
        index: refractive index at the d line (587.56 nm), 1 to 4; with ``glass`` the catalogue's.
        abbe: Abbe number (n_d - 1) / (n_F - n_C), 5 to 1000; None for no dispersion; with ``glass`` the catalogue's.
        glass: name of a catalogue glass, whose Sellmeier formula then gives the index at every wavelength.
    """

    index: Annotated[float, ranged(1, 4, "(refractive index)")]
    abbe: Annotated[float, ranged(5, 1000, "(Abbe number)")] | None = None
    glass: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_catalogue(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("glass"), str):
            return data
        d, f, c = (float(n) for n in glass_index(data["glass"], [LINE_D_NM, LINE_F_NM, LINE_C_NM]))
        known = {"index": d, "abbe": (d - 1) / (f - c)}
        for name, value in known.items():
            given = data.get(name)
            if given is not None and not (isinstance(given, int | float) and abs(given - value) <= 1e-9 * value):
                raise InputError(name, given, f"left out with glass = {data['glass']!r}, whose {name} is {value:.6g}")
        return {**data, **known}

    def index_at(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the index at wavelengths in nm: Sellmeier's of a catalogue glass, else Cauchy's two terms (theory.md (R.6))."""
        x = np.asarray(wavelength_nm, np.float64)
        if self.glass is not None:
            return glass_index(self.glass, x)
        if self.abbe is None:
            return np.full(x.shape, self.index)
        slope = (self.index - 1) / self.abbe / (LINE_F_NM**-2 - LINE_C_NM**-2)
        return self.index + slope * (x**-2 - LINE_D_NM**-2)


class RoughPlastic(Material):
    """A diffuse base under a rough clear coat, front side only.

    Args:
        reflectance: of the base, within [0, 1].
        roughness: GGX alpha of the coat, 0.01 to 1.
        index: refractive index of the coat, 1.05 to 3.
    """

    reflectance: Reflectance
    roughness: Annotated[float, ranged(0.01, 1, "(GGX alpha)")] = 0.1
    index: Annotated[float, ranged(1.05, 3, "(refractive index)")] = 1.5


class Conductor(Material):
    """A smooth metal, front side only.

    Args:
        eta: real part of the refractive index, 0 to 100.
        k: extinction coefficient, 0 to 100.
    """

    eta: OpticalConstant
    k: OpticalConstant
