"""What acts on the tibia from outside: wrenches, supports, lines of constant tension."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import (
    Placement,
    Pose,
    Vector,
    add,
    dot,
    grood_suntay_axes,
    norm,
    rotate,
    scale,
    subtract,
    transpose,
    vector,
)
from kneejax.mechanics._wrench import Wrench, generalised_force

#: The bones in whose frame a point may be stated.
BONES = ("femur", "tibia")
#: The axes of Grood and Suntay, as those of a load.
GROOD_SUNTAY = "grood_suntay"
#: The axes in which a load may be stated.
AXES = (*BONES, GROOD_SUNTAY)


class Load(eqx.Module):
    """A force and a moment on the tibia.

    Attributes:
        force: shape `(3, ...)`, N.
        moment: shape `(3, ...)`, N mm.
        point: where the force acts, shape `(3, ...)`, mm.
        axes: those in which force and moment are given: anterior, superior, lateral. In `femur`
            axes the force keeps its direction in space, in `tibia` axes it follows the tibia. With
            `grood_suntay` the components lie along the floating axis, the tibia's long axis and
            the femur's transverse axis (`kneejax.geometry.grood_suntay_axes`), wherever the
            tibia is. Loads by name are of this kind: `load_of`.
        point_in: the bone in whose frame the point is given, and to which it is fixed.
        name: what reports call it.
    """

    force: Array
    moment: Array
    point: Array
    axes: str = eqx.field(static=True, default="femur")
    point_in: str = eqx.field(static=True, default="tibia")
    name: str = eqx.field(static=True, default="load")

    def __init__(
        self,
        force: ArrayLike = (0.0, 0.0, 0.0),
        moment: ArrayLike = (0.0, 0.0, 0.0),
        point: ArrayLike = (0.0, 0.0, 0.0),
        axes: str = "femur",
        point_in: str = "tibia",
        name: str = "load",
    ):
        self.force = jnp.asarray(force, float)
        self.moment = jnp.asarray(moment, float)
        self.point = jnp.asarray(point, float)
        self.axes = axes
        self.point_in = point_in
        self.name = name

    def __check_init__(self):
        for field, value, known in (
            ("axes", self.axes, AXES),
            ("point_in", self.point_in, BONES),
        ):
            if value not in known:
                raise ValueError(f"Load.{field} is {value!r}; expected one of {known}")

    def wrench(self, tibia: Placement) -> Wrench:
        """On the tibia, about the tibia's origin in femur axes."""
        force, moment, point = vector(self.force), vector(self.moment), vector(self.point)
        if self.axes == "tibia":
            force, moment = tibia.turn(force), tibia.turn(moment)
        elif self.axes == GROOD_SUNTAY:
            axes = transpose(grood_suntay_axes(tibia))
            force, moment = rotate(axes, force), rotate(axes, moment)
        if self.point_in == "tibia":
            arm = tibia.turn(point)
        else:
            arm = subtract(point, tibia.translation)
        return Wrench.at(arm, force, moment)

    def work(self, pose: Pose, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force on some coordinates: N mm per rad of a rotation, N of a translation."""
        tibia = pose.placement
        return generalised_force(pose, tibia, self.wrench(tibia), names)


class Support(eqx.Module):
    """What a machine adds along one coordinate, whatever the pose: it does work on no other.

    Attributes:
        size: N mm per rad of a rotation, N of a translation, `(...)`.
        coordinate: its name.
    """

    size: Array
    coordinate: str = eqx.field(static=True)

    def work(self, pose: Pose, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force on some coordinates."""
        nothing = jnp.zeros(jnp.shape(pose.adduction))
        return tuple(nothing + self.size if name == self.coordinate else nothing for name in names)


class ConstantTensionLine(eqx.Module):
    """A line of constant tension from a femoral point, which may travel with flexion, to the tibia.

    With it the weight on the quadriceps tendon of paper 1 acts as the patellar tendon's pull
    while no patella is modelled: its upper end follows the patella's path over flexion.

    Attributes:
        tension: N.
        origin: polynomial in flexion (rad) of the upper end, shape `(k, 3, ...)`, mm, femur
            frame, lowest power first. One row is a fixed point.
        insertion: shape `(3, ...)`, mm, tibia frame.
        name: what reports call it.
    """

    tension: Array
    origin: Array
    insertion: Array
    name: str = eqx.field(static=True, default="line")

    def __init__(
        self, tension: ArrayLike, origin: ArrayLike, insertion: ArrayLike, name: str = "line"
    ):
        self.tension = jnp.asarray(tension, float)
        self.origin = jnp.asarray(origin, float)
        self.insertion = jnp.asarray(insertion, float)
        self.name = name

    def energy(self, flexion: Array, tibia: Placement) -> Array:
        """Tension times length, N mm."""
        return self.tension * norm(self._line(flexion, tibia)[1])

    def wrench(self, flexion: Array, tibia: Placement) -> Wrench:
        """On the tibia, about the tibia's origin in femur axes."""
        arm, line = self._line(flexion, tibia)
        length = norm(line)
        pull = -self.tension / jnp.where(length > 0, length, 1.0)
        return Wrench.at(arm, scale(pull, line))

    def work_of_end(self, flexion: Array, tibia: Placement) -> Array:
        """Generalised force on flexion that the travelling upper end adds, N mm per rad."""
        rate = jnp.zeros_like(self.origin[0])
        for power, row in reversed(list(enumerate(self.origin))[1:]):
            rate = rate * flexion + power * row
        _, line = self._line(flexion, tibia)
        length = norm(line)
        return self.tension / jnp.where(length > 0, length, 1.0) * dot(line, vector(rate))

    def _line(self, flexion: Array, tibia: Placement) -> tuple[Vector, Vector]:
        """The insertion from the tibia's origin and from the upper end, femur axes, mm."""
        end = self.origin[-1]
        for row in self.origin[-2::-1]:
            end = end * flexion + row
        arm = tibia.turn(vector(self.insertion))
        return arm, subtract(add(arm, tibia.translation), vector(end))
