"""Paper 3's own patella: two rigid contact points without friction, a tendon that does not stretch.

Nothing here is elastic, so nothing of it is a part of a knee: three constraints hold the patella
and their multipliers are its forces. It stands beside the elastic form as a check of it, and where
the paper's own numbers are asked for.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array

from kneejax.geometry import PATELLA, Condyle, Placement, Pose, Surface, coordinates_of, scales

#: Where a search ends, mm and N per N of pull; and after how many steps it is given up.
_TOLERANCE, _MOST_STEPS = 1e-11, 100
#: What counts as 1 of each unknown of a patella: its six coordinates; angle and width of both
#: points of the groove; force of the medial and lateral contact and of the tendon, per N of the
#: quadriceps' pull.
SCALES = (*scales(coordinates_of([PATELLA])), 1 / 30, 1.0, 1 / 30, 1.0, 1.0, 1.0, 1.0)


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

        def lagrangian(coordinates: Array) -> Array:
            there = Pose(*coordinates).placement
            gaps = [self.gap(k, there, unknowns[6 + 2 * k : 8 + 2 * k]) for k in (0, 1)]
            stretch = jnp.linalg.norm(self.tendon(there, attached)) - self.tendon_length
            rest = pull * stretch - medial * gaps[0] - lateral * gaps[1]
            return self.quadriceps(there) + rest

        coordinates = unknowns[:6]
        there = Pose(*coordinates).placement
        gaps, slopes = zip(
            *(
                jax.value_and_grad(lambda met, k=k: self.gap(k, there, met))(
                    unknowns[6 + 2 * k : 8 + 2 * k]
                )
                for k in (0, 1)
            ),
            strict=True,
        )
        stretch = jnp.linalg.norm(self.tendon(there, attached)) - self.tendon_length
        return jnp.concatenate(
            [jax.grad(lagrangian)(coordinates), *slopes, jnp.stack([*gaps, stretch])]
        ) * jnp.array([*SCALES[:10], 1.0, 1.0, 1.0])

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
