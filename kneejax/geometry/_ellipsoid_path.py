"""The taut path around an ellipsoid: a geodesic, found by shooting.

Scaled by its semi-axes the ellipsoid is a unit sphere. Tangents stay tangents, so the straight
piece from the start touches somewhere on a known circle, and one angle on it fixes where the
geodesic begins and in which direction. On the unit sphere a geodesic of the ellipsoid is a curve
with unit tangent `w`, `b = u x w`, and

    u' = w,    w' = -u + k b,    k = -(b . N u) / (u . N u),    N = diag(1/a^2, 1/b^2, 1/c^2)

(its acceleration in the ellipsoid's own space is along the normal). `k` turns the great circle
that osculates the curve; the Runge-Kutta steps integrate that turn alone, so a sphere's great
circles are exact. Jacobi's equation is integrated beside it: it gives the miss at the end as a
function of the angle, for Newton's rule, and the second derivatives of the length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import _vectors as v
from kneejax.geometry._round_path import Section, Wrapped, choose, joined, section, unit
from kneejax.geometry._vectors import Vector

#: Planes through both ends whose paths are compared before the search.
PLANES = 8
#: Runge-Kutta steps in each shot of the search, and in the last one.
SEARCH = (4, 4, 8, 8)
STEPS = 12


class Aim(NamedTuple):
    """Where on its circle the path leaves (cosine and sine) and how far it runs, rad."""

    cosine: Array
    sine: Array
    turn: Array


class Shot(NamedTuple):
    """A geodesic from its point of contact: ends and tangents on the unit sphere, length in mm,
    the transfer of sideways deviations `(a, b, c, d)`."""

    begin: Vector
    begin_along: Vector
    finish: Vector
    finish_along: Vector
    arc: Array
    transfer: tuple[Array, Array, Array, Array]


class _Plane(NamedTuple):
    length: Array
    contact: Vector
    turn: Array


def around_ellipsoid(
    start: Vector, end: Vector, shape: tuple[Array, ...], aim: tuple[Array, ...] = ()
) -> Wrapped:
    """The taut path around an ellipsoid of semi-axes `shape`.

    With the `aim` of a path that was found before, nothing is searched, and the path can be
    differentiated by the shape.
    """
    if aim:
        return shot_path(start, end, shape, Aim(*aim))
    aim, other = search(start, end, shape)
    path = shot_path(start, end, shape, aim)
    return path._replace(opposite=path.length + other)


def search(start: Vector, end: Vector, shape: tuple[Array, ...]) -> tuple[Aim, Array]:
    """Aim of the taut path, and how much longer the best path well beside it is, mm."""
    p, q = v.stretch(_inverse(shape), start), v.stretch(_inverse(shape), end)
    s = section(p, q)
    aim, other = _first_aim(p, q, s, shape)
    for steps in SEARCH:
        aim = _better_aim(end, p, q, s, shape, aim, steps)
    return aim, other


def shot_path(start: Vector, end: Vector, shape: tuple[Array, ...], aim: Aim) -> Wrapped:
    """The path along a geodesic with this aim, its small miss corrected to first order.

    Differentiable by the shape for a fixed aim: the correction is one step of Newton's rule.
    """
    p, q = v.stretch(_inverse(shape), start), v.stretch(_inverse(shape), end)
    s = section(p, q)
    shot = _shoot(p, s, shape, aim, STEPS)
    x0, x1 = v.stretch(shape, shot.begin), v.stretch(shape, shot.finish)
    n0, n1 = (unit(v.stretch(_inverse(shape), u)) for u in (shot.begin, shot.finish))
    onward = v.subtract(end, x1)
    t0, t1 = unit(v.stretch(shape, shot.begin_along)), unit(onward)
    first, last = v.norm(v.subtract(x0, start)), v.norm(onward)
    b0 = v.cross(n0, t0)
    b1 = unit(v.cross(n1, v.stretch(shape, shot.finish_along)))
    a, b, d = joined(first, shot.transfer, last)
    # Newton's step: turned by `swing` at the start, the path gets to the end without a miss.
    miss = v.dot(b1, onward)
    fixed = lax.stop_gradient((_away_from_zero(b, first + last), d, last))
    swing = miss / fixed[0]
    t0 = v.add(t0, v.scale(swing, b0))
    t1 = v.add(t1, v.scale(swing * fixed[1] - miss / fixed[2], b1))
    length = first + shot.arc + last
    return Wrapped(length, t0, t1, (x0, x1), (n0, n1), (first, last), (a, b, d), length, aim)


def trace(
    start: Vector, end: Vector, shape: tuple[Array, ...], aim: Aim, count: int
) -> list[Vector]:
    """`count` points of the geodesic, from contact to contact."""
    p, q = v.stretch(_inverse(shape), start), v.stretch(_inverse(shape), end)
    u, w = _begin(p, section(p, q), aim)
    points = [u]
    step = aim.turn / (count - 1)
    metric = _metric(shape)
    one = jnp.ones_like(step)
    state = (u, w, 0.0 * one, (one, 0.0 * one, 0.0 * one, one))
    for _ in range(count - 1):
        state = _step(state, step, jnp.cos(step), jnp.sin(step), *_half(step), shape, metric)
        points.append(state[0])
    return [v.stretch(shape, u) for u in points]


def _inverse(shape: tuple[Array, ...]) -> Vector:
    return 1.0 / shape[0], 1.0 / shape[1], 1.0 / shape[2]


def _metric(shape: tuple[Array, ...]) -> Vector:
    x, y, z = _inverse(shape)
    return x * x, y * y, z * z


def _half(step: Array) -> tuple[Array, Array]:
    return jnp.cos(0.5 * step), jnp.sin(0.5 * step)


def _away_from_zero(spread: Array, length: Array) -> Array:
    """The spread of neighbouring paths, kept from a zero that Newton's rule would divide by."""
    return jnp.maximum(spread, 0.02 * length)


