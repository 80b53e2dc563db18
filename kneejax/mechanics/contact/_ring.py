"""A meniscus: a rim whose sections give way outwards until its hoop tension holds them.

A wedge that lies on a plateau without friction is pushed outwards by the femur, and so stretches
along its arc. Without friction the tension is the same all along the ring, from horn to horn. With
`u` the outward motion of each section, the depth of a point on it becomes less by `c u`, where `c`
is the part of its normal that points inwards, and the ring is longer by the sum of `u` times the
angle of each section. The sections stand where

    springs of all points (depth - c u)  +  1/2 coronary u^2  +  1/2 hoop (sum of angle u)^2

is least: a convex function of a few numbers, whose second derivative is a diagonal and one product
of vectors a ring, so that a Newton step is a few sums. The force on the femur is the derivative of
the least by the pose, and needs no derivative of `u`; its stiffness has that of `u` by elimination
(`kneejax.mechanics.contact._points_force`).
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry import Vector
from kneejax.mechanics.contact._points import Points
from kneejax.numerics import jvp_of_moved, ruled

# Newton steps and trials at most, the length of the last, and from which on none was found, mm.
_STEPS, _ACCURACY, _NOT_FOUND = 100, 1e-11, 1e-6
# What is left of the slope along a step that is taken.
_LESS = 0.9


class Ring(eqx.Module):
    """What holds a rim from horn to horn.

    Attributes:
        youngs_modulus: along the arc, MPa.
        cross_section: mm^2.
        horn_stiffness: of the attachment of each horn, N/mm.
        coronary_stiffness: of all that holds the ring's border along its arc, N/mm.
        middle: about which angles are counted, forwards and to the person's right in the plane of
            the surface, mm.
        horns: angles at which the ring begins and ends, rad, from the front towards the right.
        sections: number of pieces of equal angle that move on their own.
        hoop_left: part of the hoop's stiffness that a meniscectomy has left, 0 where the ring is
            cut through.
    """

    youngs_modulus: Array
    cross_section: Array
    horn_stiffness: Array
    coronary_stiffness: Array
    middle: Array
    horns: Array
    hoop_left: Array
    sections: int = eqx.field(static=True)

    def __init__(
        self,
        youngs_modulus: ArrayLike,
        cross_section: ArrayLike,
        horn_stiffness: ArrayLike,
        coronary_stiffness: ArrayLike,
        middle: ArrayLike,
        horns: ArrayLike,
        sections: int = 12,
        hoop_left: ArrayLike = 1.0,
    ):
        self.youngs_modulus = jnp.asarray(youngs_modulus, float)
        self.cross_section = jnp.asarray(cross_section, float)
        self.horn_stiffness = jnp.asarray(horn_stiffness, float)
        self.coronary_stiffness = jnp.asarray(coronary_stiffness, float)
        self.middle = jnp.asarray(middle, float)
        self.horns = jnp.asarray(horns, float)
        self.hoop_left = jnp.asarray(hoop_left, float)
        self.sections = sections

    def placed(
        self, point: Vector, normal: Vector, area: Array
    ) -> tuple[Array, Array, Array, Array]:
        """How its points give way.

        Args:
            point: in the frame of the surface, mm, components `(points, ...)`.
            normal: outward unit normals there.
            area: that each point stands for, mm^2.

        Returns:
            Depth that is lost for each mm of outward motion, `(points, ...)`; number of the
            section, likewise; angle of a section, rad, and N/mm of the whole hoop with its horns in
            series, both `(...)`.
        """
        forwards, right = point.x - self.middle[0], point.z - self.middle[1]
        away = jnp.sqrt(forwards * forwards + right * right)
        outwards = -(normal.x * forwards + normal.z * right) / away
        begin, span = self.horns[0], self.horns[1] - self.horns[0]
        turn = jnp.mod(jnp.arctan2(right, forwards) - begin, 2.0 * jnp.pi)
        place = jnp.clip(jnp.floor(self.sections * turn / span), 0, self.sections - 1)
        on_ring = (turn <= span) & (area > 0.0)
        weight = jnp.where(on_ring, area, 0.0)
        whole = jnp.sum(weight, axis=0)
        empty = whole == 0.0  # a meniscus that was removed
        radius = jnp.sum(jnp.where(empty, 1.0, weight) * away, axis=0)
        radius = radius / jnp.where(empty, 1.0, whole)
        hoop = self.hoop_left * self.youngs_modulus * self.cross_section / (radius * span)
        series = hoop * self.horn_stiffness / (self.horn_stiffness + 2.0 * hoop)
        outwards = jnp.where(on_ring, outwards, 0.0)
        return outwards, lax.stop_gradient(place), span / self.sections, series

    def resected(
        self, outline: np.ndarray, width: float, anterior: float, posterior: float
    ) -> tuple[Ring, np.ndarray]:
        """What a partial meniscectomy leaves.

        The ring's cross-section is taken as a wedge that rises from its inner edge, so that half
        of its width, from inside, is a quarter of its area. Where the whole width is gone the hoop
        is cut through: what is left is held by its coronary attachment alone.

        Args:
            outline: corners of the meniscus in the plane of its surface, shape `(k, 2)`, mm.
            width: part of the width that is taken away, from the inner edge; 1 is all of it.
            anterior: part of the arc, from the anterior horn, in which it is; 0 to 1.
            posterior: likewise from the posterior horn.

        Returns:
            The ring that is left, and its outline with as many corners.
        """
        begin, end = np.asarray(self.horns)
        ends = (anterior, posterior) if np.cos(begin) >= np.cos(end) else (posterior, anterior)
        first, last = begin + ends[0] * (end - begin), end - ends[1] * (end - begin)
        narrow = 1.0 - width * width
        left = narrow / (narrow + sum(ends) * (1.0 - narrow))  # in series with what is whole
        ring = dataclasses.replace(self, hoop_left=self.hoop_left * left)
        turns = np.linspace(begin, end, 721)
        inner, outer = _across(outline - np.asarray(self.middle), turns)
        known = np.isfinite(inner)
        low, high = turns[known][[0, -1]]
        if width == 1.0:
            low, high = max(low, first), min(high, last)
        at = np.linspace(low, high, len(outline) // 2)
        near, far = (np.interp(at, turns[known], x[known]) for x in (inner, outer))
        cut_there = (at <= first) | (at >= last)
        near = np.where(cut_there & (width < 1.0), near + width * (far - near), near)
        kept = np.concatenate([far, near[::-1]]), np.concatenate([at, at[::-1]])
        corners = np.asarray(self.middle) + np.stack(
            [kept[0] * np.cos(kept[1]), kept[0] * np.sin(kept[1])], axis=1
        )
        return ring, corners[[*range(len(corners)), *[-1] * (len(outline) - len(corners))]]


def _across(corners: np.ndarray, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which rays from the origin enter and leave an outline; NaN where they miss it.

    Args:
        corners: in order, shape `(k, 2)`.
        turns: of the rays, from the first axis towards the second, rad, `(n,)`.
    """
    edge = np.roll(corners, -1, axis=0) - corners
    ray = np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None]

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    with np.errstate(divide="ignore", invalid="ignore"):
        away = cross(corners, edge) / cross(ray, edge)
        part = cross(corners, ray) / cross(ray, edge)
    meets = (part >= 0.0) & (part <= 1.0) & (away > 0.0)
    far = np.where(meets, away, -np.inf).max(axis=1)
    near = np.where(meets, away, np.inf).min(axis=1)
    known = near < far
    return np.where(known, near, np.nan), np.where(known, far, np.nan)


