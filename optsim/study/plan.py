"""The list of work of a study: captures (what is photographed) and solves (what is inverted)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from optsim.report.data import SERIES, Capture, Series
from optsim.study.config import StudyConfig

BANDS = 24
MONO_SHOTS_PER_GROUP = 3

BASIS_PURSUIT = "basis-pursuit"
GPSR = "gpsr"
ADMM = "admm"
UNIT_SHIFT = "unit-shift"
CAMERA = "camera"
MATCHED = "matched"
PHYSICAL = "physical"


def shots_of(sensor: str, groups: int) -> int:
    """Return the exposures L of a sensor at one R: ``groups`` of a colour sensor, groups of three of a monochrome one."""
    return groups * (MONO_SHOTS_PER_GROUP if sensor == "mono" else 1)


def ratio_of(groups: int) -> float:
    """Return the compression ratio R, the same for all sensors."""
    return MONO_SHOTS_PER_GROUP * groups / BANDS


@dataclass(frozen=True)
class Shooting:
    """One capture: a target seen by one sensor with a number of groups of shots.

    Args:
        target: scene name.
        series: sensor and mask rule.
        groups: colour shots, or groups of three monochrome shots.
        model: ``matched`` or ``physical``.
    """

    target: str
    series: Series
    groups: int
    model: str

    @property
    def shots(self) -> int:
        """Return the number of exposures L."""
        return shots_of(self.series.sensor, self.groups)

    @property
    def physical(self) -> bool:
        """Tell whether the fine camera model makes the data."""
        return self.model == PHYSICAL

    @property
    def ratio(self) -> float:
        """Return R: L / K for mono, 3 L / K for colour."""
        return ratio_of(self.groups)

    @property
    def name(self) -> str:
        """Return the name of its frames file, without folder and suffix."""
        return f"{self.target}-{self.series.key}-R{self.groups}of8-{self.model}"

    @property
    def capture(self) -> Capture:
        """Return its identity in the report."""
        return Capture(self.target, self.series.sensor, self.series.masks, self.ratio, self.model)


@dataclass(frozen=True)
class SolveTask:
    """One reconstruction of a capture; solvers of Eq. 4 give two rows, automatic and oracle tau."""

    shooting: Shooting
    operator: str
    solver: str

    @property
    def name(self) -> str:
        """Return the name of its entry, without folder and suffix."""
        return f"{self.shooting.name}-{self.operator}-{self.solver}"

    @property
    def unit_shift(self) -> bool:
        """Tell whether H believes that band k falls exactly k columns on."""
        return self.operator == UNIT_SHIFT

    @property
    def needs_tau(self) -> bool:
        """Tell whether the solver minimises Eq. 4, whose tau has to be chosen."""
        return self.solver != BASIS_PURSUIT

    @property
    def cost(self) -> float:
        """Return the expected time relative to one-shot basis pursuit, for the progress bar and the order of work."""
        shots = self.shooting.shots * (3 if self.shooting.series.sensor == "foveon" else 1)
        base = 1 + 0.1 * shots
        return base * (5.0 if self.needs_tau else 1.5 if not self.unit_shift else 1.0)


def shootings(config: StudyConfig, target: str) -> Iterator[Shooting]:
    """Yield the captures of one target: matched at every R, physical where asked."""
    matched = {*config.groups, *config.gpsr_groups, *config.physical_groups}
    for model, groups in ((MATCHED, matched), (PHYSICAL, config.physical_groups)):
        for group in sorted(groups):
            for series in SERIES:
                yield Shooting(target, series, group, model)


def solves(config: StudyConfig) -> list[SolveTask]:
    """List all reconstructions, the headline's first.

    Physical data are not in the range of any H: an exact fit amplifies what H does not know, so they are inverted by
    ADMM on Eq. 4 beside basis pursuit, and matched data too, for comparison at the same solver.
    """
    tasks = []
    for target in config.targets:
        for shooting in shootings(config, target):
            if shooting.physical:
                tasks += [SolveTask(shooting, operator, solver) for operator in (UNIT_SHIFT, CAMERA) for solver in (BASIS_PURSUIT, ADMM)]
                continue
            wanted = ((BASIS_PURSUIT, config.groups), (GPSR, config.gpsr_groups), (ADMM, config.physical_groups))
            tasks += [SolveTask(shooting, UNIT_SHIFT, solver) for solver, groups in wanted if shooting.groups in groups]
    return tasks
