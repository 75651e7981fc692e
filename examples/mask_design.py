"""Masks designed by gradient, compared with random ones on scenes and seeds that the design never saw.

    python examples/mask_design.py

Three shots of a monochrome camera. From masks that are balanced over the shots (every mirror open in one or two of three),
every mirror is moved along the derivative of the expected error of the best linear estimate (a Gaussian prior in the
reconstruction's own basis, learned from two training scenes), then made binary. Bernoulli(0.5), the balanced and the designed
masks photograph two other scenes, and the project's solvers invert the frames: basis pursuit for noise-free data of the
band model, ADMM for noisy photographs of the traced camera. Draws mask_design.png and prints the gains over Bernoulli(0.5)
in dB with their 95 % intervals, whatever their sign.
Set OPTSIM_QUICK=1 for 16 x 16 mirrors and two seeds.
"""

import os

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

from optsim.camera import CameraConfig, Distinct, Exposure, Mono, Noise, band_model_of, masks_for, photograph, physical_model, signal_of
from optsim.camera.design import ExpectedError, GaussianPrior, MaskDesign
from optsim.camera.patterns import Stratified
from optsim.cube import Bands, band_mean, block_mean
from optsim.render import RenderSettings, render
from recon import Admm, reconstruct
from recon.metrics import psnr
from recon.tau import AutoTau, tau_max
from scenes import scene_by_name

quick = bool(os.environ.get("OPTSIM_QUICK"))
size, shots = (16 if quick else 32), 3
seeds = (2001, 2002) if quick else (2001, 2002, 2003, 2004, 2005)  # settings were chosen with others (0, 1, 1001 to 1005)
training, held_out = ("color-checker", "color-checker-bars"), ("relief", "glass")
bands, sensor, camera = Bands.paper(), Mono(), CameraConfig().ideal()
fine_bands = bands.subdivide(10, cover=(camera.bandpass.lower_nm, camera.bandpass.upper_nm))
design = MaskDesign(steps=30 if quick else 60)


def fine(name: str):
    return render(scene_by_name(name).build(), fine_bands, (size, size), RenderSettings(oversample=2, error=0.03))


def exposed(masks: np.ndarray, cube, seed: int):
    frames = photograph(cube, bands, camera, sensor, masks, Exposure(noise=Noise(), seed=seed))
    return band_model_of(frames).operator("float32"), signal_of(frames)


def bernoulli(seed: int) -> np.ndarray:
    return masks_for(sensor, shots, Distinct(), (size, size), seed)


def balanced(seed: int) -> np.ndarray:
    return masks_for(sensor, shots, Distinct(), (size, size), seed, pattern=Stratified())


def scores(masks: np.ndarray, name: str, seed: int) -> tuple[float, float]:
    """Return PSNR in dB of noise-free matched data by basis pursuit, and of a noisy photograph by ADMM."""
    operator = physical_model(camera, sensor, bands, masks).operator("float32")
    clean = reconstruct(operator, operator.forward(truth[name].astype(np.float32)))
    operator, signal = exposed(masks, cubes[name], seed)
    noisy = reconstruct(operator, signal, tau=tau_fraction * tau_max(operator, signal), solver=Admm())
    return psnr(clean.cube, truth[name]), psnr(noisy.cube, truth[name])


cubes = {name: fine(name) for name in (*training, *held_out)}
truth = {name: band_mean(block_mean(cube, 2), bands)["radiance"].values.astype(float) for name, cube in cubes.items()}
prior = GaussianPrior.learned([truth[name] for name in training])
fractions = [AutoTau().choose(*exposed(bernoulli(0), cubes[name], 0)).fraction for name in training]
tau_fraction = float(np.exp(np.mean(np.log(fractions))))
print(f"{size} x {size} mirrors, {shots} shots, {bands.count} bands; tau = {tau_fraction:.1e} of tau_max, from the training scenes alone.")

