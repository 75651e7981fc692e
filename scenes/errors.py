"""The one error for misuse: it names the field, what is allowed with its unit, and the value given."""

LONGEST_SHOWN = 300
"""A value whose text is longer is cut."""


class InputError(ValueError):
    """Refuse an input; ``str(error)`` reads ``field: must be ALLOWED, got VALUE``.

    Args:
        field: dotted name of the offending field or option, e.g. ``render.spp``.
        value: what was given.
        allowed: the allowed range or form, with its unit.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        shown = repr(value)
        if len(shown) > LONGEST_SHOWN:
            shown = f"{shown[: LONGEST_SHOWN - 20]}... ({len(shown)} characters)"
        super().__init__(f"{field}: must be {allowed}, got {shown}")
        self.field = field
        self.value = value
        self.allowed = allowed
