"""Springs at fixed points of tibial surfaces, and how deep each of them is pressed.

Of a knee with menisci one pose of ten has an unusual ray, at one point of 1,200. A row is also
what is searched at once: a program's memory is that of its largest part, asked for in each call,
and all points at once made every solve four times slower.

In this file and `_points_force`, `femoral` is what presses, `points` lie on tibial surfaces,
`motion` leads from femoral to tibial axes, and depths are in mm.
"""

__all__ = ["Sampled"]

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.geometry import ZERO, Condyles, Matrix, Placement, Surface, Vector
from kneejax.mechanics.contact import _cartilage_law as law
from kneejax.mechanics.contact import _rays as rays
from kneejax.mechanics.contact._cartilage_law import ContactDamper
from kneejax.numerics import positive_part

if TYPE_CHECKING:
    from kneejax.mechanics.contact._ring import Hoops

Found = TypeVar("Found")
_ROW = 36


def of_usual_rows(sound: Array) -> Array:
    """Whether all rays of the row in which a point stands are sound, `(points, 1, ...)`."""
    rows = jnp.all(_split(sound), axis=tuple(range(1, sound.ndim + 1)))
    return jnp.repeat(rows, _ROW)[: len(sound)].reshape(-1, *(1,) * (sound.ndim - 1))


def over_unusual_rows(
    points: "Points",
    known: Array,
    sound: Array,
    search: Callable[..., Found],
    nothing: Callable[[Array], Found],
    more: Any = None,
) -> Found:
    """What a function makes of the rows of points that have unusual rays.

    Args:
        points: of tibial surfaces.
        known: depths that have been found, mm, `(points, ...)`.
        sound: whose they are.
        search: of the points of a row, as much of `known` and `sound`, and the row's part of
            `more`; returns arrays.
        nothing: the same for a row without unusual rays, of its `known`.
        more: what such a search has found before, `(rows, ...)`.

    Returns:
        The answers of all rows, `(rows, ...)`.
    """
    count, *poses = known.shape

    def split(x: Array | float) -> Array:
        x = jnp.asarray(x)
        return _split(jnp.broadcast_to(x, (count, *(x.shape[1:] or (1,) * len(poses)))))

    own, *of_rays = jax.tree.map(split, (points, known, sound))
    # The last point fills up its row, and does nothing there.
    counted = np.arange(own.area.shape[0] * _ROW).reshape(-1, _ROW, *(1,) * len(poses)) < count

    def of_row(row: tuple[Points, Array, Array, Any]) -> Found:
        _, known, sound, _ = row
        return lax.cond(jnp.all(sound), lambda: nothing(known), lambda: search(*row))

    return lax.map(of_row, (own.only(counted), *of_rays, more))


def row_after_row(x: Array) -> Array:
    """What was found at the points of each row, `(rows, ...)`, point after point."""
    return x.reshape(-1, *x.shape[2:])


def _split(x: Array) -> Array:
    """What is known of points, `(points, ...)`, in rows; the last point fills up the last row.

    Joined and not gathered: where a gather is fused, XLA (jaxlib 0.10.2) ends the process while it
    compiles the derivative backwards.
    """
    more = -len(x) % _ROW
    last = jnp.broadcast_to(x[-1:], (more, *x.shape[1:]))
    return jnp.concatenate([x, last]).reshape(-1, _ROW, *x.shape[1:])


Answer = TypeVar("Answer")


def over_rays(
    femoral: Surface | Condyles,
    points: "Points",
    motion: Placement,
    answer: "Callable[[Sampled], Answer]",
    hoops: "Hoops | None" = None,
) -> Answer:
    """What a function makes of the depths at points of tibial surfaces.

    The usual rays take a short search; if one of them is not usual, the row of points that it is
    one of is searched thoroughly.
    """
    surface = asked_at(femoral, points)

    def settled(sampled: Sampled) -> Answer:
        return answer(sampled.settled(hoops))

    quick, sound = quick_depths(surface, points, motion)
    usual = quickly(surface, points, motion, quick)

    def again() -> Answer:
        def of_row(own: Points, known: Array, is_known: Array, _: None) -> tuple[Array, ...]:
            surface = asked_at(femoral, own)
            found = rays.thorough_exit(surface, *own.lines(motion), known, is_known)
            return _numbers(thoroughly(surface, own, motion, known, is_known, found))

        def nothing(known: Array) -> tuple[Array, ...]:
            return (jnp.zeros_like(known),) * 7 + (jnp.zeros(known.shape, bool),)

        rows = over_unusual_rows(points, quick, sound, of_row, nothing)
        kept = of_usual_rows(sound)
        both = zip(_numbers(usual), map(row_after_row, rows), strict=True)
        depth, *six, lost = (jnp.where(kept, x, y[: len(quick)]) for x, y in both)
        return settled(Sampled(points, depth, Vector(*six[:3]), Vector(*six[3:]), lost))

    return lax.cond(jnp.all(sound), lambda: settled(usual), again)


