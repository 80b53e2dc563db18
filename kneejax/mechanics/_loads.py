"""What acts on a bone: wrenches and the work that they do, loads, supports, lines of tension."""

__all__ = [
    "AXES", "BONES", "GROOD_SUNTAY", "ConstantTensionLine", "Load", "Support", "Wrench", "Wrenches",
    "generalised_force",
]

import dataclasses
import functools
import operator
from collections.abc import Sequence
from typing import Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import (
    ARM_MM,
    FEMUR,
    FEMUR_AND_TIBIA,
    TIBIA,
    ZERO,
    Pair,
    Placement,
    Pose,
    State,
    Vector,
    coordinate,
    grood_suntay_axes,
    numbers,
)
from kneejax.numerics import numpy_for

#: The bones in whose frame a point may be stated.
BONES = FEMUR_AND_TIBIA
#: The axes of Grood and Suntay, as those of a load.
GROOD_SUNTAY = "grood_suntay"
#: The axes in which a load may be stated.
AXES = (*BONES, GROOD_SUNTAY)


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
        "flexion": lambda: Vector(0.0, 0.0, -1.0),
        "adduction": lambda: Vector(c, -s, 0.0),
        "internal_rotation": lambda: pose.placement.turn(Vector(0.0, 1.0, 0.0)),
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


