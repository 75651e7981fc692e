"""Words of the command line turned into objects, and what verbs print."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from optsim.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from optsim.camera import Sensor
    from optsim.camera.dmd import MaskRule
    from optsim.camera.knowledge import Knowledge
    from optsim.render.choice import Physics
    from recon.prior import Prior
    from recon.problem import Solver
    from recon.tau import TauRule
    from scenes.scene import Scene

Json = Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative="")]
Force = Annotated[list[str] | None, Parameter(help="An effect to compute whatever the scene requires; may be repeated.", negative="")]
Without = Annotated[list[str] | None, Parameter(help="An effect to leave out whatever the scene requires; may be repeated.", negative="")]
Output = Annotated[Path, Parameter(name=["--output", "-o"], help="File to write.")]
PAPER = "paper"
LINE_EVERY_S = 10.0
"""How often progress is told where it cannot be drawn over."""
ProgressCall = Callable[[float | None, str], None]


def find_scene(word: str) -> Scene:
    """Return a scene by its name, or from a .toml or .json file."""
    if word.endswith((".toml", ".json")):
        from scenes.files import read_scene

        return read_scene(Path(word))
    from scenes import scene_by_name

    return scene_by_name(word).build()


def sensor_named(word: str, curves: Path | None = None) -> Sensor:
    """Return the sensor of that name, with the curves of a CSV file if one is given.

    Raises:
        InputError: ``--sensor``, ``--curves``.
    """
    from optsim.camera import Bayer, Foveon, Mono
    from optsim.camera.quattro import Quattro

    made: dict[str, Callable[[], Sensor]] = {"mono": Mono, "bayer": Bayer.nikon, "foveon": Foveon.sigma}
    made |= {"mono-silicon": Mono.silicon, "foveon-physical": Foveon.physical, "quattro": Quattro.physical}
    own: dict[str, Callable[[Path], Sensor]] = {
        "mono": Mono.from_csv,
        "bayer": Bayer.from_csv,
        "foveon": Foveon.from_csv,
        "quattro": Quattro.from_csv,
    }
    if word not in made:
        raise InputError("--sensor", word, f"one of {', '.join(made)}")
    if curves is None:
        return made[word]()
    if word not in own:
        raise InputError("--curves", str(curves), f"given with --sensor {', '.join(own)}")
    return own[word](curves)


def knowledge_named(word: str) -> Knowledge:
    """Return what H is to know of the camera."""
    from optsim.camera import Exact, OwnShifts, UnitShift

    known: dict[str, Knowledge] = {"exact": Exact(), "camera": OwnShifts(), "unit-shift": UnitShift()}
    return known[word]


def mask_rule(word: str) -> MaskRule:
    """Return the rule of that name."""
    from optsim.camera import Distinct, Repeated

    return {rule.name: rule for rule in (Distinct(), Repeated())}[word]


def physics_named(field: str, names: Sequence[str]) -> tuple[Physics, ...]:
    """Return the effects of these names.

    Raises:
        InputError: ``field``.
    """
    from optsim.render.choice import effects_named

    return effects_named(field, names)


def solver_named(word: str, max_iterations: int | None, debias: bool) -> Solver:
    """Return a solver's configuration.

    Args:
        word: basis-pursuit, admm, gpsr, fista or gap.
        max_iterations: None leaves the solver's default.
        debias: refit the support (gpsr).

    Raises:
        InputError: ``--debias`` or ``--max-iterations``.
    """
    from recon import Admm, BasisPursuit, Fista, Gap, Gpsr

    if max_iterations is not None and max_iterations < 1:
        raise InputError("--max-iterations", max_iterations, "at least 1")
    limit = {} if max_iterations is None else {"max_iterations": max_iterations}
    if debias and word != "gpsr":
        raise InputError("--debias", debias, "given with --solver gpsr")
    if word == "gpsr":
        return Gpsr(debias=debias, **limit)
    made: dict[str, Callable[..., Solver]] = {"basis-pursuit": BasisPursuit, "admm": Admm, "fista": Fista, "gap": Gap}
    return made[word](**limit)


def prior_named(word: str, wavelet: str, frames: xr.Dataset) -> Prior:
    """Return the prior of that name for the cube that these frames show.

    Args:
        word: l1, group-l1, tv or quality.
        wavelet: of l1, group-l1 and quality.
        frames: whose sizes and bands count.

    Raises:
        InputError: ``--prior`` when quality knows nothing of these bands.
    """
    from recon import L1, GroupL1, Kronecker, SpectralTotalVariation

    if word == "tv":
        return SpectralTotalVariation()
    if word == "quality":
        from optsim.cube import bands_of
        from optsim.study.library import quality

        try:
            known = quality(bands_of(frames))
        except InputError as error:
            form = f"tv, l1 or group-l1, as quality needs bands {error.allowed} (in Python recon.Quality() needs no library)"
            raise InputError("--prior", f"quality for bands from {error.value}", form) from None
        return known.model_copy(update={"wavelet": Kronecker(wavelet=wavelet).wavelet})
    basis = Kronecker.for_shape((frames.sizes["mirror_y"], frames.sizes["mirror_x"], frames.sizes["wavelength"]), wavelet=wavelet)
    return L1(basis=basis) if word == "l1" else GroupL1(basis=basis)


def tau_named(word: str | None, solver: str) -> TauRule | None:
    """Return the rule for tau: ``auto``, None (the solver's own), ``discrepancy`` or a fraction of tau_max, as text.

    Raises:
        InputError: ``--tau``.
    """
    from recon.tau import AutoTau, Discrepancy, TauFraction

    if word is None:
        return None
    if solver in ("basis-pursuit", "gap"):
        raise InputError("--tau", word, f"absent with --solver {solver}, which needs none")
    if word in ("auto", "discrepancy"):
        return AutoTau() if word == "auto" else Discrepancy()
    allowed = "auto, discrepancy, or a fraction of tau_max from 0 to 1"
    try:
        fraction = float(word)
    except ValueError:
        raise InputError("--tau", word, allowed) from None
    if not 0 <= fraction <= 1:
        raise InputError("--tau", word, allowed)
    return TauFraction(fraction=fraction)


def known_noise(frames: xr.Dataset, path: Path, option: str) -> np.ndarray:
    """Return the variance of each measurement.

    Raises:
        InputError: ``option``, what the user asked for, for frames that don't tell it.
    """
    from optsim.camera import noise_unknown, noise_variance

    variance = noise_variance(frames)
    if variance is None:
        made = "as measure --noise and import-measurement --gain --read-noise write them"
        form = f"given with frames in DN that have the attributes gain, read_noise_e and dark_e_per_s, {made}"
        raise InputError(option, f"{path}: {noise_unknown(frames)}", form)
    return variance


def print_json(value: Mapping[str, object]) -> None:
    """Print one JSON object; refuses NaN and infinity."""
    print(json.dumps(value, allow_nan=False))


@contextmanager
def progress_bar(what: str) -> Iterator[ProgressCall]:
    """Give ``progress(fraction or None, text)``, shown on standard error: as a bar on a terminal, else as a line every ten seconds."""
    if not sys.stderr.isatty():
        yield _progress_lines(what)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn(what),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        last = 0.0

        def show(fraction: float | None, text: str) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last < 0.1 and fraction != 1:
                return
            last = now
            if fraction is None:
                bar.update(task, description=text)
            else:
                bar.update(task, total=1.0, completed=fraction, description=text)

        yield show


def _progress_lines(what: str) -> ProgressCall:
    last = time.monotonic()

    def tell(fraction: float | None, text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= LINE_EVERY_S:
            last = now
            done = "" if fraction is None else f" {fraction:.0%}"
            print(f"{what}{done}{' ' if text else ''}{text}", file=sys.stderr, flush=True)

    return tell


def wrote(path: Path, shape: tuple[int, ...], what: str) -> None:
    """Tell on standard error what was written."""
    print(f"{path}: {' x '.join(map(str, shape))} {what}", file=sys.stderr)
