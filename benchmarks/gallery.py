"""The gallery of all scenes that come with the program: pictures, what each requires, error and time, into docs/gallery.

    python -m benchmarks.gallery [NAME ...] [--size 256] [--fresh] [--out docs/gallery]

Each scene is rendered by the command that its page shows. What is done is kept in gallery.json: the same call goes on after an
interruption, and renders again only what has changed (or all, with --fresh); what a scene requires is asked anew each time.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from optsim.cube import Bands, bands_of
from optsim.files import read_cube
from optsim.render.backend import versions
from optsim.report.color import SceneLight, exposure_of, srgb, xyz
from recon.threads import cores
from scenes import SCENES
from scenes.files import read_scene, scene_to_data
from scenes.scene import Scene

ERRORS = {"cornell": 0.005, "dim-bright": 0.02, "glass": 0.02, "glass-dispersive": 0.05, "still-life": 0.05}
"""Where less than 1 % takes long: light that reaches a pixel on rare ways."""
WIDE_RANGE = 1e4
"""Pictures whose brightest and dimmest parts are farther apart get a second one, on a logarithmic scale."""
OWN = Path(__file__).resolve().parents[1] / "examples" / "own_scene" / "still-life.toml"
"""A scene file, with what it needs beside it."""
HEAD = """# Gallery

Every scene that comes with the program, and the one of [scenes.md](../scenes.md), {size} × {size} × {bands}, each by the one line
under its picture; written by `python -m benchmarks.gallery`. The colours are sRGB under the scene's own light (`optsim show` draws the
same, with bands and spectra).

| scene | error asked for | error reached, 95 % interval | paths a pixel | CPU time |
| --- | --- | --- | --- | --- |
"""
LEGEND = """
The error is the RMS over the picture in the worst band, relative to that band's mean. CPU time is of all cores together, start of the
program, files and all, on {machine}. Without samples means that light and coverage of pixels are closed forms: the error is then a bound.
"""


def scenes_shown() -> Iterator[tuple[str, Scene]]:
    """Yield the word by which the command line knows a scene, and the scene."""
    for recipe in SCENES:
        yield recipe.name, recipe.build()
    yield OWN.name, read_scene(OWN)


def command_of(word: str, size: int) -> list[str]:
    """Return the words of the command that renders a scene."""
    name = word.removesuffix(OWN.suffix)
    error = ["--error", f"{ERRORS[name]:g}"] if name in ERRORS else []
    return ["render", word, "--size", str(size), *error, "-o", "cube.nc"]


def question_of(word: str) -> list[str]:
    """Return the words of the command that tells what a scene requires to the same error."""
    words = command_of(word, 1)
    error = words[words.index("--error") : words.index("--error") + 2] if "--error" in words else []
    return ["explain", word, *error]


def run(words: list[str], folder: Path) -> tuple[str, str, float]:
    """Run optsim; return what it printed, its messages, and the seconds of CPU that it took."""

    def spent() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = spent()
    done = subprocess.run([sys.executable, "-m", "optsim", *words], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"optsim {' '.join(words)}: {done.stderr}")
    return done.stdout, done.stderr, spent() - before


def wide_range(cube: np.ndarray, bands: Bands) -> bool:
    """Tell whether one exposure cannot show the whole picture."""
    luminance = xyz(cube, bands)[..., 1]
    lit = luminance[luminance > 0]
    return lit.size > 0 and float(np.quantile(lit, 0.99) / np.quantile(lit, 0.01)) > WIDE_RANGE


def logarithmic(cube: np.ndarray, bands: Bands) -> np.ndarray:
    """Return a cube of the same colours whose luminance is the logarithm of the given one's, from its dimmest hundredth up."""
    luminance = xyz(cube, bands)[..., 1]
    lit = luminance[luminance > 0]
    low, high = np.quantile(lit, [0.01, 1.0])
    scale = (np.log(np.maximum(luminance, low) / low) / np.log(high / low) + 0.02) ** 1.5
    return cube * (scale / np.maximum(luminance, low))[..., None] * (luminance > 0)[..., None]


def save(path: Path, cube: np.ndarray, bands: Bands, light: SceneLight | None) -> None:
    """Write a picture, one pixel a pixel."""
    from PIL import Image

    picture = srgb(cube, bands, exposure_of(cube, bands, light))
    Image.fromarray(np.round(picture * 255).astype(np.uint8)).save(path, optimize=True)


