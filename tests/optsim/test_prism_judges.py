"""The traced prism against optiland: a thousand random stacks, and whole spot diagrams off the axis."""

from importlib import resources

import numpy as np
import pytest

from optsim.camera import CameraConfig, DoubleAmici, PrismStack, glass, glass_names
from optsim.camera.arrays import NUMPY
from optsim.camera.glass import AIR

optic = pytest.importorskip("optiland.optic", reason="judge optiland is not installed")
materials = pytest.importorskip("optiland.materials")
rays = pytest.importorskip("optiland.rays")

PITCH_MM, FOCAL_MM = 0.0099, 100.0
SCHOTT = resources.files("optiland.database") / "data-nk" / "glass" / "schott"  # by name, optiland takes N-SF10 for SF10
MATERIALS = {name: materials.MaterialFile(str(SCHOTT / f"{name}.yml")) for name in glass_names()} | {"air": "air"}


def judge_of(faces, media, lenses=None):
    """Build the system; with lenses = (f1, f2), ideal ones stand around the prism."""
    system = optic.Optic()
    f1, f2 = (np.inf, 10.0) if lenses is None else lenses
    kind = [{}, {}] if lenses is None else [{"surface_type": "paraxial", "f": f} for f in lenses]
    system.surfaces.add(index=0, thickness=f1)
    system.surfaces.add(index=1, thickness=30.0, is_stop=True, **kind[0])
    for i, (tilt, name) in enumerate(zip(faces, (*media, "air"))):
        system.surfaces.add(index=2 + i, thickness=12.0, ry=tilt, material=MATERIALS[name])
    system.surfaces.add(index=2 + len(faces), thickness=f2, **kind[1])
    system.surfaces.add(index=3 + len(faces))
    system.wavelengths.add(value=0.55, is_primary=True)
    return system


def random_stack(rng):
    """Draw 1 to 5 media, no two neighbours alike, air only between glasses."""
    count = int(rng.integers(1, 6))
    media = [str(name) for name in rng.choice(glass_names(), count, replace=False)]
    for i in range(1, count - 1, 2):
        if rng.random() < 0.4:
            media[i] = "air"
    return rng.uniform(-0.25, 0.25, count + 1), media


def test_a_thousand_random_stacks_agree_with_optiland_to_1e_9_px():
    rng = np.random.default_rng(3)
    worst, compared, rays_each = 0.0, 0, 6
    for _ in range(1000):
        faces, media = random_stack(rng)
        L, M = rng.uniform(-0.1, 0.1, (2, rays_each))
        wavelength = rng.uniform(400, 700, rays_each)
        N = np.sqrt(1 - L**2 - M**2)
        zero = np.zeros(rays_each)
        bundle = rays.RealRays(zero, zero, zero - 1, L, M, N, zero + 1, wavelength / 1000)
        judge_of(faces, media).surfaces.trace(bundle)
        stack = PrismStack(glasses=tuple(AIR if m == "air" else glass(m) for m in media), face_tilt_rad=tuple(faces))
        traced = stack.directions(NUMPY, wavelength, L / N, M / N, stack.values._replace(collimator_mm=1.0))
        slope_x, slope_y = (np.asarray(v) / np.asarray(bundle.N) for v in (bundle.L, bundle.M))
        assert np.array_equal(traced.valid, np.isfinite(slope_x) & (np.asarray(bundle.N) > 0))
        keep = traced.valid
        error = np.maximum(np.abs(traced.kx / traced.kz - slope_x), np.abs(M / N / traced.kz - slope_y))[keep]
        worst, compared = max(worst, float(error.max(initial=0.0)) * FOCAL_MM / PITCH_MM), compared + int(keep.sum())
    assert compared > 5500
    assert worst < 1e-9


USERS = CameraConfig.parse_toml(
    "[prism]\nglasses = ['N-SK2', 'N-SF10', 'N-SK2']\nface_tilt_deg = [5.1, -24.138, 23.722, -5.516]\n"
    "[relay]\ncollimator_mm = 50.0\nfocal_mm = 50.0"
).dispersion


@pytest.mark.parametrize("prism", [DoubleAmici.default(), USERS], ids=["default", "user's"])
@pytest.mark.parametrize("corner", [(1.2, -1.6), (-3.5, 3.5)])
def test_a_whole_spot_diagram_off_the_axis_is_the_traced_point(prism, corner):
    u, v = np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 13))
    inside = u**2 + v**2 <= 1
    f1, f2 = prism.relay.collimator_mm, prism.relay.focal_mm
    system = judge_of(prism.stack.face_tilt_rad, [m.name for m in prism.media], (f1, f2))
    pupil = f1 / 16  # f/8
    for wavelength in (450.0, 550.0, 670.0):
        x, y = (np.full(int(inside.sum()), c) for c in corner)
        direction = np.stack([u[inside] * pupil - x, v[inside] * pupil - y, np.full(x.size, f1)])
        direction /= np.linalg.norm(direction, axis=0)
        bundle = rays.RealRays(x, y, np.full(x.size, -f1), *direction, np.ones(x.size), np.full(x.size, wavelength / 1000))
        system.surfaces.trace(bundle)
        traced = prism.trace(NUMPY, wavelength, -corner[0], -corner[1], prism.values)  # X and Y count along the inverted image
        assert traced[2]
        assert np.abs(np.asarray(bundle.x) - traced[0]).max() / PITCH_MM < 1e-9
        assert np.abs(np.asarray(bundle.y) - traced[1]).max() / PITCH_MM < 1e-9
