"""Which condition sorts the cases that hold from those that don't?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

Traits = dict[str, str]
"""Kind of condition -> the condition in words, true of one case."""

CLEAR = 0.7
"""A condition is named when so large a part of the cases that meet it hold, and at most the rest of the others."""
FEWEST = 5
"""Cases that must meet a condition, and that must miss it, before it is named: fewer show nothing but themselves."""
FEWEST_EXACT = 3
"""The same for a condition without exception."""


def condition(cases: Sequence[Traits], good: Sequence[bool]) -> str | None:
    """Return the condition, of one or two traits, that agrees best with ``good``, with its counts; None where none is clear."""
    best: tuple[float, str] | None = None
    for candidate in _candidates(cases):
        met = [candidate.items() <= case.items() for case in cases]
        inside, held = sum(met), sum(m and g for m, g in zip(met, good))
        rest, others = len(cases) - inside, sum(good) - held
        clear = held >= CLEAR * inside and others <= (1 - CLEAR) * rest
        exact = held == inside and others == 0
        if min(inside, rest) < (FEWEST_EXACT if exact else FEWEST) or not clear:
            continue
        agreement = (held + rest - others) / len(cases) - 1e-6 * len(candidate)  # of equals the simpler
        if best is None or agreement > best[0]:
            best = agreement, f"{_words(candidate)}: {held} of {inside} such cases, {others} of the {rest} others"
    return None if best is None else best[1]


def _candidates(cases: Sequence[Traits]) -> Iterator[Traits]:
    """Yield single traits, then pairs of two kinds, that some case has."""
    kinds = list(dict.fromkeys(kind for case in cases for kind in case))
    for chosen in [(kind,) for kind in kinds] + list(combinations(kinds, 2)):
        seen = {tuple((kind, case[kind]) for kind in chosen) for case in cases if all(kind in case for kind in chosen)}
        yield from (dict(found) for found in sorted(seen))


def _words(traits: Mapping[str, str]) -> str:
    first, *more = traits.values()
    return " ".join([first, *(f"and {text.removeprefix('if ')}" if text.startswith("if ") else text for text in more)])