def sample(
    femoral: Surface | Condyles, points: "Points", motion: Placement, hoops: "Hoops | None" = None
) -> "Sampled":
    """Depths at all points; arguments as `over_rays`."""
    depth, *six, lost = over_rays(femoral, points, motion, _numbers)
    rays = Sampled(points, depth, Vector(*six[:3]), Vector(*six[3:]), lost)
    return rays.settled(hoops)


def _numbers(sampled: "Sampled") -> tuple[Array, ...]:
    """Depth, slope, twist and what is lost, each `(points, ...)`."""
    numbers = sampled.depth, *sampled.slope, *sampled.twist, sampled.lost
    shape = jnp.broadcast_shapes(*map(jnp.shape, numbers))
    return tuple(jnp.broadcast_to(x, shape) for x in numbers)


def quick_depths(
    femoral: Surface, points: "Points", motion: Placement
) -> tuple[Array, Array]:
    """Depths of the usual rays, mm, and whose are sound.

    Off the cartilage a fitted surface goes on where no tibia is: a condyle that hangs over the rim
    may be as deep in it as it likes. A point there counts as apart, farther than anything.
    """
    quick, sound = rays.quick_exit(femoral, *points.lines(motion))
    bare = points.area <= 0.0
    return jnp.where(bare, -rays.FARTHEST, quick), sound | bare


def quickly(femoral: Surface, points: "Points", motion: Placement, quick: Array) -> "Sampled":
    """What the points see where their rays are the usual ones."""
    lines = points.lines(motion)
    own = rays.follow(femoral, *lines, quick)
    level, gradient, steep = rays.look(femoral, own, *lines)
    return _usual(points, motion, own, level, gradient, steep)


def quickly_with_bend(
    femoral: Surface, points: "Points", motion: Placement, quick: Array
) -> "tuple[Sampled, Vector, Matrix]":
    """As `quickly`, with gradient and bend of the femoral level where the rays end.

    The surface is asked once for all of it, where the last step is taken: 3e-8 mm from the end at
    most over the motion of a knee with splines, 2e-13 mm at most points.
    """
    start, along = points.lines(motion)
    own = rays.follow(femoral, start, along, quick)
    level, gradient, bend = femoral.level_slope_and_bend(start - own * along)
    # The gradient goes along with the last step: else forces would tell how far off the rays were
    # found, which depends on those beside them.
    step = level / jnp.minimum(gradient @ along, -rays.LEVEL)
    gradient = gradient - jnp.clip(step, -rays.LAST_STEP, rays.LAST_STEP) * (bend @ along)
    usual = _usual(points, motion, own, level, gradient, gradient @ along)
    return usual, gradient, bend


def _usual(
    points: "Points", motion: Placement, own: Array, level: Array, gradient: Vector, steep: Array
) -> "Sampled":
    """What points see along usual rays that have been looked at near their ends."""
    per_steep = 1.0 / jnp.minimum(steep, -rays.LEVEL)
    depth = own + jnp.clip(level * per_steep, -rays.LAST_STEP, rays.LAST_STEP)
    lost = jnp.zeros(jnp.shape(depth), bool)
    slope = points.turned(motion, per_steep * gradient)
    return Sampled(points, points.left_of(depth), slope, ZERO, lost)


def thoroughly(
    femoral: Surface, points: "Points", motion: Placement, known: Array, is_known: Array,
    found: rays.Exit,
) -> "Sampled":  # fmt: skip
    """What the points see, whatever their rays."""
    depth, by_point, by_normal = rays.any_depth(femoral, *points.lines(motion), found)
    depth = jnp.where(is_known & (known <= -rays.APART), lax.stop_gradient(known), depth)
    slope = points.turned(motion, by_point)
    # A ray's own depth changes by a turn of the normal as if its far end were held: no twist.
    swing = points.turned(motion, by_normal) + depth * slope
    twist = points.normal.cross(swing)
    return Sampled(points, points.left_of(depth), slope, twist, found.lost)


