"""Reconstruct a measurement that optsim's camera did not make: a mask, a frame and the shifts, 2 px a band as in the KAIST / TSA set-up."""

import numpy as np

from recon import L1, CodedAperture, Quality, reconstruct, shift_taps
from recon.metrics import psnr

rng, y, x, band = np.random.default_rng(0), *np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 64), np.arange(28), indexing="ij")
truth = np.exp(-8 * (x - 0.3) ** 2 - 8 * (y - 0.6) ** 2) * np.sin(0.2 * band + 3 * x) ** 2 + (x > 0.6) * np.exp(-((band - 9) ** 2) / 40)
mask = rng.random((64, 64)) < 0.5
frame = np.zeros((64, 64 + 2 * 27))
for k in range(28):
    frame[:, 2 * k : 2 * k + 64] += mask * truth[:, :, k]  # somebody else's camera

shifts = 2.0 * np.arange(28)  # of any sign and fraction: shift_taps divides the light between two columns
operator = CodedAperture(mask[None], np.ones((1, 28)), *shift_taps(shifts), width=frame.shape[1])
for prior in (L1(), Quality()):  # the paper's sparsity, and the best there is here
    solution = reconstruct(operator, frame[None, None], prior=prior)
    print(f"{type(prior).__name__:8s}{psnr(solution.cube, truth):5.1f} dB from one frame; {solution.stop}")
