"""Force and moment of springs at points, and how they change as the bones move.

A solve asks for the change of the wrench along five motions. Differentiated, each motion would go
over all points again; but what it does to a point is a few lines of vector algebra, and their sum
over the points is a 6 x 6 stiffness that serves all motions. A point `h` of the femur that moves
by `u` changes the depth there by `-s . u`, where `s` is the slope of the depth, and with the force
`f = -P a s` (pressure, area)

    f by   a P' s (s . u) - P a (change of s),
    s by   w x s - s (n . w x s) - M u,    M = (I - s n') H (I - n s') / (g . n),

Rims that give way (`Ring`) lose depth `c u`, where the outward motions `u` of their sections are
such that the energy is least. Their change follows by elimination: with `B` the change of what
pushes sections outwards and `H` the second derivative of the energy by `u`, the stiffness is less
by `B' H^-1 B`.

`w` the rotation of the femur, `n` the normal of the tibial surface, `g` and `H` the first two
derivatives of the femoral level. What springs are made of, a modulus above all, leaves the rays as
they are, and is differentiated there. Any change of a surface is differentiated with its rays.
"""

__all__ = ["PointFaults"]

import dataclasses
import functools
import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry import AXES, ZERO, Condyles, Matrix, Placement, Surface, Vector, plus, times
from kneejax.mechanics._loads import Wrench
from kneejax.mechanics.contact._border import OFF_SURFACE_MM
from kneejax.mechanics.contact._points import (
    Points,
    Sampled,
    asked_at,
    of_usual_rows,
    over_rays,
    over_unusual_rows,
    quick_depths,
    quickly_with_bend,
    row_after_row,
    sample,
    thoroughly,
)
from kneejax.mechanics.contact._rays import FARTHEST, Exit, thorough_exit
from kneejax.mechanics.contact._ring import Hoops
from kneejax.numerics import instantiate, jvp_of_moved, none_of


class PointFaults(eqx.Module):
    """What is wrong with springs at points, or with contacts of them; each `(...)`, as the poses.

    Attributes:
        depth: overlap, mm, negative apart; of a contact the largest, of several the least of these.
        too_deep: the overlap is the whole layer somewhere.
        outside: points touch more than `OFF_SURFACE_MM` outside the region in which the femoral
            surface is known.
        lost: the depth of a point could not be found.
    """

    depth: Array
    too_deep: Array
    outside: Array
    lost: Array

    def and_of(self, other: "PointFaults") -> "PointFaults":
        """Those of two contacts together."""
        return PointFaults(
            jnp.minimum(self.depth, other.depth),
            self.too_deep | other.too_deep,
            self.outside | other.outside,
            self.lost | other.lost,
        )


def sampled_wrenches(sampled: Sampled) -> Wrench:
    """Wrench of each spring on the tibia, about its origin and in its axes.

    A displacement of the tibia changes a depth by its slope, at the point where the normal's line
    leaves the femur: the force is pressure times area times that slope, there.
    """
    share = -sampled.points.force(sampled.depth)
    couple = share * sampled.twist
    return Wrench.at(sampled.hit, share * sampled.slope, couple)


def faults_at(femoral: Surface, sampled: Sampled, motion: Placement) -> PointFaults:
    """What is wrong at each point."""
    depth, points = sampled.depth, sampled.points
    off = femoral.beyond(points.in_femoral(motion, sampled.hit)) > OFF_SURFACE_MM
    return PointFaults(depth, depth >= points.layer, (depth > 0) & off, sampled.lost)


@jax.custom_jvp
def press_points(
    femoral: Surface | Condyles, points: Points, motion: Placement, hoops: Hoops | None
) -> tuple[Array, Wrench, PointFaults]:
    """Energy and wrench of springs at points, and what is wrong with them.

    Returns:
        N mm; the wrench on the tibia about its origin and in its axes; faults, of which the depth
        is told point by point, and which have no derivative.
    """
    answer = partial(_pressed_and_faults, asked_at(femoral, points), motion)
    (energy, wrench), faults = over_rays(femoral, points, motion, answer, hoops)
    return energy, wrench, lax.stop_gradient(faults)


