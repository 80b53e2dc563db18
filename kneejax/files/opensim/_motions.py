"""Rigid motions: exact decimals where nothing turns, and arrays over instants."""

from __future__ import annotations

import dataclasses
from decimal import Decimal
from typing import NamedTuple

import numpy as np

from kneejax.geometry import angles_from_rotation

Point = tuple[Decimal, Decimal, Decimal]
ORIGIN: Point = (Decimal(0), Decimal(0), Decimal(0))
#: Side -> from a model's axes to those of clinical meaning, which are the right knee's.
MIRROR = {"r": np.eye(3), "l": np.diag([1.0, 1.0, -1.0])}


@dataclasses.dataclass(frozen=True)
class Offset:
    """A motion `x -> rotation x + translation`, m; exact where nothing turns (rotation None)."""

    rotation: np.ndarray | None = None
    translation: Point = ORIGIN

    @classmethod
    def of(cls, translation: Point, angles: Point) -> Offset:
        """The motion from a frame's coordinates, by its place and its X-Y-Z angles (rad)."""
        return cls(turn_xyz(angles) if any(angles) else None, translation)

    @property
    def matrix(self) -> np.ndarray:
        """The rotation, also where nothing turns."""
        return np.eye(3) if self.rotation is None else self.rotation

    def point(self, x: Point) -> Point:
        """Image of a point."""
        return _sum(self._turned(x, self.matrix), self.translation)

    def point_back(self, x: Point) -> Point:
        """The point whose image is `x`."""
        return self._turned(_sum(x, _minus(self.translation)), self.matrix.T)

    def after(self, first: Offset) -> Offset:
        """This motion after `first`."""
        if self.rotation is None or first.rotation is None:
            rotation = self.rotation if first.rotation is None else first.rotation
        else:
            rotation = self.rotation @ first.rotation
        return Offset(rotation, self.point(first.translation))

    def inverse(self) -> Offset:
        """The motion that undoes this one."""
        back = None if self.rotation is None else self.rotation.T
        return Offset(back, self._turned(_minus(self.translation), self.matrix.T))

    def _turned(self, x: Point, matrix: np.ndarray) -> Point:
        if self.rotation is None:
            return x
        a, b, c = (Decimal(repr(float(value))) for value in matrix @ np.array(x, float))
        return a, b, c


class Rigid(NamedTuple):
    """Motions `x -> turn x + shift`, one an instant: turn `(..., 3, 3)`, shift `(..., 3)`, m."""

    turn: np.ndarray
    shift: np.ndarray

    @classmethod
    def of(cls, offset: Offset) -> Rigid:
        """One that does not move."""
        return cls(offset.matrix, np.array(offset.translation, float))

    def point(self, x: np.ndarray) -> np.ndarray:
        """Images of points, `(..., 3)`."""
        return np.einsum("...ij,...j->...i", self.turn, x) + self.shift

    def after(self, first: Rigid) -> Rigid:
        """This motion after `first`."""
        return Rigid(self.turn @ first.turn, self.point(first.shift))

    def inverse(self) -> Rigid:
        """The motion that undoes this one."""
        back = np.swapaxes(self.turn, -1, -2)
        return Rigid(back, -np.einsum("...ij,...j->...i", back, self.shift))

    def at(self, rows) -> Rigid:
        """At some of the instants, as NumPy indexes."""
        return Rigid(self.turn[rows], self.shift[rows])


def poses_of(there: Rigid, side: str) -> np.ndarray:
    """Poses of a bone in the femur from the motion of its coordinates to the femur's, in rows of
    degrees and mm, by clinical meaning: of a left knee (`l`) that of the mirrored right one."""
    turn = MIRROR[side] @ there.turn @ MIRROR[side]
    rows = tuple(tuple(turn[..., i, j] for j in range(3)) for i in range(3))
    angles = np.rad2deg(np.stack([np.asarray(x) for x in angles_from_rotation(rows)], axis=-1))
    return np.concatenate([angles, 1e3 * there.shift @ MIRROR[side]], axis=-1) + 0.0


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


def _sum(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Point) -> Point:
    return -a[0], -a[1], -a[2]
