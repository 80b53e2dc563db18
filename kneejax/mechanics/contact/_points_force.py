"""Force and moment of a contact summed over points, and how they change as the bones move.

A solve asks for the change of the wrench along five motions. Differentiated, each motion would go
over all points again; but what it does to a point is a few lines of vector algebra, and their sum
over the points is a 6 x 6 stiffness that serves all motions. A point `h` of the femur that moves
by `u` changes the depth there by `-s . u`, where `s` is the slope of the depth, and with the force
`f = -P a s` (pressure, area)

    f by   a P' s (s . u) - P a (change of s),
    s by   w x s - s (n . w x s) - M u,    M = (I - s n') H (I - n s') / (g . n),

`w` the rotation of the femur, `n` the normal of the tibial surface, `g` and `H` the first two
derivatives of the femoral level. Any other change, of a surface or of a modulus, is differentiated.
"""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry import (
    Placement,
    Rotation,
    Vector,
    add,
    compose,
    cross,
    dot,
    plus,
    rotate,
    scale,
    subtract,
    times,
    transpose,
)
from kneejax.mechanics._wrench import Wrench
from kneejax.mechanics.contact._quadrature import (
    Points,
    Sampled,
    over_rays,
    quick_depths,
    quickly_with_bend,
    thoroughly,
)
from kneejax.numerics import instantiate, none_of

if TYPE_CHECKING:
    from kneejax.mechanics.contact._contact import Contact

class PointFaults(eqx.Module):
    """What is wrong with a contact over points, or with several; each `(...)` for the lanes.

    Attributes:
        depth: the largest overlap, mm, of the contact that is least deep; negative apart.
        too_deep: the overlap is the whole layer somewhere.
        outside: points touch outside the region in which the femoral surface is known.
        lost: the depth of a point could not be found.
    """

    depth: Array
    too_deep: Array
    outside: Array
    lost: Array

    def and_of(self, other: PointFaults) -> PointFaults:
        """Those of two contacts together."""
        return PointFaults(
            jnp.minimum(self.depth, other.depth),
            self.too_deep | other.too_deep,
            self.outside | other.outside,
            self.lost | other.lost,
        )


_UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def sampled_wrench(contact: Contact, sampled: Sampled) -> Wrench:
    """Wrench on the tibia in its surface's frame.

    A displacement of the tibia changes a depth by its slope, at the point where the normal's line
    leaves the femur: the force is pressure times area times that slope, there.

    Args:
        contact: whose pressure law is meant.
        sampled: depths at the points.
    """
    share = -contact.point_force(sampled)
    couple = scale(share, sampled.twist)
    return _sum(Wrench.at(sampled.hit, scale(share, sampled.slope), couple))


def faults_of_points(contact: Contact, sampled: Sampled, motion: Placement) -> PointFaults:
    """What is wrong with a contact, from depths at its points.

    Args:
        contact: whose layer and femoral region are meant.
        sampled: depths at the points.
        motion: from the femoral to the tibial surface's frame.
    """
    depth = sampled.depth
    deep = jnp.any(depth >= contact.layer(sampled.points), axis=0)
    known = contact.femoral.knows(motion.apply_inverse(sampled.hit))
    outside = jnp.any((depth > 0) & ~known, axis=0)
    return PointFaults(jnp.max(depth, axis=0), deep, outside, jnp.any(sampled.lost, axis=0))


@jax.custom_jvp
def press_points(
    contact: Contact, points: Points, motion: Placement
) -> tuple[Array, Wrench, PointFaults]:
    """Energy and wrench of a layer over points, and what is wrong with it.

    Args:
        contact: gives the femoral surface and the pressure law.
        points: of the tibial surface.
        motion: from the femoral to the tibial surface's frame.

    Returns:
        N mm; the wrench on the tibia in its surface's frame; faults, which have no derivative.
    """
    answer = partial(_pressed_and_faults, contact, motion)
    (energy, wrench), faults = over_rays(contact.femoral, points, motion, answer)
    return energy, wrench, lax.stop_gradient(faults)