def _pressed_and_faults(femoral: Surface, motion: Placement, sampled: Sampled):
    energy = sampled.energy
    faults = faults_at(femoral, sampled, motion)
    depth = jnp.broadcast_to(faults.depth, jnp.shape(faults.too_deep))
    found = (jnp.any(x, axis=0) for x in (faults.too_deep, faults.outside, faults.lost))
    return (energy, _of_all(sampled_wrenches(sampled))), PointFaults(depth, *found)


def _press_points_jvp(primals, tangents):
    femoral, points, motion, hoops = primals
    of_femoral, of_points, of_motion, of_hoops = tangents
    if _moves((of_femoral, of_points.point, of_points.normal, of_points.femoral)):
        return jax.jvp(press_points.fun, primals, instantiate(tangents))
    changes = []
    if _moves((of_points, of_hoops)):
        rays, surface = sample(femoral, points, motion), asked_at(femoral, points)

        def pressed(points: Points, hoops: Hoops | None):
            sampled = dataclasses.replace(rays, points=points).settled(hoops)
            held, faults = _pressed_and_faults(surface, motion, sampled)
            return *held, lax.stop_gradient(faults)

        value, change = jvp_of_moved(pressed, (points, hoops), (of_points, of_hoops))
        changes.append(change[:2])
    if _moves(of_motion) or not changes:
        energy, wrench, by_twist, faults = _stiff(femoral, points, motion, hoops)
        shift, turn = _twist(motion, instantiate(of_motion))
        # The work of the wrench on the tibia, as the femur moves instead.
        work, change = plus(shift @ wrench.force, turn @ wrench.moment), Wrench(ZERO, ZERO)
        for rate, by in zip((*shift, *turn), by_twist, strict=True):
            change = change + Wrench(rate * by.force, rate * by.moment)
        value = energy, wrench, faults
        changes.append((work, change))
    energy, wrench = (functools.reduce(operator.add, x) for x in zip(*changes, strict=True))
    return value, (energy, wrench, none_of(value[2]))


def _moves(tangents: Any) -> bool:
    return not all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(tangents))


def _stiff(
    femoral: Surface | Condyles, points: Points, motion: Placement, hoops: Hoops | None
):
    """Energy and wrench, the wrench's change by three shifts and three turns, and faults."""
    surface = asked_at(femoral, points)
    quick, sound = quick_depths(surface, points, motion)
    sampled, *level = quickly_with_bend(surface, points, motion, quick)
    outward = exits = None
    if hoops is not None:
        depth, exits = _every_depth(femoral, points, motion, sampled, quick, sound)
        outward = hoops.settled(points, depth)
        points = dataclasses.replace(points, given_way=hoops.given_way(depth, outward))
        left = points.left_of(sampled.depth)
        sampled = dataclasses.replace(sampled, points=points, depth=left)
    usual = sampled.only(of_usual_rows(sound))
    held, faults = _pressed_and_faults(surface, motion, usual)
    sums = held, stiffness(usual, motion, *level), _pushes(hoops, usual)

    def again():
        search = partial(_stiff_row, femoral, motion)
        *rows, firmer, found = over_unusual_rows(points, quick, sound, search, _nothing, exits)
        held, by_twist = jax.tree.map(lambda x: jnp.sum(x, axis=0), rows)
        changes = [jax.tree.map(lambda x, k=k: x[k], by_twist) for k in range(6)]
        pushes: list[Any] = [()] * 6
        if hoops is not None:
            each = (row_after_row(firmer[:, k])[: len(quick)] for k in range(6))
            pushes = [*map(hoops.pushed, each)]
        depth = jnp.maximum(faults.depth, row_after_row(found.depth)[: len(quick)])
        bad = (
            x | jnp.any(y, axis=0)
            for x, y in zip(jax.tree.leaves(faults)[1:], jax.tree.leaves(found)[1:], strict=True)
        )
        more = held, changes, pushes
        return jax.tree.map(jnp.add, sums, more), PointFaults(depth, *bad)

    (held, changes, pushes), faults = lax.cond(jnp.all(sound), lambda: (sums, faults), again)
    energy, wrench = held
    if hoops is not None and outward is not None:
        energy = energy + hoops.energy(outward)
        firm = hoops.firm(points, points.left_of(depth))
        moved = [hoops.solved(firm, push) for push in pushes]
        changes = [
            change + _of_six([-jnp.sum(push * move, axis=0) for push in pushes])
            for change, move in zip(changes, moved, strict=True)
        ]
    return energy, wrench, changes, faults


