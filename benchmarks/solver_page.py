"""Write docs/solvers.md, "which solver should I use", from what the benchmarks of tau, of errors and of solvers have measured.

python -m benchmarks.solver_page [--output docs/solvers.md]
"""

# ruff: noqa: E501
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import quality, solver_curves, tau_rules, uncertainty

RULES = {
    "held_out": ("`AutoTau()`", "plain"),
    "discrepancy": ("`Discrepancy()`", "weighted by the noise"),
    "morozov": ("`Discrepancy(probes=0)`", "weighted by the noise"),
}
CASES = """| you have | in Python | `optsim reconstruct FRAMES -o ESTIMATE` with | because |
| --- | --- | --- | --- |
| frames without noise, or nearly | `reconstruct(H, g)` | `--solver basis-pursuit` (what matched frames without noise get) | basis pursuit has no tau to choose: the answer depends on no weight, no response scale, no mix of layers |
| frames and the variance of each measurement | `reconstruct(H, g, tau=Discrepancy(), noise=variance)` | `--weighted --tau discrepancy` | ADMM on Eq. 4 weighted by the noise; tau leaves unexplained what noise alone would. `optsim.camera.noise_variance(frames)` is the variance that a frames file tells |
| frames with noise that nobody measured | `reconstruct(H, g, tau=AutoTau())` | `--solver admm --tau auto` (what noisy, physical and foreign frames get) | ADMM on Eq. 4; tau from pixels that the solve does not see |
| a better picture than the paper's prior gives | `prior=quality(bands)`, below; `SpectralTotalVariation()`, `TotalVariation()` | `--prior quality` (bands from 380 to 780 nm), `--prior tv` (`SpectralTotalVariation()`) | fewer edges and few wavelets; docs/theory.md S tells what each assumes |
| two priors, and no truth to choose by | `choose_prior(H, g, (Quality(), TotalVariation())).prior` | | each predicts detector pixels that its solve did not see; the better one is named, with both errors |
| the fear that a prior does harm | `never_below(H, g, quality(bands))` | | three solves: the answer is that of l1 where l1 predicts the unseen pixels better |
| a denoiser of your own | `reconstruct(H, g, prior=PlugAndPlay(denoiser=f), solver=Gap())` | | `f(picture, sigma)` returns a picture; [examples/plug_and_play.py](../examples/plug_and_play.py) |
| radiance that must not be negative | `nonnegative=True` | `--nonnegative` | exactly at least 0, with every solver but `Gpsr` |
| the paper's own method | `reconstruct(H, g, solver=Gpsr(), tau=...)` | `--solver gpsr --tau 1e-4` (of tau_max), `--debias` | GPSR-BB with continuation; `debias=True` and `barzilai_borwein=False` (GPSR-Basic, Python only) are there too |
| a scene of flat patches, and little time | `reconstruct(H, g, prior=TotalVariation(), solver=Gap())` | `--solver gap --prior tv` (of spectral coefficient pictures) | projection and denoising by turns; it minimises nothing, so the answer depends on where it stops; below l1 where a mosaic or fine bars rule |
| an operator of your own | `adjoint_error(H)` first; then `solver=Fista(), tau=...` or any other | | the first is rounding (1e-7 in float32) if adjoint and forward belong together. `Fista` needs no data step; the others solve theirs by conjugate gradients where H does not tell the blocks of H H^T; [examples/own_operator.py](../examples/own_operator.py) |
| the wish to know how wrong each voxel is | `estimate_error(H, g, Given(noise=variance), solver=Admm(), tau=Discrepancy())` | | intervals with measured coverage, for ten times the work |

Names are imported from `recon`, `Given` from `recon.tau`, `quality` from `optsim.study.library`. For a frames file, H and g are

```python
import numpy as np

from optsim.camera import band_model_of, signal_of
from optsim.cube import bands_of
from optsim.files import read
from optsim.study.library import quality
from recon import reconstruct

frames = read("frames.nc")
H, g = band_model_of(frames).operator(np.float32), signal_of(frames)
solution = reconstruct(H, g, prior=quality(bands_of(frames)))
print(solution)
```

and for others a `CodedAperture` ([examples/foreign_measurement.py](../examples/foreign_measurement.py)) or any object with `in_shape`, `out_shape`, `forward` and `adjoint`.

`quality(bands)` is `Quality(spectral=learned(samples))` with the samples that optsim has: reflectances of 50 colour samples under equal-energy light, xenon, D65 and A, known from 380 to 780 nm; no chart or scene of optsim shows any of them. For other bands, or
spectra that you know better, `samples` is an array (n, K): n spectra as radiances (or reflectances) in the K bands of the cube, on any common scale, not those of the scene that is sought; fewer than K will do. `Quality()` without samples takes cosines, and
any bands."""
"""What to call, in Python and on the command line."""


def rules_table(rows: list[dict[str, Any]]) -> str:
    """Return the distribution of losses, a line a rule."""
    lines = [
        "| rule | objective | cases | median | mean | 90 % below | largest | choices at an end of the path |",
        "| " + "--- | " * 8,
    ]
    for rule, (name, objective) in RULES.items():
        at = tau_rules.spread(rows, rule)
        lines.append(
            f"| {name} | {objective} | {at['cases']} | {at['median']:.2f} | {at['mean']:.2f} | {at['p90']:.2f} | {at['max']:.2f} | {at['edges']} |"
        )
    return "\n".join(lines)


