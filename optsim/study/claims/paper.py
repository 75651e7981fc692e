"""What Rueda, Lau, Arce (Optics Express, 2015) claim, each as a size in dB and a way to measure it."""

from __future__ import annotations

from dataclasses import dataclass

from optsim.study.claims.measures import (
    BandsBelow,
    Drop,
    Gap,
    LargestGap,
    Measure,
    MoreShots,
    background_db,
    false_color_db,
    signature_db,
    tilt_from,
)
from optsim.study.claims.worlds import BENCH, TARGET_1, TARGET_2


@dataclass(frozen=True)
class Size:
    """What range of dB a claim allows.

    Args:
        low, high: in dB; high None: no upper end.
    """

    low: float
    high: float | None = None

    def met(self, value: float) -> bool:
        """Tell whether a number lies in the range."""
        return self.low <= value and (self.high is None or value <= self.high)

    def __str__(self) -> str:
        return f"above {self.low:g} dB" if self.high is None else f"{self.low:g} to {self.high:g} dB"


def tolerance(size_db: float) -> float:
    """Return how far a number read off a figure may be off: half a decibel or a quarter, whichever is larger."""
    return max(0.5, size_db / 4)


def about(size_db: float) -> Size:
    """Return the range of "about so many dB"."""
    return Size(max(0.0, size_db - tolerance(size_db)), size_db + tolerance(size_db))


def up_to(size_db: float) -> Size:
    """Return the range of "up to so many dB"."""
    return Size(0.0, size_db + tolerance(size_db))


@dataclass(frozen=True)
class PaperClaim:
    """One claim.

    Args:
        ident: a short name.
        text: as the paper has it, in our words.
        size: what it says in dB.
        measure: how it is measured.
        ours: whether it is a question of ours: what was said of two targets, asked of scenes at large.
    """

    ident: str
    text: str
    size: Size
    measure: Measure
    ours: bool = False


ANY = Size(0.0)

CLAIMS: tuple[PaperClaim, ...] = (
    PaperClaim("target1-bayer-mono", "Target 1: Bayer up to 3 dB above mono", up_to(3), Gap("bayer", "mono", (TARGET_1,))),
    PaperClaim(
        "target1-bayer-most",
        "Target 1: Bayer's largest gap over mono, of all R, is about 3 dB",
        about(3),
        LargestGap("bayer", "mono", TARGET_1),
    ),
    PaperClaim("target1-foveon-mono", "Target 1: Foveon about 4 dB above mono", about(4), Gap("foveon", "mono", (TARGET_1,))),
    PaperClaim("target1-foveon-bayer", "Target 1: Foveon about 1 dB above Bayer", about(1), Gap("foveon", "bayer", (TARGET_1,))),
    PaperClaim("target2-bayer-mono", "Target 2: Bayer about 1.5 dB above mono", about(1.5), Gap("bayer", "mono", (TARGET_2,))),
    PaperClaim("target2-foveon-mono", "Target 2: Foveon about 2 dB above mono", about(2), Gap("foveon", "mono", (TARGET_2,))),
    PaperClaim("target2-foveon-bayer", "Target 2: Foveon about 0.5 dB above Bayer", about(0.5), Gap("foveon", "bayer", (TARGET_2,))),
    PaperClaim("target2-harder", "Target 2 is about 10 dB below target 1 for every sensor", about(10), Drop()),
    PaperClaim("spectrum-bayer", "Bayer's error lies below mono's in every band (both targets)", ANY, BandsBelow("bayer")),
    PaperClaim("spectrum-foveon", "Foveon's error lies below mono's in every band (both targets)", ANY, BandsBelow("foveon")),
    PaperClaim(
        "target2-aliasing",
        "Target 2: Bayer shows colour aliasing, Foveon does not (at most half of Bayer's false colour)",
        Size(6.0),
        Gap("bayer", "foveon", (TARGET_2,), false_color_db),
    ),
    PaperClaim("more-shots", "Every sensor improves with the number of shots (both targets)", ANY, MoreShots()),
    PaperClaim("scenes-bayer-mono", "Random scenes: Bayer above mono", ANY, Gap("bayer", "mono", ()), ours=True),
    PaperClaim("scenes-foveon-mono", "Random scenes: Foveon above mono", ANY, Gap("foveon", "mono", ()), ours=True),
    PaperClaim("scenes-foveon-bayer", "Random scenes: Foveon above Bayer", ANY, Gap("foveon", "bayer", ()), ours=True),
    PaperClaim("bench-bayer-mono", "Test bed: Bayer 2 to 4 dB above mono", Size(1.5, 4.5), Gap("bayer", "mono", (BENCH,))),
    PaperClaim("bench-foveon-mono", "Test bed: Foveon 2 to 4 dB above mono", Size(1.5, 4.5), Gap("foveon", "mono", (BENCH,))),
    PaperClaim(
        "bench-long-waves",
        "Test bed: Foveon gains more over mono from 600 nm on than below",
        ANY,
        Gap("foveon", "mono", (BENCH,), tilt_from(600.0)),
    ),
    PaperClaim(
        "bench-signatures",
        "Test bed: Foveon's spectral signatures lie closer to the truth than mono's",
        ANY,
        Gap("foveon", "mono", (BENCH,), signature_db),
    ),
    PaperClaim(
        "bench-background",
        "Test bed: mono's signatures ride on a background, Foveon's on less of it",
        ANY,
        Gap("mono", "foveon", (BENCH,), background_db),
    ),
)
"""In the paper's order. Its remark that the Foveon "shows artefacts" has no number, and none is given here."""
