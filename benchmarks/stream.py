"""A cube beyond memory: render to disk and tell the peak memory, as a share of the cube and of 4 GiB.

    python -m benchmarks.stream [--size 2048] [--bands 240] [--spp 1] [--scene color-checker] [--limit 4] [--folder DIR] [--json]

The address space of the process is limited as well (RLIMIT_DATA), so that a render that needed more would fail. Seconds are told for
orientation only.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from optsim.cube import Bands
from optsim.files import NetcdfSink
from optsim.render import RenderSettings, render_to
from scenes.catalogue import scene_by_name


def main() -> None:
    """Render, and print one line or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=2048, help="picture side in pixels")
    parser.add_argument("--bands", type=int, default=240)
    parser.add_argument("--spp", type=int, default=1, help="samples a pixel; 0: to the default error")
    parser.add_argument("--scene", default="color-checker")
    parser.add_argument("--limit", type=float, default=4.0, help="GiB of memory that the process may take")
    parser.add_argument("--folder", type=Path, default=None, help="where the file is written, and removed again")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    limit = int(chosen.limit * 2**30)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    bands = Bands.from_edges(np.linspace(450, 670, chosen.bands + 1))
    settings = RenderSettings(samples_per_pixel=chosen.spp) if chosen.spp else RenderSettings()
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        file = Path(folder) / "cube.nc"
        render_to(NetcdfSink(file), scene_by_name(chosen.scene).build(), bands, (chosen.size, chosen.size), settings)
        size = file.stat().st_size / 2**30
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    found = {"size": chosen.size, "bands": chosen.bands, "samples": chosen.spp, "file_gib": size, "peak_gib": peak}
    found |= {"seconds": time.perf_counter() - start, "limit_gib": chosen.limit, "met": bool(peak < chosen.limit)}
    if chosen.json:
        print(json.dumps(found))
        return
    what = f"{chosen.scene} {chosen.size} x {chosen.size} x {chosen.bands} at {chosen.spp} sample(s) a pixel"
    print(f"{what}: file {size:.2f} GiB, peak memory {peak:.2f} GiB (limit {chosen.limit:g} GiB), {found['seconds']:.0f} s")


if __name__ == "__main__":
    main()
