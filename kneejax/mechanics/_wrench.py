"""Force and moment between bodies, and the work that they do."""

__all__ = ["Wrench", "Wrenches", "generalised_force"]

import functools
import operator
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import (
    AXES,
    FEMUR,
    ZERO,
    Pair,
    Placement,
    Pose,
    State,
    Vector,
    coordinate,
)


class Wrench(eqx.Module):
    """A force, and the moment about the origin of the axes in which both are given.

    Attributes:
        force: N.
        moment: N mm.

    Example:
        >>> from kneejax.geometry import Vector
        >>> pull = Wrench(Vector(100.0, 0.0, 0.0), Vector(0.0, 0.0, -5000.0))
        >>> [float(x) for x in pull.moment]
        [0.0, 0.0, -5000.0]
    """

    force: Vector
    moment: Vector

    @classmethod
    def at(cls, point: Vector, force: Vector, moment: Vector = ZERO) -> "Wrench":
        """Of a force, and a moment about the point where it acts, mm."""
        return cls(force, moment + point.cross(force))

    def turned(self, frame: Placement) -> "Wrench":
        """In other axes with the same origin."""
        return Wrench(frame.turn(self.force), frame.turn(self.moment))

    def moved(self, frame: Placement) -> "Wrench":
        """From a frame's axes and origin to those of the body that carries it."""
        turned = self.turned(frame)
        return Wrench.at(frame.translation, turned.force, turned.moment)

    def __add__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force + other.force, self.moment + other.moment)

    def __neg__(self) -> "Wrench":
        return Wrench(-self.force, -self.moment)

    def alone(self) -> "Wrench":
        """With a first axis of length one."""
        return jax.tree.map(lambda x: jnp.asarray(x)[None], self)

    @staticmethod
    def total(wrenches: "list[Wrench]", axis: int = 0) -> "Wrench":
        """Sum of wrenches, and of the parts that each holds along an axis."""
        sums = [jax.tree.map(lambda x: jnp.sum(x, axis=axis), wrench) for wrench in wrenches]
        return functools.reduce(operator.add, sums)


class Wrenches:
    """What the parts of a knee do to the bodies that they join, not yet summed.

    Each wrench acts on the second body of its pair, about that body's origin in the first's axes,
    and may hold several parts along its first axis.
    """

    def __init__(self):
        self.between: dict[Pair, list[Wrench]] = {}

    def add(self, pair: Pair, wrench: Wrench) -> None:
        """Add a part, or several along a first axis."""
        self.between.setdefault(pair, []).append(wrench)

    def take(self, others: "Wrenches") -> None:
        """Add all that others hold."""
        for pair, parts in others.between.items():
            self.between.setdefault(pair, []).extend(parts)

    def work(self, state: State, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force of all together; see `generalised_force`."""
        rows = [
            generalised_force(state, pair, Wrench.total(parts), names)
            for pair, parts in self.between.items()
        ]
        if not rows:
            return (jnp.zeros(state.shape),) * len(names)
        return tuple(functools.reduce(operator.add, row) for row in zip(*rows, strict=True))


def generalised_force(
    state: State, pair: Pair, wrench: Wrench, names: Sequence[str]
) -> tuple[Array, ...]:
    """Work that a wrench between two bodies does per unit of each of some coordinates.

    Args:
        state: where the bodies are.
        pair: the two bodies.
        wrench: on the second, about its origin in the first's axes; the first feels the opposite.
        names: of the coordinates, of any bodies.

    Returns:
        One array each: N mm per rad of a rotation, N of a translation; 0 for those of others.
    """
    first, second = pair
    on = {second: wrench}
    if first != FEMUR:
        own = state.poses[first].placement
        on[second] = wrench.turned(own)
        arm = own.turn(state.between(pair).translation)
        on[first] = -Wrench.at(arm, on[second].force, on[second].moment)
    work = {}
    for body, whole in on.items():
        if body != FEMUR:
            wanted = [one for one in map(coordinate, names) if one.body == body]
            ways = _work(state.poses[body], whole, [one.way for one in wanted])
            work |= {one.name: row for one, row in zip(wanted, ways, strict=True)}
    # Several wrenches have none on other bones too, each by itself.
    nothing = jnp.zeros(jnp.broadcast_shapes(state.shape, *map(jnp.shape, wrench.force)))
    rows = jnp.broadcast_arrays(*(work.get(name, nothing) for name in names), nothing)
    return tuple(rows[: len(names)])


def _work(pose: Pose, wrench: Wrench, ways: Sequence[str]) -> list[Array]:
    """Of a wrench on a body, about the body's origin in femur axes, along some fields of `Pose`."""
    c, s = jnp.cos(pose.flexion), jnp.sin(pose.flexion)
    turns = {
        "flexion": lambda: -AXES.z,
        "adduction": lambda: Vector(c, -s, 0.0),
        "internal_rotation": lambda: pose.placement.turn(AXES.y),
    }
    x, y, z = wrench.force
    shifts = {
        "anterior": lambda: x,
        "superior": lambda: y,
        "lateral": lambda: z,
        "drawer": lambda: c * x - s * y,
        "lift": lambda: s * x + c * y,
    }
    return [turns[way]() @ wrench.moment if way in turns else shifts[way]() for way in ways]
