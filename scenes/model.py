"""The base of all configs here: frozen, closed, finite; refuses misuse with InputError naming the whole path."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationError

from scenes.errors import InputError

LENGTH_LIMIT_M = 1e9
"""Coordinates above this are a mistake of units, not a scene."""


class Model(BaseModel):
    """A frozen pydantic model whose constructor raises InputError(field, value, allowed) for the first fault.

    ``place`` names the model's role in messages of its own constructor, e.g. ``material.reflectance``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)
    place: ClassVar[str] = ""

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise _first_fault(error, type(self)) from None


def _first_fault(error: ValidationError, model: type[Model]) -> InputError:
    faults = error.errors(include_url=False)
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    path = [str(part) for part in fault["loc"]]
    inner = fault.get("ctx", {}).get("error")
    value, allowed = fault.get("input"), _sentence(fault["type"], fault["msg"], model, path)
    if isinstance(inner, InputError):
        value, allowed = inner.value, inner.allowed
        path += [part for part in inner.field.split(".") if part]
    if model.place and path[:1] != [model.place]:
        path = [model.place, *path]
    return InputError(".".join(path) or model.__name__, value, allowed)


def _sentence(kind: str, message: str, model: type[Model], path: list[str]) -> str:
    if kind == "missing":
        return "given"
    if kind == "extra_forbidden":
        return f"one of the fields {', '.join(model.model_fields)}{did_you_mean(path[-1], model.model_fields)}"
    prefix = "Input should be "
    return message.removeprefix(prefix) if message.startswith(prefix) else message


def ranged(low: float, high: float, unit: str, form: str = "[]") -> Any:
    """Return a pydantic validator for a float in a range whose ends are closed "[]" or open "()"."""

    def check(value: float) -> float:
        above = value >= low if form[0] == "[" else value > low
        below = value <= high if form[1] == "]" else value < high
        if not (above and below):
            raise InputError("", value, f"in {form[0]}{low:g}, {high:g}{form[1]}{' ' + unit if unit else ''}")
        return value

    return AfterValidator(check)


def did_you_mean(word: str, choices: Any) -> str:
    """Return `` (did you mean 'x'?)`` for the closest choice, or nothing."""
    import difflib

    lower = {str(choice).lower(): str(choice) for choice in choices}
    close = difflib.get_close_matches(str(word).lower(), list(lower), 1, 0.6)
    return f" (did you mean {lower[close[0]]!r}?)" if close else ""


def vector(value: Any) -> tuple[float, float, float]:
    """Return three finite numbers as a tuple, from any sequence or array of three.

    Raises:
        InputError: when they are not three, not finite, or above 1e9 in size.
    """
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise InputError("", value, "three numbers") from None
    if array.shape != (3,):
        raise InputError("", value, "three numbers")
    if not np.all(np.isfinite(array)) or np.any(np.abs(array) > LENGTH_LIMIT_M):
        raise InputError("", array.tolist(), f"three finite numbers within [-{LENGTH_LIMIT_M:g}, {LENGTH_LIMIT_M:g}] m")
    return float(array[0]), float(array[1]), float(array[2])


def _not_null(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise InputError("", value, "a vector of non-zero length")
    return value


Vector = Annotated[tuple[float, float, float], BeforeValidator(vector)]
"""Three finite coordinates in metres."""
Direction = Annotated[Vector, AfterValidator(_not_null)]
"""A vector of non-zero length."""
