"""A prism designed for a wanted dispersion: the same number of nanometres on every pixel.

    python examples/prism_design.py

Glass disperses blue light more than red: the default camera's pixels hold 4.5 nm at the blue end and 18.5 nm at the red end.
Here all pairs of the built-in glasses are ranked by the thin-prism formula, and the best are refined by the exact trace
and its derivatives with respect to the tilts of all four faces, under three sets of demands: direct view and a picture to
scale; a picture to scale that may leave at an angle; direct view with a picture that may be stretched along the dispersion.
Draws prism_design.png and prints the first as a camera file.
Set OPTSIM_QUICK=1 to refine fewer pairs.
"""

import itertools
import os

import matplotlib.pyplot as plt
import numpy as np

from optsim.camera import CameraConfig, DoubleAmici, PrismStack, glass, glass_names
from optsim.camera.design import PrismDesign, PrismResult, WantedDispersion

quick = bool(os.environ.get("OPTSIM_QUICK"))
wanted = WantedDispersion.equal(450, 670, pixels=24)
catalogue = [glass(name) for name in glass_names()]
if quick:
    catalogue = [g for g in catalogue if g.name in ("N-KZFS4", "N-BAF10", "N-FK5", "N-PK52A", "F5", "N-BK7")]


def error_px(prism: PrismStack | DoubleAmici) -> np.ndarray:
    """Return how far wavelengths land from where they are wanted, free of a common shift."""
    position = prism.position_px(wanted.wavelength_nm)[0]
    return position - position.mean() - (wanted.position_px - wanted.position_px.mean())


def nm_per_px(prism: PrismStack | DoubleAmici) -> np.ndarray:
    fine = np.linspace(450, 670, 881)
    return np.interp(wanted.wavelength_nm, fine, np.gradient(fine, prism.position_px(fine)[0]))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def tolerance_px(result: PrismResult) -> float:
    """Return the error, rms px, that the worst face costs when it is ground one arc minute off."""
    costs = []
    for face in range(4):
        tilts = np.array(result.face_tilt_rad)
        tilts[face] += np.radians(1 / 60)
        off = PrismStack(glasses=result.glasses, face_tilt_rad=tuple(map(float, tilts)))
        costs.append(rms(error_px(off)))
    return max(costs)


def draw(ax: plt.Axes, result: PrismResult, height: float = 1.0) -> None:
    """Draw the wedges in the plane of dispersion, as thin as their faces allow."""
    left = np.array([0.0, 0.0])
    slopes = -np.tan(result.face_tilt_rad)
    for wedge, (before, after) in enumerate(itertools.pairwise(slopes)):
        right = left + 0.05 + max(0.0, float(np.max(np.array([-1, 1]) * height * (before - after))))
        corners = [(left[0] + before * y, y) for y in (-height, height)] + [(right[0] + after * y, y) for y in (height, -height)]
        ax.fill(*zip(*corners), alpha=0.5, ec="k")
        ax.text(*np.mean(corners, 0), result.glasses[wedge].name, ha="center", va="center", fontsize=7)
        left = right
    ax.set(aspect="equal", xlabel="along the axis", ylabel="along the dispersion", title="direct view, to scale")


def stretch(prism: PrismStack | DoubleAmici) -> float:
    """Return the picture's magnification along the dispersion over that of the lenses."""
    x = prism.position_px(550.0, np.array([-0.01, 0.01]))[0]
    return float((x[1] - x[0]) / 0.02 / prism.magnification_px)


default = DoubleAmici.default()
count = 4 if quick else 40
cases = {
    "direct view, to scale": PrismDesign(refine=count),
    "to scale, may leave at an angle": PrismDesign(refine=count, per_degree_px=0.02),
    "direct view, may stretch": PrismDesign(refine=count, field_mm=0.0),
}
best = {name: design.run(wanted, catalogue)[0] for name, design in cases.items()}
print(f"Wanted: {wanted.nm_per_px[0]:.3f} nm on each of {wanted.pixels:.0f} pixels, 450 to 670 nm; catalogue of {len(catalogue)} glasses.")
print(f"The default camera's prism misses it by {rms(error_px(default)):.3f} px rms, {np.abs(error_px(default)).max():.3f} px at worst.")
for name, r in best.items():
    prism = r.stack()
    passed = prism.transmission(np.array([450.0, 550.0, 670.0]))
    smile = prism.position_px(550.0, 0.0, 1.75)[0] - prism.position_px(550.0)[0]
    print(f"{name}: {' / '.join(g.name for g in r.glasses)}, tilts {np.degrees(r.face_tilt_rad).round(2)} deg")
    print(f"    {r.axis_rms_px:.3f} px rms on the axis, {r.rms_px:.3f} over what was demanded (the thin angles gave {r.start_rms_px:.2f});")
    print(f"    550 nm leaves at {r.deviation_deg:+.2f} deg; picture x {stretch(prism):.3f} along the dispersion;", end=" ")
    print(f"smile {smile:+.2f} px at 1.75 mm; faces pass {passed.min():.0%} to {passed.max():.0%};")
    print(f"    one arc minute of error on the worst face: {tolerance_px(r):.3f} px rms on the axis.")
winner = best["direct view, to scale"]
CameraConfig.parse_toml(winner.to_toml())  # it is a camera
print(winner.to_toml())

figure, axes = plt.subplots(1, 3, figsize=(14, 4), layout="constrained", width_ratios=(2, 2, 1.4))
lines = {"default camera": default} | {name: r.stack() for name, r in best.items()}
for name, prism in lines.items():
    axes[0].plot(wanted.wavelength_nm, nm_per_px(prism), label=name)
    axes[1].plot(wanted.wavelength_nm, error_px(prism), label=name)
axes[0].plot(wanted.wavelength_nm, wanted.nm_per_px, "k--", label="wanted")
axes[0].set(xlabel="wavelength / nm", ylabel="nm per pixel", ylim=(0, None), title="dispersion")
axes[1].set(xlabel="wavelength / nm", ylabel="error of the position / px", title="distance from where it is wanted")
axes[0].legend(fontsize=8)
draw(axes[2], winner)
figure.savefig("prism_design.png", dpi=120)
