"""A made-up run for testing the report: invented cubes, but every score is computed from them."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
import pytest

from optsim.cube import PAPER_CENTERS_NM, Bands
from optsim.report.data import SERIES, Capture, Frames, Response, RunData, Solve, TauScore, Truth

WANTED_DB = {  # target -> series -> dB at R = 1/8, from which the invented noise is sized
    "color-checker": {"mono-distinct": 27.3, "mono-repeated": 20.8, "bayer": 23.7, "foveon": 26.9},
    "color-checker-bars": {"mono-distinct": 17.2, "mono-repeated": 14.5, "bayer": 15.1, "foveon": 16.0},
}


def checker(size: int, bands: Bands, bars: bool) -> np.ndarray:
    """Paint 24 smooth reflectances under a sloping lamp on a dark board."""
    rng = np.random.Generator(np.random.Philox(7))
    wl = bands.center
    lamp = 0.012 * (1 - 0.45 * ((wl - 470) / 200) ** 2 / 2)
    cube = np.full((size, size, bands.count), 0.04)
    patch = max(1, size // 7)
    for i in range(24):
        r, c = divmod(i, 6)
        y, x = (2 * r + 1) * size // 9, c * size // 6 + size // 40
        level = 0.9 - 0.16 * c if r == 3 else None
        spectrum = (
            np.full(bands.count, level)
            if level
            else 0.08 + 0.7 / (1 + np.exp(-(wl - rng.uniform(440, 660)) / rng.uniform(8, 40) * rng.choice([-1, 1])))
        )
        cube[y : y + patch, x : x + patch] = spectrum
    if bars:
        yy, xx = np.mgrid[:size, :size]
        cube[((yy + xx) % 16 < 2) & (yy < size // 2)] = 0.95
        cube[(yy > size * 0.6) & (xx < size // 2) & (xx % 4 < 2)] = 0.95
        cube[(yy > size * 0.6) & (xx >= size // 2) & (xx % 2 < 1)] = 0.95
    return cube * lamp


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.mean(10 * np.log10(b.max() ** 2 / np.mean((a - b) ** 2, axis=(0, 1)))))


def make_run(
    size: int = 48,
    targets: tuple[str, ...] = ("color-checker", "color-checker-bars"),
    ratios: tuple[float, ...] = (0.125, 0.25, 0.375, 0.5),
    wanted: dict[str, dict[str, float]] | None = None,
    rename: Callable[[str], str] = str,
    gpsr: bool = True,
    physical: bool = True,
) -> RunData:
    """Return a run whose rows are scored from invented estimates."""
    bands = Bands.paper()
    wanted = wanted or WANTED_DB
    truths = {rename(t): Truth(checker(size, bands, t.endswith("bars")), bands, np.full((size, size, 24), 3e-5)) for t in targets}
    cubes: dict[Solve, np.ndarray] = {}
    rows: list[dict[str, object]] = []
    tau_path: list[TauScore] = []

    def solve(
        target: str, series_key: str, R: float, model: str, operator: str, solver: str, rule: str | None, lose: float, tau: float | None
    ) -> None:
        series = next(s for s in SERIES if s.key == series_key)
        truth = truths[rename(target)].radiance
        db = wanted[target][series_key] + 12 * (R - 0.125) - lose
        rng = np.random.Generator(np.random.Philox(zlib.crc32(f"{series_key} {R}".encode())))
        noise = rng.standard_normal((*truth.shape[:2], 4)) @ rng.standard_normal((4, 24))
        noise = noise / np.sqrt(np.mean(noise**2, axis=(0, 1)))
        cube = truth + noise * truth.max() * 10 ** (-db / 20)
        key = Solve(Capture(rename(target), series.sensor, series.masks, R, model), operator, solver, rule, 0)
        cubes[key] = cube
        rows.append(
            {
                "target": key.capture.target,
                "sensor": series.sensor,
                "masks": series.masks,
                "R": R,
                "shots": round(R * 24 / (1 if series.sensor == "mono" else 3)),
                "model": model,
                "operator": operator,
                "solver": solver,
                "tau": tau,
                "tau_rule": rule,
                "psnr_db": psnr(cube, truth),
                "ssim": 0.8 + R / 10,
                "sam_deg": 12 - 4 * R,
                "seconds": 5.1 + R,
                "iterations": 400,
                "stop": "relative change below 1e-4",
                "converged": db > 15,
                "seed": 0,
                "data_range": float(truth.max()),
            }
        )

    for target in targets:
        for s in SERIES:
            for R in ratios:
                solve(target, s.key, R, "matched", "unit-shift", "basis-pursuit", None, 0, None)
            if gpsr:
                for R in sorted({ratios[0], ratios[-1]}):
                    for i, fraction in enumerate((1e-2, 3e-3, 1e-3, 3e-4, 1e-4)):
                        lose = abs(i - (2 if s.key == "bayer" else 3)) * 0.8 + 0.4
                        db = wanted[target][s.key] + 12 * (R - 0.125) - lose
                        tau_path.append(TauScore(rename(target), s.sensor, s.masks, R, fraction * 2.0, fraction, db, 0.1 + lose / 100))
                    solve(target, s.key, R, "matched", "unit-shift", "gpsr", "auto", 1.2 if s.key == "foveon" else 0.4, 6e-4)
                    solve(target, s.key, R, "matched", "unit-shift", "gpsr", "oracle", 0.4, 2e-3 if s.key == "bayer" else 6e-4)
            if physical:
                solve(target, s.key, 0.125, "physical", "unit-shift", "basis-pursuit", None, 0.8 if s.sensor == "mono" else 0.2, None)
                solve(target, s.key, 0.125, "physical", "camera", "basis-pursuit", None, 0.1, None)

    def frames(capture: Capture) -> Frames | None:
        if capture.target not in truths:
            return None
        truth = truths[capture.target].radiance
        shots = round(capture.R * 24 / (1 if capture.sensor == "mono" else 3))
        channels = 3 if capture.sensor == "foveon" else 1
        mask = np.random.Generator(np.random.Philox(3)).random(truth.shape[:2]) < 0.5
        wide = np.zeros((shots, channels, size, size + 23))
        for k in range(24):
            wide[..., k : k + size] += truth[..., k] * mask
        cfa = np.tile([[0, 1], [1, 2]], (size, size + 23))[:size, : size + 23] if capture.sensor == "bayer" else None
        return Frames(wide, "relative", cfa)

    wl = np.arange(400.0, 701, 10)

    def bump(c: float, w: float) -> np.ndarray:
        return np.exp(-(((wl - c) / w) ** 2))

    responses = {
        "mono": Response(wl, {"mono": np.ones_like(wl)}, "flat"),
        "bayer": Response(wl, {"red": bump(600, 45), "green": bump(535, 45), "blue": bump(465, 35)}, "invented"),
        "foveon": Response(wl, {"red": bump(590, 80), "green": bump(550, 90), "blue": bump(480, 90)}, "invented"),
    }
    centers = np.array(PAPER_CENTERS_NM, float)
    prism = {
        "wavelength_nm": np.linspace(450, 670, 45).tolist(),
        "position_px": np.interp(np.linspace(450, 670, 45), centers, np.arange(24.0)).tolist(),
        "nm_per_px": np.linspace(4.5, 17, 45).tolist(),
        "band_center_nm": centers.tolist(),
        "band_edge_nm": np.append(bands.lower, bands.upper[-1]).tolist(),
        "residual_to_paper_nm": (0.8 * np.sin(np.arange(24) / 4)).tolist(),
    }
    effect = {"name": "interreflection", "on": False, "reason": "one flat shape", "error_without": 0.0}
    return RunData(
        summary={"version": "0.1.0", "config": {"size": size, "seed": 0}, "machine": {"cores": 2, "cpu": "invented"}, "rows": rows},
        truths=truths,
        estimate=cubes.get,
        frames=frames,
        responses=responses,
        prism=prism,
        explain={t: {"scene": t, "effects": [effect]} for t in truths},
        tau_path=tau_path,
        lost_light={"outside the band-pass of 450-670 nm": 0.02},
        timings={"render": 3.0, "measure": 0.4, "reconstruct": 40.0},
        notes=["An invented run, for testing."],
        command="optsim run --seed 0",
    )


@pytest.fixture(scope="session")
def make() -> Callable[..., RunData]:
    return make_run


@pytest.fixture(scope="session")
def run() -> RunData:
    return make_run()
