"""Coordinates as data: whose they are, their units and signs, their names in tables and figures."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

#: mm at which a rotation moves what counts: the condyles are as far from the knee's centre.
ARM_MM = 30.0

#: Coordinate -> prescribed value of each lane, `(lanes,)`, rad or mm. All others are free.
Prescribed = Mapping[str, Array]


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One of the six ways in which a body can move.

    Attributes:
        body: that moves, against the femur.
        name: without its unit; distinct among all bodies.
        label: in figures and headers.
        unit: at the border, `deg` or `mm`; inside the package rotations are in rad.
        positive: what a positive value means, in words.
    """

    body: str
    name: str
    label: str
    unit: str
    positive: str

    @property
    def column(self) -> str:
        """Its name in tables."""
        return f"{self.name}_{self.unit}"

    @property
    def axis_label(self) -> str:
        """Label with unit, for axes and headers."""
        return f"{self.label}, {self.unit}"

    @property
    def table_unit(self) -> float:
        """Degrees per rad, or 1 for a length."""
        return math.degrees(1.0) if self.unit == "deg" else 1.0

    @property
    def scale(self) -> float:
        """rad or mm that move what counts by 1 mm."""
        return 1.0 / ARM_MM if self.unit == "deg" else 1.0


#: Name -> coordinate, in the order of every array and table.
COORDINATES = {
    one.name: one
    for one in (
        Coordinate("tibia", "flexion", "Flexion", "deg", "bent"),
        Coordinate("tibia", "adduction", "Adduction", "deg", "varus"),
        Coordinate("tibia", "internal_rotation", "Internal rotation", "deg", "turned inwards"),
        Coordinate("tibia", "anterior", "Anterior translation", "mm", "forwards"),
        Coordinate("tibia", "superior", "Superior translation", "mm", "upwards"),
        Coordinate("tibia", "lateral", "Lateral translation", "mm", "outwards"),
    )
}
#: Columns of pose tables, with units.
COLUMNS = tuple(one.column for one in COORDINATES.values())


def free_of(prescribed: Iterable[str]) -> tuple[str, ...]:
    """The coordinates that are free when some are prescribed.

    Args:
        prescribed: names.

    Returns:
        The others, in the order of `COORDINATES`.

    Raises:
        KeyError: a name is none of `COORDINATES`.

    Example:
        >>> free_of(["flexion", "anterior"])
        ('adduction', 'internal_rotation', 'superior', 'lateral')
    """
    held = {COORDINATES[name].name for name in prescribed}
    return tuple(name for name in COORDINATES if name not in held)


#: The coordinates that are free when flexion alone is prescribed.
FREE_COORDINATES = free_of(["flexion"])


def table_units(names: Iterable[str]) -> np.ndarray:
    """What takes coordinates from rad and mm to the degrees and mm of tables, one factor each."""
    return np.array([COORDINATES[name].table_unit for name in names])


def scales(names: Iterable[str]) -> tuple[float, ...]:
    """rad and mm of each coordinate that move what counts by 1 mm (a rotation: at 30 mm)."""
    return tuple(COORDINATES[name].scale for name in names)


def prescribed_of(columns: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Prescribed coordinates from columns of a table.

    Args:
        columns: column of `COLUMNS` -> numbers, degrees or mm.

    Returns:
        Coordinate -> numbers, rad or mm.

    Raises:
        ValueError: a column is none of `COLUMNS`.

    Example:
        >>> prescribed_of({"anterior_mm": 5.0})["anterior"].tolist()
        5.0
    """
    names = {one.column: one for one in COORDINATES.values()}
    for column in columns:
        if column not in names:
            near = difflib.get_close_matches(column, COLUMNS, 1, 0.5)
            meant = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{column!r} is no coordinate: expected any of {COLUMNS}{meant}")
    rows = ((names[column], jnp.asarray(x, float)) for column, x in columns.items())
    return {one.name: jnp.deg2rad(x) if one.unit == "deg" else x for one, x in rows}


def all_coordinates(prescribed: Prescribed, q: Array) -> tuple[Array, ...]:
    """Prescribed and free coordinates together.

    Args:
        prescribed: rad and mm.
        q: free coordinates in the order of `free_of`, `(free, ...)`, rad and mm.

    Returns:
        One array per coordinate, in the order of `COORDINATES`, of one shape.
    """
    free = dict(zip(free_of(prescribed), q, strict=True))
    values = [free[name] if name in free else prescribed[name] for name in COORDINATES]
    return tuple(jnp.broadcast_arrays(*(jnp.asarray(x, float) for x in values)))