def _begin(p: Vector, s: Section, aim: Aim) -> tuple[Vector, Vector]:
    """Point of contact and direction of the geodesic with this aim."""
    square = v.dot(p, p)
    around = v.add(v.scale(aim.cosine, s.forward), v.scale(aim.sine, s.pole))
    distance = jnp.sqrt(square)
    tangent = s.tangents[0]
    u = v.scale(1.0 / square, v.add(p, v.scale(tangent * distance, around)))
    # (u - p) / tangent without the difference, which is small beside the surface
    w = v.add(v.scale(-tangent / square, p), v.scale(1.0 / distance, around))
    return u, w


def _shoot(p: Vector, s: Section, shape: tuple[Array, ...], aim: Aim, steps: int) -> Shot:
    u, w = _begin(p, s, aim)
    step = aim.turn / steps
    cosine, sine = jnp.cos(step), jnp.sin(step)
    half = _half(step)
    metric = _metric(shape)
    one = jnp.ones_like(step)
    state = (u, w, 0.0 * one, (one, 0.0 * one, 0.0 * one, one))
    finish, along, arc, transfer = lax.fori_loop(
        0, steps, lambda _, at: _step(at, step, cosine, sine, *half, shape, metric), state
    )
    return Shot(u, w, finish, along, arc, transfer)


def _step(state, step, cosine, sine, half_cosine, half_sine, shape, metric):
    """One step of the classical Runge-Kutta method, in the frame of a great circle."""
    determinant = shape[0] * shape[1] * shape[2]
    curvature = 1.0 / (determinant * determinant)

    def rates(e, f, field, c, s):
        u = v.add(v.scale(c, e), v.scale(s, f))
        w = v.subtract(v.scale(c, f), v.scale(s, e))
        b = v.cross(u, w)
        normal = v.stretch(metric, u)
        inverse = 1.0 / v.dot(u, normal)
        k = -v.dot(b, normal) * inverse
        speed = v.norm(v.stretch(shape, w))
        bend = -speed * curvature * inverse * inverse
        ya, yb, va, vb = field
        return (
            v.scale(-s * k, b),
            v.scale(c * k, b),
            (speed * va, speed * vb, bend * ya, bend * yb),
            speed,
        )

    def moved(e, f, field, rate, h):
        return (
            v.add(e, v.scale(h, rate[0])),
            v.add(f, v.scale(h, rate[1])),
            tuple(y + h * r for y, r in zip(field, rate[2], strict=True)),
        )

    e, f, arc, (a, b, c, d) = state
    field = (a, b, c, d)
    one = jnp.ones_like(step)
    k1 = rates(e, f, field, one, 0.0)
    k2 = rates(*moved(e, f, field, k1, 0.5 * step), half_cosine, half_sine)
    k3 = rates(*moved(e, f, field, k2, 0.5 * step), half_cosine, half_sine)
    k4 = rates(*moved(e, f, field, k3, step), cosine, sine)
    mean = jax.tree.map(lambda p, q, r, s: (p + 2.0 * (q + r) + s) / 6.0, k1, k2, k3, k4)
    e, f, field = moved(e, f, field, mean, step)
    u = v.add(v.scale(cosine, e), v.scale(sine, f))
    w = v.subtract(v.scale(cosine, f), v.scale(sine, e))
    return u, w, arc + step * mean[3], field


