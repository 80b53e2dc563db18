"""Flexion angles as people write them: `0:120:5`, or `0,30,60`."""

from __future__ import annotations

import numpy as np

from kneejax.files.reading import Field
from kneejax.mechanics import RANGES

_MOST_VALUES = 10_000


def parse_flexion(text: str, file: str = "--flexion", field: str = "flexion_deg") -> np.ndarray:
    """Flexion angles from `FROM:TO:STEP`, both ends included, or from a comma separated list.

    Args:
        text: e.g. `0:120:5` or `0,30,60`; degrees.
        file: where the text stands, for the error.
        field: likewise.

    Returns:
        Shape `(n,)`, degrees.

    Raises:
        InputProblem: the text is something else, the step leads away from the end, or an angle
            is out of range.

    Example:
        >>> parse_flexion("0:20:5").tolist()
        [0.0, 5.0, 10.0, 15.0, 20.0]
    """
    place = Field(file, field, text)
    expected = f"FROM:TO:STEP or a comma separated list, {RANGES['flexion_deg']}"
    is_range = ":" in text
    try:
        numbers = [float(part) for part in text.split(":" if is_range else ",")]
    except ValueError:
        raise place.problem(expected) from None
    if not is_range:
        return _angles(place, numbers)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise place.problem(expected)
    first, last, step = numbers
    _angles(place, [first, last])
    if step == 0 or (last - first) / step < 0:
        raise place.problem("a step that leads from the first angle to the last")
    count = np.floor((last - first) / step + 1e-9) + 1
    if count > _MOST_VALUES:
        raise place.problem(f"at most {_MOST_VALUES} angles")
    return first + step * np.arange(int(count))


def _angles(place: Field, numbers) -> np.ndarray:
    if not all(RANGES["flexion_deg"].holds(x) for x in numbers):
        raise place.problem(f"angles {RANGES['flexion_deg']}")
    return np.array(numbers, float)