def groups_table(rows: list[dict[str, Any]]) -> str:
    """Return mean and largest loss by sensor and light."""
    lights = [None, 20_000, 1_000]
    names = ["no noise", "20000 e", "1000 e"]
    lines = ["| sensor | rule | " + " | ".join(names) + " |", "| " + "--- | " * 5]
    for sensor in dict.fromkeys(row["sensor"] for row in rows):
        for rule, (name, _) in list(RULES.items())[:2]:
            cells = []
            for well in lights:
                losses = [row[rule]["loss_db"] for row in rows if row["sensor"] == sensor and row["well"] == well and rule in row]
                cells.append(f"{np.mean(losses):.2f} (at most {max(losses):.2f})" if losses else "")
            lines.append(f"| {sensor} | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def edges(rows: list[dict[str, Any]]) -> str:
    """Say where the best tau was an end of the grid, so that the loss is a lower bound."""
    found = [row for row in rows for kind in ("plain", "weighted") if kind in row and row[kind]["at_edge"]]
    quiet = sum(row["well"] is None for row in found)
    total = sum(kind in row for row in rows for kind in ("plain", "weighted"))
    return (
        f"The best tau was an end of the path in {len(found)} of {total} searches ({quiet} of them without noise, where tau -> 0 is best: that is"
        " basis pursuit); there the loss is against the best of the path."
    )


def paces(curves: list[dict[str, Any]]) -> str:
    """Say how much faster ADMM is than GPSR-BB, and GPSR-BB than GPSR-Basic."""
    told = []
    for quick, slow in (("ADMM", solver_curves.REFERENCE), (solver_curves.REFERENCE, "GPSR-Basic")):
        cells = []
        for row in curves:
            by = {result["solver"]: result for result in row["results"]}
            bound = "" if by[slow]["met"] else "more than "
            cells.append(f"{bound}{by[slow]['seconds'] / by[quick]['seconds']:.2g} ({row['case'].rsplit(',', 1)[0]})")
        told.append(f"{quick} is faster than {slow} by a factor of " + ", ".join(cells) + ".")
    return "\n".join(told)


def page(curves: list[dict[str, Any]], rules: list[dict[str, Any]], errors: list[dict[str, Any]], gains: list[dict[str, Any]]) -> str:
    """Return the document."""
    size = rules[0]["size"]
    return f"""# Which solver should I use?

{CASES}

This page is written by `python -m benchmarks.solver_page` from measurements that `benchmarks.quality`, `benchmarks.tau_rules`, `benchmarks.uncertainty` and `benchmarks.solver_curves` keep in benchmarks/results; run them to measure again.

## How fast

![PSNR against seconds](figures/solver_curves.png)

The colour checker, 24 bands, R = 1/8; every point is a solve of its own from zero, set-up included, in CPU seconds of one thread. Dotted lines are the
converged answers. tau is {solver_curves.FRACTION:g} of tau_max without noise, that of `Discrepancy` with noise. Basis pursuit has an objective of its own (and no
tau); the others share Eq. 4 and its answer. Without noise this is a small tau, hard for gradients; with noise tau is larger and everything is quicker. GPSR-BB
with full steps is `Gpsr(monotone=False)`.

{solver_curves.report(curves)}

{paces(curves)}

## What the quality mode gains

`Quality` over the paper's l1 on the same frames: matched measurements at R = 1/8 (three monochrome shots, one Bayer, one Foveon shot), mean over mask seeds with the 95 % interval of Student's t.
Without noise both by basis pursuit, with noise both at the tau that the known noise asks for. Its spectra are learned from samples that no scene is painted with.

{quality.table(gains)}

## What a tau found without ground truth costs

{len(rules)} cases: sensors {", ".join(dict.fromkeys(row["sensor"] for row in rules))}; scenes {", ".join(dict.fromkeys(row["scene"] for row in rules))}; without noise and with
wells of 20000 and 1000 electrons (10 e read noise, 12 bits); {size} x {size} mirrors, R = 1/8. The rules were set on other scenes. Loss in dB of PSNR against the best
tau of the same objective, found with the truth on a path of half decades.

{rules_table(rules)}

{edges(rules)}

{groups_table(rules)}

## How good the error estimates are

The share of voxels within the interval that `estimate_error` gives ({errors[0]["size"]} x {errors[0]["size"]} mirrors, R = 1/8, 6 repeats), the rms error that it expects over the one made, and how
much of the true squared error lies in the tenth of the voxels that it calls worst (10 % would be no information). The color-checker and procedural-1 were looked at
while the estimate was designed, bricks was not.

{uncertainty.table(errors)}

Coverage is that of the whole cube. It falls short where a scene has detail that the measurement cannot show, which no repeat on the
estimate can know; read a 95 % interval with the measured figures beside it.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs/solvers.md"))
    options = parser.parse_args()
    curves = json.loads(solver_curves.OUTPUT.read_text())
    rules = json.loads(tau_rules.OUTPUT.read_text())["rows"]
    errors = json.loads(uncertainty.OUTPUT.read_text())
    gains = json.loads(quality.OUTPUT.read_text())
    options.output.write_text(page(curves, rules, errors, gains), encoding="utf-8")
    print(f"{options.output} written")


if __name__ == "__main__":
    main()
