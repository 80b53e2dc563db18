"""Force and moment on the tibia."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import Placement, Pose, Vector, add, cross, dot, scale, transpose

_UNTURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Wrench(eqx.Module):
    """A force, and the moment about the origin of the axes in which both are given.

    Attributes:
        force: N.
        moment: N mm.
    """

    force: Vector
    moment: Vector

    @classmethod
    def at(cls, point: Vector, force: Vector, moment: Vector = (0.0, 0.0, 0.0)) -> Wrench:
        """Of a force, and a moment about the point where it acts, mm."""
        return cls(force, add(moment, cross(point, force)))

    def turned(self, frame: Placement) -> Wrench:
        """In other axes with the same origin."""
        return Wrench(frame.turn(self.force), frame.turn(self.moment))

    def moved(self, frame: Placement) -> Wrench:
        """From a frame's axes and origin to those of the body that carries it."""
        turned = self.turned(frame)
        return Wrench.at(frame.translation, turned.force, turned.moment)

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(add(self.force, other.force), add(self.moment, other.moment))

    def __neg__(self) -> Wrench:
        return Wrench(scale(-1.0, self.force), scale(-1.0, self.moment))

    def alone(self) -> Wrench:
        """With a first axis of length one."""
        return jax.tree.map(lambda x: jnp.asarray(x)[None], self)

    @staticmethod
    def total(wrenches: list[Wrench], axis: int = 0) -> Wrench:
        """Sum of wrenches, and of the parts that each holds along an axis."""
        sums = [jax.tree.map(lambda x: jnp.sum(x, axis=axis), wrench) for wrench in wrenches]
        return functools.reduce(operator.add, sums)


def wrench_of(energy: Callable[[Placement], Array], tibia: Placement) -> Wrench:
    """Wrench on the tibia that an energy exerts, about the tibia's origin in femur axes.

    Args:
        energy: of a placement of the tibia, N mm, one number a lane.
        tibia: the placement.
    """
    shape = jax.eval_shape(energy, tibia).shape
    columns = transpose(_UNTURNED if tibia.rotation is None else tibia.rotation)

    def displaced(twist: Array) -> Array:
        x, y, z, a, b, c = twist
        e, f, g = (add(column, cross((a, b, c), column)) for column in columns)
        shift = add(tibia.translation, (x, y, z))
        return jnp.sum(energy(Placement(transpose((e, f, g)), shift)))

    slope = -jax.grad(displaced)(jnp.zeros((6, *shape)))
    return Wrench((slope[0], slope[1], slope[2]), (slope[3], slope[4], slope[5]))


def generalised_force(
    pose: Pose, tibia: Placement, wrench: Wrench, names: Sequence[str]
) -> tuple[Array, ...]:
    """Work of a wrench on the tibia per unit of each of some coordinates.

    Args:
        pose: where the tibia is.
        tibia: `pose.placement`.
        wrench: about the tibia's origin in femur axes.
        names: of the coordinates.

    Returns:
        One array each: N mm per rad of a rotation, N of a translation.
    """
    c, s = jnp.cos(pose.flexion), jnp.sin(pose.flexion)
    turns = {
        "flexion": (0.0, 0.0, -1.0),
        "adduction": (c, -s, 0.0),
        "internal_rotation": tibia.turn((0.0, 1.0, 0.0)),
    }
    work = dict(zip(("anterior", "superior", "lateral"), wrench.force, strict=True))
    work |= {name: dot(axis, wrench.moment) for name, axis in turns.items() if name in names}
    rows = jnp.broadcast_arrays(*(work[name] for name in names), pose.adduction)
    return tuple(rows[: len(names)])
