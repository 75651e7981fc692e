"""How much light a sensor may have decides which one wins: six budgets, from 50 to 50,000 electrons.

    python examples/light_budgets.py

Photographs the colour checker with the traced prism, shot noise, read noise of 10 electrons and 16 bits over a well of
200,000, under the budgets A to F; inverts every measurement the same way, as smooth as its noise allows; prints the scores
and draws light_budgets.png. "Light" is the charge of the brightest pixel of one monochrome shot of a colour shot's exposure.
The efficiencies are assumed (mono and Bayer 0.5 at their peaks, the Foveon's layers together 0.6); the last table sweeps
those of the colour sensors by 30 per cent.
Set OPTSIM_QUICK=1 for 16 x 16 mirrors and two levels.
"""

import os
from functools import cache

import matplotlib.pyplot as plt
import numpy as np

from optsim.camera import CameraConfig, Exposure, Noise, band_model_of, masks_for, photograph, signal_of
from optsim.camera.absolute import AssumedEfficiencies
from optsim.camera.amplification import noise_amplification
from optsim.camera.budgets import EqualMasks, PaperRatio, budgets
from optsim.cube import Bands, band_mean, block_mean
from optsim.render import RenderSettings, render
from recon import Admm, reconstruct
from recon.metrics import psnr
from recon.tau import tau_max
from scenes import scene_by_name
from scenes.library import illuminant

quick = bool(os.environ.get("OPTSIM_QUICK"))
size, levels = (16, (500, 50_000)) if quick else (32, (50, 500, 5000, 50_000))
ideal = CameraConfig().ideal()
camera = ideal.model_copy(update={"sensor": ideal.sensor.model_copy(update={"full_well_e": 200_000.0})})
bands, noise = Bands.paper(), Noise(read_noise_e=10.0, bits=16)
fine_bands = bands.subdivide(10, cover=(camera.bandpass.lower_nm, camera.bandpass.upper_nm))
fine = render(scene_by_name("color-checker").build(), fine_bands, (size, size), RenderSettings(oversample=2, error=0.03))
truth = band_mean(block_mean(fine, 2), bands)["radiance"].values
sensors = dict(zip(("mono", "bayer", "foveon"), AssumedEfficiencies().sensors()))
fractions = 10 ** np.arange(-0.5, -4.01, -1.0 if quick else -0.25)


@cache
def means(name, sensor, shots, masks):
    """Return the frames of one second, without noise."""
    return photograph(fine, bands, camera, sensor, masks_for(sensor, shots, masks, (size, size), seed=1), Exposure(time_s=1.0))


second = float(means("mono", sensors["mono"], 1, EqualMasks().plan(sensors["mono"], 1, 1.0).rule)["frames"].max())


@cache
def score(name, sensor, shots, masks, time_s):
    """Return the PSNR in dB of one plan's reconstruction."""
    drawn = masks_for(sensor, shots, masks, (size, size), seed=1)
    frames = photograph(fine, bands, camera, sensor, drawn, Exposure(time_s=time_s, noise=noise, seed=7))
    return psnr(smoothest(band_model_of(frames).operator("float32"), signal_of(frames), frames.attrs["gain"]), truth)


def smoothest(operator, signal, gain):
    """Return the cube of the largest tau that leaves no more than the expected noise unexplained (discrepancy principle)."""
    expected = gain * signal.sum() + signal.size * ((gain * noise.read_noise_e) ** 2 + 1 / 12)
    largest, cube = tau_max(operator, signal), None
    for fraction in fractions:
        cube = reconstruct(operator, signal, tau=fraction * largest, solver=Admm(), start=cube).cube
        if ((signal - operator.forward(cube)) ** 2).sum() <= expected:
            break
    return cube


def run(budget, name, level, sensor):
    """Return the score of a sensor under a budget; D exposes every sensor's brightest pixel to the level itself."""
    plan = budget.plan(sensor, 1, level / second)
    time_s = plan.exposure_s or level / float(means(name, sensor, plan.shots, plan.rule)["frames"].max())
    return plan, score(name, sensor, plan.shots, plan.rule, round(time_s, 12))


print("PSNR in dB; light in electrons:       " + "".join(f"{level:>8d}" for level in levels))
table = {}
for budget in budgets():
    for name, sensor in sensors.items():
        rows = [run(budget, name, level, sensor) for level in levels]
        table[budget.name, name] = [value for _, value in rows]
        shots, light = rows[0][0].shots, rows[0][0].light_s
        note = f"{shots} shot(s)" + ("" if light is None else f", light x {light * second / levels[0]:.2g}")
        print(f"{budget.name:18s} {name:7s} {note:24s}" + "".join(f"{value:8.2f}" for value in table[budget.name, name]))

print("\nNoise of unmixing three colours, against disjoint filters that detect as much (xenon lamp):")
for name in ("bayer", "foveon"):
    values = [noise_amplification(sensors[name], illuminant("xenon"), level, 10.0) for level in levels]
    print(f"  {name:7s} variance x " + ", ".join(f"{v.ratio:.1f} at {level} electrons" for v, level in zip(values, levels)))

level = 500
print(f"\nThe colour sensors' assumed efficiency -30 %, as it is, +30 % (budget B, {level} electrons):")
for name in ("bayer", "foveon"):
    swept = [AssumedEfficiencies().swept(f).sensors()[1 if name == "bayer" else 2] for f in (0.7, 1.0, 1.3)]
    print(f"  {name:7s} " + ", ".join(f"{run(PaperRatio(), name, level, s)[1]:.2f} dB" for s in swept))

winners = {b.name: [max(sensors, key=lambda n: table[b.name, n][i]) for i in range(len(levels))] for b in budgets()}
print("\nBest sensor by budget: " + "; ".join(f"{b}: {', '.join(f'{w} at {x}' for w, x in zip(ws, levels))}" for b, ws in winners.items()))

figure, axes = plt.subplots(2, 3, figsize=(11, 6.5), sharex=True, sharey=True, layout="constrained")
for axis, budget in zip(axes.flat, budgets()):
    for name, colour in zip(sensors, ("0.35", "tab:green", "tab:red")):
        axis.semilogx(levels, table[budget.name, name], "o-", color=colour, label=name)
    axis.set_title(budget.name)
    axis.grid(alpha=0.3)
for axis in axes[1]:
    axis.set_xlabel("light (electrons in mono's brightest pixel)")
for axis in axes[:, 0]:
    axis.set_ylabel("PSNR (dB)")
axes[0, 0].legend()
figure.savefig("light_budgets.png", dpi=110)
print("\nlight_budgets.png drawn")
