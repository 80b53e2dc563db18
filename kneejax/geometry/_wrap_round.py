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

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry._vectors import AXES, Component, Vector, minus, plus, times
from kneejax.numerics import arctan2

#: Heights above the surface below this (relative, squared) count as on it: an end on the
#: surface gets a straight piece of a thousandth of a permille of a radius instead of none.
ON_SURFACE = 1e-12
#: Least B as a part of the length: where all paths around a sphere are equally short, the
#: sideways stiffness is infinite, and this keeps it finite.
LEAST_SPREAD = 1e-6


class Wrapped(NamedTuple):
    """A taut path that touches its obstacle; lengths in mm, vectors in the obstacle's frame. For a
    slightly negative wrap angle the two straight pieces overlap and the arc between them is
    negative: the continuation of the length that the hand-over to the free path needs."""

    length: Array
    leave: Vector
    reach: Vector
    contacts: tuple[Vector, Vector]
    normals: tuple[Vector, Vector]
    pieces: tuple[Array, Array]
    transfer: tuple[Array, Array, Array]
    opposite: Array  # length of the path round another side
    aim: tuple[Array, ...] = ()


class Section(NamedTuple):
    """The section through both ends and the centre, where the obstacle is a unit sphere."""

    turn: Array  # of the arc between the two tangent points, negative where the segment stays clear
    contacts: tuple[Vector, Vector]
    forward: Vector  # direction across `start` towards `end`
    pole: Vector  # the normal in the sense of the path
    tangents: tuple[Array, Array]


def unit(a: Vector) -> Vector:
    """Direction of a vector; zero for the zero vector, with finite derivatives."""
    square = a @ a
    return a / jnp.sqrt(jnp.where(square > 0.0, square, jnp.inf))


def inverse_of(a: Vector) -> Vector:
    """One over each component."""
    return Vector(1.0 / a.x, 1.0 / a.y, 1.0 / a.z)


def choose(condition: Array, a: Vector, b: Vector) -> Vector:
    """`a` where the condition holds, else `b`."""
    return Vector(*(jnp.where(condition, i, j) for i, j in zip(a, b, strict=True)))


def changed(tangent: Vector) -> Vector:
    """A change of a vector, as a rule with `symbolic_zeros=True` gets it, with known zeros."""
    return Vector(*(0.0 if isinstance(x, SymbolicZero) else x for x in tangent))


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def section(start: Vector, end: Vector, side: Vector | None = None) -> Section:
    """Tangents to the unit sphere in the plane of its centre and two points outside it, the
    shorter way around; where the three are on one line, in a plane across the axis of the least
    component of `start`.

    With a `side` (a direction across Z) the points lie in the plane across Z, and the way is the
    one that passes on that side of the axis, however far it leads around.
    """
    distance = _distance(start), _distance(end)
    out, out_end = start / distance[0], end / distance[1]
    along = out @ end
    if side is None:
        across = end - along * out
        width = across.norm()
        # Any direction across a line through the centre; across Z too where all else is.
        x, y, z = (jnp.abs(c) for c in out)
        least_x, least_y = (x <= y) & (x <= z), (y < x) & (y <= z)
        axis = Vector(1.0 * least_x, 1.0 * least_y, 1.0 * ~(least_x | least_y))
        beside = unit(out.cross(axis))
        aligned = width < 1e-12 * end.norm()
        forward = choose(aligned, beside, across / jnp.where(aligned, 1.0, width))
        pole = out.cross(forward)
    else:
        # From `start` over `side` to `end`. The end that stands farther off the line along `side`
        # decides: the other may go past the far side.
        lead = (out - out_end).cross(side) @ AXES.z
        pole = Vector(0.0, 0.0, jnp.where(lead >= 0.0, 1.0, -1.0))
        forward = pole.cross(out)
        width = forward @ end
    tangents = tuple(jnp.sqrt(jnp.maximum(p @ p - 1.0, ON_SURFACE)) for p in (start, end))
    first = (out + tangents[0] * forward) / distance[0]
    last = (out_end + tangents[1] * out_end.cross(pole)) / distance[1]
    # Arguments of complex numbers add: one arctangent for the angle less its two free parts.
    free = 1.0 - tangents[0] * tangents[1], tangents[0] + tangents[1]
    turn = arctan2(width * free[0] - along * free[1], along * free[0] + width * free[1])
    # Beyond half a turn it counts on.
    turn = jnp.where((width < 0.0) & (turn < 0.0), turn + 2.0 * jnp.pi, turn)
    return Section(turn, (first, last), forward.full(), pole.full(), tangents)


