"""The lamp's light through a slit that steps through wavelengths: ground-truth cubes and calibration images (theory.md (C.55))."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from optsim.camera.camera import CameraConfig
from optsim.camera.model import Model, ranged
from optsim.camera.noise import Noise, expose
from optsim.camera.physical import Exposure, photograph
from optsim.camera.radiometry import photon_integral, product_integral
from optsim.camera.sensor import Mono
from optsim.cube import Bands, bands_of, check_cube, make_cube
from optsim.errors import InputError
from scenes.spectrum import Spectrum

if TYPE_CHECKING:
    import xarray as xr


def _xenon() -> Spectrum:
    from scenes.library import illuminant

    return illuminant("xenon")


class Monochromator(Model):
    """Describe a monochromator: the image of one slit swept over another passes a trapezium of wavelengths.

    Args:
        bandwidth_nm: full width at half maximum, in (0, 200] nm; None: the width of the band that is stepped to.
        slit_ratio: width of the narrower slit over the wider one, in [0.01, 1]; 1 passes a triangle.
        lamp: spectral radiance of a white target under the whole lamp, any unit; xenon by default.
    """

    place: ClassVar[str] = "monochromator"
    bandwidth_nm: Annotated[float, ranged(0, 200, "nm", "(]")] | None = None
    slit_ratio: Annotated[float, ranged(0.01, 1, "")] = 1.0
    lamp: Spectrum = Field(default_factory=_xenon)

    def slit(self, center_nm: float, width_nm: float | None = None) -> Spectrum:
        """Return the transmission at one step: a trapezium with maximum 1.

        Args:
            center_nm: where it is centred.
            width_nm: full width at half maximum where the config leaves it open.

        Raises:
            InputError: ``bandwidth_nm`` when neither is given, ``center_nm`` when the slit would reach below 0.1 nm.
        """
        wide = self.bandwidth_nm if self.bandwidth_nm is not None else width_nm
        if wide is None or not 0 < wide <= 200:
            raise InputError("monochromator.bandwidth_nm", wide, "in (0, 200] nm")
        foot, top = wide * (1 + self.slit_ratio) / 2, wide * (1 - self.slit_ratio) / 2
        if not (np.isfinite(center_nm) and center_nm - foot > 0.1):
            raise InputError("monochromator.center_nm", center_nm, f"above {foot + 0.1:g} nm, half the slit's foot")
        nodes = [-foot, -top, top, foot] if top > 0 else [-foot, 0, foot]
        return Spectrum(
            center_nm + np.array(nodes), np.array([0.0, 1.0, 1.0, 0.0] if top > 0 else [0.0, 1.0, 0.0]), f"slit at {center_nm:g} nm"
        )

    def acquire(
        self,
        cube: xr.Dataset,
        steps: Bands,
        sensor: Mono,
        noise: Noise | None = None,
        *,
        full_well_e: float = 20_000.0,
        fill: float = 0.9,
        seed: int = 0,
    ) -> xr.Dataset:
        """Record a cube as it is done on a bench: step by step, an image by a monochrome sensor without mask and prism.

        A step's image is divided by what the sensor would read of unit radiance through the same slit. A value is
        therefore the mean of the radiance weighted by slit x QE x lambda: not quite the band's mean.

        Args:
            cube: the target's radiance under the whole lamp, fine in wavelength.
            steps: centres to step to; their widths are the slit's where the config leaves that open.
            sensor: its curve weighs the wavelengths.
            noise: None records means; else each step is exposed until its brightest pixel reaches ``fill``.
            full_well_e: in (0, 1e12] electrons.
            fill: in (0, 1].
            seed: of the noise.

        Returns:
            A cube on ``steps`` in the unit of ``cube``.

        Raises:
            InputError: ``cube`` when a slit lets light pass beyond its wavelengths or its bands have gaps, and what ``expose`` names.
        """
        check_cube(cube)
        weights = self._weights(bands_of(cube), steps, sensor)
        images = cube["radiance"].values.astype(np.float64) @ (weights / weights.sum(0))
        if noise is not None:
            images = _recorded(images, noise, full_well_e, fill, seed)
        units = cube["radiance"].attrs["units"]
        return make_cube(images.astype(np.float32), steps, attrs={"source": "monochromator", "seed": seed}, units=units)

    def white(self, center_nm: float, fine: Bands, size: tuple[int, int], width_nm: float | None = None) -> xr.Dataset:
        """Return the radiance of a white target at one step, as a cube of ``fine`` bands and (rows, columns) pixels.

        Raises:
            InputError: field ``cube`` when the slit lets light pass beyond the bands, ``monochromator.lamp`` beyond the lamp's data.
        """
        slit = self.slit(center_nm, width_nm)
        (low, high), (first, last) = slit.range_nm, self.lamp.range_nm
        if low < first or high > last:
            raise InputError(
                "monochromator.lamp", f"{first:g}-{last:g} nm", f"known over {low:g}-{high:g} nm, what the {slit.name} lets pass"
            )
        _check_cover(slit, fine)
        mean = product_integral([self.lamp, slit], fine.lower, fine.upper) / fine.width
        return make_cube(
            np.broadcast_to(mean.astype(np.float32), (*size, fine.count)).copy(), fine, attrs={"source": f"slit at {center_nm:g} nm"}
        )

    def _weights(self, fine: Bands, steps: Bands, sensor: Mono) -> np.ndarray:
        """Return (n, K) photoelectrons of unit radiance from each fine band at each step."""
        if not fine.contiguous:
            raise InputError("cube", "bands with gaps or overlaps", "of touching bands")
        columns = []
        for center, width in zip(steps.center, steps.width):
            slit = self.slit(float(center), float(width))
            _check_cover(slit, fine)
            columns.append(photon_integral(sensor.curve, fine.lower, fine.upper, slit))
        weights = np.stack(columns, axis=1)
        if np.any(weights.sum(0) <= 0):
            raise InputError("sensor.curve", sensor.curve.name, "above 0 somewhere in every slit")
        return weights


def pinholes(size: tuple[int, int], pitch: int) -> np.ndarray:
    """Return (1, M, N) uint8 with one open mirror in the middle of every block of ``pitch`` x ``pitch`` mirrors."""
    if pitch < 1:
        raise InputError("pitch", pitch, "at least 1 mirror")
    mask = np.zeros((1, *size), np.uint8)
    mask[0, pitch // 2 :: pitch, pitch // 2 :: pitch] = 1
    return mask


def calibration_images(
    monochromator: Monochromator,
    centers_nm: Sequence[float],
    bands: Bands,
    camera: CameraConfig,
    mask: np.ndarray,
    exposure: Exposure | None = None,
    sensor: Mono | None = None,
) -> tuple[xr.Dataset, ...]:
    """Photograph a white target through the whole camera at each wavelength: spots where the prism lays the mask's openings.

    Args:
        monochromator: with a bandwidth.
        centers_nm: of the steps, above 0 nm.
        bands: of the camera's discrete model; each is cut into 10, out to the band-pass's edges.
        camera: the camera to be calibrated.
        mask: (1, M, N), e.g. of :func:`pinholes`.
        exposure: as for ``photograph``.
        sensor: Mono() when None.

    Raises:
        InputError: as ``photograph``; ``cube`` when a slit reaches beyond the band-pass and the bands.
    """
    fine = bands.subdivide(10, cover=(camera.bandpass.lower_nm, camera.bandpass.upper_nm))
    size = (2 * mask.shape[1], 2 * mask.shape[2])
    return tuple(
        photograph(monochromator.white(center, fine, size), bands, camera, Mono() if sensor is None else sensor, mask, exposure)
        for center in centers_nm
    )


def _check_cover(slit: Spectrum, fine: Bands) -> None:
    low, high = slit.range_nm
    if low < fine.lower[0] - 1e-6 or high > fine.upper[-1] + 1e-6:
        raise InputError(
            "cube", f"{fine.lower[0]:g}-{fine.upper[-1]:g} nm", f"covering {low:g}-{high:g} nm, what the {slit.name} lets pass"
        )


def _recorded(images: np.ndarray, noise: Noise, full_well_e: float, fill: float, seed: int) -> np.ndarray:
    """Expose each step to the same fill, read it and divide by gain and exposure; steps without light stay 0 in the mean."""
    if not 0 < fill <= 1:
        raise InputError("fill", fill, "in (0, 1]")
    brightest = images.max((0, 1))
    scale = np.where(brightest > 0, fill * full_well_e / np.where(brightest > 0, brightest, 1.0), 1.0)
    mean = np.moveaxis(images * scale, -1, 0)[:, None]
    read = expose(mean, noise, full_well_e=full_well_e, exposure_s=0.0, seed=seed)
    return np.asarray(np.moveaxis((read.dn[:, 0] - read.dark_dn) / read.gain, 0, -1) / scale)
