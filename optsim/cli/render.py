"""The verb render: from a scene to a cube."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from optsim.cli.words import PAPER, Force, Output, Without, find_scene, physics_named, progress_bar, wrote
from optsim.errors import InputError

STREAMED_VALUES = 2**28
"""Cubes of at least so many values (1 GiB) go to their netCDF file part by part; called again, an interrupted render goes on there."""

TRUST = (
    "given with --trust-mitsuba-scene: Mitsuba's XML may load any plugin and read any file of yours, so optsim opens only what you "
    "vouch for; a scene of optsim's own (.toml, .json) can do neither"
)


def render(
    scene: Annotated[str, Parameter(help="Name of a scene (`optsim scenes` lists them) or a scene file (.toml, .json).")],
    /,
    *,
    output: Output,
    size: Annotated[int, Parameter(help="Mirrors along each side of the square picture.")] = 256,
    bands: Annotated[str, Parameter(help="`paper` (24 bands, 452.5-668.5 nm) or START:STOP:COUNT, outer edges in nm.")] = PAPER,
    subdivide: Annotated[
        int, Parameter(help="Parts of every band; `measure --physical` wants 10. With `paper` the cube then spans 450-670 nm.")
    ] = 1,
    oversample: Annotated[int, Parameter(help="Samples along each side of a mirror; `measure --physical` wants 2.")] = 1,
    error: Annotated[float | None, Parameter(help="Relative RMS error per band at which to stop (default 0.01).")] = None,
    spp: Annotated[int | None, Parameter(help="Paths a pixel, in place of an error.")] = None,
    max_samples: Annotated[int | None, Parameter(help="Give up on the error here, in paths a pixel (default 65536).")] = None,
    force: Force = None,
    without: Without = None,
    seed: Annotated[int, Parameter(help="0 to 4294967295; the same seed gives the same bytes.")] = 0,
    trust_mitsuba_scene: Annotated[
        bool, Parameter(help="SCENE is a Mitsuba XML file that you trust: it may load any plugin and read any file.", negative="")
    ] = False,
) -> None:
    """Render a scene to a cube of spectral radiance in W m^-2 sr^-1 nm^-1, with its Monte Carlo standard error."""
    from optsim.cube import Bands
    from optsim.files import NetcdfSink, writable, write
    from optsim.render import RenderSettings, render_to
    from optsim.render import render as render_scene

    writable(output)
    limit = {} if max_samples is None else {"max_samples": max_samples}
    choices = {"force": physics_named("--force", force or ()), "without": physics_named("--without", without or ())}
    settings = RenderSettings(oversample=oversample, error=error, samples_per_pixel=spp, seed=seed, **limit, **choices)
    table = Bands.parse(bands)
    if subdivide != 1:
        from optsim.camera import CameraConfig

        passes = CameraConfig().bandpass
        table = table.subdivide(subdivide, (passes.lower_nm, passes.upper_nm) if bands.strip() == PAPER else None)
    raw = scene.endswith(".xml")
    if raw != trust_mitsuba_scene:
        raise InputError("SCENE", scene, TRUST if raw else "a Mitsuba .xml file with --trust-mitsuba-scene")
    chosen = None if raw else find_scene(scene)
    more: dict[str, str | int | float] = {"bands": bands.strip(), "subdivide": subdivide, "oversample": oversample}
    side = size * oversample
    with progress_bar("rendering") as progress:

        def told(share: float, now: float | None) -> None:
            progress(share, "" if now is None else f"error {now:.2g}")

        if chosen is None:
            from optsim.render.trusted import render_trusted

            cube = render_trusted(Path(scene), table, (size, size), settings, told).assign_attrs(more)
            write(cube, output)
            attrs = cube.attrs
        elif output.suffix == ".nc" and side * side * table.count >= STREAMED_VALUES:
            sink = NetcdfSink(output, more)
            try:
                render_to(sink, chosen, table, (size, size), settings, told)
            finally:
                sink.close()
            attrs = sink.attrs
        else:
            cube = render_scene(chosen, table, (size, size), settings, told).assign_attrs(more)
            write(cube, output)
            attrs = cube.attrs
    wrote(output, (side, side, table.count), "(y, x, wavelength)")
    print(achieved(attrs), file=sys.stderr)


def achieved(attrs: Mapping[str, Any]) -> str:
    """Return a sentence about the error that was reached, and effects that were decided by hand."""
    if attrs["samples_per_pixel"] == 0:
        text = f"error {attrs['error']:.2g} at most, without samples"
    elif "error_low" in attrs:
        text = f"error {attrs['error']:.2g} ({attrs['error_low']:.2g} to {attrs['error_high']:.2g} at 95 %) in the worst band"
    else:
        text = "error unknown: one pass only"
    if attrs["samples_per_pixel"]:
        text += f", {attrs['samples_per_pixel']} paths a pixel in {attrs['passes']} passes"
    rows = json.loads(attrs["effects"])
    for word in ("force", "without"):
        names = [name for name, row in rows.items() if row["decided_by"] == word]
        if names:
            text += f"; {'forced' if word == 'force' else 'left out'} by hand: {', '.join(names)}"
    return text
