"""Poses of a simulation in words, and what a load moved."""

from __future__ import annotations

import textwrap

import numpy as np

from kneejax.experiments import Motion
from kneejax.geometry import (
    CLINICAL,
    COLUMNS,
    CONVENTION_WORDS,
    FEMORAL,
    FREE_COORDINATES,
    convert_table,
    coordinate,
)
from kneejax.statics import Status, converged

_HEADS = ("flexion", "adduction", "int.rot.", "anterior", "superior", "lateral")
_UNITS = tuple(column.rsplit("_", 1)[1] for column in COLUMNS)
_WIDTHS = (7, 9, 8, 8, 8, 7)


def displacement(under_load: Motion, without: Motion) -> np.ndarray:
    """How far a load moved the tibia.

    Args:
        under_load: the motion with the load.
        without: the motion of the same knee at the same flexions without it.

    Returns:
        Changes of adduction and internal rotation in degrees and of the translations of Grood and
        Suntay in mm, shape `(n, 5)`; NaN where either knee does not balance.
    """
    tables = []
    for motion in (under_load, without):
        table = convert_table(np.asarray(motion.to_table()), FEMORAL, CLINICAL)
        table[~converged(np.asarray(motion.status))] = np.nan
        tables.append(table)
    return (tables[0] - tables[1])[:, 1:]


def displacement_table(
    flexion: np.ndarray, moved: np.ndarray
) -> tuple[list[str], list[list[float]]]:
    """Header and rows of displacement.csv."""
    changes = map(change_column, FREE_COORDINATES)
    return [COLUMNS[0], *changes], np.column_stack([flexion, moved]).tolist()


def change_column(name: str) -> str:
    """`anterior` -> `anterior_change_mm`."""
    return f"{name}_change_{coordinate(name).unit}"


def displacement_lines(flexion: np.ndarray, moved: np.ndarray) -> list[str]:
    """The same for a terminal."""
    words = (
        "What the load moved, along its own axes: translations of the tibia's origin along the "
        "floating axis (anterior), the tibia's long axis (superior) and the femur's transverse "
        "axis (lateral)"
    )
    rows = [_numbers(row) for row in np.column_stack([flexion, moved])]
    return ["", *textwrap.wrap(words, 98), *_head(), *rows]


def pose_lines(table: np.ndarray, status: np.ndarray, convention: str) -> list[str]:
    """Poses for a terminal.

    Args:
        table: in the convention, degrees and mm, `(n, 6)`.
        status: `Status` values, `(n,)`.
        convention: one of `kneejax.geometry.CONVENTIONS`.
    """
    words = textwrap.wrap(f"Poses, {convention}: {CONVENTION_WORDS[convention]}", 98)
    rows = [f"{_numbers(row)}  {Status(s).word}" for row, s in zip(table, status, strict=True)]
    head, units = _head()
    return [*words, f"{head}  status", units, *rows]


def _head() -> tuple[str, str]:
    heads = (f"{word:>{width}}" for word, width in zip(_HEADS, _WIDTHS, strict=True))
    units = (f"{unit:>{width}}" for unit, width in zip(_UNITS, _WIDTHS, strict=True))
    return "  ".join(heads), "  ".join(units)


def _numbers(row: np.ndarray) -> str:
    digits = (1, 2, 2, 2, 2, 2)
    return "  ".join(f"{x:{w}.{d}f}" for x, w, d in zip(row, _WIDTHS, digits, strict=True))
