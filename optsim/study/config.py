"""What a study runs: a frozen model, the same for Python, TOML and the command line."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator

from optsim.errors import InputError

Fraction = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Groups = Annotated[int, Field(ge=1, le=8)]


class StudyConfig(BaseModel):
    """Describe the default study: both targets of the paper, three sensors, four compression ratios.

    ``groups`` counts colour shots; a monochrome sensor gets three shots a group, so the compression ratio is
    R = 3 groups / 24 (Rueda, Lau, Arce 2015, section 3).

    Args:
        seed: root of every random stream, 0 to 2^32 - 1.
        size: mirrors along each side of the square coded aperture, 16 to 1024.
        targets: names of scenes, as ``optsim scenes`` lists them.
        groups: colour shots of the noise-free matched runs by basis pursuit.
        gpsr_groups: colour shots at which Eq. 4 is solved too, by GPSR, with automatic and oracle tau.
        physical_groups: colour shots at which data of the fine camera model are reconstructed.
        tau_fractions: grid of tau / tau_max for GPSR, descending; at most 5 values.
        wavelet: of the sparse basis, an orthogonal family of PyWavelets; levels: as deep as the picture allows, at most 5.
        render_error: relative error (RMSE per band) at which the render of the samples stops.
        subdivide: wavelengths inside every band of the fine cube, at least 10.
        oversample: samples along each side of a mirror, at least 2.
        workers: solves that run side by side; None: one a core.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    seed: int = Field(0, ge=0, le=2**32 - 1)
    size: int = Field(256, ge=16, le=1024)
    targets: tuple[str, ...] = Field(("color-checker", "color-checker-bars"), min_length=1)
    groups: tuple[Groups, ...] = Field((1, 2, 3, 4), min_length=1)
    gpsr_groups: tuple[Groups, ...] = (1, 4)
    physical_groups: tuple[Groups, ...] = (1,)
    tau_fractions: tuple[Fraction, ...] = Field((3e-4, 1e-4, 3e-5, 1e-5, 3e-6), min_length=1, max_length=5)
    wavelet: str = "db2"
    render_error: float = Field(0.005, gt=1e-5, le=1)
    subdivide: int = Field(10, ge=10, le=100)
    oversample: int = Field(2, ge=2, le=8)
    workers: int | None = Field(None, ge=1, le=256)

    @field_validator("tau_fractions")
    @classmethod
    def _descending(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if list(value) != sorted(set(value), reverse=True):
            raise ValueError("must be strictly descending, so that each solve starts warm from a larger tau")
        return value

    @field_validator("targets", "groups", "gpsr_groups", "physical_groups")
    @classmethod
    def _distinct(cls, value: tuple[object, ...]) -> tuple[object, ...]:
        if len(set(value)) != len(value):
            raise ValueError("must not name anything twice")
        return value

    @field_validator("wavelet")
    @classmethod
    def _orthogonal(cls, value: str) -> str:
        from recon import Kronecker

        return Kronecker(wavelet=value).wavelet

    @classmethod
    def quick(cls, seed: int = 0) -> StudyConfig:
        """Return the study of ``optsim run --quick``: 64 x 64, target 1, R = 1/8 and 1/2, three values of tau."""
        return cls(seed=seed, size=64, targets=("color-checker",), groups=(1, 4), tau_fractions=(1e-4, 3e-5, 1e-5))

    @classmethod
    def from_toml(cls, path: Path) -> StudyConfig:
        """Read a TOML file whose keys are this model's fields.

        Raises:
            InputError: for a missing or malformed file, or an unknown key, with the nearest known one.
            pydantic.ValidationError: for a value out of range.
        """
        try:
            if path.stat().st_size > 1 << 20:
                raise InputError("--config", str(path), "a TOML file of at most 1 MiB")
            table = tomllib.loads(path.read_text("utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError("--config", str(path), f"a readable TOML file ({error})") from None
        for key in table:
            if key not in cls.model_fields:
                near = difflib.get_close_matches(key, cls.model_fields, 1)
                hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(cls.model_fields)}"
                raise InputError(f"--config {key}", table[key], f"a known field ({hint})")
        return cls.model_validate(table)