def _of_six(rows: list[Array]) -> Wrench:
    return Wrench(Vector(*rows[:3]), Vector(*rows[3:]))


def _pushes(hoops: Hoops | None, sampled: Sampled) -> list[Any]:
    """Change of what pushes the sections of rims outwards by three shifts and three turns of the
    femur, each `(sections, ...)`; nothing without rims."""
    if hoops is None:
        return [()] * 6
    _, firm = jax.jvp(sampled.points.force, (sampled.depth,), (jnp.ones_like(sampled.depth),))
    turn = sampled.hit.cross(sampled.slope)
    return [hoops.pushed(-firm * x) for x in (*sampled.slope, *turn)]


def _every_depth(
    femoral: Surface | Condyles, points: Points, motion: Placement, usual: Sampled, quick: Array,
    sound: Array,
) -> tuple[Array, Exit]:  # fmt: skip
    """Depth of all points, of unusual rays too, mm, and where the rays of unusual rows end."""

    def of_row(own: Points, known: Array, is_known: Array, _: None) -> tuple[Array, Exit]:
        surface = asked_at(femoral, own)
        found = thorough_exit(surface, *own.lines(motion), known, is_known)
        return thoroughly(surface, own, motion, known, is_known, found).depth, found

    def nothing(known: Array) -> tuple[Array, Exit]:
        no = jnp.zeros(known.shape, bool)
        return known, Exit(known, known, no, no)

    def again() -> tuple[Array, Exit]:
        rows, found = over_unusual_rows(points, quick, sound, of_row, nothing)
        depth = row_after_row(rows)[: len(quick)]
        return jnp.where(of_usual_rows(sound), usual.depth, depth), found

    def already() -> tuple[Array, Exit]:
        return usual.depth, jax.tree.map(jnp.zeros_like, jax.eval_shape(again)[1])

    return lax.cond(jnp.all(sound), already, again)


def _stiff_row(
    femoral: Surface | Condyles, motion: Placement, points: Points, known: Array,
    is_known: Array, found: Exit | None,
):  # fmt: skip
    """As `_stiff`, differentiated: of points whose rays are searched thoroughly; with the change of
    each point's force."""
    surface, nowhere = asked_at(femoral, points), (jnp.zeros(known.shape[1:]),) * 6
    if found is None:
        found = thorough_exit(surface, *points.lines(motion), known, is_known)

    def pressed(*twist: Array):
        moved = _displaced(motion, twist)
        sampled = thoroughly(surface, points, moved, known, is_known, found)
        held, faults = _pressed_and_faults(surface, motion, sampled)
        return (*held, sampled.points.force(sampled.depth)), faults

    def by(unit: Array):
        rates = tuple(x + rate for x, rate in zip(nowhere, unit, strict=True))
        return jax.jvp(pressed, nowhere, rates, has_aux=True)

    held, (_, *changes), faults = lax.map(by, jnp.eye(6))
    (energy, wrench, _), faults = jax.tree.map(lambda x: x[0], (held, faults))
    return (energy, wrench), *changes, faults


def _nothing(known: Array):
    """What `_stiff_row` gives of points that do nothing."""
    zero, fine = jnp.zeros(known.shape[1:]), jnp.zeros(known.shape[1:], bool)
    wrench, changes = (
        Wrench(Vector(x, x, x), Vector(x, x, x)) for x in (zero, jnp.zeros((6, *zero.shape)))
    )
    apart, unpressed = jnp.full(known.shape, -FARTHEST), jnp.zeros((6, *known.shape))
    return (zero, wrench), changes, unpressed, PointFaults(apart, fine, fine, fine)


