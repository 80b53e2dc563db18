"""Points all over the condyles of a knee, as a mesh would give them."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import FEMUR_AND_TIBIA, Surface
from kneejax.mechanics._knee import Knee

# About 0.8 mm apart on a condyle.
_AROUND, _ALONG = 120, 40


def condyle_points(knee: Knee) -> tuple[np.ndarray, np.ndarray]:
    """Sample a knee's condyles, each surface once, over the regions to which they were fitted.

    With them `kneejax.joints.condyle_axes` finds the axes of a knee that has no mesh. The groove of
    the patella is none of them.

    Args:
        knee: any knee in which femur and tibia touch.

    Returns:
        Points, mm, and outward unit normals, in femur axes, each of shape `(n, 3)`.

    Raises:
        ValueError: femur and tibia have no contacts.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.joints import condyle_axes
        >>> axes = condyle_axes(*condyle_points(kj.load_knee("four_ligament")))
        >>> [round(facet.cylinder.radius) for facet in axes.facets]
        [30, 46, 23, 21]
    """
    condyles = [x.femoral for x in knee.contacts if x.bodies == FEMUR_AND_TIBIA]
    if not condyles:
        raise ValueError(f"{knee.name} has no contacts, hence no condyles")
    sampled = []
    for surface in _different(condyles):
        place = surface.frame.placement
        (first, last), (medial, lateral) = np.asarray(surface.bounds())
        a, b = np.meshgrid(
            np.linspace(first, last, _AROUND), np.linspace(medial, lateral, _ALONG)
        )
        point, normal, _ = surface.oriented(jnp.asarray(a.ravel()), jnp.asarray(b.ravel()))
        sampled.append([_rows(place.apply(point)), _rows(place.turn(normal))])
    points, normals = (np.concatenate(both) for both in zip(*sampled, strict=True))
    return points, normals


def _different(surfaces: list[Surface]) -> list[Surface]:
    """Each surface once: cartilage and meniscus meet the same condyle."""
    found: list[Surface] = []
    for surface in surfaces:
        if not any(eqx.tree_equal(surface, other) for other in found):
            found.append(surface)
    return found


def _rows(vector) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*map(np.asarray, vector)), axis=1)
