"""Paper 3's own patella: two rigid contact points without friction, a tendon that does not stretch.

Nothing here is elastic, so nothing of it is a part of a knee: three constraints hold the patella
and their multipliers are its forces. The elastic form becomes this one as it stiffens.

The paper prints neither its polynomials nor the place of its facets, but their kind: second-order
polynomials in cylindrical coordinates for the two surfaces of the groove, planes 130 degrees apart
for the facets, parted by a vertical ridge. They are laid through a knee's own groove and patella.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array

from kneejax.geometry import (
    FEMUR,
    PATELLA,
    TIBIA,
    Condyle,
    Frame,
    Placement,
    Plane,
    Pose,
    Surface,
    coordinates_of,
    fit_condyle,
    scales,
)
from kneejax.mechanics import Knee

#: Where a search ends, mm and N per N of pull; and after how many steps it is given up.
_TOLERANCE, _MOST_STEPS = 1e-11, 100
#: What counts as 1 of each unknown of a patella: its six coordinates; angle and width of both
#: points of the groove; force of the medial and lateral contact and of the tendon, per N of the
#: quadriceps' pull.
SCALES = (*scales(coordinates_of([PATELLA])), 1 / 30, 1.0, 1 / 30, 1.0, 1.0, 1.0, 1.0)
#: Between the patella's facets (section 2), degrees.
FACETS_DEG = 130.0
#: The order of the groove's polynomials (section 2).
ORDER = 2
#: Where on the groove its two surfaces are laid: angle from the front, and width from its deepest
#: line, degrees and mm: from the floor over the crest that the facets ride on.
_ANGLE_DEG, _WIDTH_MM = (-35.0, 85.0), (4.0, 25.0)
#: Where on the patella: height and width from the ridge, mm.
_HEIGHT_MM, _FACET_MM = (-10.0, 10.0), (4.0, 14.0)
_POINTS = 25


class RigidPatella(eqx.Module):
    """A patella on a groove that it touches in two points, between tendon and quadriceps.

    Attributes:
        groove: the medial and the lateral surface of the femur's groove.
        facets: those of the patella, medial and lateral.
        patellar_attachment: of the tendon, `(3,)`, mm, patella frame.
        tibial_attachment: of the tendon, `(3,)`, mm, tibia frame.
        tendon_length: mm.
        origin: of the quadriceps, `(3,)`, mm, femur frame.
        insertion: of the quadriceps, `(3,)`, mm, patella frame.
    """

    groove: tuple[Condyle, Condyle]
    facets: tuple[Surface, Surface]
    patellar_attachment: Array
    tibial_attachment: Array
    tendon_length: Array
    origin: Array
    insertion: Array

    def gap(self, side: int, patella: Placement, met: Array) -> Array:
        """Distance of a point of the groove from a facet, mm.

        Args:
            side: 0 medial, 1 lateral.
            patella: where it is in the femur.
            met: parameters of the point, `(2,)`.
        """
        groove, facet = self.groove[side], self.facets[side]
        point = groove.frame.placement.apply(groove.point(met[0], met[1]))
        seen = facet.frame.placement.apply_inverse(patella.apply_inverse(point))
        return facet.level(seen)

    def tendon(self, patella: Placement, attached: Array) -> Array:
        """The tendon from the tibia to the patella in femur axes, `(3,)`, mm.

        Args:
            patella: where it is in the femur.
            attached: its end on the tibia, `(3,)`, mm, in the femur's frame.
        """
        return jnp.stack(patella.apply(tuple(self.patellar_attachment))) - attached

    def quadriceps(self, patella: Placement) -> Array:
        """Length of the quadriceps, a straight line, mm."""
        return jnp.linalg.norm(jnp.stack(patella.apply(tuple(self.insertion))) - self.origin)

    def stationary(self, unknowns: Array, attached: Array) -> Array:
        """What vanishes where the patella is in balance, `(13,)`; the pull is 1 N.

        The quadriceps becomes as short as the constraints allow: the derivatives of its length
        with the constraints' multipliers. In order: forces and moments on the patella; that each
        point of the groove has the facet's normal (paper 3, Eqs 1 and 2); that it touches the
        facet (Eq 17), medial and lateral; that the tendon has its length.

        Args:
            unknowns: see `SCALES`; rad, mm, N per N.
            attached: end of the tendon on the tibia, `(3,)`, mm, in the femur's frame.
        """
        medial, lateral, pull = unknowns[10:]
        touch = unknowns[6:10].reshape(2, 2)

        def constrained(coordinates: Array) -> tuple[Placement, list[Array]]:
            there = Pose(*coordinates).placement
            stretch = jnp.linalg.norm(self.tendon(there, attached)) - self.tendon_length
            return there, [*(self.gap(k, there, touch[k]) for k in (0, 1)), stretch]

        def lagrangian(coordinates: Array) -> Array:
            there, (inner, outer, stretch) = constrained(coordinates)
            return self.quadriceps(there) + pull * stretch - medial * inner - lateral * outer

        there, left = constrained(unknowns[:6])
        slopes = [jax.grad(self.gap, argnums=2)(k, there, touch[k]) for k in (0, 1)]
        forces = jax.grad(lagrangian)(unknowns[:6])
        units = jnp.array([*SCALES[:10], 1.0, 1.0, 1.0])
        return jnp.concatenate([forces, *slopes, jnp.stack(left)]) * units

    def balanced(self, attached: Array, near: Array) -> Array:
        """Where the patella is in balance, `(13,)`; NaN where the search finds nothing.

        Args:
            attached: end of the tendon on the tibia, `(3,)`, mm, in the femur's frame.
            near: where the search begins, as in `SCALES`.

        Returns:
            The unknowns, differentiable by every number of this patella and by `attached`.
        """
        size, begin = jnp.array(SCALES), jax.lax.stop_gradient(near)
        solver = optx.Dogleg(rtol=_TOLERANCE, atol=_TOLERANCE)
        found = optx.root_find(
            lambda x, args: args[0].stationary(x * size, args[1]),
            solver, begin / size, (self, attached), max_steps=_MOST_STEPS, throw=False,
        )  # fmt: skip
        left = jnp.max(jnp.abs(self.stationary(found.value * size, attached)))
        return jnp.where(left < 1e3 * _TOLERANCE, found.value * size, jnp.nan)


def rigid_patella_of(knee: Knee) -> RigidPatella:
    """The patella of a knee in paper 3's form.

    Args:
        knee: of three bones, with a fitted groove and patella.

    Returns:
        Its surfaces as simple as paper 3's; one tendon and one quadriceps, between the mean
        attachments of its fibres and heads; the tendon as long as its fibres are on the whole.
    """
    (contact,) = (one for one in knee.contacts if one.bodies == (FEMUR, PATELLA))
    assert isinstance(contact.femoral, Condyle)
    fibres, muscles = knee.ligaments, knee.muscles
    rows = np.array([k for k, pair in enumerate(fibres.bodies) if pair == (PATELLA, TIBIA)])
    assert muscles is not None
    heads = np.array(muscles.quadriceps)
    part = muscles.tension[heads] / jnp.sum(muscles.tension[heads])
    share = fibres.stiffness[rows] / jnp.sum(fibres.stiffness[rows])
    return RigidPatella(groove=_groove(contact.femoral), facets=_facets(contact.tibial),
                        patellar_attachment=share @ fibres.femoral_attachment[rows],
                        tibial_attachment=share @ fibres.tibial_attachment[rows],
                        tendon_length=share @ fibres.slack_length[rows],
                        origin=part @ muscles.femoral_attachment[heads],
                        insertion=part @ muscles.tibial_attachment[heads])  # fmt: skip


def _groove(whole: Condyle) -> tuple[Condyle, Condyle]:
    """Medial and lateral polynomial through points of a groove on both sides of its floor."""
    angle = np.deg2rad(np.linspace(*_ANGLE_DEG, _POINTS))
    across = np.linspace(-8.0, 8.0, 81)
    radius = np.asarray(whole.radius(angle[:, None] + 0 * across, across + 0 * angle[:, None]))
    floor = float(np.median(across[np.argmin(radius, axis=1)]))
    sides = []
    for side in (-1.0, 1.0):
        width = floor + side * np.linspace(*_WIDTH_MM, _POINTS)
        grid = np.meshgrid(angle, width, indexing="ij")
        points = whole.frame.placement.apply(whole.point(*map(jnp.asarray, grid)))
        every = np.stack([np.ravel(x) for x in points], axis=1)
        limits = float(width.min()), float(width.max())
        found = fit_condyle(
            every, _ANGLE_DEG, limits, (ORDER, ORDER), whole.frame, total_degree=ORDER
        )
        sides.append(found.surface)
    return sides[0], sides[1]


def _facets(whole: Surface) -> tuple[Plane, Plane]:
    """Medial and lateral plane, each at half of 130 degrees from the ridge's plane of symmetry."""
    tilt = 0.5 * np.deg2rad(180.0 - FACETS_DEG)
    height = np.linspace(*_HEIGHT_MM, _POINTS)
    across = np.linspace(-8.0, 8.0, 81)
    ridge = float(across[np.argmax(np.mean(_levels(whole, height, across), axis=0))])
    through = []
    for side in (-1.0, 1.0):
        width = ridge + side * np.linspace(*_FACET_MM, _POINTS)
        level = _levels(whole, height, width) + np.tan(tilt) * side * width
        origin = whole.frame.placement.apply((0.0, float(level.mean()), 0.0))
        # The plate's frame stands with its Y axis backwards; the facet leans to its side.
        turned = jnp.array([0.0, side * tilt, 0.5 * np.pi])
        through.append(Plane(Frame(jnp.stack([jnp.asarray(x) for x in origin]), turned)))
    return through[0], through[1]


def _levels(whole: Surface, height: np.ndarray, width: np.ndarray) -> np.ndarray:
    grid = np.meshgrid(height, width, indexing="ij")
    return np.asarray(whole.point(*map(jnp.asarray, grid))[1])
