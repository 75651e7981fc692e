"""Plug a denoiser of scikit-image into a reconstruction: Chambolle's total variation on the coefficient pictures of learned spectra.

    python examples/plug_and_play.py [--size 64]

Any function denoiser(picture, sigma) -> picture serves in its place.
"""

import argparse

import numpy as np
from skimage.restoration import denoise_tv_chambolle

from optsim.camera import Distinct, band_model_of, masks_for, measure_matched, sensors, signal_of
from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.study.library import learned_basis, quality
from recon import Gap, PlugAndPlay, TotalVariation, reconstruct
from recon.metrics import psnr
from scenes import scene_by_name


def denoiser(picture: np.ndarray, sigma: float) -> np.ndarray:
    """Denoise by total variation, from scratch at every call."""
    return denoise_tv_chambolle(picture, weight=sigma, max_num_iter=30)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--size", type=int, default=64)
    size, bands = (options.parse_args().size,) * 2, Bands.paper()
    truth = render(scene_by_name("color-checker-bars").build(), bands, size, RenderSettings(error=0.005))
    spectral = learned_basis(bands)
    plugged = PlugAndPlay(denoiser=denoiser, spectral=spectral, weights=spectral.weights(bands.count))
    print(f"{'PSNR in dB':10s}{'l1':>10s}{'GAP-TV':>10s}{'plug and play':>15s}{'quality':>10s}")
    for sensor in sensors():
        frames = measure_matched(truth, sensor, masks_for(sensor, sensor.shots_per_group, Distinct(), size, 0))
        operator, signal = band_model_of(frames).operator(np.float32), signal_of(frames)
        found = (
            reconstruct(operator, signal),
            reconstruct(operator, signal, prior=TotalVariation(), solver=Gap()),
            reconstruct(operator, signal, prior=plugged, solver=Gap(start=2, end=0.01, decay=0.85, max_iterations=40)),
            reconstruct(operator, signal, prior=quality(bands)),
        )
        scores = [psnr(solution.cube, truth["radiance"].values) for solution in found]
        print(f"{sensor.name:10s}{scores[0]:10.2f}{scores[1]:10.2f}{scores[2]:15.2f}{scores[3]:10.2f}", flush=True)


if __name__ == "__main__":
    main()
