"""Loads beside measured poses: columns of one table."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from kneejax.files.reading import InputProblem
from kneejax.files.tables._tables import cell_number, pose_range, read_rows
from kneejax.geometry import COLUMNS
from kneejax.mechanics import NAMED_LOADS, RANGES, load_called, load_opposite_to


def read_loads(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Read which loads acted while poses were measured.

    Args:
        path: a CSV table; of its columns those with the name of a load count
            (`kneejax.mechanics.NAMED_LOADS`).

    Returns:
        Name of a load -> its size in each row, in the unit of its name; empty without such a
        column.

    Raises:
        InputProblem: the file cannot be read, a cell is not a number or out of range, or a column
            is called as loads were once called, or by another unit.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "poses.csv"
        >>> _ = path.write_text("flexion_deg, anterior_N\\n30, 134\\n")
        >>> read_loads(path)["anterior_N"].tolist()
        [134.0]
    """
    file = os.fspath(path)
    header, rows = read_rows(file, [])
    for name in header:
        meant, opposite = load_called(name), load_opposite_to(name)
        if opposite is not None and name not in COLUMNS:
            meant = f"{opposite} of the opposite sign"
        if meant is not None and name != meant:
            raise InputProblem(file, "header", name, f"one of {', '.join(NAMED_LOADS)}", meant)
    return {
        name: np.array([
            cell_number(file, f"row {number} (line {line}), {name}", cells[place], RANGES[name])
            for number, (line, cells) in enumerate(rows, 1)
        ])
        for place, name in enumerate(header) if name in NAMED_LOADS
    }  # fmt: skip


#: Column of the times of a table over time.
TIME = "time_s"


def read_loads_over_time(
    path: str | os.PathLike[str], may_lead: Sequence[str] = COLUMNS
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Read loads over time, and coordinates that are led.

    Args:
        path: a CSV table with a column `time_s` that rises; further columns have the name of a load
            (`kneejax.mechanics.NAMED_LOADS`) or of what is led.
        may_lead: names of columns that may be, in degrees or mm.

    Returns:
        Times, s; name of a load -> its sizes; column of what is led -> degrees or mm.

    Raises:
        InputProblem: the file cannot be read, a cell is no number or out of range, times that do
            not rise, fewer than two of them, or a column that is neither.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "pull.csv"
        >>> _ = path.write_text("time_s, anterior_N\\n0, 0\\n0.1, 100\\n")
        >>> read_loads_over_time(path)[1]["anterior_N"].tolist()
        [0.0, 100.0]
    """
    file = os.fspath(path)
    header, rows = read_rows(file, [TIME])
    sizes = read_loads(path)
    led = {name: k for k, name in enumerate(header) if name in may_lead}
    for name in header:
        if name not in (TIME, *sizes, *led):
            known = (TIME, *NAMED_LOADS, *may_lead)
            raise InputProblem(file, "header", name, f"one of {', '.join(known)}", known)
    place = header.index(TIME)
    where = [f"row {number} (line {line}), {TIME}" for number, (line, _) in enumerate(rows, 1)]
    times = [
        cell_number(file, at, cells[place]) for at, (_, cells) in zip(where, rows, strict=True)
    ]
    for at, before, after in zip(where[1:], times[:-1], times[1:], strict=True):
        if not after > before:
            raise InputProblem(file, at, f"{after:g}", f"later than {before:g}: times that rise")
    if len(times) < 2:
        raise InputProblem(file, TIME, f"{times[0]:g}", "two times at least")
    ways = {
        name: np.array([
            cell_number(file, f"row {number} (line {line}), {name}", cells[k], pose_range(name))
            for number, (line, cells) in enumerate(rows, 1)
        ])
        for name, k in led.items()
    }  # fmt: skip
    return np.array(times), sizes, ways
