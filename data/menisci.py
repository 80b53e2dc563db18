"""Menisci: rings on a plateau, further contacts of the same femoral condyles.

A ring lies along the border of the cartilage, open towards the middle of the knee. It fills the
room that the femur leaves above the plateau while the knee flexes, as far as the height of its
wedge, and a little more: an unloaded knee rests on its menisci. A condyle that leaves its path, or
bends further, pushes sections of the ring outwards, and others move inwards with them. In life a
meniscus moves with an unloaded femur from extension on (a few mm medially, a centimetre laterally):
where the femur passes in flexion there is no ring in extension either.
"""

from __future__ import annotations

import copy
import dataclasses

import jax
import numpy as np
from matplotlib.path import Path as Outline
from scipy.interpolate import BSpline

import kneejax as kj
from kneejax.geometry import Plateau, Pose, State, Surface
from kneejax.mechanics.contact import Contact

# Vertical distances at which the femur is looked for, and how finely heights are made, per cell.
_ROOM_MM, _FINENESS = np.arange(-4.0, 16.0, 0.1), 4
# Half of the angle over which a ring is open, and corners along its border.
_OPEN_DEG, _CORNERS = 42.0, 24
# Rounding of the corner where the room ends the wedge.
_ROUNDING_MM = 0.5


@dataclasses.dataclass(frozen=True)
class Rim:
    """What is known of a meniscus.

    Attributes:
        compartment: name of the contact on whose plateau it stands.
        open_towards: sign of the lateral direction in which its horns end.
        height_mm: at the border, above the plane of the plateau.
        source: of its numbers.
        inner_mm: the same at the inner edge; what the femur leaves is less there.
        over_mm: by which it is higher than the room that the femur leaves.
        hoop_modulus_MPa: along its fibres.
        horn_stiffness_N_per_mm: of the attachment of each horn.
        coronary_stiffness_N_per_mm: of all that holds its border.
    """

    compartment: str
    open_towards: int
    height_mm: float
    source: str
    inner_mm: float = 4.0
    over_mm: float = 0.95
    width_mm: float = 10.0
    youngs_modulus_MPa: float = 20.0
    poisson_ratio: float = 0.2
    layer_thickness_mm: float = 10.0
    hoop_modulus_MPa: float = 120.0
    horn_stiffness_N_per_mm: float = 180.0
    coronary_stiffness_N_per_mm: float = 30.0


def contact_of(document: dict, knee: kj.Knee, rim: Rim, poses: np.ndarray) -> dict:
    """A rim as a contact of a knee document.

    Args:
        document: of the knee; what the femoral condyle and the plateau are is read there.
        knee: the same.
        rim: what is made.
        poses: that leave room for it, degrees and mm, `(n, 6)`.
    """
    own = document["contacts"][rim.compartment]
    contact = knee.contacts[knee.contact_names.index(rim.compartment)]
    surface = copy.deepcopy(own["tibial_surface"])
    surface["coefficients_mm"] = np.round(_heights(contact, rim, poses), 4).tolist()
    outline, middle = _ring(contact.tibial, rim)
    surface["outline_mm"] = np.round(outline, 3).tolist()
    for field in ("fit_rms_mm", "fit_max_mm"):
        surface.pop(field, None)
    surface["source"] = f"wedge on the {rim.compartment} plateau: {rim.source}"
    return {
        "form": "quadrature",
        "points": [36, 5],
        "law": "linear",
        "youngs_modulus_MPa": rim.youngs_modulus_MPa,
        "poisson_ratio": rim.poisson_ratio,
        "layer_thickness_mm": rim.layer_thickness_mm,
        "onset_width_mm": 0.05,
        "ring": _held(outline, middle, rim),
        "femoral_surface": copy.deepcopy(own["femoral_surface"]),
        "tibial_surface": surface,
        "source": rim.source,
    }


def _held(outline: np.ndarray, middle: np.ndarray, rim: Rim) -> dict:
    """What holds a rim, from the horn at one end of its border to that at the other."""
    forwards, right = (outline[:_CORNERS] - middle).T
    turns = np.rad2deg(np.unwrap(np.arctan2(right, forwards)))
    return {
        "youngs_modulus_MPa": rim.hoop_modulus_MPa,
        "cross_section_mm2": 0.5 * rim.width_mm * rim.height_mm,
        "horn_stiffness_N_per_mm": rim.horn_stiffness_N_per_mm,
        "coronary_stiffness_N_per_mm": rim.coronary_stiffness_N_per_mm,
        "middle_mm": np.round(middle, 3).tolist(),
        "horns_deg": sorted(np.round(turns[[0, -1]], 1).tolist()),
        "sections": 12,
    }


