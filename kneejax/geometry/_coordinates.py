"""Coordinates as data: whose they are, units, signs, names; and where all bodies of a knee are.

The femur stands still; every other body has six coordinates against it, by which it turns and moves
as `kneejax.geometry.Pose` says. Names differ among bodies, so a choice of coordinates, free or
prescribed, is a set of names.
"""

__all__ = [
    "ARM_MM", "BODIES", "BY_COORDINATE", "COLUMNS", "COORDINATES", "FEMUR", "FEMUR_AND_TIBIA",
    "FREE_COORDINATES", "OTHER_COLUMNS", "PATELLA", "TIBIA", "Coordinate", "Pair", "Prescribed",
    "State", "coordinate", "coordinates_of", "free_of", "prescribed_of", "scales", "table_units",
]

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry._pose import Placement, Pose
from kneejax.numerics import numpy_for
from kneejax.quantities import nearest_name

#: mm at which a rotation moves what counts: the condyles are as far from the knee's centre.
ARM_MM = 30.0

#: Coordinate -> prescribed value of each pose, `(...)`, rad or mm. All others are free.
Prescribed = Mapping[str, Array]


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One of the six ways in which a body can move.

    Attributes:
        body: that moves, against the femur.
        way: field of `kneejax.geometry.Pose` in which its value stands.
        name: without its unit; distinct among all bodies.
        label: in figures and headers.
        unit: at the border, `deg` or `mm`; inside the package rotations are in rad.
        positive: what a positive value means, in words.

    Example:
        >>> one = COORDINATES["adduction"]
        >>> one.body, one.unit, one.positive
        ('tibia', 'deg', 'varus')
    """

    body: str
    way: str
    name: str
    label: str
    unit: str
    positive: str

    @property
    def column(self) -> str:
        """Its name in tables."""
        return f"{self.name}_{self.unit}"

    @property
    def phrase(self) -> str:
        """Label within a sentence."""
        return self.label[:1].lower() + self.label[1:]

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


#: Does not move; all else is told against it.
FEMUR = "femur"
#: The body of a knee's tables, motions and tests.
TIBIA = "tibia"
#: Joined to the tibia by its tendon and pulled by the quadriceps, of knees that have one.
PATELLA = "patella"
#: Two bodies that a part joins. What it does to the second it does to the first, turned round.
Pair = tuple[str, str]
FEMUR_AND_TIBIA: Pair = (FEMUR, TIBIA)

_EVERY = (
    Coordinate(TIBIA, "flexion", "flexion", "Flexion", "deg", "bent"),
    Coordinate(TIBIA, "adduction", "adduction", "Adduction", "deg", "varus"),
    Coordinate(TIBIA, "internal_rotation", "internal_rotation", "Internal rotation", "deg",
               "turned inwards"),
    Coordinate(TIBIA, "anterior", "anterior", "Anterior translation", "mm", "forwards"),
    Coordinate(TIBIA, "superior", "superior", "Superior translation", "mm", "upwards"),
    Coordinate(TIBIA, "lateral", "lateral", "Lateral translation", "mm", "outwards"),
    Coordinate(PATELLA, "flexion", "patella_flexion", "Patellar flexion", "deg", "bent"),
    Coordinate(PATELLA, "adduction", "patella_rotation", "Patellar rotation", "deg",
               "apex inwards"),
    Coordinate(PATELLA, "internal_rotation", "patella_tilt", "Patellar tilt", "deg",
               "turned inwards"),
    Coordinate(PATELLA, "anterior", "patella_anterior", "Patella, anterior", "mm", "forwards"),
    Coordinate(PATELLA, "superior", "patella_superior", "Patella, superior", "mm", "upwards"),
    Coordinate(PATELLA, "lateral", "patella_lateral", "Patella, lateral", "mm", "outwards"),
)  # fmt: skip
#: Body -> its six coordinates by name, in the order of `kneejax.geometry.Pose`.
BODIES = {
    body: {one.name: one for one in _EVERY if one.body == body}
    for body in dict.fromkeys(one.body for one in _EVERY)
}
#: Name -> coordinate of the tibia, in the order of every array and table.
COORDINATES = BODIES[TIBIA]
#: Columns of pose tables, with units.
COLUMNS = tuple(one.column for one in COORDINATES.values())
#: Column -> coordinate of a bone other than the tibia.
OTHER_COLUMNS = {one.column: one for one in _EVERY if one.body != TIBIA}
#: The tibia's translations in axes turned by flexion, in the place of two along the femur's. They
#: are coordinates only where one of them is prescribed: a drawer at 90 degrees moves the tibia
#: along the femur's superior axis, and no other pair is free to follow it.
ALONG_FLEXED_TIBIA = {
    "anterior": Coordinate(TIBIA, "drawer", "drawer", "Drawer", "mm", "forwards when bent"),
    "superior": Coordinate(TIBIA, "lift", "lift", "Lift", "mm", "towards the femur when bent"),
}
_FLEXED = tuple(one.name for one in ALONG_FLEXED_TIBIA.values())
_BY_NAME = {one.name: one for one in (*_EVERY, *ALONG_FLEXED_TIBIA.values())}


def coordinate(name: str) -> Coordinate:
    """The coordinate of a name, of any body.

    Args:
        name: without its unit.

    Raises:
        KeyError: there is none.

    Example:
        >>> coordinate("patella_tilt").body
        'patella'
    """
    return _BY_NAME[name]


def coordinates_of(bodies: Iterable[str]) -> tuple[str, ...]:
    """Names of all coordinates of some bodies, body by body.

    Example:
        >>> coordinates_of(["tibia"])
        ('flexion', 'adduction', 'internal_rotation', 'anterior', 'superior', 'lateral')
    """
    return tuple(name for body in bodies for name in BODIES[body])


def free_of(prescribed: Iterable[str], bodies: Iterable[str] = (TIBIA,)) -> tuple[str, ...]:
    """The coordinates that are free when some are prescribed.

    Args:
        prescribed: names.
        bodies: that move.

    Returns:
        The others, in the order of `coordinates_of`. Where `drawer` or `lift` is prescribed, these
        two stand for `anterior` and `superior`.

    Raises:
        KeyError: none of the bodies has a coordinate of such a name.

    Example:
        >>> free_of(["flexion", "anterior"])
        ('adduction', 'internal_rotation', 'superior', 'lateral')
        >>> free_of(["flexion", "drawer"])
        ('adduction', 'internal_rotation', 'lift', 'lateral')
    """
    held, every = set(prescribed), coordinates_of(bodies)
    if held.intersection(_FLEXED):
        flexed = {name: one.name for name, one in ALONG_FLEXED_TIBIA.items()}
        every = tuple(flexed.get(name, name) for name in every)
    for name in held.difference(every):
        raise KeyError(name)
    return tuple(name for name in every if name not in held)


#: The coordinates that are free when flexion alone is prescribed.
FREE_COORDINATES = free_of(["flexion"])
#: Labels of a dimension of these, for datasets.
BY_COORDINATE = {
    "coordinate": ("coordinate", FREE_COORDINATES),
    "coordinate_unit": ("coordinate", [COORDINATES[name].unit for name in FREE_COORDINATES]),
}


def table_units(names: Iterable[str]) -> np.ndarray:
    """What takes coordinates from rad and mm to the degrees and mm of tables, one factor each.

    Example:
        >>> table_units(["adduction", "anterior"]).round(2).tolist()
        [57.3, 1.0]
    """
    return np.array([coordinate(name).table_unit for name in names])


def scales(names: Iterable[str]) -> tuple[float, ...]:
    """rad and mm of each coordinate that move what counts by 1 mm (a rotation: at 30 mm).

    Example:
        >>> scales(["adduction", "anterior"])
        (0.03333333333333333, 1.0)
    """
    return tuple(coordinate(name).scale for name in names)


def prescribed_of(columns: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Prescribed coordinates from columns of a table.

    Args:
        columns: column of `COLUMNS`, or `drawer_mm` -> numbers, degrees or mm.

    Returns:
        Coordinate -> numbers, rad or mm.

    Raises:
        ValueError: a column is none of these, or the drawer stands beside a translation of which
            it consists.

    Example:
        >>> prescribed_of({"anterior_mm": 5.0})["anterior"].tolist()
        5.0
    """
    names = {one.column: one for one in (*COORDINATES.values(), *ALONG_FLEXED_TIBIA.values())}
    for column in columns:
        if column not in names:
            near = nearest_name(column, names)
            meant = f"; did you mean {near!r}?" if near else ""
            known = ", ".join(names)
            raise ValueError(f"{column!r} is no coordinate: expected any of {known}{meant}")
    given = {names[column].name for column in columns}
    both = given.intersection(ALONG_FLEXED_TIBIA)
    if both and given.intersection(_FLEXED):
        raise ValueError(f"drawer_mm beside {min(both)}_mm, of which it consists; expected one")
    found = {}
    for column, x in columns.items():
        one, xp = names[column], numpy_for(x)
        x = xp.asarray(x, float)
        found[one.name] = jnp.asarray(xp.deg2rad(x) if one.unit == "deg" else x, float)
    return found