def _pressed_and_faults(contact: Contact, motion: Placement, sampled: Sampled):
    return _pressed(contact, sampled), faults_of_points(contact, sampled, motion)


def _pressed(contact: Contact, sampled: Sampled) -> tuple[Array, Wrench]:
    return contact.sampled_energy(sampled), sampled_wrench(contact, sampled)


def _press_points_jvp(primals, tangents):
    contact, points, motion = primals
    *of_parts, of_motion = tangents
    if not all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(of_parts)):
        return jax.jvp(press_points.fun, primals, instantiate(tangents))
    (energy, wrench), faults, by_twist = _stiff(contact, points, motion)
    shift, turn = _twist(motion, instantiate(of_motion))
    change = Wrench((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for rate, by in zip((*shift, *turn), by_twist, strict=True):
        change = change + Wrench(scale(rate, by.force), scale(rate, by.moment))
    # The work of the wrench on the tibia, as the femur moves instead.
    work = plus(dot(shift, wrench.force), dot(turn, wrench.moment))
    return (energy, wrench, faults), (work, change, none_of(faults))


def _stiff(contact: Contact, points: Points, motion: Placement):
    """Energy and wrench, faults, and the wrench's change by three shifts and three turns."""
    quick, sound = quick_depths(contact.femoral, points, motion)
    sampled, *level = quickly_with_bend(contact.femoral, points, motion, quick)
    stiff = stiffness(contact, sampled, motion, *level)
    usual = *_pressed_and_faults(contact, motion, sampled), stiff

    def again():
        nowhere = (jnp.zeros(jnp.shape(motion.translation[0])),) * 6

        def of_row(row):
            own, known, is_known = row

            def pressed(*twist: Array):
                moved = _displaced(motion, twist)
                sampled = thoroughly(contact.femoral, own, moved, known, is_known)
                return _pressed_and_faults(contact, motion, sampled)

            def by(unit: Array):
                rates = tuple(x + rate for x, rate in zip(nowhere, unit, strict=True))
                return jax.jvp(pressed, nowhere, rates, has_aux=True)

            return lax.map(by, jnp.eye(6))

        # Row by row of points: a program's memory is that of its largest part, asked for in each
        # call. All at once, this part, which is seldom needed, made every solve four times slower.
        count, shape = contact.points[0], jnp.shape(quick)
        split = jax.tree.map(
            lambda x: _by_rows(x, count, shape), (points, quick, sound), is_leaf=_is_number
        )
        held, changes, faults = lax.map(of_row, split)
        worst = jax.tree.map(lambda x: jnp.max(x[:, 0], axis=0), faults)
        held, changes = jax.tree.map(lambda x: jnp.sum(x, axis=0), (held, changes[1]))
        first = jax.tree.map(lambda x: x[0], held)
        return first, worst, [jax.tree.map(lambda x, k=k: x[k], changes) for k in range(6)]

    return lax.cond(jnp.all(sound), lambda: usual, again)


def _is_number(x) -> bool:
    return isinstance(x, float)


def _by_rows(x: Array | float, count: int, shape: tuple[int, ...]) -> Array:
    """What is known of points, `(points, ...)`, as `(rows, points of a row, ...)`."""
    x = jnp.asarray(x)
    whole = jnp.broadcast_to(x, shape[:1] + (x.shape[1:] or (1,) * (len(shape) - 1)))
    return whole.reshape(count, -1, *whole.shape[1:])


def _displaced(motion: Placement, twist: tuple[Array, ...]) -> Placement:
    """The femur after a small shift and turn about the origin of the tibial surface's frame."""
    shift, turn = twist[:3], twist[3:]
    columns = transpose(_UNITS if motion.rotation is None else motion.rotation)
    turned = transpose(tuple(add(column, cross(turn, column)) for column in columns))
    moved = add(motion.translation, add(shift, cross(turn, motion.translation)))
    return Placement(turned, moved)


press_points.defjvp(_press_points_jvp, symbolic_zeros=True)


def stiffness(
    contact: Contact, sampled: Sampled, motion: Placement, gradient: Vector, bend: Rotation
) -> list[Wrench]:
    """Change of the wrench on the tibia by motions of the femur, in the tibial surface's frame.

    Args:
        contact: gives the femoral surface and the pressure law.
        sampled: depths at the points of the tibial surface, none of them held.
        motion: from the femoral to the tibial surface's frame.
        gradient: of the femoral level where the rays end, in the femoral surface's frame.
        bend: its derivative, rows by x, y, z.

    Returns:
        Per mm along X, Y and Z; per rad about them, through the origin.
    """
    hit, slope, normal = sampled.hit, sampled.slope, sampled.points.normal
    pressing, firm = _force_and_slope(contact, sampled)
    force = -pressing
    # Force by a motion of the femoral point, if the slope keeps its direction: symmetric.
    bent = _bend_along_layer(sampled, motion, gradient, bend)
    spring = tuple(
        tuple(firm * slope[i] * slope[j] - force * bent[i][j] for j in range(3)) for i in range(3)
    )
    aside = cross(slope, normal)
    by_shift, by_turn = [], []
    for unit in _UNITS:
        change = rotate(spring, unit)
        # The point at which the force acts moves along the normal, as the depth does.
        arm_moves = scale(-times(force, dot(slope, unit)), aside)
        by_shift.append(_sum(Wrench(change, add(arm_moves, cross(hit, change)))))
        moved = cross(unit, hit)
        turned = subtract(cross(unit, slope), scale(dot(unit, aside), slope))
        change = add(rotate(spring, moved), scale(force, turned))
        arm_moves = scale(-force * dot(slope, moved), aside)
        by_turn.append(_sum(Wrench(change, add(arm_moves, cross(hit, change)))))
    return [*by_shift, *by_turn]


def _force_and_slope(contact: Contact, sampled: Sampled):
    """N, and N per mm of depth."""

    def pressing(depth):
        return contact.point_force(dataclasses.replace(sampled, depth=depth))

    return jax.jvp(pressing, (sampled.depth,), (jnp.ones_like(sampled.depth),))


def _bend_along_layer(
    sampled: Sampled, motion: Placement, gradient: Vector, bend: Rotation
) -> Rotation:
    """The matrix `M` of the file's first lines, 1/mm."""
    slope, normal = sampled.slope, sampled.points.normal
    if motion.rotation is not None:
        gradient = motion.turn(gradient)
        bend = compose(motion.rotation, compose(bend, transpose(motion.rotation)))
    along = rotate(bend, normal)
    twice = dot(normal, along)
    steep = dot(gradient, normal)
    per_steep = 1.0 / jnp.where(steep < 0, steep, -1.0)
    return tuple(
        tuple(
            per_steep * (bend[i][j] - along[i] * slope[j] - slope[i] * along[j]
                         + twice * slope[i] * slope[j])
            for j in range(3)
        )
        for i in range(3)
    )  # fmt: skip


def _twist(motion: Placement, rates: Placement) -> tuple[Vector, Vector]:
    """Velocity of the femur's point at the tibial frame's origin, and its rotation."""
    if motion.rotation is None:
        return rates.translation, (0.0, 0.0, 0.0)
    spin = compose(rates.rotation, transpose(motion.rotation))
    turn = tuple(
        0.5 * (spin[k][j] - spin[j][k]) for j, k in ((1, 2), (2, 0), (0, 1))
    )
    return subtract(rates.translation, cross(turn, motion.translation)), turn


def _sum(wrench: Wrench) -> Wrench:
    parts = jnp.broadcast_arrays(*(jnp.asarray(x) for x in (*wrench.force, *wrench.moment)))
    fx, fy, fz, mx, my, mz = (jnp.sum(x, axis=0) for x in parts)
    return Wrench((fx, fy, fz), (mx, my, mz))
