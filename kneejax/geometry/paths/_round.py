"""Taut paths around a sphere and a cylinder, and what every wrapped path has in common.

A taut path is a straight piece, a geodesic of the obstacle, a straight piece; each straight piece
touches the surface where the geodesic begins. Its length `L` is a function of its two ends with

    dL = -t0 . dstart + t1 . dend

(`t0`, `t1`: directions of the two straight pieces, along the path), and these directions turn by

    dt0 = -(n0 . dstart) / l0 n0 + (y_end - A y_start) / B b0
    dt1 =  (n1 . dend)   / l1 n1 + (D y_end - y_start) / B b1

where `n` is the normal of the surface at the point of contact, `b = n x t`, `l` the length of the
straight piece, `y_start = b0 . dstart`, `y_end = b1 . dend`. A, B and D are entries of the matrix
that carries a sideways deviation and its slope from the start to the end; along the arc it solves
Jacobi's equation `y'' + K y = 0` with the Gaussian curvature K, along the straight pieces `K = 0`
(do Carmo, Differential Geometry of Curves and Surfaces, 5-5). B vanishes where neighbouring paths
meet again at the end: the path is then about to lose its place as the shortest one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from kneejax.geometry._vectors import AXES, Vector, minus
from kneejax.numerics import arctan2

#: Heights above the surface below this (relative, squared) count as on it: an end on the
#: surface gets a straight piece of a thousandth of a permille of a radius instead of none.
ON_SURFACE = 1e-12
#: Least B as a part of the length: where all paths around a sphere are equally short, the
#: sideways stiffness is infinite, and this keeps it finite.
LEAST_SPREAD = 1e-6


class Wrapped(NamedTuple):
    """A taut path that touches its obstacle; lengths in mm, vectors in the obstacle's frame.

    For a slightly negative wrap angle the two straight pieces overlap and the arc between them
    is negative: the analytic continuation of the length, which the hand-over to the free path
    needs.
    """

    length: Array
    leave: Vector
    reach: Vector
    contacts: tuple[Vector, Vector]
    normals: tuple[Vector, Vector]
    pieces: tuple[Array, Array]
    transfer: tuple[Array, Array, Array]
    opposite: Array
    aim: tuple[Array, ...]


class Section(NamedTuple):
    """The section through both ends and the centre, where the obstacle is a unit sphere.

    `turn` is the angle of the arc between the two tangent points, negative where the segment
    stays clear; `forward` is the direction across `start` towards `end`, `pole` the normal in
    the sense of the path.
    """

    turn: Array
    contacts: tuple[Vector, Vector]
    forward: Vector
    pole: Vector
    tangents: tuple[Array, Array]
    opposite: Array


def unit(a: Vector) -> Vector:
    """Direction of a vector; zero for the zero vector, with finite derivatives."""
    square = jnp.asarray(a @ a, float)
    positive = square > 0.0
    inverse = jnp.where(positive, 1.0 / jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)
    return inverse * a


def unit_outside(a: Vector) -> Vector:
    """Direction of a point outside the unit sphere; shorter than one for a point inside."""
    return a / jnp.sqrt(jnp.maximum(a @ a, 1.0))


def choose(condition: Array, a: Vector, b: Vector) -> Vector:
    """`a` where the condition holds, else `b`."""
    return Vector(*(jnp.where(condition, i, j) for i, j in zip(a, b, strict=True)))


def section(start: Vector, end: Vector) -> Section:
    """Tangents to the unit sphere in the plane of its centre and two points outside it, the
    shorter way around.

    Where the three are on one line any plane does; the one nearest to the least component of
    `start` is taken.
    """
    out = unit_outside(start)
    along = out @ end
    across = end - along * out
    width = across.norm()
    # Any direction across a line through the centre: start the line, drop its part along.
    x, y, z = (jnp.abs(c) for c in out)
    least_x, least_y = (x <= y) & (x <= z), (y < x) & (y <= z)
    axis = Vector(1.0 * least_x, 1.0 * least_y, 1.0 * ~(least_x | least_y))
    beside = unit(axis - axis @ out * out)
    aligned = width < 1e-12 * end.norm()
    forward = choose(aligned, beside, across / jnp.where(aligned, 1.0, width))
    return _tangents(start, end, forward, width)


def section_by_side(start: Vector, end: Vector, side: Vector) -> Section:
    """The same in the plane across Z, the way that passes on a given side of the axis (a direction
    across Z), however far it leads around; the Z of both ends counts for nothing."""
    ends = unit_outside(start), unit_outside(end)
    # From `start` over `side` to `end`. The end that stands farther off the line along `side`
    # decides: the other may go past the far side.
    lead = (ends[0] - ends[1]).cross(side) @ AXES.z
    pole = Vector(0.0, 0.0, jnp.where(lead >= 0.0, 1.0, -1.0))
    forward = pole.cross(ends[0])
    return _tangents(start, end, forward, forward @ end)


def _tangents(start: Vector, end: Vector, forward: Vector, width: Array) -> Section:
    """Tangents to the unit sphere of a path that leaves `start` forward, a unit vector across it
    in the plane of the section; `width` is how far `end` lies that way, negative beyond half a
    turn."""
    square = start @ start, end @ end
    distance = tuple(jnp.sqrt(jnp.maximum(s, 1.0)) for s in square)
    tangents = tuple(jnp.sqrt(jnp.maximum(s - 1.0, ON_SURFACE)) for s in square)
    out, out_end = start / distance[0], end / distance[1]
    along, pole = out @ end, out.cross(forward)
    back = out_end.cross(pole)
    first = (out + tangents[0] * forward) / distance[0]
    last = (out_end + tangents[1] * back) / distance[1]
    # Arguments of complex numbers add: one arctangent for the angle less its two free parts.
    free = 1.0 - tangents[0] * tangents[1], tangents[0] + tangents[1]
    turn = arctan2(width * free[0] - along * free[1], along * free[0] + width * free[1])
    between = arctan2(width, along)
    # Beyond half a turn both count on.
    turn = jnp.where((width < 0.0) & (turn < 0.0), turn + 2.0 * jnp.pi, turn)
    between = jnp.where(width < 0.0, between + 2.0 * jnp.pi, between)
    # Round the other side the ends see each other at 2 pi less their angle.
    opposite = 2.0 * jnp.pi + turn - 2.0 * between
    return Section(turn, (first, last), forward, pole, (tangents[0], tangents[1]), opposite)


def joined(first: Array, arc: tuple[Array, Array, Array, Array], last: Array) -> tuple[Array, ...]:
    """Entries A, B, D of the transfer over a straight piece, an arc `(a, b, c, d)`, a piece."""
    a, b, c, d = arc
    top, bottom = a + last * c, b + last * d
    return top, top * first + bottom, c * first + d


def around_sphere(
    start: Vector, end: Vector, shape: Vector, aim: tuple[Array, ...] = ()
) -> Wrapped:
    """The taut path around a sphere of radius `shape[0]`."""
    radius = shape[0]
    s = section(start / radius, end / radius)
    contacts = radius * s.contacts[0], radius * s.contacts[1]
    first, last = radius * s.tangents[0], radius * s.tangents[1]
    sine, cosine = jnp.sin(s.turn), jnp.cos(s.turn)
    length = first + radius * s.turn + last
    return Wrapped(
        length,
        s.pole.cross(s.contacts[0]),
        s.pole.cross(s.contacts[1]),
        contacts,
        s.contacts,
        (first, last),
        joined(first, (cosine, radius * sine, -sine / radius, cosine), last),
        first + radius * s.opposite + last,
        (),
    )


def around_cylinder(
    start: Vector,
    end: Vector,
    shape: Vector,
    aim: tuple[Array, ...] = (),
    *,
    section: Callable[[Vector, Vector], Section] = section,
) -> Wrapped:
    """The taut path around an endless cylinder of radius `shape[0]` about Z: a helix between."""
    radius = shape[0]
    s = section(
        Vector(start.x / radius, start.y / radius, 0.0 * start.z),
        Vector(end.x / radius, end.y / radius, 0.0 * end.z),
    )
    rise = minus(end[2], start[2])
    flat = radius * (s.tangents[0] + s.turn + s.tangents[1])
    flat = jnp.maximum(flat, 1e-9 * radius)
    length = jnp.sqrt(flat * flat + rise * rise)
    stretch, slope = length / flat, rise / flat
    first, last = radius * s.tangents[0], radius * s.tangents[1]
    directions, contacts = [], []
    for point, height in zip(
        s.contacts, (start[2] + first * slope, end[2] - last * slope), strict=True
    ):
        x, y, _ = s.pole.cross(point)
        directions.append(Vector(x / stretch, y / stretch, slope / stretch))
        contacts.append(Vector(radius * point.x, radius * point.y, height))
    one, arc = jnp.ones_like(length), radius * s.turn * stretch
    other = radius * (s.tangents[0] + s.opposite + s.tangents[1])
    first, last = first * stretch, last * stretch
    return Wrapped(
        length,
        directions[0],
        directions[1],
        (contacts[0], contacts[1]),
        s.contacts,
        (first, last),
        joined(first, (one, arc, 0.0 * one, one), last),
        jnp.sqrt(other * other + rise * rise),
        (),
    )


def differentiate(
    w: Wrapped, leave: Vector, reach: Vector, start: Vector, end: Vector
) -> tuple[Array, Vector, Vector]:
    """Changes of length and of both directions with changes of the ends (module docstring)."""
    (n0, n1), (first, last), (a, b, d) = w.normals, w.pieces, w.transfer
    b0, b1 = n0.cross(w.leave), n1.cross(w.reach)
    spread = jnp.maximum(b, LEAST_SPREAD * jnp.abs(w.length))
    y0, y1 = b0 @ start, b1 @ end
    return (
        minus(reach @ end, leave @ start),
        -(n0 @ start) / first * n0 + (y1 - a * y0) / spread * b0,
        n1 @ end / last * n1 + (d * y1 - y0) / spread * b1,
    )