class State(eqx.Module):
    """The pose of every body that moves against the femur.

    Attributes:
        poses: body -> its pose, all of one shape.

    Example:
        >>> state = State.of({"flexion": 0.5, "anterior": 2.0}, jnp.zeros((4, 1)))
        >>> float(state.tibia.anterior[0]), float(state.tibia.superior[0])
        (2.0, 0.0)
    """

    poses: dict[str, Pose]

    @classmethod
    def of(cls, prescribed: Prescribed, q: Array, bodies: Sequence[str] = (TIBIA,)) -> "State":
        """Make a state from its prescribed and its free coordinates.

        Args:
            prescribed: coordinate -> its value, rad or mm.
            q: the others, `(free, ...)`, rad and mm, in the order of `kneejax.geometry.free_of`.
            bodies: that move.
        """
        free, rows = free_of(prescribed, bodies), numpy_for(q).asarray(q)
        values = {**prescribed, **dict(zip(free, rows, strict=True))}
        if "drawer" in values:
            # The inverse of `Pose.drawer` and `Pose.lift`.
            drawer, lift = values["drawer"], values["lift"]
            c, s = jnp.cos(values["flexion"]), jnp.sin(values["flexion"])
            values["anterior"], values["superior"] = c * drawer + s * lift, c * lift - s * drawer
        names = coordinates_of(bodies)
        xp = numpy_for(values)
        every = xp.broadcast_arrays(*(xp.asarray(values[name], float) for name in names))
        rows = {name: jnp.asarray(x, float) for name, x in zip(names, every, strict=True)}
        return cls({body: Pose(*(rows[name] for name in BODIES[body])) for body in bodies})

    @property
    def tibia(self) -> Pose:
        """The tibia's pose."""
        return self.poses[TIBIA]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the batch."""
        return jnp.shape(self.tibia.adduction)

    def at(self, names: Iterable[str]) -> Array:
        """Some of the coordinates, `(len(names), ...)`, rad and mm."""
        places = [coordinate(name) for name in names]
        values = [getattr(self.poses[one.body], one.way) for one in places]
        xp = numpy_for(values)
        return jnp.asarray(xp.stack(xp.broadcast_arrays(*values)), float)

    def between(self, pair: Pair) -> Placement:
        """The motion from the second body's coordinates to the first's."""
        first, second = pair
        if first == FEMUR:
            return self.poses[second].placement
        back = self.poses[first].placement.inverse()
        return back if second == FEMUR else back.after(self.poses[second].placement)
