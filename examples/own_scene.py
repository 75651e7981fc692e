"""A scene of your own, from files: a leaf of measured reflectance, an obelisk from a mesh file and a glass ball.

    python examples/own_scene.py

Reads examples/own_scene/still-life.toml (docs/scenes.md goes through it), says which physics it needs, and renders it twice at 31
bands: as it is, and, changed in Python, under an incandescent lamp alone. Draws still-life.png and incandescent.png.
Set OPTSIM_QUICK=1 for 24 x 24 pixels.
"""

import os
from pathlib import Path

from optsim.cube import Bands
from optsim.render import RenderSettings, explain, render
from optsim.report.show import show
from scenes.files import read_scene
from scenes.library import illuminant

scene = read_scene(Path(__file__).with_name("own_scene") / "still-life.toml")
lamp = scene.lights[0].model_copy(update={"radiance": illuminant("A")})

for effect in explain(scene, error=0.05).effects:
    print(f"{'on ' if effect.on else 'off'} {effect.name:20s} {effect.reason}")

size, paths = (24, 16) if os.environ.get("OPTSIM_QUICK") else (128, 128)
for name, lights in (("still-life", scene.lights), ("incandescent", (lamp,))):
    lit = scene.model_copy(update={"lights": lights})
    cube = render(lit, Bands.parse("400:700:31"), (size, size), RenderSettings(samples_per_pixel=paths))
    show(cube, f"{name}.png")
    print(f"{name}.png: {cube['radiance'].shape}, error {cube.attrs['error']:.1g}")
