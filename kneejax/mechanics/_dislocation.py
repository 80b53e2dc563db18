"""How far a tibia is from its place under the femur, and when a knee counts as dislocated."""

__all__ = ["LIMITS", "WIDEST_GAP_MM", "condyle_points", "dislocated", "displacement"]

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import FEMUR_AND_TIBIA, FREE_COORDINATES, Pose, Surface, Vector
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


#: From the reference pose, degrees and mm, at any flexion. Generous: cut knees on a rig stay well
#: within. Internal and external rotation 12 and 10 degrees, intact (Komzak 2013); adduction 7
#: degrees from varus to valgus, intact (Markolf 1978); anterior 13.2 +- 2.9 mm by 90 N without
#: the ACL (robot, n = 12), to which passive flexion adds up to 12 mm of roll-back. A condyle moved
#: sideways by 20 mm has left its own plateau, some 30 mm wide.
LIMITS = {
    "adduction": 20.0,
    "internal_rotation": 50.0,
    "anterior": 30.0,
    "superior": 20.0,
    "lateral": 20.0,
}
#: Gap of a compartment, mm. Lift-off of some mm is a knee: with all medial structures cut a
#: clinician's valgus opens the medial compartment by 9.8 mm more (LaPrade et al., Am J Sports Med
#: 38, 2010); what had been dislocated and reduced opened by 13.8 mm, to 14 degrees.
WIDEST_GAP_MM = 15.0


def displacement(knee: Knee, pose: Pose) -> Array:
    """How far the tibia is from where it is at the reference pose, apart from flexion.

    Rotations are differences of coordinates. Translations are those of the femur's centre at the
    knee as the tibia sees it, in the tibia's axes, so that they do not depend on where the bones'
    origins are: the middle of the condyles' own origins, or of the fibres' attachments where there
    is no contact.

    Args:
        knee: leaves end in the axes of the poses, or in one that broadcasts.
        pose: any shape.

    Returns:
        Shape `(5, ...)`, degrees and mm, in the order of `kneejax.geometry.FREE_COORDINATES`.

    Example:
        >>> from kneejax.files import load_knee
        >>> from kneejax.mechanics import add_lane_axis
        >>> knee, pose = load_knee("four_ligament"), Pose.from_table([[30.0, 2.0, 5.0, 0, 0, 0]])
        >>> moved = displacement(add_lane_axis(knee), pose)
        >>> moved[:2, 0].round(6).tolist()
        [2.0, 5.0]
    """
    center, rest = _center(knee), knee.reference_pose
    there = rest.placement.apply_inverse(center)
    here = pose.placement.apply_inverse(center)
    turned = [
        jnp.rad2deg(pose.adduction - rest.adduction),
        jnp.rad2deg(pose.internal_rotation - rest.internal_rotation),
    ]
    moved = [a - b for a, b in zip(there, here, strict=True)]
    return jnp.stack(jnp.broadcast_arrays(*turned, *moved))


def dislocated(displaced: Array, widest_gap_mm: Array) -> Array:
    """Whether a knee has come apart, or a coordinate is beyond those of any knee.

    Args:
        displaced: see `displacement`, `(5, ...)`.
        widest_gap_mm: of the compartments, `(...)`; negative where all touch.

    Returns:
        Truth values `(...)`; false where numbers are NaN.

    Example:
        >>> import jax.numpy as jnp
        >>> gap_mm = jnp.array([1.0, 16.0])
        >>> dislocated(jnp.zeros((5, 2)), gap_mm).tolist()
        [False, True]
    """
    limits = jnp.array([LIMITS[name] for name in FREE_COORDINATES])
    far = jnp.abs(displaced) > limits.reshape(5, *(1,) * (displaced.ndim - 1))
    return jnp.any(far, axis=0) | (widest_gap_mm > WIDEST_GAP_MM)


def _center(knee: Knee) -> Vector:
    if knee.contacts:
        origins = [Vector.of(contact.femoral.frame.origin) for contact in knee.contacts]
        return Vector(*(sum(x) / len(origins) for x in zip(*origins, strict=True)))
    return Vector.of(jnp.mean(knee.ligaments.femoral_attachment, axis=0))
