"""What a matched simulation hides: data of the traced prism, inverted with two ideas of where the bands fall.

    python examples/what_matched_hides.py

The same physical frames (sub-pixel shifts, smile, finite bands) are inverted with shifts of exactly one pixel a band,
as most simulations assume, and with the camera's own columns; both are compared with matched data. No H explains physical
data exactly, so all are inverted by ADMM with a tau found from held-out pixels.
Set OPTSIM_QUICK=1 for 32 x 32 mirrors.
"""

import os

from optsim.camera import CameraConfig, Distinct, Mono, band_model_of, masks_for, measure_matched, photograph, signal_of, with_unit_shifts
from optsim.cube import Bands, band_mean, block_mean
from optsim.render import RenderSettings, render
from recon import Admm, reconstruct
from recon.metrics import psnr
from recon.tau import AutoTau
from scenes import scene_by_name

size = 32 if os.environ.get("OPTSIM_QUICK") else 128
bands, camera, sensor = Bands.paper(), CameraConfig().ideal(), Mono()
fine_bands = bands.subdivide(10, cover=(camera.bandpass.lower_nm, camera.bandpass.upper_nm))
fine = render(scene_by_name("color-checker").build(), fine_bands, (size, size), RenderSettings(oversample=2, error=0.01))
truth = band_mean(block_mean(fine, 2), bands)
masks = masks_for(sensor, 3, Distinct(), (size, size), seed=1)

physical = photograph(fine, bands, camera, sensor, masks)
cases = {
    "matched data, matched H": measure_matched(truth, sensor, masks),
    "physical data, unit-shift H": with_unit_shifts(physical),
    "physical data, the camera's own H": physical,
}
for name, frames in cases.items():
    operator, signal = band_model_of(frames).operator("float32"), signal_of(frames)
    tau = AutoTau().choose(operator, signal).tau
    solution = reconstruct(operator, signal, tau=tau, solver=Admm())
    print(f"{name:35s} {psnr(solution.cube, truth['radiance'].values):6.2f} dB, data misfit {solution.residual:.1e}")