class Points(eqx.Module):
    """Springs on tibial surfaces, along the axis before those of the poses.

    Attributes:
        point: mm, in the axes of the bone that carries the surface, the tibia.
        normal: outward unit normals there.
        area: weight of each point, mm^2; zero off the cartilage.
        layer: thickness of both cartilages, mm; this and what follows may have one point that
            stands for all.
        modulus: of the layer, confined, MPa.
        onset_width: rounding of the depth's corner at first touch, mm.
        femoral: placement in its bone of the surface that presses on the point.
        which: number of that surface among several; None where it is the same for all.
        damper: of the contact during a step through time, arrays `(points, ...)`; None at rest.
        law: pressure law.
        given_way: depth that is lost where a rim has given way, mm; None as long as that is not
            known, or where none does.
    """

    point: Vector
    normal: Vector
    area: Array
    layer: Array
    modulus: Array
    onset_width: Array
    femoral: Placement
    which: Array | None
    damper: ContactDamper | None
    law: str = eqx.field(static=True)
    given_way: Array | None = None

    def energy(self, depth: Array) -> Array:
        """Energy of each spring at a depth, N mm."""
        near, _ = rays.faded(depth)
        density = law.relative_energy(self.law, self._rounded(near) / self.layer)
        energy = self.modulus * self.area * self.layer * density
        return energy if self.damper is None else energy + self.damper.energy(near)

    def force(self, depth: Array) -> Array:
        """Force of each spring along the slope of its depth, N: the derivative of its energy."""
        force = self.pressure(depth) * self.area
        if self.damper is None:
            return force
        near, slope = rays.faded(depth)
        return force + self.damper.force(near) * slope

    def pressure(self, depth: Array) -> Array:
        """Elastic pressure at a depth, MPa, with the rounded onset: the derivative of the elastic
        energy per area."""
        near, _ = rays.faded(depth)
        relative = law.relative_pressure(self.law, self._rounded(near) / self.layer)
        return self.modulus * relative * self.touching(depth)

    def only(self, counted: Array | np.ndarray) -> "Points":
        """The same points, of which those that do not count do nothing, `(points, ...)`."""
        area, damper = jnp.where(counted, self.area, 0.0), self.damper
        if damper is not None:
            pressing = jnp.where(counted, damper.pressing, 0.0)
            damper = dataclasses.replace(damper, pressing=pressing)
        return dataclasses.replace(self, area=area, damper=damper)

    def left_of(self, depth: Array) -> Array:
        """Depth that is left where rims have given way, mm."""
        return depth if self.given_way is None else depth - self.given_way

    def touching(self, depth: Array) -> Array:
        """From 0 apart to 1 in touch, over the onset."""
        near, slope = rays.faded(depth)
        return slope * law.touching(near, self.onset_width)

    def _rounded(self, near: Array) -> Array:
        return positive_part(near, self.onset_width)

    def lines(self, motion: Placement) -> tuple[Vector, Vector]:
        """Points and their normals in the femoral surfaces' frames."""
        along = self.femoral.turn_back(motion.turn_back(self.normal))
        return self.in_femoral(motion, self.point).full(), along.full()

    def in_femoral(self, motion: Placement, place: Vector) -> Vector:
        """A place beside each point, in its femoral surface's frame, mm."""
        return self.femoral.apply_inverse(motion.apply_inverse(place))

    def turned(self, motion: Placement, direction: Vector) -> Vector:
        """A direction of the femoral surfaces' frames in tibial axes."""
        return motion.turn(self.femoral.turn(direction))


class Sampled(eqx.Module):
    """What the points see of the femur.

    Attributes:
        points: of tibial surfaces.
        depth: overlap along the normal, mm; negative where the surfaces are apart. Of a rim that
            gives way, what is left of it.
        slope: derivative of the depth with respect to a motion of the point.
        twist: couple that goes with a unit of force along the slope, mm: zero but for rays that
            graze the femur.
        lost: whether the search for a ray's end has not ended.
        of_hoops: energy of rims that have given way, N mm; None without any.
    """

    points: Points
    depth: Array
    slope: Vector
    twist: Vector
    lost: Array
    of_hoops: Array | None = None

    def settled(self, hoops: "Hoops | None") -> "Sampled":
        """Once rims have given way, if there are any."""
        if hoops is None:
            return self
        own = self.points
        outward = hoops.settled(own, self.depth)
        own = dataclasses.replace(own, given_way=hoops.given_way(self.depth, outward))
        depth, energy = own.left_of(self.depth), hoops.energy(outward)
        return dataclasses.replace(self, points=own, depth=depth, of_hoops=energy)

    @property
    def energy(self) -> Array:
        """Of all springs, and of rims that have given way, N mm."""
        springs = jnp.sum(self.points.energy(self.depth), axis=0)
        return springs if self.of_hoops is None else springs + self.of_hoops

    @property
    def hit(self) -> Vector:
        """Where the normal's line leaves the femoral solid, mm, in tibial axes."""
        given_way = self.points.given_way
        ray = self.depth if given_way is None else self.depth + given_way
        return self.points.point - ray * self.points.normal

    def only(self, counted: Array) -> "Sampled":
        """As `Points.only`; those that do not count are far apart, too."""
        depth = jnp.where(counted, self.depth, -rays.FARTHEST)
        return dataclasses.replace(self, points=self.points.only(counted), depth=depth)


def asked_at(femoral: Surface | Condyles, points: Points) -> Surface:
    """The surface that presses on points; of several, one whose numbers are told by the point."""
    return femoral.at(points.which) if isinstance(femoral, Condyles) else femoral
