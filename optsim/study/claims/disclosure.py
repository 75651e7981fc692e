"""What a referee asks of the numbers: how many solves did not converge or had a tau at the end of its grid, and every setting."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from optsim.camera import CameraConfig, Exposure, Noise, matched_model
from optsim.camera.absolute import AssumedEfficiencies
from optsim.camera.patterns import Bernoulli
from optsim.cube import Bands
from optsim.report.select import listing
from optsim.study.claims.answer import Claims
from optsim.study.claims.bench import BENCH_BITS, Bench
from optsim.study.claims.captures import (
    BITS,
    FULL_WELL_E,
    OFFSET_DN,
    READ_NOISE_E,
    Capture,
    Demosaiced,
    KnowsAll,
    KnowsNothing,
    KnowsSpots,
    Lit,
    Matched,
    Physical,
)
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.curves import PHOTONS, PUBLISHED
from optsim.study.claims.judge import LEVEL
from optsim.study.claims.methods import (
    BENCH_FRACTIONS,
    FRACTIONS,
    INTERPOLATED_FRACTIONS,
    MATCHED_FRACTIONS,
    NOISY_FRACTIONS,
    PATH_ITERATIONS,
    PURSUIT_TOLERANCE,
    QUALITY_FRACTIONS,
    BlindTau,
    KnownNoise,
    Method,
    OracleTau,
    Pursuit,
    best_prior,
)
from optsim.study.claims.plan import Task, scene_names
from optsim.study.claims.readings import SENSOR_WORDS, SENSORS
from optsim.study.claims.worlds import BENCH, SAMPLES, SUBDIVIDE, TARGET_1, TARGET_2
from optsim.study.statistics import CONFIDENCE

HEADER = ("data", "H", "inverted by", "tau", "solves", "not converged", "tau at its grid’s least", "tau at its largest", "iterations")
UNIT_SHIFTS = "the data’s own: unit shifts, unit band weights"
BELIEFS = {
    KnowsAll: "the camera’s own columns and weights",
    KnowsSpots: "columns fitted to spots of a monochromator",
    KnowsNothing: "unit shifts",
}


@dataclass(frozen=True)
class Kind:
    """Solves that a row of the table counts together, all as text."""

    data: str
    model: str
    method: str
    rule: str


def disclosures(found: Claims) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Tabulate, by kind of data and method, how the solves ended: header and rows, all as text.

    Iterations are those of the final solve, median and largest. What is not zero is told by sensor. Each solve counts once, whatever
    readings look at it.
    """
    groups: dict[Kind, list[tuple[Task, Mapping[str, Any]]]] = {}
    for task, row in found.solved.items():
        groups.setdefault(kind_of(task), []).append((task, row))
    return HEADER, [_line(kind, groups[kind]) for kind in sorted(groups, key=lambda k: (k.data, k.model, k.method, k.rule))]


def kind_of(task: Task) -> Kind:
    """Return the kind of a solve: response curves, light levels and budgets are counted together."""
    data, model = data_told(task.recipe.capture)
    return Kind(data, model, *method_told(task.recipe.method))


def data_told(capture: Capture) -> tuple[str, str]:
    """Return what kind of data a capture makes, and which H inverts them."""
    if isinstance(capture, Matched):
        return "matched", UNIT_SHIFTS
    if isinstance(capture, Physical):
        return "physical", BELIEFS[type(capture.belief)]
    if isinstance(capture, Demosaiced):
        data, model = data_told(capture.base)
        return f"{data}, Bayer demosaiced first", f"{model}; the mosaic’s three curves in every pixel"
    if isinstance(capture, Lit):
        return "matched with noise", f"{UNIT_SHIFTS}, in DN"
    assert isinstance(capture, Bench)
    return "test bed", "the camera’s own columns and weights, as a monochromator tells; without blur and leak"


def method_told(method: Method) -> tuple[str, str]:
    """Return how data are inverted, and how tau is found."""
    prior = "quality mode’s prior" if getattr(method, "quality", False) else "l1"
    if isinstance(method, Pursuit):
        return f"basis pursuit, {prior}", "none"
    grid = grid_told(fractions_of(method))
    if isinstance(method, KnownNoise):
        weights = "weighted by the inverse variance" if method.weighted else "unweighted"
        return f"Eq. 4, {prior}, {weights}", f"discrepancy principle, {grid}"
    return f"Eq. 4, {prior}", f"{'oracle' if isinstance(method, OracleTau) else 'held-out pixels'}, {grid}"


def fractions_of(method: Method) -> tuple[float, ...]:
    """Return the values of tau / tau_max that a method tries, falling; none without a tau."""
    if isinstance(method, BlindTau | OracleTau):
        return method.fractions
    if isinstance(method, KnownNoise):
        return QUALITY_FRACTIONS if method.quality else NOISY_FRACTIONS
    return ()


def grid_told(fractions: Sequence[float]) -> str:
    """Write a grid of tau / tau_max by its ends."""
    return f"{len(fractions)} values from {fractions[0]:g} to {fractions[-1]:g} tau_max"


