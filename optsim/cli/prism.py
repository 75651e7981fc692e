"""The verb prism: what the dispersing prism of a camera does to the spectrum."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from optsim.cli.words import Json, print_json
from optsim.errors import InputError


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
