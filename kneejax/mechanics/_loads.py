"""What acts on a bone from outside: wrenches, supports, lines of constant tension."""

__all__ = ["AXES", "BONES", "GROOD_SUNTAY", "ConstantTensionLine", "Load", "Support"]

import dataclasses
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
    Pair,
    Placement,
    State,
    Vector,
    grood_suntay_axes,
    numbers,
)
from kneejax.mechanics._wrench import Wrench, generalised_force
from kneejax.numerics import numpy_for

#: The bones in whose frame a point may be stated.
BONES = FEMUR_AND_TIBIA
#: The axes of Grood and Suntay, as those of a load.
GROOD_SUNTAY = "grood_suntay"
#: The axes in which a load may be stated.
AXES = (*BONES, GROOD_SUNTAY)


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