def _better_aim(
    end: Vector,
    p: Vector,
    q: Vector,
    s: Section,
    shape: tuple[Array, ...],
    aim: Aim,
    steps: int,
) -> Aim:
    """One step of Newton's rule on the sideways miss at the end; the arc ends where it leaves."""
    shot = _shoot(p, s, shape, aim, steps)
    onward = v.subtract(end, v.stretch(shape, shot.finish))
    steep = v.stretch(_inverse(shape), shot.finish)
    sideways = unit(v.cross(steep, v.stretch(shape, shot.finish_along)))
    begin = v.stretch(shape, shot.begin_along)
    speed_square = v.dot(begin, begin)
    speed = jnp.sqrt(speed_square)
    first, last = speed * s.tangents[0], v.norm(onward)
    spread = _away_from_zero(joined(first, shot.transfer, last)[1], first + shot.arc + last)
    swing = v.dot(sideways, onward) / spread
    # An angle on the circle of contact turns the straight piece by this much less.
    area = shape[0] * shape[1] * shape[2] * v.norm(v.stretch(_inverse(shape), shot.begin))
    angle = swing * jnp.sqrt(v.dot(p, p)) * speed_square / area
    half = 0.5 * jnp.clip(angle, -0.6, 0.6)
    inverse = 1.0 / (1.0 + half * half)
    c, d = (1.0 - half * half) * inverse, 2.0 * half * inverse
    run = jnp.maximum(v.dot(shot.finish_along, q), 0.2 * s.tangents[1])
    more = jnp.clip((1.0 - v.dot(shot.finish, q)) / run, -0.4, 0.4)
    return Aim(
        aim.cosine * c - aim.sine * d,
        aim.sine * c + aim.cosine * d,
        jnp.clip(aim.turn + more, -1.0, 5.0),
    )


def _plane(
    p: Vector, q: Vector, s: Section, shape: tuple[Array, ...], beside: Vector, c: Array, d: Array
) -> _Plane:
    """Path in the plane turned by an angle (cosine, sine) from the centre's, by Simpson's rule."""
    n = v.add(v.scale(c, s.pole), v.scale(d, beside))
    height = v.dot(n, p)
    square = jnp.maximum(1.0 - height * height, 1e-6)
    radius = jnp.sqrt(square)
    centre = v.scale(height, n)
    spokes = []
    for point, tangent in ((p, s.tangents[0]), (q, -s.tangents[1])):
        out = v.subtract(point, centre)
        inverse = 1.0 / (square + tangent * tangent)
        side = v.scale(radius * tangent * inverse, v.cross(n, out))
        spokes.append(v.add(v.scale(square * inverse, out), side))
    first, last = spokes
    turn = jnp.arctan2(v.dot(n, v.cross(first, last)), v.dot(first, last))
    # Behind the centre an arc is never negative, before it only by a little.
    turn = turn + 2.0 * jnp.pi * (turn < jnp.where(c < 0.1, 0.0, -1.0))
    chord, middle = v.subtract(last, first), v.cross(n, v.add(first, last))
    long = v.dot(chord, chord) > v.dot(middle, middle)
    speeds = [
        v.norm(v.stretch(shape, unit(direction)))
        for direction in (v.cross(n, first), choose(long, chord, middle), v.cross(n, last))
    ]
    arc = radius * turn
    straight = [
        v.norm(v.stretch(shape, v.subtract(v.add(spoke, centre), point)))
        for spoke, point in ((first, p), (last, q))
    ]
    length = straight[0] + straight[1] + arc * (speeds[0] + 4.0 * speeds[1] + speeds[2]) / 6.0
    return _Plane(length, v.add(first, centre), arc)


def _first_aim(p: Vector, q: Vector, s: Section, shape: tuple[Array, ...]) -> tuple[Aim, Array]:
    """Aim along the best of a fan of planes, and how much longer the best one beside it is."""
    beside = v.cross(unit(v.subtract(q, p)), s.pole)
    angles = [2.0 * math.pi * i / PLANES for i in range(PLANES)]
    one = jnp.ones_like(p[0])
    lengths = [
        _plane(p, q, s, shape, beside, math.cos(x) * one, math.sin(x) * one).length for x in angles
    ]
    best, where = lengths[0], 0.0 * one
    for i in range(1, PLANES):
        shorter = lengths[i] < best
        best, where = jnp.where(shorter, lengths[i], best), jnp.where(shorter, 1.0 * i, where)
    other = jnp.full_like(one, jnp.inf)
    before = after = cosine = sine = 0.0 * one
    for i in range(PLANES):
        apart = jnp.abs(where - i)
        apart = jnp.minimum(apart, PLANES - apart)
        other = jnp.where(4.0 * apart >= PLANES, jnp.minimum(other, lengths[i]), other)
        here = where == i
        before = jnp.where(here, lengths[i - 1], before)
        after = jnp.where(here, lengths[(i + 1) % PLANES], after)
        cosine = jnp.where(here, math.cos(angles[i]), cosine)
        sine = jnp.where(here, math.sin(angles[i]), sine)
    bend = jnp.maximum(before - 2.0 * best + after, 1e-12 * best)
    half = math.pi / PLANES * jnp.clip(0.5 * (before - after) / bend, -0.5, 0.5)
    inverse = 1.0 / (1.0 + half * half)
    c, d = (1.0 - half * half) * inverse, 2.0 * half * inverse
    plane = _plane(p, q, s, shape, beside, cosine * c - sine * d, sine * c + cosine * d)
    x, y = v.dot(plane.contact, s.forward), v.dot(plane.contact, s.pole)
    size = jnp.sqrt(x * x + y * y)
    size = jnp.where(size > 0.0, size, 1.0)
    return Aim(x / size, y / size, plane.turn), other - best
