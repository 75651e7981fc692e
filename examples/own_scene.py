"""A scene of your own: a ball of measured reflectance in a white corner, under a 3200 K lamp.

    python examples/own_scene.py

Says which physics the scene needs, renders it at 31 bands, and draws ball.png.
Set OPTSIM_QUICK=1 for 24 x 24 pixels.
"""

import os

import numpy as np

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.render.needs import explain
from optsim.report.show import show
from scenes.library import blackbody
from scenes.scene import AreaLight, Diffuse, Perspective, Rectangle, Scene, Sphere
from scenes.spectrum import Spectrum

wavelength = np.arange(390.0, 711.0, 10.0)
leaf = Spectrum(wavelength, 0.05 + 0.15 * np.exp(-(((wavelength - 552) / 30) ** 2)) + 0.4 / (1 + np.exp((695 - wavelength) / 8)), "a leaf")
white = Spectrum.constant(0.9, 390, 710, "white paint")

scene = Scene(
    name="ball in a corner",
    materials={"leaf": Diffuse(reflectance=leaf), "white": Diffuse(reflectance=white)},
    shapes=(
        Sphere(name="ball", material="leaf", center=(0, 0.4, 0), radius=0.4),
        Rectangle(name="floor", material="white", center=(0, 0, 0), half_u=(2, 0, 0), half_v=(0, 0, -2)),
        Rectangle(name="wall", material="white", center=(0, 1, -1), half_u=(2, 0, 0), half_v=(0, 1.5, 0)),
    ),
    lights=(AreaLight(center=(1.5, 2.5, 1.5), half_u=(0.3, 0, -0.3), half_v=(-0.2, 0.3, -0.2), radiance=blackbody(3200, wavelength)),),
    viewpoint=Perspective(origin=(0.3, 0.9, 3.0), target=(0, 0.45, 0), fov_deg=30),
)

for effect in explain(scene, error=0.02).effects:
    print(f"{'on ' if effect.on else 'off'} {effect.name:20s} {effect.reason}")

size = 24 if os.environ.get("OPTSIM_QUICK") else 256
cube = render(scene, Bands.parse("400:710:31"), (size, size), RenderSettings(error=0.05 if size == 24 else 0.02))
show(cube, "ball.png")
print(f"ball.png: {cube['radiance'].shape}, error {cube.attrs['error']:.1g}")