class Hoops(eqx.Module):
    """Rings of a foundation, with the sections of all of them.

    Attributes:
        angle: of each section, rad, `(sections, ...)`.
        held: N/mm by which each section is held by itself, `(sections, ...)`.
        stiffness: of each ring as a whole, N/mm, `(rings, ...)`.
        counts: sections of each ring.
    """

    angle: Array
    held: Array
    stiffness: Array
    counts: tuple[int, ...] = eqx.field(static=True)

    def tension(self, outward: Array) -> Array:
        """Of each ring, N, `(rings, ...)`.

        Args:
            outward: motion of each section, mm, `(sections, ...)`.
        """
        return self.stiffness * self._of_rings(self.angle * outward)

    def energy(self, outward: Array) -> Array:
        """Of rings and what holds their sections, N mm."""
        longer = self._of_rings(self.angle * outward)
        own = jnp.sum(self.held * outward * outward, axis=0)
        return 0.5 * (own + jnp.sum(self.stiffness * longer * longer, axis=0))

    def settled(self, points: Points, depth: Array) -> Array:
        """Outward motion of each section, mm, `(sections, ...)`, differentiable.

        Args:
            points: with `outwards` and `section`, without `given_way`.
            depth: overlap of each point if no section moved, mm, `(points, ...)`.
        """
        still, fixed, below = lax.stop_gradient((self, points, depth))

        def newton(outward):
            left = still._residual(fixed, below, outward)
            return left, -still.solved(still._firm(fixed, below, outward), left)

        def nearer(state):
            count, outward, left, step, part = state
            tried = outward + part * step
            own, following = newton(tried)
            # The energy is convex: its slope along the step grows, and is zero at the least.
            along, before = (jnp.abs(jnp.sum(x * step, axis=0)) for x in (own, left))
            taken = along <= _LESS * before
            kept = (
                jnp.where(taken, new, old)
                for new, old in ((tried, outward), (own, left), (following, step))
            )
            return count + 1, *kept, jnp.where(taken, 1.0, 0.5 * part)

        def far(state):
            return jnp.max(jnp.abs(state[3]), axis=0) > _ACCURACY

        shape = jnp.broadcast_shapes(self.held.shape[1:], depth.shape[1:])
        nothing = jnp.zeros((sum(self.counts), *shape))
        state = jnp.asarray(0), nothing, *newton(nothing), jnp.ones(shape)
        going_on = lambda s: (s[0] < _STEPS) & jnp.any(far(s))  # noqa: E731
        last = lax.while_loop(going_on, nearer, state)
        found = jnp.where(jnp.max(jnp.abs(last[3]), axis=0) > _NOT_FOUND, jnp.nan, last[1])
        return ruled(_settled_rule, found, self, points, depth)

    def given_way(self, points: Points, outward: Array) -> Array:
        """Depth that each point has lost, mm, `(points, ...)`."""
        assert points.outwards is not None
        return points.outwards * jnp.tensordot(self._members(points).T, outward, 1)

    def pushed(self, points: Points, x: Array) -> Array:
        """Sum over the points of each section of what moves it outwards, `(sections, ...)`.

        Args:
            points: of the rings and others.
            x: force of each point, N, or its change.
        """
        assert points.outwards is not None
        return jnp.tensordot(self._members(points), points.outwards * x, 1)

    def solved(self, firm: Array, right: Array) -> Array:
        """Solution of the system with the second derivative of the energy.

        Args:
            firm: N/mm by which points hold each section, `(sections, ...)`.
            right: `(sections, ...)`.
        """
        inverse = 1.0 / (firm + self.held)
        along, across = inverse * right, inverse * self.angle
        share = self._of_rings(self.angle * along)
        # Sherman and Morrison's formula, ring by ring.
        share = share / (1.0 + self.stiffness * self._of_rings(self.angle * across))
        share = share * self.stiffness
        return along - across * self._to_sections(share)

    def firm(self, points: Points, depth: Array) -> Array:
        """N/mm by which points hold each section, `(sections, ...)`.

        Args:
            points: with `outwards` and `section`.
            depth: that presses, mm.
        """
        _, firm = jax.jvp(points.force, (depth,), (jnp.ones_like(depth),))
        assert points.outwards is not None
        return self.pushed(points, points.outwards * firm)

    def _firm(self, points: Points, depth: Array, outward: Array) -> Array:
        return self.firm(points, depth - self.given_way(points, outward))

    def _residual(self, points: Points, depth: Array, outward: Array) -> Array:
        """Derivative of the energy by the motion of each section, N."""
        force = points.force(depth - self.given_way(points, outward))
        hoop = self.angle * self._to_sections(self.tension(outward))
        return self.held * outward + hoop - self.pushed(points, force)

    def _members(self, points: Points) -> Array:
        """Which points are of which section, `(sections, points)`."""
        assert points.section is not None
        place = points.section.reshape(len(points.section), -1)
        if place.shape[1] > 1:
            raise ValueError("rings with other horns or middles side by side: use jax.vmap")
        return (place[:, 0] == jnp.arange(sum(self.counts))[:, None]).astype(float)

    def _of_rings(self, x: Array) -> Array:
        ends = np.cumsum((0, *self.counts))
        pairs = zip(ends[:-1], ends[1:], strict=True)
        return jnp.stack([jnp.sum(x[a:b], axis=0) for a, b in pairs])

    def _to_sections(self, x: Array) -> Array:
        return jnp.repeat(x, np.array(self.counts), axis=0, total_repeat_length=sum(self.counts))


def _settled_rule(outward: Array, primals, tangents):
    def residual(hoops: Hoops, points: Points, depth: Array) -> Array:
        return hoops._residual(points, depth, outward)

    hoops, points, depth = primals
    change = jvp_of_moved(residual, primals, tangents)[1]
    return outward, -hoops.solved(hoops._firm(points, depth, outward), change)


