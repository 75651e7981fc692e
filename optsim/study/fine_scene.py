"""Scenes as fine cubes for studies of the optics: rendered from the catalogue, or a textured field mixed from measured reflectances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Protocol

import numpy as np

from optsim.camera.model import Model, ranged
from optsim.cube import Bands, make_cube

if TYPE_CHECKING:
    import xarray as xr

    from scenes.scene import Scene


class FineScene(Protocol):
    """Something that stands in front of the camera, as a cube finer than mirrors and bands."""

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        ...

    def cube(self, bands: Bands, size: tuple[int, int], samples: int) -> xr.Dataset:
        """Return radiance of (M s, N s) pixels in the fine ``bands``."""
        ...


class Rendered(Model):
    """A scene of the catalogue, rendered.

    Args:
        name: as ``optsim scenes`` lists it.
        error: of the render, in [1e-4, 1]. Noise of the render is texture that the truth has too, so a coarse one is fair.
        seed: of the render.
    """

    name: str
    error: Annotated[float, ranged(1e-4, 1, "")] = 0.02
    seed: Annotated[int, ranged(0, 2**32 - 1, "")] = 0

    def cube(self, bands: Bands, size: tuple[int, int], samples: int) -> xr.Dataset:
        """Return radiance of (M s, N s) pixels in the fine ``bands``."""
        from scenes import scene_by_name

        return _rendered(scene_by_name(self.name).build(), bands, size, samples, self.error, self.seed)


@dataclass(frozen=True)
class RenderedScene:
    """A scene of one's own, rendered.

    Args:
        scene: what to render.
        error: of the render, in [1e-4, 1].
    """

    scene: Scene
    error: float = 0.02

    @property
    def name(self) -> str:
        """Return the scene's name."""
        return self.scene.name

    def cube(self, bands: Bands, size: tuple[int, int], samples: int) -> xr.Dataset:
        """Return radiance of (M s, N s) pixels in the fine ``bands``."""
        return _rendered(self.scene, bands, size, samples, self.error, 0)


class TexturedField(Model):
    """A field without a flat patch: the chart's 24 reflectances under xenon light, mixed by random fields (theory.md (C.70)).

    Flat charts are sparse in a wavelet basis, so that a wrong H costs little on them; here structure goes on below the
    mirrors' size.

    Args:
        slope: b of the fields' amplitude spectrum f^-b, in [0.5, 3]: natural pictures have about 1.
        contrast: c of the mixing weights exp(c z), in [0, 10]; 0 mixes all evenly.
        seed: of the fields.
    """

    slope: Annotated[float, ranged(0.5, 3, "")] = 1.4
    contrast: Annotated[float, ranged(0, 10, "")] = 3.0
    seed: Annotated[int, ranged(0, 2**32 - 1, "")] = 0

    @property
    def name(self) -> str:
        """Return its name, for files and tables."""
        return "textured-field"

    def cube(self, bands: Bands, size: tuple[int, int], samples: int) -> xr.Dataset:
        """Return radiance of (M s, N s) pixels in the fine ``bands``."""
        from scenes.library import illuminant, reflectance, reflectances

        spectra = np.stack([reflectance(name).band_mean(bands.lower, bands.upper) for name in reflectances()])
        light = illuminant("xenon").band_mean(bands.lower, bands.upper)
        shape = (size[0] * samples, size[1] * samples)
        random = np.random.Generator(np.random.Philox(self.seed))
        weights = np.exp(self.contrast * np.stack([self._field(shape, random) for _ in spectra], axis=-1))
        weights /= weights.sum(-1, keepdims=True)
        return make_cube((weights @ spectra * light).astype(np.float32), bands, attrs={"scene": self.name, "seed": self.seed})

    def _field(self, shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
        """Return a Gaussian field of mean 0 and variance 1 with amplitude spectrum f^-slope."""
        frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1]))
        amplitude = np.where(frequency > 0, frequency, 1.0) ** -self.slope * (frequency > 0)
        values = np.fft.ifft2(np.fft.fft2(random.standard_normal(shape)) * amplitude).real
        return np.asarray(values / values.std())


def _rendered(scene: Scene, bands: Bands, size: tuple[int, int], samples: int, error: float, seed: int) -> xr.Dataset:
    from optsim.render import RenderSettings, render

    return render(scene, bands, size, RenderSettings(oversample=samples, error=error, seed=seed))
