"""A value that a function refuses, with the name under which it was given."""

from __future__ import annotations


class WrongValue(ValueError):
    """An argument that is not what it should be: `FIELD: FOUND; expected EXPECTED`.

    Attributes:
        field: name of the argument, or of the part of it.
        found: what was given, in words.
        expected: what should be given.
    """

    def __init__(self, field: str, found: str, expected: str):
        self.field, self.found, self.expected = field, found, expected
        super().__init__(f"{field}: {found}; expected {expected}")

    def __reduce__(self):
        return type(self), (self.field, self.found, self.expected)
