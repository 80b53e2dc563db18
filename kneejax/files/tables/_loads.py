"""Loads beside measured poses: columns of one table."""

from __future__ import annotations

import os

import numpy as np

from kneejax.files.reading import InputProblem
from kneejax.files.tables._tables import cell_number, read_rows
from kneejax.mechanics import NAMED_LOADS, RANGES, load_called


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
        meant = load_called(name)
        if meant is not None and name != meant:
            raise InputProblem(file, "header", name, f"one of {', '.join(NAMED_LOADS)}", meant)
    return {
        name: np.array([
            cell_number(file, f"row {number} (line {line}), {name}", cells[place], RANGES[name])
            for number, (line, cells) in enumerate(rows, 1)
        ])
        for place, name in enumerate(header) if name in NAMED_LOADS
    }  # fmt: skip