def edge_of(row: Mapping[str, Any], fractions: Sequence[float]) -> str:
    """Return at which end of its grid a tau lies: "least", "largest", or "" inside."""
    if not row["at_edge"] or row["tau_fraction"] is None:
        return ""
    place = math.log(row["tau_fraction"])
    return "least" if abs(place - math.log(fractions[-1])) < abs(place - math.log(fractions[0])) else "largest"


def _line(kind: Kind, solves: Sequence[tuple[Task, Mapping[str, Any]]]) -> tuple[str, ...]:
    def count(chosen: Callable[[Task, Mapping[str, Any]], bool]) -> str:
        return counted((task.series.sensor for task, row in solves if chosen(task, row)), len(solves))

    def at(end: str) -> str:
        tau = any(row["tau_fraction"] is not None for _, row in solves)
        return count(lambda task, row: edge_of(row, fractions_of(task.recipe.method)) == end) if tau else "–"

    made = [row["iterations"] for _, row in solves]
    ends = (count(lambda _, row: not row["converged"]), at("least"), at("largest"))
    return (kind.data, kind.model, kind.method, kind.rule, str(len(solves)), *ends, f"{median(made):.0f}, at most {max(made)}")


def counted(sensors: Iterable[str], total: int) -> str:
    """Write how many solves, their share, and by sensor."""
    found = Counter(sensors)
    number = found.total()
    if not number:
        return "0"
    by = ", ".join(f"{SENSOR_WORDS[s]} {found[s]}" for s in SENSORS if found[s])
    return f"{number} ({percent(number / total)}: {by})"


def percent(share: float) -> str:
    """Write a share in per cent."""
    return f"{100 * share:.0f} %"


def settings_told(config: ClaimsConfig) -> list[str]:
    """Write in paragraphs what decides the numbers: scores, priors, grids of tau, masks, light, H, saturation, statistics."""
    return [_scores(), _priors(config), _tau(), _trials(config), _models(), _light(config), _saturation(config), _statistics()]


def _scores() -> str:
    return (
        f"PSNR is the mean over the {Bands.paper().count} bands of 10 log10(peak² / mean squared error of the band). The peak is the "
        "largest value of the whole true cube, one for all bands, so a band with little light scores high at the same relative error. A "
        "band that came out exact would be left out of the mean. Estimates are compared as they are: neither scaled nor clipped."
    )


def _priors(config: ClaimsConfig) -> str:
    from recon import Admm, BasisPursuit
    from recon.basis import DEFAULT_WAVELET, Kronecker

    levels = listing(f"{Kronecker.for_shape((s, s, Bands.paper().count)).level} at {s} x {s}" for s in _sizes(config))
    quality: Any = best_prior()
    return (
        f"The l1 prior is the paper’s: coefficients of wavelet {DEFAULT_WAVELET}, periodised, at full depth (levels: {levels}), times the "
        f"orthonormal DCT over all bands. The quality mode’s prior is {quality.share:g} total variation and {1 - quality.share:g} l1 of "
        f"wavelet {quality.wavelet}, both of spectral coefficients weighted by their usual strength to the power of −{quality.power:g}; "
        "the spectral basis is learned from colour samples that no scene here is painted with. Basis pursuit stops at relative residuals "
        f"of {PURSUIT_TOLERANCE:g} or after {BasisPursuit().max_iterations} iterations, ADMM on Eq. 4 at {Admm().tolerance:g} or after "
        f"{Admm().max_iterations}. A solve that stopped for its iterations counts as not converged in the table of solves and stays in all "
        "numbers."
    )


def _tau() -> str:
    from recon.tau import AutoTau, Discrepancy

    grids = (
        ("physical data", FRACTIONS),
        ("matched data", MATCHED_FRACTIONS),
        ("demosaiced frames", INTERPOLATED_FRACTIONS),
        ("test bed", BENCH_FRACTIONS),
        ("noise", NOISY_FRACTIONS),
        ("noise, quality mode", QUALITY_FRACTIONS),
    )
    told = "; ".join(f"{what} {', '.join(f'{v:g}' for v in values)}" for what, values in grids)
    held, known = AutoTau(), Discrepancy()
    return (
        f"Grids of tau / tau_max: {told}. The automatic rule leaves out {percent(held.share)} of the detector’s pixels with all their "
        f"shots and layers and takes the smallest tau that predicts them nearly as well as the best (within {percent(held.slack)}, and "
        f"within one standard error). Under noise tau is interpolated to where the misfit is {known.target:g} times what the noise leaves, "
        "degrees of freedom counted; its variance is known but for the photons, which the measurement itself stands for. On the way every "
        f"tau gets at most {PATH_ITERATIONS} iterations. The oracle’s tau is the one nearest the truth: no one who measures has it."
    )


