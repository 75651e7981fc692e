"""What the study of the paper's claims hands back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.judge import Judged, Overall
from optsim.study.claims.measures import Table
from optsim.study.claims.plan import Task


@dataclass(frozen=True, eq=False)
class Claims:
    """The study's answer.

    Args:
        config: what was run.
        rows: every claim under every reading.
        verdicts: one a claim.
        tables: by reading, what the claims were measured from.
        solved: every solve's row.
        folder: where everything lies.
        page: the page for a referee.
        seconds: wall time of the call.
    """

    config: ClaimsConfig
    rows: list[Judged]
    verdicts: list[Overall]
    tables: list[Table]
    solved: dict[Task, dict[str, Any]]
    folder: Path
    page: Path
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object: a claim over all readings first, then under each."""
        return {"claims": [v.as_dict() for v in self.verdicts] + [row.as_dict() for row in self.rows]}
