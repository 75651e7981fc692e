"""The verb calibrate: fit a camera's file to spots of known wavelength."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from optsim.cli.paths import FIGURES, target
from optsim.cli.words import Json, print_json

if TYPE_CHECKING:
    from optsim.camera.calibrate import Calibration


def calibrate(
    spots: Annotated[Path | None, Parameter(help="CSV of measured spots; absent: those of a camera built at random.")] = None,
    /,
    *,
    camera: Annotated[Path | None, Parameter(help="The drawing: a camera file (TOML); the default camera when absent.")] = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], help="Write the fitted camera file (TOML).")] = None,
    noise: Annotated[float, Parameter(help="Standard error of a simulated centroid, px.")] = 0.1,
    seed: Annotated[int, Parameter(help="Of the simulated camera and its spots.")] = 0,
    wavelengths: Annotated[int, Parameter(help="Simulated wavelengths, each at 3 x 3 places of a 256 x 256 field.")] = 24,
    save_spots: Annotated[Path | None, Parameter(help="Write the spots as CSV.")] = None,
    plot: Annotated[Path | None, Parameter(help="Draw curve, misfit and combinations (PNG, PDF or SVG).")] = None,
    json: Json = False,
) -> None:
    """Fit prism, lenses and registration to spots: the curve with its error, and what the spots can't tell apart."""
    from optsim.camera import CameraConfig
    from optsim.camera import calibrate as package

    target(plot, "--plot", FIGURES)
    target(output, "-o", (".toml",), source=camera)
    target(save_spots, "--save-spots", (".csv",), source=spots)
    drawing = CameraConfig() if camera is None else CameraConfig.from_toml(camera)
    truth = None
    if spots is None:
        measured, truth = package.simulate_spots(drawing, noise, seed, wavelengths)
    else:
        measured = package.read_spots(spots)
    found = package.calibrate(drawing, measured)
    if save_spots is not None:
        measured.write(save_spots)
        print(f"{save_spots}: {measured.count} spots", file=sys.stderr)
    if output is not None:
        output.write_text(found.fitted_camera.to_toml(), encoding="utf-8")
        print(f"{output}: the fitted camera", file=sys.stderr)
    if plot is not None:
        package.plot_calibration(found, plot, truth)
        print(f"{plot}: the calibration", file=sys.stderr)
    report = found.as_dict()
    if truth is not None:
        error = found.curve(report["curve"]["wavelength_nm"]).x_px - truth.position_px(report["curve"]["wavelength_nm"])[0]
        report["curve"]["error_px"] = error.tolist()
    if json:
        print_json(report)
        return
    _print(found, report)


def _print(found: Calibration, report: dict[str, Any]) -> None:
    curve = report["curve"]
    print(f"{report['spots']} spots, misfit {report['rms_px']:.3g} px rms, {found.fitted} combinations fitted; {report['stop']}")
    if report["p_value"] is not None:
        print(f"chi2 {report['chi2']:.1f} for {report['degrees_of_freedom']} degrees of freedom (p = {report['p_value']:.2g})")
    print(f"curve known to {min(curve['sigma_px']):.2g} - {max(curve['sigma_px']):.2g} px (one standard error)")
    if "error_px" in curve:
        print(f"true curve missed by at most {max(map(abs, curve['error_px'])):.2g} px")
    print("\nparameter                 drawn       fitted     std error  tolerance  unit")
    for row in report["parameters"]:
        sigma = "held" if row["sigma"] is None else f"{row['sigma']:.3g}"
        mark = "" if row["identifiable"] else "  not better than the drawing"
        print(f"{row['name']:22s} {row['drawn']:10.5g} {row['fitted']:12.6g} {sigma:>11s} {row['tolerance']:10.3g}  {row['unit']:4s}{mark}")
    print("\nthe spots cannot tell apart (combinations no better known than the drawing, in its tolerances):")
    for row in report["combinations"]:
        if not row["told_apart"]:
            parts = "  ".join(f"{share:+.2f} {name}" for name, share in row["parts"].items())
            known = "not at all" if row["std_in_tolerances"] is None else f"to {row['std_in_tolerances']:.3g}"
            print(f"  {known:12s} {parts}")
