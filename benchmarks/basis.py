"""Which wavelet: PSNR of basis pursuit at R = 1/8 on the two rendered targets.

    python -m benchmarks.basis [--size 256] [--seed 0]

Prints one row a wavelet and target; docs/decisions/0003-basis.md quotes it.
"""

import argparse

import numpy as np

from optsim.camera import Distinct, Repeated, band_model_of, masks_for, measure_matched, sensors, signal_of
from optsim.cube import Bands
from optsim.render import RenderSettings, render
from recon import L1, Kronecker, reconstruct
from recon.metrics import psnr
from scenes import scene_by_name

WAVELETS = ("haar", "db2", "db4", "sym8")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--size", type=int, default=256)
    options.add_argument("--seed", type=int, default=0)
    chosen = options.parse_args()
    size, seed = (chosen.size, chosen.size), chosen.seed
    mono, bayer, foveon = sensors()
    cases = (
        ("mono distinct", mono, Distinct()),
        ("mono repeated", mono, Repeated()),
        ("Bayer", bayer, Distinct()),
        ("Foveon", foveon, Distinct()),
    )
    print(f"{size[0]} x {size[1]} x 24, level 5, mask seed {seed}, PSNR in dB")
    print(f"{'target':20s} {'wavelet':8s}" + "".join(f"{name:>15s}" for name, _, _ in cases))
    for target in ("color-checker", "color-checker-bars"):
        truth = render(scene_by_name(target).build(), Bands.paper(), size, RenderSettings(error=0.005))
        for wavelet in WAVELETS:
            found = []
            for _, sensor, rule in cases:
                masks = masks_for(sensor, sensor.shots_per_group, rule, size, seed)
                frames = measure_matched(truth, sensor, masks)
                basis = Kronecker.for_shape((*size, 24), wavelet=wavelet)
                solution = reconstruct(band_model_of(frames).operator(np.float32), signal_of(frames), prior=L1(basis=basis))
                found.append(psnr(solution.cube, truth["radiance"].values))
            print(f"{target:20s} {wavelet:8s}" + "".join(f"{value:15.2f}" for value in found), flush=True)


if __name__ == "__main__":
    main()