def entry_of(word: str, scene: Scene, size: int, out: Path) -> dict[str, Any]:
    """Render a scene, write its pictures, and return what is to be told of it."""
    words = command_of(word, size)
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "files"
        shutil.copytree(OWN.parent, folder)
        _, messages, seconds = run(words, folder)
        data = read_cube(folder / "cube.nc")
    bands, cube = bands_of(data), data["radiance"].values.astype(np.float64)
    light = SceneLight.of(data.attrs.get("illuminant"), bands.count)
    save(out / f"{scene.name}.png", cube, bands, light)
    pictures = [f"{scene.name}.png"]
    if wide_range(cube, bands):
        pictures.append(f"{scene.name}-log.png")
        save(out / pictures[1], logarithmic(cube, bands), bands, None)
    kept = ("error", "error_low", "error_high", "samples_per_pixel", "samples_per_pixel_most")
    kept += ("dispersed_share", "error_dispersed", "error_elsewhere", "caustic_share")
    return {
        "description": scene.description,
        "commands": [" ".join(["optsim", *question_of(word)]), " ".join(["optsim", *words])],
        "warnings": [line.removeprefix("optsim: ") for line in messages.splitlines() if "warning: " in line],
        "pictures": pictures,
        "bands": bands.count,
        "asked": ERRORS.get(scene.name, 0.01),
        "cpu_s": seconds,
        "machine": f"{cores()} cores ({platform.machine()})",
        "load": max(load, os.getloadavg()[0]),
        **{name: float(data.attrs[name]) for name in kept if name in data.attrs},
    }


def key_of(word: str, scene: Scene, size: int) -> str:
    """Return a digest of what decides an entry."""
    pinned = {name: versions().get(name) for name in ("optsim", "mitsuba", "drjit")}
    told = json.dumps([scene_to_data(scene), command_of(word, size), pinned], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()


def of_glass(row: dict[str, Any]) -> str:
    """Return what a render tells of glass: which share of the light and of the pixels it touches."""
    text = ""
    if row.get("caustic_share"):
        text += f"\n{row['caustic_share']:.1%} of the light came to a surface by way of glass.\n"
    if row.get("dispersed_share"):
        text += (
            f"\n{row['dispersed_share']:.0%} of the pixels show glass that disperses: the error over these is "
            f"{row['error_dispersed']:.2g} of the picture's mean, over the others {row['error_elsewhere']:.2g}.\n"
        )
    return text


def page(entries: dict[str, dict[str, Any]], size: int) -> str:
    """Return the gallery as Markdown."""
    first = next(iter(entries.values()))
    parts = [HEAD.format(size=size, bands=first["bands"])]
    for name, row in entries.items():
        reached, paths = f"at most {row['error']:.1g}", "without samples"
        if row["samples_per_pixel"]:
            reached = f"{row['error']:.2g} ({row['error_low']:.2g} to {row['error_high']:.2g})"
            paths = f"{row['samples_per_pixel']:.0f} (up to {row['samples_per_pixel_most']:.0f})"
        parts.append(f"| [{name}](#{name}) | {row['asked']:g} | {reached} | {paths} | {row['cpu_s']:.1f} s |\n")
    parts.append(LEGEND.format(machine=first["machine"]))
    busiest = max(row.get("load", 0.0) for row in entries.values())
    if busiest > cores() + 1:
        parts.append(f"The machine had other work to do (load average up to {busiest:.0f}): left alone it takes less.\n")
    for name, row in entries.items():
        pictures = " ".join(f"![{name}{', logarithmic' if i else ''}]({file})" for i, file in enumerate(row["pictures"]))
        parts.append(f"\n## {name}\n\n{row['description']}\n\n{pictures}\n")
        if len(row["pictures"]) > 1:
            parts.append("\nLeft as a camera would show it; right the same colours with the logarithm of their luminance.\n")
        parts.append(of_glass(row))
        parts.extend(f"\n{sentence}\n" for sentence in row["warnings"])
        parts.append("\n" + "".join(f"    {command}\n" for command in row["commands"]))
        parts.append(f"\n```text\n{row['explain'].rstrip()}\n```\n")
    return "".join(parts)


def main() -> None:
    """Bring the gallery up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="scenes to look at; all when none is named")
    parser.add_argument("--size", type=int, default=256, help="picture side in pixels")
    parser.add_argument("--fresh", action="store_true", help="render again what is up to date")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[1] / "docs" / "gallery")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    record = chosen.out / "gallery.json"
    done: dict[str, dict[str, Any]] = json.loads(record.read_text()) if record.exists() else {}
    names = []
    for word, scene in scenes_shown():
        names.append(scene.name)
        if chosen.names and scene.name not in chosen.names:
            continue
        key = key_of(word, scene, chosen.size)
        if not chosen.fresh and done.get(scene.name, {}).get("key") == key and (chosen.out / f"{scene.name}.png").exists():
            print(f"{scene.name}: up to date", flush=True)
        else:
            start = time.monotonic()
            done[scene.name] = {"key": key} | entry_of(word, scene, chosen.size, chosen.out)
            print(f"{scene.name}: error {done[scene.name]['error']:.2g}, {time.monotonic() - start:.0f} s", flush=True)
        done[scene.name]["explain"] = run(question_of(word), OWN.parent)[0]
        record.write_text(json.dumps(done, indent=1) + "\n")
    entries = {name: done[name] for name in names if name in done}
    (chosen.out / "README.md").write_text(page(entries, chosen.size))


if __name__ == "__main__":
    main()
