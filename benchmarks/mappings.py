"""Measure every way to map wavelengths and field to the sensor: error in px and speed as a ratio, in one run.

    python -m benchmarks.mappings [--rays 1000000]

Errors are against the exact trace of the default prism over 450-670 nm, on the axis and over a field of +-3.5 mm. Speeds
are ratios to the exact trace (NumPy) and to a kernel that only reads three numbers and writes two (Dr.Jit). The last table
is the exact trace against the four roots and three divisions that it cannot do without.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from optsim.camera import CenterTable, DoubleAmici
from optsim.camera.arrays import Kernels, kernels
from optsim.camera.field_maps import FieldPolynomial, ParaxialMap, WholePixel
from optsim.camera.mappings import AxialMap, CauchyMap, LinearMap, PolynomialMap, SplineMap

RANGE, HALF_MM = (450.0, 670.0), 3.5
ROUNDS = 25


def entries(prism: DoubleAmici) -> list[tuple[str, object]]:
    return [
        ("exact trace", prism),
        ("paraxial wedges, one scale", ParaxialMap.fit(prism, RANGE)),
        ("linear", LinearMap.fit(prism, RANGE)),
        *((f"polynomial of degree {d}", PolynomialMap.fit(prism, RANGE, d)) for d in (2, 3, 4, 5, 7)),
        *((f"degree {d} in 1/wavelength^2", CauchyMap.fit(prism, RANGE, d)) for d in (1, 2, 3, 5)),
        *((f"spline of {n} knots", SplineMap.fit(prism, RANGE, n)) for n in (12, 24, 64)),
        ("field polynomial, degree 5", FieldPolynomial.fit(prism, RANGE, HALF_MM)),
        ("its own 24 centres (table)", CenterTable.fit(prism, RANGE)),
        ("the paper's 24 centres (table)", CenterTable()),
        ("whole pixels", WholePixel.fit(prism, RANGE)),
    ]


def errors(mapping: object, prism: DoubleAmici) -> tuple[float, float]:
    wavelength, field = np.linspace(*RANGE, 2201), np.linspace(-HALF_MM, HALF_MM, 15)
    axis = np.abs(mapping.position_px(wavelength)[0] - prism.position_px(wavelength)[0]).max()
    points = wavelength[::55, None, None], field[:, None], field
    one, other = mapping.position_px(*points), prism.position_px(*points)
    return float(axis), float(max(np.hypot(one[0] - other[0], one[1] - other[1]).max(), axis))


def best_of_all(works: dict[str, Callable[[], float]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the least time of each, measured in turn so that a busy machine hurts all alike."""
    least = dict.fromkeys(works, np.inf)
    for _ in range(rounds):
        for name, work in works.items():
            least[name] = min(least[name], work())
    return least


def numpy_ratios(prism: DoubleAmici, rays: int) -> dict[str, float]:
    rng = np.random.default_rng(0)
    host = rng.uniform(*RANGE, rays), *rng.uniform(-1.75, 1.75, (2, rays))

    def timed(mapping: object) -> Callable[[], float]:
        def work() -> float:
            start = time.perf_counter()
            mapping.position_px(*host)
            return time.perf_counter() - start

        return work

    least = best_of_all({name: timed(mapping) for name, mapping in entries(prism)})
    return {name: least["exact trace"] / spent for name, spent in least.items()}


def formula(k: Kernels, mapping: object, arrays: list, values: object) -> tuple | None:
    """Return (x, y) of a mapping that is a formula, as Dr.Jit arrays."""
    wavelength, X, Y = arrays
    if isinstance(mapping, DoubleAmici):
        return mapping.trace(k.ops, *arrays, values)[:2]
    if isinstance(mapping, FieldPolynomial):
        return mapping.formula(*arrays)
    if isinstance(mapping, AxialMap) and not isinstance(mapping, SplineMap):
        along = mapping.formula(k.ops, wavelength) if isinstance(mapping, ParaxialMap) else mapping.along(wavelength)
        return along + mapping.magnification_px * X, mapping.magnification_px * Y
    return None


def kernel_time(k: Kernels, make: Callable[[], tuple]) -> float:
    """Return the ms that the kernels of one evaluation ran, as Dr.Jit counts them."""
    k.dr.kernel_history_clear()
    k.dr.eval(*make())
    k.dr.sync_thread()
    return sum(entry["execution_time"] for entry in k.dr.kernel_history() if entry["type"] == k.dr.KernelType.JIT)


def kernel_tables(k: Kernels, prism: DoubleAmici, rays: int) -> tuple[dict[str, float], list[str]]:
    dr, rng = k.dr, np.random.default_rng(0)
    host = rng.uniform(*RANGE, rays), *rng.uniform(-1.75, 1.75, (2, rays))
    ratios, lines = {}, []
    for kind, digits in ((k.backend.Float64, np.float64), (k.backend.Float, np.float32)):
        arrays = [kind(v.astype(digits)) for v in host]
        values, one = prism.opaque_values(k, kind), dr.opaque(kind, 1.0)
        dr.eval(arrays, values)
        w, X, Y = arrays

        def copy(w=w, X=X, Y=Y) -> tuple:
            return w + X, X + Y

        def limit(w=w, X=X, Y=Y, one=one) -> tuple:
            p, q = X * X + one, Y * Y + one
            return (dr.sqrt(w) + dr.sqrt(p)) / p + one / q, (dr.sqrt(q) + dr.sqrt(w + p)) / w

        works = {"copy": copy, "limit": limit, "trace": lambda a=arrays, v=values: formula(k, prism, a, v)}
        least = best_of_all({name: (lambda make=make: kernel_time(k, make)) for name, make in works.items()}, 4 * ROUNDS)
        lines.append(f"{digits.__name__:10s}{least['trace'] / least['limit']:18.2f}{least['trace'] / least['copy']:14.2f}")
        if digits is np.float64:
            maps = {name: mapping for name, mapping in entries(prism) if formula(k, mapping, arrays, values) is not None}
            works = {"copy": copy} | {name: (lambda m=m, a=arrays, v=values: formula(k, m, a, v)) for name, m in maps.items()}
            least = best_of_all({name: (lambda make=make: kernel_time(k, make)) for name, make in works.items()})
            ratios = {name: spent / least["copy"] for name, spent in least.items()}
    return ratios, lines


def main(rays: int) -> None:
    prism, k = DoubleAmici.default(), kernels()
    host = numpy_ratios(prism, min(rays, 200_000))
    kernel: dict[str, float] = {}
    lines: list[str] = []
    if k is not None:
        with k.dr.scoped_set_flag(k.dr.JitFlag.KernelHistory, True):
            kernel, lines = kernel_tables(k, prism, rays)
    print("| mapping | error on the axis, px | over +-3.5 mm, px | NumPy: speed / exact trace | Dr.Jit float64: time / copy |")
    print("| --- | --- | --- | --- | --- |")
    for name, mapping in entries(prism):
        axis, field = errors(mapping, prism)
        spent = f"{kernel[name]:.2f}" if name in kernel else "-"
        print(f"| {name} | {axis:.2g} | {field:.2g} | {host[name]:.1f} | {spent} |")
    if not lines:
        print("no usable libLLVM: no kernels")
        return
    print("\nexact trace   / (4 roots + 3 divisions)   / copy")
    print("\n".join(lines))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=1_000_000)
    main(parser.parse_args().rays)
