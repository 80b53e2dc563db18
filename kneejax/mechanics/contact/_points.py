"""Springs at fixed points of tibial surfaces, and how deep each of them is pressed."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import Condyles, Placement, Surface, Vector, full, scale, subtract
from kneejax.mechanics.contact import _cartilage_law as law
from kneejax.mechanics.contact import _rays as rays
from kneejax.mechanics.contact._damper import ContactDamper
from kneejax.numerics import positive_part


class Points(eqx.Module):
    """Springs on tibial surfaces, along the axis before the lanes.

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
        damper: of the contact during a step through time, arrays `(points, lanes)`; None at rest.
        law: pressure law.
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

    def only(self, counted: Array | np.ndarray) -> Points:
        """The same points, of which those that do not count do nothing, `(points, ...)`."""
        area, damper = jnp.where(counted, self.area, 0.0), self.damper
        if damper is not None:
            pressing = jnp.where(counted, damper.pressing, 0.0)
            damper = dataclasses.replace(damper, pressing=pressing)
        return dataclasses.replace(self, area=area, damper=damper)

    def touching(self, depth: Array) -> Array:
        """From 0 apart to 1 in touch, over the onset."""
        near, slope = rays.faded(depth)
        return slope * law.touching(near, self.onset_width)

    def _rounded(self, near: Array) -> Array:
        return positive_part(near, self.onset_width)

    def lines(self, motion: Placement) -> tuple[Vector, Vector]:
        """Points and their normals in the femoral surfaces' frames.

        Args:
            motion: from femoral to tibial axes.
        """
        along = self.femoral.turn_back(motion.turn_back(self.normal))
        return full(self.in_femoral(motion, self.point)), full(along)

    def in_femoral(self, motion: Placement, place: Vector) -> Vector:
        """A place beside each point, in its femoral surface's frame, mm.

        Args:
            motion: from femoral to tibial axes.
            place: in tibial axes.
        """
        return self.femoral.apply_inverse(motion.apply_inverse(place))

    def turned(self, motion: Placement, direction: Vector) -> Vector:
        """A direction of the femoral surfaces' frames in tibial axes."""
        return motion.turn(self.femoral.turn(direction))


class Sampled(eqx.Module):
    """What the points see of the femur.

    Attributes:
        points: of tibial surfaces.
        depth: overlap along the normal, mm; negative where the surfaces are apart.
        slope: derivative of the depth with respect to a motion of the point.
        twist: couple that goes with a unit of force along the slope, mm: zero but for rays that
            graze the femur.
        lost: whether the search for a ray's end has not ended.
    """

    points: Points
    depth: Array
    slope: Vector
    twist: Vector
    lost: Array

    @property
    def hit(self) -> Vector:
        """Where the normal's line leaves the femoral solid, mm, in tibial axes."""
        return subtract(self.points.point, scale(self.depth, self.points.normal))

    def only(self, counted: Array) -> Sampled:
        """As `Points.only`; those that do not count are far apart, too."""
        depth = jnp.where(counted, self.depth, -rays.FARTHEST)
        return dataclasses.replace(self, points=self.points.only(counted), depth=depth)


def asked_at(femoral: Surface | Condyles, points: Points) -> Surface:
    """The surface that presses on points; of several, one whose numbers are told by the point."""
    return femoral.at(points.which) if isinstance(femoral, Condyles) else femoral


def midpoints(
    surface: Surface, count: tuple[int, int], trailing: int
) -> tuple[Vector, Vector, Array, tuple[Array, Array]]:
    """Middles of equal rectangles over a surface's region; they weigh nothing off its cartilage.

    What touches lies inside the region, and there the midpoint rule is the better one: Gauss
    points, dense at the edges, are half as dense in the middle (an error of area of 9.6 instead of
    5.3 per cent with 28 x 20 points on a measured knee).

    Args:
        surface: the tibial surface.
        count: number along each parameter.
        trailing: number of axes that the lanes take.

    Returns:
        Points and unit normals in the surface's frame, areas, and both parameters, scaled to -1..1.
    """
    (lower_a, upper_a), (lower_b, upper_b) = surface.bounds()
    along_a, along_b = (upper_a - lower_a) / count[0], (upper_b - lower_b) / count[1]
    s, t = (x.reshape(-1, *(1,) * trailing) for x in _middles(count))
    a, b = lower_a + s * (upper_a - lower_a), lower_b + t * (upper_b - lower_b)
    a, b = jnp.broadcast_arrays(a, b)
    weight = along_a * along_b * surface.covered(a, b, (along_a, along_b))
    point, normal, area = surface.oriented(a, b)
    return point, normal, weight * area, (2.0 * s - 1.0, 2.0 * t - 1.0)


def _middles(count: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the rectangles of a unit square, one row of rectangles after the other."""
    first, second = ((np.arange(n) + 0.5) / n for n in count)
    a, b = np.meshgrid(first, second, indexing="ij")
    return a.ravel(), b.ravel()