def _trials(config: ClaimsConfig) -> str:
    return (
        f"Masks: every mirror is open with probability {Bernoulli().p:g}, independently, from a Philox stream keyed by scene, trial, shot "
        f"and the study’s seed, {config.seed}; both targets share theirs. Noise and calibrations take the trial’s seed. Random scenes are "
        f"{scene_names(config)[0]} to {scene_names(config)[-1]}. All scenes are lit by {_lamps(config)}. They are rendered once each, at "
        f"{SUBDIVIDE} wavelengths a band and {SAMPLES} x {SAMPLES} samples a mirror, until the relative rms error is below "
        f"{config.render_error:g} in every band; data and truth come from the same render, so its grain is part of the scene and no error "
        "of an estimate, though it is harder to compress than a clean picture."
    )


def _models() -> str:
    told = [data_told(capture) for capture in (Matched(), Physical(), Demosaiced(Matched()), Lit(1.0, 1), Bench())]
    return (
        "H of each kind of data: "
        + "; ".join(f"{data}: {model}" for data, model in told)
        + ". Changed readings give physical data the H of "
        + listing((BELIEFS[KnowsSpots], BELIEFS[KnowsNothing]), "or")
        + ". Matched data come from the very H that inverts them, as no camera’s do: their scores are optimistic."
    )


def _light(config: ClaimsConfig) -> str:
    known = AssumedEfficiencies()
    return (
        f"Data with noise: {min(_levels(config)):g} to {max(_levels(config)):g} electrons in the brightest pixel of one monochrome shot of "
        f"full exposure; the other sensors get the same light. Efficiencies are assumed: mono {known.mono:g} and Bayer {known.bayer:g} at "
        f"their peaks, the Foveon’s layers together {known.foveon_sum:g}. Bands weigh by efficiency times radiance: the energy of a "
        f"photon, which would weigh long waves more for every sensor alike, does not enter. Read noise {READ_NOISE_E:g} electrons, {BITS} "
        f"bits over {FULL_WELL_E:,.0f} electrons, offset {OFFSET_DN:g} DN; no dark current, no fixed pattern, no time between shots."
    )


def _saturation(config: ClaimsConfig) -> str:
    most = max(_levels(config)) * max(1.0, largest_over_mono())
    exposure, well = Exposure(), CameraConfig().sensor.full_well_e
    bench_dn = READ_NOISE_E * Noise(bits=BENCH_BITS).gain(well)
    offset_e = OFFSET_DN / Noise(bits=BITS, offset_dn=OFFSET_DN).gain(FULL_WELL_E)
    room = (1 - exposure.fill) * math.sqrt(well / exposure.fill)
    return (
        "Saturation: data without noise pass no well and no converter. With noise the brightest pixel behind the first mask, which all "
        f"sensors share, holds at most {most:,.0f} electrons (the largest ratio of a colour channel to mono in a band is "
        f"{largest_over_mono():.2f}); a later shot would need a mask that lets {FULL_WELL_E / most:.1f} times as much onto one pixel to "
        f"fill the well of {FULL_WELL_E:,.0f}, and opening every mirror gives about {1 / Bernoulli().p:g} times. The offset lies "
        f"{offset_e / READ_NOISE_E:.0f} standard deviations of read noise above the converter’s zero. Every exposure of the test bed is "
        f"set so that its brightest pixel has a mean of {exposure.fill:g} of a well of {well:,.0f} electrons, {room:.0f} standard "
        f"deviations of shot noise below full; its {BENCH_BITS} bits have no offset, and read noise is {bench_dn:.2f} DN there, less than "
        "rounding."
    )


def _statistics() -> str:
    return (
        f"Intervals are two-sided, {percent(CONFIDENCE)} each, and not corrected for their number. p values are one-sided and corrected by "
        f"Holm inside a claim, over its base readings and over its changed ones, to {LEVEL:g}; nothing is corrected across claims, so "
        "among many claims without substance some sign may be shown by chance. The interval of a claim about all bands, sensors or steps "
        "is that of its weakest part, and that of a largest gap is the gap’s at one R: parts selected by looking, whose intervals know "
        "nothing of the selection (for “all parts are above 0” the test of the weakest one needs no correction)."
    )


def largest_over_mono() -> float:
    """Return the largest ratio of a colour channel's response to mono's, over channels, bands and the curves used under noise."""
    bands, masks = Bands.paper(), np.ones((1, 2, 2), np.uint8)
    found = []
    for curves in (PHOTONS, PUBLISHED):
        mono, *colour = (matched_model(curves.of(name), bands, masks).response for name in SENSORS)
        found += [float((response / mono).max()) for response in colour]
    return max(found)


def _levels(config: ClaimsConfig) -> tuple[float, ...]:
    return (*config.light_e, *config.budget_e)


def _sizes(config: ClaimsConfig) -> list[int]:
    return sorted({config.size, config.bench_size, *(() if config.large is None else (config.large,))})


def _lamps(config: ClaimsConfig) -> str:
    from scenes import scene_by_name

    scenes: list[Any] = [scene_by_name(name) for name in (TARGET_1, TARGET_2, BENCH, scene_names(config)[0])]
    return listing(f"the library’s {name} lamp" for name in dict.fromkeys(scene.lamp.name for scene in scenes))
