"""Measure what each optical effect adds, what leaving it out costs, and what modelling it costs; write docs/fidelity.md.

    python benchmarks/fidelity.py [--size 24] [--seeds 3] [--output docs/fidelity.md]

Each effect is taken alone, at a plausible value, on top of the ideal camera. Costs are ratios of times in one run.
"""

# ruff: noqa: E402
import argparse
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path = [folder for folder in sys.path if Path(folder or ".").resolve() != HERE]  # recon.py beside this file would hide the package

import numpy as np

from optsim import __version__
from optsim.camera import CameraConfig, Distinct, Exposure, Mono, masks_for, photograph, physical_model, signal_of
from optsim.camera.band_model import Exact
from optsim.camera.effects import EFFECTS, Effect, effect_named, reduced
from optsim.camera.optics_config import BandpassConfig, DmdConfig, ObjectiveConfig, SensorConfig
from optsim.camera.relay import Relay
from optsim.cube import Bands
from optsim.study.effect_cost import NOT_IN_H, EffectCostConfig, effect_costs
from optsim.study.fine_scene import TexturedField

STATED = CameraConfig(
    objective=ObjectiveConfig(focal_mm=50, psf_um=5),
    dmd=DmdConfig(tilt_deg=24, offset_x_px=0.2, offset_y_px=0.1, rotation_deg=0.05, scale=1.0005, dead_share=1e-3, stuck_share=1e-3),
    relay=Relay(defocus_mm=0.05, distortion_per_mm2=1e-4, scheimpflug=False, converging=True),
    bandpass=BandpassConfig(edge_nm=5),
    sensor=SensorConfig(prnu=0.005, dsnu_e=5, crosstalk=0.01),
)
BANDS = Bands.paper()


def alone(effect: Effect) -> CameraConfig:
    """Return the camera with this effect, and what it rests on, and nothing else."""
    return reduced(STATED, [effect, *map(effect_named, effect.rests_on)])


def seconds(camera: CameraConfig, cube, masks) -> float:
    """Return the shortest of three photographs."""
    times = []
    for _ in range(4):
        start = time.perf_counter()
        photograph(cube, BANDS, camera, Mono(), masks, Exposure(time_s=1.0))
        times.append(time.perf_counter() - start)
    return min(times[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=24, help="mirrors along each side")
    parser.add_argument("--seeds", type=int, default=3, help="sets of masks")
    parser.add_argument("--output", type=Path, default=Path("docs/fidelity.md"))
    options = parser.parse_args()
    config = EffectCostConfig(size=options.size, seeds=options.seeds)
    cube = TexturedField().cube(BANDS.subdivide(config.subdivide, (450.0, 670.0)), (config.size,) * 2, config.samples)
    masks = masks_for(Mono(), Mono().shots_per_group, Distinct(), (config.size,) * 2, 1)
    ideal = reduced(STATED, ())
    base, plain = (f(ideal) for f in (lambda c: seconds(c, cube, masks), lambda c: photographed(c, cube, masks)))
    rows = []
    for effect in EFFECTS:
        rows.append(row_of(effect, config, cube, masks, base, plain))
        print(rows[-1], flush=True)
    options.output.write_text(page(rows, config), encoding="utf-8")
    print(f"{options.output} written")


def photographed(camera: CameraConfig, cube, masks) -> np.ndarray:
    return signal_of(photograph(cube, BANDS, camera, Mono(), masks, Exposure(time_s=1.0)))


def stated(value: object) -> str:
    """Return a value as a camera file has it."""
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


def row_of(effect: Effect, config: EffectCostConfig, cube, masks, base: float, plain: np.ndarray) -> str:
    """Return one line of the table."""
    camera = alone(effect)
    facts = ", ".join(
        f"`{key} = {value:g}`" if isinstance(value, float) else f"`{key} = {str(value).lower()}`"
        for key, value in effect.facts(camera).items()
    )
    size = effect.size(camera, BANDS)
    cells = [effect.name, effect.what, facts, f"{size.px:.2g}", f"{size.relative:.2g}"]
    if effect.name in NOT_IN_H:
        return "| " + " | ".join([*cells, "", NOT_IN_H[effect.name], "", ""]) + " |"
    without = photographed(effect.ideal(camera), cube, masks) if effect.rests_on else plain
    frames = photographed(camera, cube, masks)
    change = np.linalg.norm(frames - without) / np.linalg.norm(frames)
    costs = effect_costs(camera, 0.0, config=config, chosen=[Mono()], quiet=True)
    loss = next(cost.loss_db["mono"] for cost in costs if cost.effect.name == effect.name)
    taps = physical_model(camera, Mono(), BANDS, masks, Exact(error=config.error)).taps.shape
    weights = " x ".join(map(str, taps[1:] if len(taps) == 2 else taps[3:]))
    if len(taps) == 5 and taps[1:3] != (1, 1):
        weights += " a mirror"
    spent = seconds(camera, cube, masks) / base
    return "| " + " | ".join([*cells, f"{change:.2g}", str(loss), f"{spent:.1f}", weights]) + " |"


def page(rows: list[str], config: EffectCostConfig) -> str:
    """Return the document."""
    return (
        f"""# Fidelity: what each effect adds, the error without it, and its cost

Written by `python benchmarks/fidelity.py --size {config.size} --seeds {config.seeds}` (optsim {__version__}); run it to measure again.
A camera file states facts, and `photograph` models them all. `optsim explain --camera FILE` makes this ranking for a camera of your own and
says what an error requires; `reduced(camera, required(camera, error))` is the camera that states just that. Definitions: theory.md C.i.

Each effect is alone here, at the value in the third column, on top of the ideal camera (default double Amici prism, no other effect).

* **px**: the farthest that it moves light over 256 x 256 mirrors, or the diameter over which it spreads it.
* **light wrong**: largest share of a mirror's light on another pixel, missing or in excess without it, same field.
* **frames**: ||with - without|| / ||with|| of noise-free frames of {config.size} x {config.size} mirrors.
* **dB lost**: PSNR of a reconstruction whose H has the effect minus one whose H has not, on the same frames; monochrome sensor,
  three shots, textured field, {config.size} x {config.size} mirrors, mean and 95 % interval over {config.seeds} sets of masks.
  Effects that grow with the field cost more on a larger one.
* **time**: of a photograph with it, over that of the ideal camera, same run.
* **weights**: taps (rows x columns) a band of the H that has it, to {config.error:g} of the light: what varies less over the field is not
  in it.

| effect | what it adds | facts | px | light wrong | frames | dB lost | time | weights |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
        + "\n".join(rows)
        + "\n"
    )


if __name__ == "__main__":
    main()
