"""Numbers of a model as decimals, and rigid motions: exact where nothing turns."""

import math
from decimal import Context, Decimal, localcontext
from typing import Any, NamedTuple

import numpy as np

from kneejax.files.reading import plain_number
from kneejax.geometry import angles_from_rotation

#: Powers of ten from SI to the package's units.
METRES_TO_MM = 3
PASCAL_TO_MPA = -6
_WIDE = Context(prec=60)
_PI = Decimal("3.14159265358979323846264338327950288419716939937511")
#: Three decimals, `(3,)`.
Point = np.ndarray


def read_decimal(word: str) -> Decimal:
    """The number that a word of a model stands for; ValueError if it is not a finite number."""
    x = plain_number(word)
    if x is None or not math.isfinite(x):
        raise ValueError(word)
    exact = Decimal(word.strip())
    printed = len(exact.as_tuple().digits) == 17 and exact == Decimal(f"{x:.17g}")
    return Decimal(repr(x)) if printed else exact


def write_decimal(value: Decimal) -> str:
    """The shortest word that `read_decimal` reads as this number."""
    value = value.normalize(_WIDE) if value else Decimal(0)
    exponent = value.adjusted()
    word = f"{value:f}" if -6 <= exponent < 17 else str(value).replace("E", "e")
    if read_decimal(word) == value:
        return word
    # It happens to be the print of another number; one more digit says that it is meant.
    mantissa, e, power = word.partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.'}0{e}{power}"


def shifted(value: Decimal, places: int) -> float:
    """A decimal times a power of ten, as the nearest double."""
    return float(value.scaleb(places, _WIDE)) + 0.0  # no minus zero


def decimals(values, places: int = 0) -> Any:
    """What doubles are printed as, over a power of ten: decimals that `shifted` reads as them."""
    exact = np.frompyfunc(lambda x: Decimal(repr(float(x) + 0.0)).scaleb(-places, _WIDE), 1, 1)
    return exact(values)


def millimetres(point: Point) -> list[float]:
    """A point in m, in mm."""
    return [shifted(x, METRES_TO_MM) for x in point]


def degrees(radians: Decimal) -> float:
    """Degrees of an angle in rad, correctly rounded."""
    with localcontext(_WIDE):
        return float(radians * 180 / _PI) + 0.0


def radians(x: float) -> Decimal:
    """The shortest angle in rad that `degrees` reads as `x`."""
    with localcontext(_WIDE) as context:
        exact = decimals(x) * _PI / 180
        for context.prec in range(14, 24):
            angle = +exact
            if degrees(read_decimal(write_decimal(angle))) == x:
                break
    return angle


ORIGIN: Point = decimals(np.zeros(3))
#: Side -> from a model's axes to those of clinical meaning, which are the right knee's.
MIRROR = {"r": np.eye(3), "l": np.diag([1.0, 1.0, -1.0])}


class Rigid(NamedTuple):
    """Motions `x -> turn x + shift`, m, one or one an instant."""

    turn: np.ndarray = np.eye(3)  # `(..., 3, 3)`
    shift: np.ndarray = ORIGIN  # `(..., 3)`: doubles, or decimals

    @classmethod
    def of(cls, translation: Point, angles: Point) -> "Rigid":
        """The motion from a frame's coordinates, by its place and its X-Y-Z angles (rad)."""
        return cls(turn_xyz(angles), translation)

    @property
    def turns(self) -> bool:
        """Whether it turns anything; if not, decimals stay exact."""
        return self.turn.ndim > 2 or not np.array_equal(self.turn, np.eye(3))

    def point(self, x: np.ndarray) -> np.ndarray:
        """Images of points, `(..., 3)`."""
        if self.turns:
            exact, x = x.dtype == object, (self.turn @ x.astype(float)[..., None])[..., 0]
            x = decimals(x) if exact and x.ndim == 1 else x
        return _sum(x, self.shift)

    def point_back(self, x: np.ndarray) -> np.ndarray:
        """The points whose images these are."""
        return Rigid(np.swapaxes(self.turn, -1, -2)).point(_sum(x, -self.shift))

    def after(self, first: "Rigid") -> "Rigid":
        """This motion after `first`."""
        return Rigid(self.turn @ first.turn, self.point(first.shift))

    def inverse(self) -> "Rigid":
        """The motion that undoes this one."""
        return Rigid(np.swapaxes(self.turn, -1, -2), self.point_back(ORIGIN))

    def at(self, rows) -> "Rigid":
        """At some of the instants, as NumPy indexes."""
        return Rigid(self.turn[rows], self.shift[rows])


def poses_of(there: Rigid, side: str) -> np.ndarray:
    """Rows of degrees and mm of a bone in the femur; a left knee's (`l`) as in a mirror."""
    turn, shift = MIRROR[side] @ there.turn @ MIRROR[side], there.shift.astype(float)
    rows = tuple(tuple(turn[..., i, j] for j in range(3)) for i in range(3))
    angles = np.rad2deg(np.stack([np.asarray(x) for x in angles_from_rotation(rows)], axis=-1))
    return np.concatenate([angles, 1e3 * shift @ MIRROR[side]], axis=-1) + 0.0


def turn_about(axis: np.ndarray, angle) -> np.ndarray:
    """Rotations about a unit axis by angles `(...)` in rad, shape `(..., 3, 3)` (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[..., None, None], 1.0 - np.cos(angle)[..., None, None]
    return np.eye(3) + sine * skew + versine * (skew @ skew)


def turn_xyz(angles) -> np.ndarray:
    """`Rx(a0) Ry(a1) Rz(a2)`, the body-fixed X-Y-Z sequence, from angles in rad."""
    x, y, z = (turn_about(axis, float(a)) for axis, a in zip(np.eye(3), angles, strict=True))
    return x @ y @ z


def angles_xyz(rotation: np.ndarray) -> np.ndarray:
    """Angles of the body-fixed X-Y-Z sequence, rad, shape `(3,)`."""
    middle = np.arctan2(rotation[0, 2], np.hypot(rotation[0, 0], rotation[0, 1]))
    first = np.arctan2(-rotation[1, 2], rotation[2, 2])
    return np.array([first, middle, np.arctan2(-rotation[0, 1], rotation[0, 0])])


def _sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a + b if a.dtype == b.dtype else a.astype(float) + b.astype(float)