def _heights(contact: Contact, rim: Rim, poses: np.ndarray) -> np.ndarray:
    """Control values of the rim's surface, `(m + 3, n + 3)`."""
    plateau = contact.tibial
    assert isinstance(plateau, Plateau)
    table = np.asarray(plateau.coefficients)
    across = [np.linspace(-1.0, 1.0, _FINENESS * (n - 3) + 1) for n in table.shape]
    x, z = np.meshgrid(
        *(_stretched(s, ends) for s, ends in zip(across, (plateau.x, plateau.z), strict=True)),
        indexing="ij",
    )
    cartilage = np.asarray(plateau.point(x.ravel(), z.ravel())[1]).reshape(x.shape)
    inwards = _inwards(np.asarray(plateau.outline), x, z)
    flat = inwards > 0.6 * rim.width_mm
    columns = np.stack([np.ones_like(x), x, z], axis=-1)
    plane = columns @ np.linalg.lstsq(columns[flat], cartilage[flat], rcond=None)[0]
    part = 1.0 - np.clip(inwards / rim.width_mm, -0.3, 1.6)
    height = rim.inner_mm + (rim.height_mm - rim.inner_mm) * part
    wedge = np.clip(plane - cartilage + height, -3.0, 16.0)
    room = np.clip(_room(contact, x, z, cartilage, poses), -2.0, 14.0) + rim.over_mm
    rise = 0.5 * (room + wedge - np.sqrt((room - wedge) ** 2 + _ROUNDING_MM**2))
    first, second = (_basis(n - 3, s) for n, s in zip(table.shape, across, strict=True))
    added = np.linalg.lstsq(first, rise, rcond=1e-6)[0]
    return table + np.linalg.lstsq(second, added.T, rcond=1e-6)[0].T


def _room(contact: Contact, x, z, cartilage, poses: np.ndarray) -> np.ndarray:
    """Least distance from the cartilage up to the femur over some poses, mm."""
    least, heights = np.full(x.shape, _ROOM_MM[-1]), _ROOM_MM[:, None, None]
    level = jax.jit(lambda there: contact.femoral.level(there.apply_inverse((x, up, z))))
    up = cartilage + heights
    for pose in poses:
        state = State({"tibia": Pose.from_table(pose)})
        levels = np.asarray(level(contact.femur_to_plateau(state.between(contact.bodies))))
        first = np.argmax(levels < 0.0, axis=0)
        after = np.take_along_axis(levels, first[None], 0)[0]
        before = np.take_along_axis(levels, np.maximum(first - 1, 0)[None], 0)[0]
        part = np.where(first > 0, before / np.where(first > 0, before - after, 1.0), 1.0)
        found = _ROOM_MM[np.maximum(first - 1, 0)] + part * (_ROOM_MM[1] - _ROOM_MM[0])
        least = np.minimum(least, np.where((levels < 0.0).any(axis=0), found, least))
    return least


def _ring(plateau: Surface, rim: Rim) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the ring: along the cartilage's border, and back along its inner edge; and the
    middle from which its sections are seen."""
    assert isinstance(plateau, Plateau)
    border = np.asarray(plateau.outline)
    steps = np.linspace(0.0, 1.0, 12, endpoint=False)[:, None, None]
    dense = (border + steps * (np.roll(border, -1, axis=0) - border)).reshape(-1, 2)
    middle = 0.5 * (border.min(axis=0) + border.max(axis=0))
    half = 0.5 * (border.max(axis=0) - border.min(axis=0))
    forwards, outwards = ((dense - middle) / half).T
    # Measured from the opening, all around.
    angle = np.rad2deg(np.arctan2(forwards, rim.open_towards * outwards)) % 360.0
    inside = (angle > _OPEN_DEG) & (angle < 360.0 - _OPEN_DEG)
    dense, angle = dense[inside], angle[inside]
    along = dense[np.argsort(angle)]
    outer = along[np.linspace(0, len(along) - 1, _CORNERS).round().astype(int)]
    radius = np.linalg.norm(outer - middle, axis=1, keepdims=True)
    inner = middle + (outer - middle) * (1.0 - rim.width_mm / radius)
    return np.vstack([outer, inner[::-1]]), middle


def _inwards(border: np.ndarray, x, z) -> np.ndarray:
    """Distance from the border, mm; negative outside."""
    points, along = np.stack([x.ravel(), z.ravel()], axis=1), np.roll(border, -1, axis=0) - border
    part = ((points[:, None] - border) * along).sum(axis=2) / (along * along).sum(axis=1)
    nearest = border + np.clip(part, 0.0, 1.0)[..., None] * along
    away = np.linalg.norm(nearest - points[:, None], axis=2).min(axis=1)
    sign = np.where(Outline(border).contains_points(points), 1.0, -1.0)
    return (sign * away).reshape(x.shape)


def _basis(cells: int, s: np.ndarray) -> np.ndarray:
    """Uniform cubic B-splines of some equal cells over -1..1, `(len(s), cells + 3)`."""
    knots = -1.0 + 2.0 / cells * np.arange(-3, cells + 4)
    return BSpline.design_matrix(s, knots, 3).toarray()


def _stretched(s: np.ndarray, ends) -> np.ndarray:
    lower, upper = np.asarray(ends)
    return lower + 0.5 * (s + 1.0) * (upper - lower)
