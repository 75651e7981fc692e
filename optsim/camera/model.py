"""The base of the camera's configs: frozen, closed, finite; misuse raises InputError with the whole path."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from optsim.errors import InputError


class Model(BaseModel):
    """A frozen pydantic model whose constructor raises InputError(field, value, allowed) for the first fault.

    ``place`` names the model's role in messages, e.g. ``camera.relay``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)
    place: ClassVar[str] = ""

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise _first_fault(error, type(self)) from None

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with some fields changed (not validated); what was cached of the old values is forgotten."""
        copy = super().model_copy(update=update, deep=deep)
        for name in set(copy.__dict__) - set(type(self).model_fields):
            del copy.__dict__[name]
        return copy


def ranged(low: float, high: float, unit: str, form: str = "[]") -> Any:
    """Return a pydantic validator for a float in a range whose ends are closed "[]" or open "()"."""

    def check(value: float) -> float:
        above = value >= low if form[0] == "[" else value > low
        below = value <= high if form[1] == "]" else value < high
        if not (above and below):
            raise InputError("", value, f"in {form[0]}{low:g}, {high:g}{form[1]} {unit}".rstrip())
        return value

    return AfterValidator(check)


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the closest choice, or nothing."""
    lower = {str(choice).lower(): str(choice) for choice in choices}
    close = difflib.get_close_matches(str(word).lower(), list(lower), 1, 0.6)
    return f" (did you mean {lower[close[0]]!r}?)" if close else ""


def _first_fault(error: ValidationError, model: type[Model]) -> InputError:
    faults = error.errors(include_url=False)
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    path = [str(part) for part in fault["loc"]]
    inner = fault.get("ctx", {}).get("error")
    value, allowed = fault.get("input"), _sentence(fault, model, path)
    if isinstance(inner, InputError):
        value, allowed = inner.value, inner.allowed
        path += [part for part in inner.field.split(".") if part and part not in path]
    if model.place and path[:1] != [model.place]:
        path = [model.place, *path]
    return InputError(".".join(path) or model.__name__, value, allowed)


def _sentence(fault: Any, model: type[Model], path: list[str]) -> str:
    if fault["type"] == "missing":
        return "given"
    if fault["type"] == "extra_forbidden":
        fields = _fields_at(model, path[:-1])
        return f"one of the keys {', '.join(fields)}{did_you_mean(path[-1], fields)}"
    return str(fault["msg"]).removeprefix("Input should be ")


def _fields_at(model: type[BaseModel], path: list[str]) -> list[str]:
    """List the keys allowed at a nested place of a model."""
    for name in path:
        field = model.model_fields.get(name)
        inner = [] if field is None else [field.annotation, *getattr(field.annotation, "__args__", ())]
        nested = [t for t in inner if isinstance(t, type) and issubclass(t, BaseModel)]
        if not nested:
            return []
        model = nested[0]
    return list(model.model_fields)
