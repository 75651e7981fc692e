"""A scene as plain JSON data, equal for equal scenes, for digests."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel


def canonical(thing: Any) -> Any:
    """Turn models, dataclasses, arrays and containers into JSON data; arrays become hashes of their float64 bytes."""
    if isinstance(thing, BaseModel):
        return [type(thing).__name__, {name: canonical(getattr(thing, name)) for name in type(thing).model_fields}]
    if is_dataclass(thing) and not isinstance(thing, type):
        return [type(thing).__name__, {f.name: canonical(getattr(thing, f.name)) for f in fields(thing)}]
    if isinstance(thing, np.ndarray):
        data = np.ascontiguousarray(thing, np.float64)
        return ["array", list(data.shape), hashlib.sha256(data.tobytes()).hexdigest()]
    if isinstance(thing, dict):
        return {str(key): canonical(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [canonical(value) for value in thing]
    if isinstance(thing, np.generic):
        return thing.item()
    if thing is None or isinstance(thing, str | int | float | bool):
        return thing
    return repr(thing)
