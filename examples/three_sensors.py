"""One exposure's worth of data, three sensors: which recovers the colour checker best?

    python examples/three_sensors.py

Renders the chart, photographs it at R = 1/8 (three monochrome shots, or one colour shot), inverts, and prints the scores.
Set OPTSIM_QUICK=1 for 32 x 32 pixels.
"""

import os

from optsim.camera import Distinct, band_model_of, masks_for, measure_matched, sensors, signal_of
from optsim.cube import Bands
from optsim.render import RenderSettings, render
from recon import reconstruct
from recon.metrics import psnr
from scenes import scene_by_name

size = 32 if os.environ.get("OPTSIM_QUICK") else 128
truth = render(scene_by_name("color-checker").build(), Bands.paper(), (size, size), RenderSettings(error=0.01))

for sensor in sensors():
    masks = masks_for(sensor, sensor.shots_per_group, Distinct(), (size, size), seed=1)
    frames = measure_matched(truth, sensor, masks)
    solution = reconstruct(band_model_of(frames).operator("float32"), signal_of(frames))
    print(f"{sensor.name:7s} {len(masks)} shot(s)  {psnr(solution.cube, truth['radiance'].values):6.2f} dB   {solution.stop}")