class Load(eqx.Module):
    """A force and a moment on a bone, the tibia where no other is named.

    Attributes:
        force: shape `(3, ...)`, N.
        moment: shape `(3, ...)`, N mm.
        point: where the force acts, shape `(3, ...)`, mm.
        axes: those in which force and moment are given: anterior, superior, lateral. In `femur`
            axes the force keeps its direction in space, in the bone's own it follows the bone. With
            `grood_suntay` the components lie along the floating axis, the tibia's long axis and
            the femur's transverse axis (`kneejax.geometry.grood_suntay_axes`), wherever the
            tibia is. Loads by name are of this kind: `load_of`.
        point_in: the bone in whose frame the point is given, and to which it is fixed; where none
            is named, the one on which it acts.
        name: what reports call it.
        bone: on which it acts.

    Example:
        >>> from kneejax import Load
        >>> Load(force=(0.0, 90.0, 0.0), axes="grood_suntay", name="pull").axes
        'grood_suntay'
    """

    force: Array = numbers(default=(0.0, 0.0, 0.0))
    moment: Array = numbers(default=(0.0, 0.0, 0.0))
    point: Array = numbers(default=(0.0, 0.0, 0.0))
    axes: str = eqx.field(static=True, default=FEMUR)
    point_in: str = eqx.field(static=True, default="")
    name: str = eqx.field(static=True, default="load")
    bone: str = eqx.field(static=True, default=TIBIA)

    def __post_init__(self):
        self.point_in = self.point_in or self.bone

    def __check_init__(self):
        bones = (FEMUR, self.bone)
        axes = (*bones, GROOD_SUNTAY) if self.bone == TIBIA else bones
        for field, value, known in (("axes", self.axes, axes), ("point_in", self.point_in, bones)):
            if value not in known:
                raise ValueError(f"Load.{field} is {value!r}; expected one of {known}")

    @property
    def sizes(self) -> Array:
        """How much acts, `(..., 6)`: force, N, and moment at `ARM_MM`, N."""
        xp = numpy_for(self)
        moment = xp.asarray(self.moment) / ARM_MM
        return jnp.asarray(xp.concatenate([self.force, moment], axis=-1), float)

    @property
    def places(self) -> tuple[Array, ...]:
        """Where it acts: what stays while it grows."""
        return (self.point,)

    def times(self, part: ArrayLike) -> "Load":
        """A part of it, `(...)` or one."""
        share = jnp.asarray(part)[..., None]
        return dataclasses.replace(self, force=share * self.force, moment=share * self.moment)

    def at_each(self, shape: tuple[int, ...]) -> "Load":
        """Once for each of `shape` load cases."""
        xp = numpy_for(self)
        return jax.tree.map(lambda x: jnp.asarray(xp.broadcast_to(x, (*shape, 3)), float), self)

    def wrench(self, there: Placement) -> Wrench:
        """On the bone, about its origin in femur axes.

        Args:
            there: where the bone is in the femur.
        """
        force, moment, point = Vector.of(self.force), Vector.of(self.moment), Vector.of(self.point)
        if self.axes == self.bone:
            force, moment = there.turn(force), there.turn(moment)
        elif self.axes == GROOD_SUNTAY:
            axes = grood_suntay_axes(there).T
            force, moment = axes @ force, axes @ moment
        if self.point_in == self.bone:
            arm = there.turn(point)
        else:
            arm = point - there.translation
        return Wrench.at(arm, force, moment)

    def work(self, state: State, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force on some coordinates: N mm per rad of a rotation, N of a translation."""
        pair = (FEMUR, self.bone)
        return generalised_force(state, pair, self.wrench(state.between(pair)), names)


class Support(eqx.Module):
    """What a machine adds along one coordinate, whatever the pose: it does work on no other.

    Attributes:
        size: N mm per rad of a rotation, N of a translation, `(...)`.
        coordinate: its name.

    Example:
        >>> import jax.numpy as jnp
        >>> Support(jnp.array(12.0), "anterior").coordinate
        'anterior'
    """

    size: Array
    coordinate: str = eqx.field(static=True)

    def work(self, state: State, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force on some coordinates."""
        nothing = jnp.zeros(state.shape)
        return tuple(nothing + self.size if name == self.coordinate else nothing for name in names)


class Line(Protocol):
    """A part of a knee that pulls by a potential between two bones, as a `ConstantTensionLine`."""

    name: str  # what reports call it
    tension: Array  # N, that a load can add to

    @property
    def bodies(self) -> Pair:
        """The two bones that it joins."""
        ...

    def energy(self, state: State) -> Array:
        """N mm."""
        ...

    def wrench(self, state: State) -> Wrench:
        """On the second bone, about its origin in femur axes."""
        ...

    def work_of_end(self, state: State) -> Array:
        """Generalised force on flexion besides the wrench, N mm per rad."""
        ...


class ConstantTensionLine(eqx.Module):
    """A line of constant tension from a femoral point, which may travel with flexion, to a bone.

    With it the weight on the quadriceps tendon of paper 1 acts as the patellar tendon's pull
    while no patella is modelled: its upper end follows the patella's path over flexion.

    Attributes:
        tension: N.
        origin: polynomial in flexion (rad) of the upper end, shape `(k, 3, ...)`, mm, femur
            frame, lowest power first. One row is a fixed point.
        insertion: shape `(3, ...)`, mm, in the bone's frame.
        name: what reports call it.
        bone: to which it runs.

    Example:
        >>> line = ConstantTensionLine(20.0, [[45.0, 30.0, 0.0]], [35.0, -40.0, 0.0], "tendon")
        >>> float(line.tension), line.bone
        (20.0, 'tibia')
    """

    tension: Array = numbers()
    origin: Array = numbers()
    insertion: Array = numbers()
    name: str = eqx.field(static=True, default="line")
    bone: str = eqx.field(static=True, default=TIBIA)

    @property
    def bodies(self) -> Pair:
        """The two bones that it joins."""
        return FEMUR, self.bone

    def upper_end(self, flexion: Array) -> Array:
        """Where it begins at a flexion, rad: `(3, ...)`, mm, femur frame."""
        end = self.origin[-1]
        for row in self.origin[-2::-1]:
            end = end * flexion + row
        return end

    def energy(self, state: State) -> Array:
        """Tension times length, N mm."""
        return self.tension * self._line(state)[1].norm()

    def wrench(self, state: State) -> Wrench:
        """On the bone, about its origin in femur axes."""
        arm, line = self._line(state)
        length = line.norm()
        pull = -self.tension / jnp.where(length > 0, length, 1.0)
        return Wrench.at(arm, pull * line)

    def work_of_end(self, state: State) -> Array:
        """Generalised force on flexion that the travelling upper end adds, N mm per rad."""
        rate = jnp.zeros_like(self.origin[0])
        for power, row in reversed(list(enumerate(self.origin))[1:]):
            rate = rate * state.tibia.flexion + power * row
        _, line = self._line(state)
        length = line.norm()
        return self.tension / jnp.where(length > 0, length, 1.0) * (line @ Vector.of(rate))

    def _line(self, state: State) -> tuple[Vector, Vector]:
        """The insertion from the bone's origin and from the upper end, femur axes, mm."""
        there = state.between(self.bodies)
        end = self.upper_end(state.tibia.flexion)
        arm = there.turn(Vector.of(self.insertion))
        return arm, arm + there.translation - Vector.of(end)
