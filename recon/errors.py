"""The one error for misuse: it names the field, what is allowed with its unit, and the value given."""


class InputError(ValueError):
    """Refuse an input; ``str(error)`` reads ``field: must be ALLOWED, got VALUE``.

    Args:
        field: dotted name of the offending field or option, e.g. ``render.spp``.
        value: what was given.
        allowed: the allowed range or form, with its unit.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field}: must be {allowed}, got {value!r}")
        self.field = field
        self.value = value
        self.allowed = allowed
