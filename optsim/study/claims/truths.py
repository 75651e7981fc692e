"""The true cubes that figures show, kept beside the solves so that a finished study needs no render."""

from __future__ import annotations

import numpy as np

from optsim import __version__
from optsim.cube import bands_of
from optsim.report.color import SceneLight
from optsim.report.data import Truth
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.worlds import BENCH, TARGET_1, TARGET_2, World
from optsim.study.store import Store, digest
from optsim.study.world import PHYSICS_VERSION


def shown_size(config: ClaimsConfig, scene: str) -> int | None:
    """Return at which size a scene's cubes are shown; None: never."""
    return {TARGET_1: config.large or config.size, TARGET_2: config.large or config.size, BENCH: config.bench_size}.get(scene)


def keep_truth(config: ClaimsConfig, world: World, store: Store) -> None:
    """Keep the true cube of a world that figures show."""
    if shown_size(config, world.scene) == world.size:
        name = _name(world.scene, world.size)
        store.keep(name, _key(config, world.scene, world.size), {}, {f"{name}.nc": world.cube})


def truth_of(config: ClaimsConfig, scene: str, size: int, store: Store) -> Truth:
    """Return a true cube as the report shows it, rendered where it is not kept."""
    name = _name(scene, size)
    if store.finished(name, _key(config, scene, size)) is None:
        keep_truth(config, World(scene, size, config.render_error, config.seed), store)
    cube = store.load(f"{name}.nc")
    bands = bands_of(cube)
    return Truth(np.asarray(cube["radiance"].values, np.float64), bands, light=SceneLight.of(cube.attrs.get("illuminant"), bands.count))


def _name(scene: str, size: int) -> str:
    return f"cubes/{scene}-{size}"


def _key(config: ClaimsConfig, scene: str, size: int) -> str:
    what = [scene, size, config.seed, config.render_error]
    return digest({"stage": "claims truth", "version": [__version__, PHYSICS_VERSION], "what": what})
