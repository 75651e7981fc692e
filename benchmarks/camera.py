"""Measure the camera's kernels as ratios in one run: the traced prism against a memory copy, Dr.Jit against NumPy, a photograph's parts.

    python benchmarks/camera.py [--rays 4000000] [--size 128]

Seconds depend on the machine and on what else it does; read the ratios.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from optsim.camera import CameraConfig, Distinct, DoubleAmici, Exposure, masks_for, photograph, sensors
from optsim.camera import collect as collect_module
from optsim.camera.arrays import NUMPY, kernels
from optsim.cube import Bands, make_cube


def best(work: Callable[[], object], repeat: int = 5) -> float:
    work()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def trace_rates(rays: int) -> None:
    k = kernels()
    if k is None:
        print("no usable libLLVM: the traced prism runs on NumPy only")
        return
    prism, dr = DoubleAmici.default(), k.dr
    rng = np.random.default_rng(0)
    host = [rng.uniform(450, 670, rays), rng.uniform(-1.75, 1.75, rays), rng.uniform(-1.75, 1.75, rays)]
    print(f"\ntraced double Amici prism, {rays:.0e} rays (3 numbers in, 2 out)")
    print(f"{'':26s}{'Mray/s':>10s}{'time / copy':>14s}")
    numpy_rays = min(rays, 500_000)
    few = [v[:numpy_rays] for v in host]
    numpy_time = best(lambda: prism.trace(NUMPY, *few, prism.values), 3)
    for name, kind in (("Dr.Jit float32", k.backend.Float), ("Dr.Jit float64", k.backend.Float64)):
        arrays = [kind(v.astype(np.float32 if "32" in name else np.float64)) for v in host]
        values = prism.opaque_values(k, kind)
        dr.eval(arrays, values)

        def copy(arrays=arrays) -> None:
            dr.eval(arrays[0] + arrays[1], arrays[1] + arrays[2])
            dr.sync_thread()

        def trace(arrays=arrays, values=values) -> None:
            x, y, _ = prism.trace(k.ops, *arrays, values)
            dr.eval(x, y)
            dr.sync_thread()

        base, spent = best(copy), best(trace)
        print(f"{name:26s}{rays / spent / 1e6:10.1f}{spent / base:14.2f}")
    print(f"{'NumPy float64':26s}{numpy_rays / numpy_time / 1e6:10.1f}")


def photographs(size: int) -> None:
    bands, camera = Bands.paper(), CameraConfig().ideal()
    fine = bands.subdivide(10, (450, 670))
    cube = make_cube(np.random.default_rng(0).random((2 * size, 2 * size, fine.count), dtype=np.float32), fine)
    memory = cube["radiance"].values
    copy = best(lambda: memory.copy(), 3)
    print(f"\nphotograph of {2 * size} x {2 * size} x {fine.count} samples; a copy of the cube is 1")
    for sensor in sensors():
        shots = sensor.shots_per_group
        masks = masks_for(sensor, shots, Distinct(), (size, size), 0)
        spent = best(lambda s=sensor, m=masks: photograph(cube, bands, camera, s, m, Exposure(time_s=1.0)), 2)
        print(f"  {sensor.name:8s}{shots} shot(s)  {spent / copy:8.1f} copies, {spent:6.2f} s")
    small = 24
    cube = make_cube(np.random.default_rng(0).random((2 * small, 2 * small, fine.count), dtype=np.float32), fine)
    masks = masks_for(sensors()[0], 1, Distinct(), (small, small), 0)
    fast = best(lambda: photograph(cube, bands, camera, sensors()[0], masks, Exposure(time_s=1.0)), 3)
    known = collect_module.kernels
    collect_module.kernels = lambda: None
    try:
        slow = best(lambda: photograph(cube, bands, camera, sensors()[0], masks, Exposure(time_s=1.0)), 1)
    finally:
        collect_module.kernels = known
    print(f"  gather in Dr.Jit against scatter in NumPy, {small} x {small} mirrors: {slow / fast:.1f} times faster")


def against_the_trace(size: int) -> None:
    """Photograph 2 x 2 samples a mirror and 10 wavelengths a band, and trace as many rays exactly, in turns."""
    k = kernels()
    if k is None:
        return
    prism, dr, rng, rays = DoubleAmici.default(), k.dr, np.random.default_rng(0), 4_000_000
    host = (rng.uniform(450, 670, rays), rng.uniform(-1.75, 1.75, rays), rng.uniform(-1.75, 1.75, rays))
    arrays, values = [k.backend.Float64(v) for v in host], prism.opaque_values(k, k.backend.Float64)
    dr.eval(arrays, values)

    def trace() -> None:
        x, y = prism.trace(k.ops, *arrays, values)[:2]
        dr.eval(x, y)
        dr.sync_thread()

    bands = Bands.paper()
    fine = bands.subdivide(10)
    cube = make_cube(rng.random((2 * size, 2 * size, fine.count), dtype=np.float32), fine)
    print(f"\nphotograph of {2 * size} x {2 * size} x {fine.count} samples, the exact trace of as many rays being 1")
    for name, camera in (("ideal", CameraConfig().ideal()), ("default", CameraConfig())):
        for sensor in sensors():
            masks = masks_for(sensor, 1, Distinct(), (size, size), 0)
            work, whole, part = (lambda c=camera, s=sensor, m=masks: photograph(cube, bands, c, s, m, Exposure(time_s=1.0))), [], []
            for _ in range(4):
                part.append(best(trace, 2))
                whole.append(best(work, 1))
            print(f"  {name:8s} {sensor.name:8s} {min(whole) / min(part) * rays / (4 * size**2 * fine.count):6.1f}")


def growth(size: int) -> None:
    """Photograph twice the pixels, and twice the wavelengths: time a sample, that of the plain cube being 1."""
    bands, rng = Bands.paper(), np.random.default_rng(0)
    cases = {"plain": (size, 10), "twice the rows and columns": (2 * size, 10), "twice the wavelengths": (size, 20)}
    print(f"\ntime a sample (linear: at most 1, less where fixed work counts), from {2 * size} x {2 * size} x {bands.count * 10} samples")
    for name, camera in (("ideal", CameraConfig().ideal()), ("default", CameraConfig())):
        works = {}
        for case, (side, parts) in cases.items():
            fine = bands.subdivide(parts)
            cube = make_cube(rng.random((2 * side, 2 * side, fine.count), dtype=np.float32), fine)
            masks = masks_for(sensors()[0], 1, Distinct(), (side, side), 0)
            works[case] = (
                lambda c=cube, m=masks, camera=camera: photograph(c, bands, camera, sensors()[0], m, Exposure(time_s=1.0)),
                cube["radiance"].size,
            )
        spent: dict[str, list[float]] = {case: [] for case in works}
        for _ in range(3):
            for case, (work, samples) in works.items():
                spent[case].append(best(work, 1) / samples)
        plain = min(spent["plain"])
        print(f"  {name:8s}" + ", ".join(f"{case} {min(times) / plain:.2f}" for case, times in spent.items() if case != "plain"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=4_000_000)
    parser.add_argument("--size", type=int, default=128, help="mirrors along a side")
    arguments = parser.parse_args()
    trace_rates(arguments.rays)
    photographs(arguments.size)
    against_the_trace(arguments.size)
    growth(arguments.size // 2)
