"""A board covered by fine detail of many independent spectra: a scene on which no prior of flat patches gets a free ride."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import ColorChecker, Region
from scenes.library import illuminant, reflectance, test_samples
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.spectrum import Spectrum
from scenes.textures import Textured

_STREAM = 0x74657874  # keeps the texture's random numbers apart from every other use of the same seed


class TexturedBoard(Model):
    """A flat board whose reflectance changes everywhere: mixtures of samples whose weights are random fields at all scales.

    Args:
        name: of the scene.
        texels: along each side of the board; not a multiple of usual picture sizes, so that texels fall across mirrors.
        spectra: how many reflectances are mixed, 2 to 32; taken evenly from the test half of the colour samples.
        roughness: exponent of the fields' amplitude spectrum f^-roughness: 0 is white noise, 1 is like natural pictures, 2 is smooth.
        seed: of the fields.
        lamp: relative spectrum of the lamp.
        irradiance: on the middle of the board, mean over 450 to 670 nm, in W m^-2 nm^-1.
    """

    place: ClassVar[str] = "textured"
    name: str = "textured"
    texels: Annotated[int, Field(ge=2, le=4096)] = 389
    spectra: Annotated[int, Field(ge=2, le=32)] = 12
    roughness: Annotated[float, ranged(0, 4, "")] = 1.0
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01

    def build(self) -> Scene:
        """Return the scene."""
        chart = ColorChecker(lamp=self.lamp, irradiance=self.irradiance)
        return Scene(
            name=self.name,
            shapes=(chart.flat("board", "print", Region(0, 0, 1, 1), 0),),
            materials={"print": self.texture()},
            lights=(chart.light(),),
            viewpoint=chart.viewpoint(),
            description=f"A flat board of fine detail at all scales: {self.spectra} independent reflectances mixed by random fields.",
        )

    def texture(self) -> Textured:
        """Return what is printed on the board."""
        names = test_samples()
        chosen = [names[i] for i in np.linspace(0, len(names) - 1, self.spectra).round().astype(int)]
        weights = random_weights((self.texels, self.texels), self.spectra, self.roughness, self.seed)
        return Textured(basis=tuple(reflectance(name) for name in chosen), weights=weights)


def random_weights(size: tuple[int, int], count: int, roughness: float, seed: int, contrast: float = 2.0) -> np.ndarray:
    """Return (rows, columns, count) weights that add to 1: a softmax of independent random fields (theory.md (R.37)).

    Args:
        size: (rows, columns).
        count: how many fields.
        roughness: exponent of the amplitude spectrum.
        seed: of the fields.
        contrast: standard deviation of each field before the softmax.
    """
    stream = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_STREAM,))))
    fy, fx = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    frequency = np.hypot(fy, fx)
    frequency[0, 0] = np.inf
    fields = np.fft.irfft2(np.fft.rfft2(stream.standard_normal((count, *size))) * frequency**-roughness, s=size)
    fields *= contrast / fields.std((1, 2), keepdims=True)
    weights = np.exp(fields - fields.max(0))
    weights /= weights.sum(0)
    return np.moveaxis(weights, 0, -1).astype(np.float32)