def _displaced(motion: Placement, twist: tuple[Array, ...]) -> Placement:
    """The femur after a small shift and turn about the tibia's origin."""
    shift, turn = Vector(*twist[:3]), Vector(*twist[3:])
    columns = (AXES if motion.rotation is None else motion.rotation).T
    turned = Matrix(*(column + turn.cross(column) for column in columns)).T
    moved = motion.translation + shift + turn.cross(motion.translation)
    return Placement(turned, moved)


press_points.defjvp(_press_points_jvp, symbolic_zeros=True)


def stiffness(
    sampled: Sampled, motion: Placement, gradient: Vector, bend: Matrix
) -> list[Wrench]:
    """Change of the wrench on the tibia by motions of the femur, about its origin in its axes.

    Returns:
        Per mm along X, Y and Z; per rad about them, through the origin.
    """
    hit, slope, normal = sampled.hit, sampled.slope, sampled.points.normal
    depth = sampled.depth
    # N, and N per mm of depth.
    pressing, firm = jax.jvp(sampled.points.force, (depth,), (jnp.ones_like(depth),))
    force = -pressing
    # Force by a motion of the femoral point, if the slope keeps its direction: symmetric.
    bent = _bend_along_layer(sampled, motion, gradient, bend)
    each = zip(slope, bent, strict=True)
    spring = Matrix(*(firm * part * slope - force * row for part, row in each))
    aside = slope.cross(normal)
    by_shift, by_turn = [], []
    for unit in AXES:
        change = spring @ unit
        # The point at which the force acts moves along the normal, as the depth does.
        arm_moves = -times(force, slope @ unit) * aside
        by_shift.append(_of_all(Wrench(change, arm_moves + hit.cross(change))))
        moved = unit.cross(hit)
        turned = unit.cross(slope) - unit @ aside * slope
        change = spring @ moved + force * turned
        arm_moves = -force * (slope @ moved) * aside
        by_turn.append(_of_all(Wrench(change, arm_moves + hit.cross(change))))
    return [*by_shift, *by_turn]


def _bend_along_layer(
    sampled: Sampled, motion: Placement, gradient: Vector, bend: Matrix
) -> Matrix:
    """The matrix `M` of the file's first lines, 1/mm."""
    slope, normal = sampled.slope, sampled.points.normal
    rotation = motion.after(sampled.points.femoral).rotation
    if rotation is not None:
        gradient = rotation @ gradient
        bend = rotation @ (bend @ rotation.T)
    along = bend @ normal
    twice = normal @ along
    steep = gradient @ normal
    per_steep = 1.0 / jnp.where(steep < 0, steep, -1.0)
    return Matrix(*(
        per_steep * (row - a * slope - s * along + twice * s * slope)
        for row, a, s in zip(bend, along, slope, strict=True)
    ))  # fmt: skip


def _twist(motion: Placement, rates: Placement) -> tuple[Vector, Vector]:
    """Velocity of the femur's point at the tibia's origin, and its rotation."""
    if motion.rotation is None:
        return rates.translation, ZERO
    assert rates.rotation is not None
    spin = rates.rotation @ motion.rotation.T
    turn = Vector(*(0.5 * (spin[k][j] - spin[j][k]) for j, k in ((1, 2), (2, 0), (0, 1))))
    return rates.translation - turn.cross(motion.translation), turn


def summed(wrench: Wrench, add: Callable[[Array], Array]) -> Wrench:
    """Wrenches at points, put together by a sum over the points."""
    parts = jnp.broadcast_arrays(*(jnp.asarray(x) for x in (*wrench.force, *wrench.moment)))
    sums = [*map(add, parts)]
    return Wrench(Vector(*sums[:3]), Vector(*sums[3:]))


_of_all = partial(summed, add=partial(jnp.sum, axis=0))
