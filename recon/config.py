"""The base of every configuration in this package: frozen, no unknown fields, errors that name the field."""

from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from recon.errors import InputError


class Config(BaseModel):
    """A frozen pydantic model whose constructor raises ``InputError`` for the first field that is wrong."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, *unnamed: Any, **values: Any) -> None:
        if unnamed:
            raise InputError(type(self).__name__, unnamed, f"given keyword arguments only: {_fields(self, '=...')}")
        try:
            super().__init__(**values)
        except ValidationError as error:
            first = error.errors()[0]
            inner = first.get("ctx", {}).get("error")
            if isinstance(inner, InputError):
                raise inner from None
            name = ".".join([type(self).__name__, *map(str, first["loc"])])
            if first["type"] == "missing":
                raise InputError(name, values, "given: it has no default") from None
            raise InputError(name, first.get("input"), _allowed(self, first["type"], first["msg"], first["loc"])) from None


def _allowed(config: Config, kind: str, message: str, place: tuple[int | str, ...]) -> str:
    """Turn pydantic's sentence into what follows "must be"."""
    if kind == "extra_forbidden":
        if not type(config).model_fields:
            return f"left out: {type(config).__name__} has no fields"
        near = get_close_matches(str(place[-1]), type(config).model_fields, n=1)
        return f"a field of {type(config).__name__}, which are {_fields(config)}" + (f"; did you mean {near[0]}?" if near else "")
    what, has, rest = message.partition(" should have ")
    return f"a {what.lower()} with {rest}" if has else message.replace("Input should be", "").strip()


def _fields(config: Config, after: str = "") -> str:
    return ", ".join(name + after for name in type(config).model_fields)
