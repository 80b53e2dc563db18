"""Paper 3's simple surfaces of a knee that has better ones: polynomial groove, two plane facets.

The paper prints neither its polynomials nor the place of its facets. What it prints is their kind:
second-order polynomials in cylindrical coordinates for the two surfaces of the groove, planes 130
degrees apart for the facets, parted by a vertical ridge. They are laid through a knee's own groove
and patella here.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from kneejax.geometry import FEMUR, PATELLA, TIBIA, Condyle, Frame, Plane, Surface
from kneejax.geometry.fitting import fit_condyle
from kneejax.mechanics import Knee
from kneejax.reproduction.paper3._rigid_patella import RigidPatella

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
    return RigidPatella(
        groove=_groove(contact.femoral),
        facets=_facets(contact.tibial),
        patellar_attachment=share @ fibres.femoral_attachment[rows],
        tibial_attachment=share @ fibres.tibial_attachment[rows],
        tendon_length=share @ fibres.slack_length[rows],
        origin=part @ muscles.femoral_attachment[heads],
        insertion=part @ muscles.tibial_attachment[heads],
    )


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
