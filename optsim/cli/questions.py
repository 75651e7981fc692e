"""Verbs that answer a question: prism, explain, doctor, scenes, show."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from optsim.cli.words import find_scene, print_json
from optsim.errors import InputError

Json = Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative="")]


def prism(
    *,
    json: Json = False,
    plot: Annotated[
        Path | None, Parameter(help="Draw dispersion, nm per pixel and residual to the paper's table (PNG, PDF or SVG).")
    ] = None,
) -> None:
    """Tell the dispersion of the default camera: where light lands, nm per pixel, band centres and edges."""
    from optsim.camera import plot_prism, prism_report

    if plot is not None and plot.suffix not in (".png", ".pdf", ".svg"):
        raise InputError("--plot", str(plot), "a file path that ends in .png, .pdf or .svg")
    report = prism_report()
    if plot is not None:
        plot_prism(report, plot)
        print(f"{plot}: dispersion of the default prism", file=sys.stderr)
    if json:
        print_json(report)
        return
    edges = report["band_edge_nm"]
    print("band   centre nm   edges nm            width nm   centre - paper's nm")
    for k, (center, residual) in enumerate(zip(report["band_center_nm"], report["residual_to_paper_nm"])):
        print(f"{k:4d}   {center:9.2f}   {edges[k]:7.2f} - {edges[k + 1]:7.2f}   {edges[k + 1] - edges[k]:8.2f}   {residual:+8.2f}")


def explain(
    scene: Annotated[str, Parameter(help="Name of a scene, or a scene file.")],
    /,
    *,
    error: Annotated[float, Parameter(help="Relative error that the render should meet.")] = 0.01,
    json: Json = False,
) -> None:
    """Tell which physical effects a scene requires, each on or off with its reason and the error of leaving it out."""
    from optsim.render.needs import explain as needs_of

    needs = needs_of(find_scene(scene), error)
    if json:
        print_json(needs.as_dict())
        return
    print(f"{needs.scene}, to a relative error of {error:g}")
    for effect in needs.effects:
        without = "" if effect.error_without is None else f" (error without it: {effect.error_without:.2g})"
        print(f"  {'on ' if effect.on else 'off'}  {effect.name:20s} {effect.reason}{without}")


def doctor(*, json: Json = False) -> None:
    """Check this machine by rendering a real scene in a child process: backend, LLVM, cores, memory, versions."""
    from optsim.render.backend import doctor as examine

    report: dict[str, Any] = examine()
    if json:
        print_json(report)
    else:
        print(f"variant       {report['variant']}")
        print(f"render        {'works' if report['render_ok'] else 'FAILS'}")
        print(f"LLVM          {report['llvm_version'] or 'none'}   {report['llvm_path'] or ''}")
        print(f"cores         {report['cores']}")
        print(f"memory        {report['memory_gib']:.1f} GiB")
        for name, version in report["versions"].items():
            print(f"{name:13s} {version}")
        for name in sorted(set(report) - {"variant", "render_ok", "llvm_path", "llvm_version", "cores", "memory_gib", "versions"}):
            print(f"{name:13s} {report[name]}")
    if not report["render_ok"]:
        raise SystemExit(1)


def scenes(*, json: Json = False) -> None:
    """List what can be rendered."""
    from scenes import SCENES

    entries: dict[str, str] = {recipe.name: recipe.build().description for recipe in SCENES}
    if json:
        print_json(entries)
        return
    for name, description in entries.items():
        print(f"{name:22s} {description}")


def show(
    file: Annotated[Path, Parameter(help="Cube, frames or estimate.")],
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], help="PNG to write; FILE with .png when absent.")] = None,
) -> None:
    """Draw a cube, frames or an estimate: sRGB, a few bands, spectra of points; as a PNG."""
    from optsim.files import read
    from optsim.report.show import show as draw

    target = file.with_suffix(".png") if output is None else output
    if target.suffix != ".png":
        raise InputError("-o", str(target), "a file path that ends in .png")
    draw(read(file), target)
    print(target)
