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

__all__ = ["Ring"]

import dataclasses
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry import Plateau, Vector, numbers
from kneejax.mechanics.contact._points import Points
from kneejax.numerics import jvp_of_moved, ruled, safe_sqrt

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

    youngs_modulus: Array = numbers()
    cross_section: Array = numbers()
    horn_stiffness: Array = numbers()
    coronary_stiffness: Array = numbers()
    middle: Array = numbers()
    horns: Array = numbers()
    sections: int = eqx.field(static=True, default=12)
    hoop_left: Array = numbers(default=1.0)

    @property
    def angle(self) -> Array:
        """From horn to horn, rad."""
        return self.horns[1] - self.horns[0]

    def midpoints(
        self, surface: Plateau, count: tuple[int, int], trailing: int
    ) -> tuple[Vector, Vector, Array, tuple[Array, Array], Array]:
        """Middles of equal pieces of arc and of width, one section after the other.

        Args:
            surface: with the outline of the meniscus.
            count: number along the arc, rounded up to as many in each section, and across it.
            trailing: number of axes that the poses take.

        Returns:
            Points and unit normals in the surface's frame, areas, both parameters, scaled to -1..1,
            and depth that is lost for each mm of outward motion; each `(points, ...)`. Where
            nothing is left of the meniscus, the area is zero.
        """
        assert surface.outline is not None
        pieces = self.sections * -(-count[0] // self.sections)
        part, width = (
            ((np.arange(n) + 0.5) / n).reshape(-1, *(1,) * trailing) for n in (pieces, count[1])
        )
        turn = self.horns[0] + self.angle * part
        inner, outer = _across(surface.outline - self.middle, turn)
        wide = (outer - inner)[:, None]
        away = inner[:, None] + wide * width

        def flat(x: Array) -> Array:
            return jnp.broadcast_to(x, away.shape).reshape(-1, *away.shape[2:])

        forwards, right = flat(jnp.cos(turn)[:, None]), flat(jnp.sin(turn)[:, None])
        weight, away = flat(away * wide * self.angle / (pieces * count[1])), flat(away)
        x, z = self.middle[0] + away * forwards, self.middle[1] + away * right
        point, normal, area = surface.oriented(x, z)
        across = tuple(
            (2.0 * place - low - high) / (high - low)
            for place, (low, high) in zip((x, z), surface.bounds(), strict=True)
        )
        outwards = -(normal.x * forwards + normal.z * right)
        return point, normal, weight * area, across, outwards

    def hoop(self, point: Vector, area: Array) -> Array:
        """N/mm of the whole hoop, with its horns in series.

        Args:
            point: in the frame of the surface, mm, components `(points, ...)`.
            area: that each point stands for, mm^2.
        """
        away = safe_sqrt((point.x - self.middle[0]) ** 2 + (point.z - self.middle[1]) ** 2)
        whole, moment = jnp.sum(area, axis=0), jnp.sum(area * away, axis=0)
        some = whole > 0.0  # where the meniscus was not removed
        radius = jnp.where(some, moment / jnp.where(some, whole, 1.0), 1.0)
        own = self.youngs_modulus * self.cross_section / (radius * self.angle)
        hoop = self.hoop_left * own
        return hoop * self.horn_stiffness / (self.horn_stiffness + 2.0 * hoop)

    def resected(
        self, outline: np.ndarray, width: float, anterior: float, posterior: float
    ) -> "tuple[Ring, np.ndarray]":
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
        inner, outer = map(np.asarray, _across(outline - np.asarray(self.middle), turns))
        known = inner < outer
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


@jax.jit
def _across(corners: ArrayLike, turns: ArrayLike) -> tuple[Array, Array]:
    """Distances at which rays from the origin enter and leave an outline, `(n, ...)`; alike where
    they miss it.

    Args:
        corners: in order, shape `(k, 2, ...)`.
        turns: of the rays, from the first axis towards the second, rad, `(n, ...)`.
    """
    corners, turns = jnp.asarray(corners), jnp.asarray(turns)[:, None]
    ray = jnp.cos(turns), jnp.sin(turns)
    edge, corner = (jnp.moveaxis(x, 1, 0) for x in (jnp.roll(corners, -1, 0) - corners, corners))

    def cross(a, b):
        return a[0] * b[1] - a[1] * b[0]

    turned = cross(ray, edge)
    per_turned = 1.0 / jnp.where(turned == 0.0, 1.0, turned)
    away = cross(corner, edge) * per_turned
    # On which side of the ray a corner lies is asked once, for both of its edges.
    beyond = cross(corner, ray) > 0.0
    meets = (beyond != jnp.roll(beyond, -1, axis=1)) & (turned != 0.0) & (away > 0.0)
    far = jnp.max(jnp.where(meets, away, 0.0), axis=1)
    near = jnp.min(jnp.where(meets, away, jnp.inf), axis=1)
    # An odd number of times: the origin is inside.
    near = jnp.where(jnp.sum(meets, axis=1) % 2 == 1, 0.0, near)
    return jnp.where(near < far, near, far), far


class Hoops(eqx.Module):
    """Rings of a foundation, whose points are the last ones, with the sections of all of them.

    Attributes:
        angle: of each section, rad, `(sections, ...)`.
        held: N/mm by which each section is held by itself, `(sections, ...)`.
        stiffness: of each ring as a whole, N/mm, `(rings, ...)`.
        outwards: mm of depth that a point loses for each mm of outward motion, `(points of rings,
            ...)`.
        counts: sections of each ring, and points in each of these.
    """

    angle: Array
    held: Array
    stiffness: Array
    outwards: Array
    counts: tuple[tuple[int, int], ...] = eqx.field(static=True)

    def tension(self, outward: Array) -> Array:
        """Of each ring, N, `(rings, ...)`."""
        return self.stiffness * self._of_rings(self.angle * outward)

    def energy(self, outward: Array) -> Array:
        """Of rings and what holds their sections, N mm."""
        longer = self._of_rings(self.angle * outward)
        own = jnp.sum(self.held * outward * outward, axis=0)
        return 0.5 * (own + jnp.sum(self.stiffness * longer * longer, axis=0))

    def settled(self, points: Points, depth: Array) -> Array:
        """Outward motion of each section, mm, `(sections, ...)`, differentiable."""
        points, depth = self._own((points, depth))
        still, fixed, below = lax.stop_gradient((self, points, depth))

        def newton(outward):
            left = still._residual(fixed, below, outward)
            firm = still.firm(fixed, below - still._lost(outward))
            return left, -still.solved(firm, left)

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
        nothing = jnp.zeros((len(self.angle), *shape))
        state = jnp.asarray(0), nothing, *newton(nothing), jnp.ones(shape)
        going_on = lambda s: (s[0] < _STEPS) & jnp.any(far(s))  # noqa: E731
        last = lax.while_loop(going_on, nearer, state)
        found = jnp.where(jnp.max(jnp.abs(last[3]), axis=0) > _NOT_FOUND, jnp.nan, last[1])
        return ruled(_settled_rule, found, self, points, depth)

    def given_way(self, depth: Array, outward: Array) -> Array:
        """Depth that each point has lost, mm, `(points, ...)`; as many as `depth` has."""
        lost = self._lost(outward)
        others = jnp.zeros((len(depth) - len(lost), *lost.shape[1:]))
        return jnp.concatenate([others, lost])

    def pushed(self, x: Array) -> Array:
        """Sum over the points of each section of what moves it outwards, `(sections, ...)`."""
        return jnp.tensordot(self._members, self.outwards * self._own(x), 1)

    def solved(self, firm: Array, right: Array) -> Array:
        """Solution of the system with the second derivative of the energy."""
        inverse = 1.0 / (firm + self.held)
        along, across = inverse * right, inverse * self.angle
        share = self._of_rings(self.angle * along)
        # Sherman and Morrison's formula, ring by ring.
        share = share / (1.0 + self.stiffness * self._of_rings(self.angle * across))
        share = share * self.stiffness
        return along - across * self._to_sections(share)

    def firm(self, points: Points, depth: Array) -> Array:
        """N/mm by which points hold each section, `(sections, ...)`."""
        points, depth = self._own((points, depth))
        _, firm = jax.jvp(points.force, (depth,), (jnp.ones_like(depth),))
        return self.pushed(self.outwards * firm)

    def _own(self, of_points: Any) -> Any:
        """What is known of the points of rings; what one point states for all stays as it is."""
        own = len(self.outwards)
        return jax.tree.map(lambda x: x if len(x) == 1 else x[-own:], of_points)

    def _residual(self, points: Points, depth: Array, outward: Array) -> Array:
        """Derivative of the energy by the motion of each section, N."""
        force = points.force(depth - self._lost(outward))
        hoop = self.angle * self._to_sections(self.tension(outward))
        return self.held * outward + hoop - self.pushed(force)

    def _lost(self, outward: Array) -> Array:
        return self.outwards * jnp.tensordot(self._members.T, outward, 1)

    @property
    def _members(self) -> np.ndarray:
        """Which points are of which section, `(sections, points of rings)`. Products with it end a
        kernel of XLA's; sums over axes are computed again for each number that reads them."""
        per = [per for count, per in self.counts for _ in range(count)]
        return np.repeat(np.eye(len(per)), per, axis=1)

    def _parts(self, x: Array) -> list[Array]:
        """What is known of sections, `(sections, ...)`, ring by ring."""
        ends = np.cumsum([0, *(count for count, _ in self.counts)])
        return [x[a:b] for a, b in pairwise(ends)]

    def _of_rings(self, x: Array) -> Array:
        return jnp.stack([jnp.sum(part, axis=0) for part in self._parts(x)])

    def _to_sections(self, x: Array) -> Array:
        counts = np.array([count for count, _ in self.counts])
        return jnp.repeat(x, counts, axis=0, total_repeat_length=int(counts.sum()))


def _settled_rule(outward: Array, primals, tangents):
    def residual(hoops: Hoops, points: Points, depth: Array) -> Array:
        return hoops._residual(points, depth, outward)

    hoops, points, depth = primals
    change = jvp_of_moved(residual, primals, tangents)[1]
    firm = hoops.firm(points, depth - hoops._lost(outward))
    return outward, -hoops.solved(firm, change)


