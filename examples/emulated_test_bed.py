"""The paper's test bed: colour sensors emulated by a monochrome one behind red, green and blue glass (its Fig. 9).

    python examples/emulated_test_bed.py

Photographs toy bricks through the mask and the prism three times, once behind each plate, with 8 bits; keeps each colour's
pixels for the Bayer sensor and all for the Foveon; draws one measured frame of each sensor with a zoom (fig9.png), and the
curves that the plates make (plates.png). The monochromator then records the ground truth as the paper did, and its error
against the bands' true means is printed. The plates are model curves: the paper does not name its glasses.
Set OPTSIM_QUICK=1 for 24 x 24 mirrors.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

from optsim.camera import CameraConfig, Distinct, Exposure, Interpolate, Mono, Noise, masks_for, photograph
from optsim.camera.emulate import GlassPlates, bayer_of, foveon_of, plate_exposures
from optsim.camera.monochromator import Monochromator
from optsim.cube import Bands, band_mean
from optsim.render import RenderSettings, render
from scenes import scene_by_name

size = 24 if os.environ.get("OPTSIM_QUICK") else 128
camera, bands, mono = CameraConfig(), Bands.paper(), Mono.silicon()
noise = Noise(bits=8, read_noise_e=10.0)
wide = Bands.from_edges(np.linspace(440, 690, 126))  # the slit's flanks reach beyond the bands
cube = render(scene_by_name("bricks").build(), wide, (size, size), RenderSettings(error=0.05 if size == 24 else 0.02))
fine = band_mean(cube, Bands.from_edges(np.linspace(450, 670, 111)))
masks = masks_for(mono, 1, Distinct(), (size, size), seed=1)
exposure = Exposure(noise=noise, interpolate=Interpolate(), seed=1)

plain = photograph(fine, bands, camera, mono, masks, exposure)
behind = GlassPlates().before(mono)
three = plate_exposures(fine, bands, camera, masks, exposure, behind)
bayer, foveon = bayer_of(three), foveon_of(three)
for colour, frames in zip(("red", "green", "blue"), three):
    ratio = frames.attrs["exposure_s"] / plain.attrs["exposure_s"]
    print(
        f"behind {colour:5s} glass the same fill takes {ratio:5.1f} times the exposure; {frames.attrs['saturated_pixels']} pixels saturated"
    )

steps = Bands.paper()
truth = band_mean(cube, steps)["radiance"].values
for name, chain in (("without noise", None), ("with 8 bits", noise)):
    recorded = Monochromator().acquire(cube, steps, mono, chain, full_well_e=camera.sensor.full_well_e)["radiance"].values
    error = np.sqrt(np.mean((recorded - truth) ** 2)) / np.sqrt(np.mean(truth**2))
    print(f"the monochromator's cube {name} differs from the bands' means by {100 * error:.2f} % rms")


def normalised(values):
    """Return values scaled so that the largest is 1."""
    return np.clip(values / values.max(), 0, 1)


mosaic = bayer["frames"].values[0, 0]
coloured = np.where(bayer["cfa"].values[..., None] == np.arange(3), mosaic[..., None], 0)
pictures = {
    "mono": normalised(plain["frames"].values[0, 0]),
    "Bayer": normalised(coloured),
    "Foveon": normalised(np.moveaxis(foveon["frames"].values[0], 0, -1)),
}
side = size // 5
row, column = size // 4, int(0.62 * (size + bands.count))
figure, axes = plt.subplots(2, 3, figsize=(12, 7), layout="constrained")
for (name, picture), (whole, zoom) in zip(pictures.items(), axes.T):
    whole.imshow(picture, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    whole.add_patch(plt.Rectangle((column - 0.5, row - 0.5), side, side, fill=False, edgecolor="yellow"))
    whole.set_title(f"{name}, one shot")
    whole.set_xlabel("column (px)")
    whole.set_ylabel("row (px)")
    zoom.imshow(picture[row : row + side, column : column + side], cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    zoom.set_title(f"{name}, zoom")
    zoom.set_xticks([])
    zoom.set_yticks([])
figure.savefig("fig9.png", dpi=110)

figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
wavelength = np.linspace(450, 670, 221)
for sensor, colour in zip(behind, ("tab:red", "tab:green", "tab:blue")):
    axis.plot(wavelength, sensor.response(wavelength)[0], color=colour)
axis.plot(wavelength, mono.response(wavelength)[0], "0.3", linestyle="--", label="silicon without glass")
axis.set_xlabel("wavelength (nm)")
axis.set_ylabel("quantum efficiency")
axis.set_title("The monochrome sensor behind red, green and blue glass")
axis.legend()
figure.savefig("plates.png", dpi=110)
print("fig9.png and plates.png drawn")