@partial(section.defjvp, symbolic_zeros=True)
def _section_jvp(side, primals, tangents):
    """Contacts turn in the plane with the ends and as the straight pieces grow, and with the plane;
    traced through `section` the change is seven times as many operations."""
    (start, end), (d_start, d_end) = primals, map(changed, tangents)
    s = section(start, end, side)
    distance = _distance(start), _distance(end)
    out, out_end = start / distance[0], end / distance[1]
    width, size = s.forward @ end, end.norm()
    # The plane's normal stays across both ends: it turns along `out` and along `forward`.
    lower, sideways = times(1.0 / distance[0], s.pole @ d_start), s.pole @ d_end
    steep = 1.0 / jnp.where(jnp.abs(width) < 1e-12 * size, jnp.inf, width)
    tilt = times(minus(times(out @ end, lower), sideways), steep)
    d_pole = tilt * s.forward - lower * out

    def piece(p: Vector, d_p: Vector, tangent: Array) -> Component:
        square = tangent * tangent
        return times(jnp.where(square > ON_SURFACE, 1.0 / tangent, 0.0), p @ d_p)

    d_tangents = piece(start, d_start, s.tangents[0]), piece(end, d_end, s.tangents[1])
    swing = times(1.0 / distance[0], s.forward @ d_start)
    swing_end = times(1.0 / distance[1], s.pole.cross(out_end) @ d_end)
    angles = (
        plus(swing, times(1.0 / (distance[0] * distance[0]), d_tangents[0])),
        minus(swing_end, times(1.0 / (distance[1] * distance[1]), d_tangents[1])),
    )
    d_contacts = tuple(
        angle * s.pole.cross(contact) - (contact @ d_pole) * s.pole
        for angle, contact in zip(angles, s.contacts, strict=True)
    )
    d_forward = -tilt * s.pole - swing * out
    change = Section(minus(angles[1], angles[0]), d_contacts, d_forward, d_pole, d_tangents)
    return s, jax.tree.map(lambda x, dx: jnp.broadcast_to(dx, x.shape), s, change)


def _distance(p: Vector) -> Array:
    """From the centre; one for a point inside the unit sphere."""
    return jnp.sqrt(jnp.maximum(p @ p, 1.0))


def other_way(s: Section, start: Vector, end: Vector) -> Array:
    """Angle of the arc round the other side: there the ends see each other at 2 pi less theirs."""
    width = s.forward @ end
    between = arctan2(width, s.forward.cross(s.pole) @ end)
    return 2.0 * jnp.pi + s.turn - 2.0 * jnp.where(width < 0.0, between + 2.0 * jnp.pi, between)


def joined(first: Array, arc: tuple[Array, Array, Array, Array], last: Array) -> tuple[Array, ...]:
    """Entries A, B, D of the transfer over a straight piece, an arc `(a, b, c, d)`, a piece."""
    a, b, c, d = arc
    top, bottom = a + last * c, b + last * d
    return top, top * first + bottom, c * first + d


def around_sphere(
    start: Vector, end: Vector, shape: Vector, s: Section | None = None, aim: tuple[Array, ...] = ()
) -> Wrapped:
    """The taut path around a sphere of radius `shape[0]`, in a section that may be known."""
    radius = shape[0]
    p, q = start / radius, end / radius
    s = section(p, q) if s is None else s
    first, last = radius * s.tangents[0], radius * s.tangents[1]
    sine, cosine = jnp.sin(s.turn), jnp.cos(s.turn)
    transfer = joined(first, (cosine, radius * sine, -sine / radius, cosine), last)
    length, opposite = (first + radius * turn + last for turn in (s.turn, other_way(s, p, q)))
    leave, reach = (s.pole.cross(contact) for contact in s.contacts)
    touches = radius * s.contacts[0], radius * s.contacts[1]
    return Wrapped(length, leave, reach, touches, s.contacts, (first, last), transfer, opposite)


def around_cylinder(
    start: Vector, end: Vector, shape: Vector, s: Section | None = None,
    aim: tuple[Array, ...] = (), *, side: Vector | None = None,
) -> Wrapped:  # fmt: skip
    """The taut path around an endless cylinder of radius `shape[0]` about Z: a helix between; round
    another side it is endless where the side is given."""
    radius = shape[0]
    p, q = (Vector(x.x / radius, x.y / radius, 0.0 * x.z) for x in (start, end))
    s = section(p, q, side) if s is None else s
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
    opposite = jnp.full_like(length, jnp.inf)
    if side is None:
        other = first + radius * other_way(s, p, q) + last
        opposite = jnp.sqrt(other * other + rise * rise)
    pieces = first * stretch, last * stretch
    transfer = joined(pieces[0], (one, arc, 0.0 * one, one), pieces[1])
    (leave, reach), touches = directions, (contacts[0], contacts[1])
    return Wrapped(length, leave, reach, touches, s.contacts, pieces, transfer, opposite)


def differentiate(
    w: Wrapped, known: Wrapped, start: Vector, end: Vector
) -> tuple[Component, Vector, Vector]:
    """Changes of length and of both directions with changes of the ends (module docstring): the
    directions of a path, and what else is known of it."""
    (n0, n1), (first, last), (a, b, d) = known.normals, known.pieces, known.transfer
    b0, b1 = n0.cross(known.leave), n1.cross(known.reach)
    spread = 1.0 / jnp.maximum(b, LEAST_SPREAD * jnp.abs(known.length))
    y0, y1 = b0 @ start, b1 @ end
    dips = times(1.0 / first, minus(0.0, n0 @ start)), times(1.0 / last, n1 @ end)
    turns = times(spread, minus(y1, times(a, y0))), times(spread, minus(times(d, y1), y0))
    return (
        minus(w.reach @ end, w.leave @ start),
        dips[0] * n0 + turns[0] * b0,
        dips[1] * n1 + turns[1] * b1,
    )
