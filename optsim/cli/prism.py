"""The verb prism: what the dispersing prism of a camera does to the spectrum, and how well it can be known and built."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from optsim.cli.paths import FIGURES, target
from optsim.cli.words import Json, print_json
from optsim.errors import InputError

MANY = 60


def prism(
    *,
    camera: Annotated[Path | None, Parameter(help="Camera file (TOML); the default camera when absent.")] = None,
    at: Annotated[str | None, Parameter(help="Wavelengths in nm, e.g. 450,520,650: where their chief rays land, and nothing else.")] = None,
    draws: Annotated[int, Parameter(help="Prisms built at random within their tolerances.")] = 2000,
    seed: Annotated[int, Parameter(help="Of the prisms built at random.")] = 0,
    cost: Annotated[
        Path | None, Parameter(help="Also measure what nonlinearity and misregistration cost in dB, in this folder (it resumes there).")
    ] = None,
    quick: Annotated[bool, Parameter(help="With --cost: small and under a minute.", negative="")] = False,
    json: Json = False,
    plot: Annotated[Path | None, Parameter(help="Draw curve, nm per pixel, residual, smile, tolerances (PNG, PDF or SVG).")] = None,
) -> None:
    """Study a camera's prism: dispersion, bands, smile, what its numbers do, what tolerances and nonlinearity cost."""
    from optsim.camera import CameraConfig, plot_prism, prism_report
    from optsim.camera.prism_report import chief_rays
    from optsim.camera.prism_study import beam_path, study

    target(plot, "--plot", FIGURES)
    if quick and cost is None:
        raise InputError("--quick", quick, "given with --cost")
    config = CameraConfig() if camera is None else CameraConfig.from_toml(camera)
    path = beam_path(config)
    if at is not None:
        _at(chief_rays(path, _wavelengths(at), config.sensor.pitch_um), json)
        return
    report = prism_report(path, range_nm=(config.bandpass.lower_nm, config.bandpass.upper_nm))
    report.update(study(config, draws, seed))
    if plot is not None:
        plot_prism(report, plot)
        print(f"{plot}: study of the prism", file=sys.stderr)
    if cost is not None:
        report["cost"] = _cost(cost, config, quick)
    if json:
        print_json(report)
        return
    _print(report)


def _wavelengths(text: str) -> list[float]:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError("--at", text, "wavelengths in nm separated by commas, e.g. 450,520,650") from None
    return values


def _at(rays: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(rays)
        return
    print("wavelength nm   from the axis mm          px")
    for nm, mm, px in zip(rays["wavelength_nm"], rays["position_mm"], rays["position_px"]):
        print(f"{nm:13.3f}   " + ("lost in the prism" if mm is None else f"{mm:16.9f}   {px:12.6f}"))


def _cost(folder: Path, camera: Any, quick: bool) -> dict[str, Any]:
    """Run the study of what nonlinearity costs and draw it."""
    from optsim.cube import Bands
    from optsim.report.figures_cost import draw_cost
    from optsim.study.nonlinearity import NonlinearityConfig, run_nonlinearity

    config = NonlinearityConfig.quick() if quick else NonlinearityConfig()
    cost: dict[str, Any] = run_nonlinearity(folder, config, camera, Bands.paper()).as_dict()
    draw_cost(cost, folder / "nonlinearity.png")
    print(f"{folder / 'nonlinearity.png'}: what nonlinearity costs", file=sys.stderr)
    return cost


def _print(report: dict[str, Any]) -> None:
    residual, edges = report["residual_to_paper_nm"], report["band_edge_nm"]
    paper = dict(enumerate(residual)) if report["band_px"][:1] == [0.0] else {}
    print("band   px      centre nm   edges nm            width nm" + ("   centre - paper's nm" if paper else ""))
    for k, (px, center) in enumerate(zip(report["band_px"], report["band_center_nm"])):
        if MANY // 2 <= k < len(report["band_px"]) - MANY // 2:
            if k == MANY // 2:
                print(f" ...   {len(report['band_px']) - MANY // 2 * 2} more; --json lists all")
            continue
        against = f"   {paper[k]:+8.2f}" if k in paper else ""
        print(f"{k:4d}   {px:5.0f}   {center:9.2f}   {edges[k]:7.2f} - {edges[k + 1]:7.2f}   {edges[k + 1] - edges[k]:8.2f}{against}")
    if report["folds"]:
        print("the dispersion turns back: two wavelengths share a place, there are no bands")
    if report["lost_nm"]:
        print(
            f"lost in the prism: {len(report['lost_nm'])} of the wavelengths, from {report['lost_nm'][0]:g} to {report['lost_nm'][-1]:g} nm"
        )
    smile = report["smile"]
    print(f"\nsmile at Y = {smile['Y_mm']:.2f} mm: {_span(smile['smile_px'])} px; keystone {_span(smile['keystone_px'])} px")
    print(f"at X = -{smile['X_mm']:.2f} and +{smile['X_mm']:.2f} mm: {_span(smile['left_px'])} and {_span(smile['right_px'])} px")
    if report["tolerance"] is not None:
        _print_tolerance(report)
    else:
        print("no sensitivities and tolerances: they are told for glass wedges in collimated light")
    if "cost" in report:
        print("\nwhat H believes, and the dB that it costs against exact weights (mean over masks and scenes, 95 % interval)")
        for loss in report["cost"]["losses"]:
            if loss["scene"] is None:
                db = loss["loss_db"]
                interval = "" if db["low"] is None else f" ({db['low']:+.2f} to {db['high']:+.2f})"
                print(f"  {loss['sensor']:8s} {loss['case']:20s} {db['mean']:+6.2f}{interval}")


def _print_tolerance(report: dict[str, Any]) -> None:
    tolerance, slopes, known = report["tolerance"], report["jacobian"], report["identifiability"]
    print("\nnumber                tolerance        shift px   stretch px   bend px   (of the spectrum, per tolerance)")
    for row in zip(*(slopes[key] for key in ("names", "tolerance", "unit", "shift_px", "stretch_px", "bend_px"))):
        name, size, unit, shift, stretch, bend = row
        print(f"{name:20s} {size:9.3g} {unit:4s}  {shift:+10.4f}   {stretch:+10.4f}   {bend:8.5f}")
    print(f"\n{tolerance['draws']} prisms built within tolerances: change of the curve in px rms, median and 97.5 % (95 % interval)")
    for key, label in (("as_built", "as built"), ("aligned", "shifted into place"), ("bent", "and stretched")):
        s = tolerance[f"{key}_rms_px"]
        print(f"  {label:20s} {s['quantile'][1]:8.4f}   {s['quantile'][2]:8.4f} ({s['low'][2]:.4f} - {s['high'][2]:.4f})")
    print(f"\n{known['spots']} spots known to {known['sigma_px']:g} px each cannot tell apart:")
    for row in known["combinations"]:
        if not row["told_apart"]:
            print("  " + "  ".join(f"{share:+.2f} {name}" for name, share in row["parts"].items()))


def _span(values: list[float | None]) -> str:
    some = [v for v in values if v is not None]
    return f"{min(some):+.4f} to {max(some):+.4f}" if some else "lost"