results = np.zeros((len(seeds), len(held_out), 3, 2))  # seed, scene, (Bernoulli, balanced, designed), (noise-free, noisy)
for i, seed in enumerate(seeds):
    random, start = bernoulli(seed), balanced(seed)
    objective = ExpectedError(physical_model(camera, sensor, bands, start).operator(np.float64), prior)
    found = design.run(objective, start, seed)
    for j, name in enumerate(held_out):
        results[i, j] = [scores(masks, name, seed) for masks in (random, start, found.masks)]
    expected = [objective.estimate(masks, np.random.default_rng(seed), 8).value for masks in (random, found.masks)]
    fall = 10 * np.log10(expected[0] / expected[1])
    print(
        f"seed {seed}: expected error {fall:.2f} dB below Bernoulli's; {found.masks.mean():.1%} of the mirrors open ({random.mean():.1%})"
    )


np.save("designed_masks.npy", found.masks)  # optsim.camera.patterns.FromFile reads it


def interval(gain: np.ndarray) -> tuple[float, float]:
    """Return the mean over seeds and the half width of its 95 % interval (Student)."""
    spread = stats.t.ppf(0.975, len(gain) - 1) * gain.std(ddof=1) / np.sqrt(len(gain))
    return float(gain.mean()), float(spread)


comparisons = {"balanced - Bernoulli": (1, 0), "designed - Bernoulli": (2, 0), "designed - balanced": (2, 1)}
data = ("noise-free, basis pursuit", "noisy photograph, ADMM")
for d, what in enumerate(data):
    for label, (one, other) in comparisons.items():
        gain = results[:, :, one, d] - results[:, :, other, d]
        mean, half = interval(gain.mean(1))
        verdict = "a gain" if mean > half else "a loss" if mean < -half else "no difference that these seeds show"
        scenes = ", ".join("{} {:+.2f} +- {:.2f}".format(name, *interval(gain[:, j])) for j, name in enumerate(held_out))
        print(f"{what}: {label} = {mean:+.2f} +- {half:.2f} dB, {verdict} ({scenes})")
    print(f"    Bernoulli reaches {', '.join(f'{results[:, j, 0, d].mean():.2f} dB on {name}' for j, name in enumerate(held_out))}")
print(f"The intervals are over {len(seeds)} held-out seeds; {len(held_out)} held-out scenes say little of other scenes.")

figure, axes = plt.subplots(1, 4, figsize=(15, 3.9), layout="constrained")
for ax, masks, title in ((axes[0], random, "Bernoulli(0.5)"), (axes[1], found.masks, "designed")):
    picture = ax.imshow(masks.sum(0), cmap="viridis", vmin=0, vmax=shots)
    ax.set(title=title, xlabel="mirror", ylabel="mirror")
figure.colorbar(picture, ax=axes[1], label=f"open in how many of {shots} shots", ticks=range(shots + 1))
axes[2].semilogy(found.errors)
axes[2].set(xlabel="step", ylabel="expected error / energy", title=f"design, seed {seeds[-1]} (gray masks)")
for d, kind in np.ndindex(2, 2):
    place, points = 2.5 * d + kind, results[:, :, kind + 1, d] - results[:, :, 0, d]
    for j, name in enumerate(held_out):
        label = name if d == kind == 0 else None
        axes[3].plot(np.full(len(seeds), place) + 0.15 * (j - 0.5), points[:, j], "os"[j], color=f"C{kind}", alpha=0.5, ms=4, label=label)
    mean, half = interval(points.mean(1))
    axes[3].errorbar(place, mean, half, fmt="_k", capsize=6, ms=14)
axes[3].legend(fontsize=8)
axes[3].axhline(0, color="0.5", lw=0.8)
axes[3].set_xticks([0, 1, 2.5, 3.5], ["balanced", "designed"] * 2, rotation=20)
axes[3].set(ylabel="gain over Bernoulli / dB", title="held-out scenes and seeds\nnoise-free | noisy photograph")
figure.savefig("mask_design.png", dpi=120)
