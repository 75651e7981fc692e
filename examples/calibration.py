"""Calibrate a camera that strays from its drawing, and see what that is worth to a reconstruction.

A camera is built at random within its tolerances; 24 x 9 monochromatic spots of it are measured to 0.1 px. The fit gives
registration and dispersion curve with errors (calibration.png). Then the built camera photographs a textured scene, and
four discrete models reconstruct it: the drawing, the drawing with the fitted registration, the calibrated one, and the
true one. A sweep of the centroids' error shows when curve and registration are known well enough (calibration_sweep.png).

    python examples/calibration.py

OPTSIM_QUICK=1 takes a smaller picture and fewer points.
"""

import os
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from optsim.camera import Assumed, CameraConfig, Exact, Exposure, Mono, masks_for, photograph, physical_model, signal_of
from optsim.camera.calibrate import calibrate, plot_calibration, simulate_spots
from optsim.camera.dmd import Distinct
from optsim.camera.stack import DESIGN_NM
from optsim.cube import Bands, band_mean, block_mean
from optsim.study.fine_scene import TexturedField
from optsim.study.judge import FEW_FRACTIONS, judge

QUICK = os.environ.get("OPTSIM_QUICK") == "1"
SIZE = (16, 16) if QUICK else (32, 32)
SHOTS = 6
SEED = 5
NOISES = (0.03, 0.3) if QUICK else (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
NM = np.linspace(452, 668, 24)


def reconstruct_with_each_model(drawing: CameraConfig, built: CameraConfig, knowledge: Assumed) -> dict[str, float]:
    """Return the PSNR in dB that each model of the built camera reaches."""
    bands, sensor = Bands.paper(), Mono()
    fine = bands.subdivide(10, cover=(built.bandpass.lower_nm, built.bandpass.upper_nm))
    cube = TexturedField().cube(fine, SIZE, 2)
    truth = band_mean(block_mean(cube, 2), bands)["radiance"].values
    masks = masks_for(sensor, SHOTS, Distinct(), SIZE, seed=1)
    exposure_s = 1.0
    signal = signal_of(photograph(cube, bands, built, sensor, masks, Exposure(time_s=exposure_s)))
    offset = float(knowledge.dispersion.position_px(DESIGN_NM)[0] - drawing.dispersion.position_px(DESIGN_NM)[0])
    registered = replace(knowledge, dispersion=None, offset_x_px=offset)
    models = {
        "drawing": (drawing, None),
        "drawing, registered": (drawing, registered),
        "calibrated": (drawing, knowledge),
        "true": (built, Exact()),
    }
    scores = {}
    for name, (camera, known) in models.items():
        model = physical_model(camera, sensor, bands, masks, known, exposure_s)
        seen = np.zeros((*signal.shape[:3], model.width))
        width = min(model.width, signal.shape[3])
        seen[..., :width] = signal[..., :width]
        scores[name] = judge(model.operator(), seen, truth, fractions=FEW_FRACTIONS, by_gradients=True).psnr_db
    return scores


def sweep(drawing: CameraConfig) -> None:
    """Draw how well curve, offset and rotation are known against the centroids' error, and the error really made."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    axes, count = figure.subplots(1, 2)
    stated, made, apart = [], [], []
    for noise in NOISES:
        simulated = simulate_spots(drawing, noise, seed=SEED)
        found = calibrate(drawing, simulated.spots)
        curve, true = found.curve(NM), simulated.truth.position_px(NM)[0]
        stated.append(np.sqrt(np.mean(curve.sigma_x_px**2)))
        made.append(np.sqrt(np.mean((curve.x_px - true) ** 2)))
        apart.append(int(found.split.told_apart.sum()))
    axes.loglog(NOISES, stated, color="black", lw=1.2, label="standard error stated")
    axes.loglog(NOISES, made, "o", color="tab:red", ms=4, label="error made (one camera each)")
    axes.set(xlabel="error of a centroid (px)", ylabel="curve, rms (px)", title=f"{simulated.spots.count} spots")
    axes.legend(frameon=False)
    count.semilogx(NOISES, apart, "o-", color="black", ms=4, lw=1)
    count.set(
        xlabel="error of a centroid (px)", ylabel="combinations", title=f"Told apart, of {len(found.model.parameters)}", ylim=(0, None)
    )
    figure.savefig("calibration_sweep.png", dpi=150)


def main() -> None:
    drawing = CameraConfig().ideal()
    simulated = simulate_spots(drawing, noise_px=0.1, seed=SEED)
    found = calibrate(drawing, simulated.spots)
    plot_calibration(found, "calibration.png", simulated.truth)
    curve, true = found.curve(NM), simulated.truth.position_px(NM)[0]
    drawn = drawing.dispersion.position_px(NM)[0]
    print(f"{found.spots.count} spots to 0.1 px; misfit {found.rms_px:.3f} px rms, p = {found.p_value:.2f}")
    print(f"curve: drawing off by {np.abs(drawn - true).max():.2f} px, calibrated by {np.abs(curve.x_px - true).max():.3f} px")
    print(f"       (stated error {curve.sigma_x_px.min():.3f} - {curve.sigma_x_px.max():.3f} px)")
    for row in found.parameters():
        if row["name"] in ("offset_x_px", "offset_y_px", "rotation_deg", "scale"):
            print(f"{row['name']:14s} {row['fitted']:+9.4f} +- {row['sigma']:.4f} {row['unit']}")
    hidden = [row for row in found.split.describe() if not row["told_apart"]]
    print(f"{len(hidden)} combinations of parameters are no better known than from the drawing, e.g. {hidden[0]['parts']}")
    scores = reconstruct_with_each_model(drawing, simulated.truth.camera, found.knowledge)
    print("PSNR by the model that reconstructs: " + ", ".join(f"{name} {value:.2f} dB" for name, value in scores.items()))
    gain, left = scores["calibrated"] - scores["drawing"], scores["true"] - scores["calibrated"]
    curve_gain = scores["calibrated"] - scores["drawing, registered"]
    print(f"calibrating is worth {gain:+.2f} dB here, {curve_gain:+.2f} dB of it by the curve; the exact camera would add {left:+.2f} dB")
    sweep(drawing)
    print("calibration.png and calibration_sweep.png show the fit and what better centroids bring")


if __name__ == "__main__":
    main()
