"""Where the bodies of an OpenSim model are while its coordinates move."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from kneejax.files.opensim._joints import Joint, follow, read_joints
from kneejax.files.opensim._model import GROUND, Model, Offset
from kneejax.files.tables import Storage, last_word


class Rigid(NamedTuple):
    """Rigid motions `x -> turn x + shift`, one an instant.

    Attributes:
        turn: `(..., 3, 3)`.
        shift: m, `(..., 3)`.
    """

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


@dataclasses.dataclass(frozen=True)
class Movement:
    """A model that moves.

    Attributes:
        model: as read.
        joints: of the model.
        values: coordinate -> rad or m, one shape `(...)`.
        placed: body -> where it is in the ground.
    """

    model: Model
    joints: tuple[Joint, ...]
    values: dict[str, np.ndarray]
    placed: dict[str, Rigid]

    def between(self, first: str, second: str) -> Rigid:
        """Where a body is in another: from the second's coordinates to the first's."""
        return self.placed[first].inverse().after(self.placed[second])


def turning(joints: Sequence[Joint]) -> set[str]:
    """Coordinates that are angles."""
    return {name for j in joints for axis in j.axes if axis.turns for name in axis.coordinates}


def coordinate_columns(model: Model, table: Storage) -> dict[str, str]:
    """Coordinate of a model -> the column of a table that has it."""
    known = {c.name for joint in read_joints(model) for c in joint.coordinates}
    return {last_word(name): name for name in table.columns if last_word(name) in known}


def moved(model: Model, values: Mapping[str, np.ndarray]) -> Movement:
    """Bodies of a model at given coordinates.

    Args:
        model: the model.
        values: coordinate -> rad or m, all of one shape; others follow these where they are coupled
            to them, and have their defaults where not.

    Raises:
        InputProblem: a joint moves by a function that is not known.
    """
    joints = tuple(read_joints(model))
    shape = np.shape(next(iter(values.values())))
    every = {
        c.name: np.broadcast_to(values.get(c.name, c.default), shape)
        for joint in joints for c in joint.coordinates
    }  # fmt: skip
    every = {x: np.broadcast_to(y, shape) for x, y in follow(model, every, values).items()}
    still = Rigid(np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3)))
    placed, waiting = {GROUND: still}, list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in placed]
        if not ready:
            # A body that no joint carries begins at the ground, as in OpenSim.
            free = {joint.parent for joint in waiting} - {joint.child for joint in waiting}
            if not free:
                break
            placed |= dict.fromkeys(free, still)
            continue
        for joint in ready:
            placed[joint.child] = placed[joint.parent].after(_placement(model, joint, every, shape))
        waiting = [joint for joint in waiting if joint not in ready]
    return Movement(model, joints, every, placed)


def _placement(model: Model, joint: Joint, values: Mapping[str, np.ndarray], shape) -> Rigid:
    turn, shift = np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3))
    for axis in joint.axes:
        amount = joint.amount(axis, values, model)
        if axis.turns:
            turn = turn @ _turns(axis.direction, np.broadcast_to(amount, shape))
        else:
            shift = shift + np.asarray(amount)[..., None] * axis.direction
    own = Rigid(turn, shift)
    if joint.reverse:
        own = own.inverse()
    return Rigid.of(joint.parent_frame).after(own).after(Rigid.of(joint.child_frame).inverse())


def _turns(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[..., None, None], 1.0 - np.cos(angle)[..., None, None]
    return np.eye(3) + sine * skew + versine * (skew @ skew)
