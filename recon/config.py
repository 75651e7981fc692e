"""The base of every configuration in this package: frozen, no unknown fields, errors that name the field."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from recon.errors import InputError


class Config(BaseModel):
    """A frozen pydantic model whose constructor raises ``InputError`` for the first field that is wrong."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            first = error.errors()[0]
            inner = first.get("ctx", {}).get("error")
            if isinstance(inner, InputError):
                raise inner from None
            name = ".".join([type(self).__name__, *map(str, first["loc"])])
            raise InputError(name, first.get("input"), first["msg"].replace("Input should be", "").strip()) from None
