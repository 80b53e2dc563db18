"""Angles and lengths as people write them: `0:120:5`, or `0,30,60`."""

from __future__ import annotations

import numpy as np

from kneejax.files.reading import InputProblem, plain_number
from kneejax.quantities import RANGES, Range

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
    return parse_range(text, file, field, RANGES["flexion_deg"], "angle")


def parse_range(text: str, file: str, field: str, allowed: Range, of: str) -> np.ndarray:
    """Numbers from `FROM:TO:STEP`, both ends included, or from a comma separated list.

    Args:
        text: as of `parse_flexion`.
        file: where the text stands, for the error.
        field: likewise.
        allowed: what each number may be.
        of: what one of them is, in a word.

    Returns:
        Shape `(n,)`.

    Raises:
        InputProblem: as of `parse_flexion`.

    Example:
        >>> from kneejax.mechanics import Range
        >>> lengths = Range(-20.0, 60.0, "mm")
        >>> parse_range("0:-4:-2", "--quadriceps-mm", "lengths", lengths, "length").tolist()
        [0.0, -2.0, -4.0]
    """
    def refused(expected: str) -> InputProblem:
        return InputProblem(file, field, text, expected)

    expected = f"FROM:TO:STEP or a comma separated list, {allowed}"
    is_range = ":" in text
    stated = [plain_number(part) for part in text.split(":" if is_range else ",")]
    numbers = [x for x in stated if x is not None]
    if len(numbers) < len(stated):
        raise refused(expected)
    if is_range and (len(numbers) != 3 or not np.isfinite(numbers).all()):
        raise refused(expected)
    if not all(allowed.holds(x) for x in (numbers[:2] if is_range else numbers)):
        raise refused(f"{of}s {allowed}")
    if not is_range:
        return np.array(numbers, float)
    first, last, step = numbers
    if step == 0 or (last - first) / step < 0:
        raise refused(f"a step that leads from the first {of} to the last")
    count = np.floor((last - first) / step + 1e-9) + 1
    if count > _MOST_VALUES:
        raise refused(f"at most {_MOST_VALUES} {of}s")
    return first + step * np.arange(int(count))
