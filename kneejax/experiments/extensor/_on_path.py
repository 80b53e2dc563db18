"""Paper 1's patella: the path on which a patella in balance moves, with one degree of freedom."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments._motion import passive_flexion
from kneejax.experiments.extensor._extensor import needs_patella
from kneejax.experiments.extensor._held_leg import at_rest
from kneejax.experiments.extensor._mechanism import tendon_rows
from kneejax.geometry import FEMUR, PATELLA, Pose
from kneejax.mechanics import Knee, PatellaOnPath, Strands, add_lane_axis
from kneejax.statics import converged

#: Degree of the path's polynomials: a knee that rides on them turns by 0.50, 0.39, 0.41 and 0.39
#: degrees at most otherwise than with its patella in balance, with 11, 13, 15 and 17.
_DEGREE = 13
#: Where the path is taken, degrees: polynomials bend at their ends, which stand outside 0 to 120.
_FLEXION_DEG = np.arange(-10.0, 122.6, 2.5)


def patella_path(knee: Knee, flexion_deg: ArrayLike = _FLEXION_DEG) -> PatellaOnPath:
    """The path of a knee's patella in balance, over arc length, as a part of a knee of two bones.

    Args:
        knee: of three bones (`KneeFile.with_patella`); its quadriceps pulls as much as there.
        flexion_deg: over which the patella is followed, `(poses,)`.

    Returns:
        The patella on its path, with the tendon's fibres straight.

    Raises:
        ValueError: the knee has no patella, or it does not balance at one of the flexions.

    Source: paper 1, section 2.2, where the path comes from a simulation of the contact too.
    """
    needs_patella(knee)
    flexion = np.asarray(flexion_deg, float)
    motion = passive_flexion(knee, flexion)
    lost = np.flatnonzero(~converged(np.asarray(motion.status)))
    if len(lost):
        place = f"{flexion[lost[0]]:g} degrees"
        raise ValueError(f"{knee.name}: the patella has no balance at {place}; expected one there")
    state = motion.equilibrium.state
    poses = state.poses[PATELLA]
    length = np.asarray(add_lane_axis(knee.muscles).quadriceps_length(state))
    steps = np.linalg.norm(np.diff(np.asarray(poses.to_table())[:, 3:], axis=0), axis=1)
    arc_length = np.r_[0.0, np.cumsum(steps)]
    place = 2.0 * arc_length / arc_length[-1] - 1.0
    pairs = knee.ligaments.bodies
    retinacula = [k for k, pair in enumerate(pairs) if pair == (FEMUR, PATELLA)]
    return PatellaOnPath(
        tension=jnp.asarray(at_rest(knee)),
        ends=jnp.array([0.0, arc_length[-1]]),
        quadriceps=_polynomials(place, length),
        tendon=_strands(knee, tendon_rows(knee), place, poses),
        retinacula=_strands(knee, np.array(retinacula, int), place, poses),
    )


def _strands(knee: Knee, rows: np.ndarray, place: np.ndarray, poses: Pose) -> Strands:
    """Fibres of the patella, straight; rows of one pair of bones."""
    fibres = knee.ligaments
    ends = fibres.femoral_attachment[rows], fibres.tibial_attachment[rows]
    patella_first = all(fibres.bodies[row][0] == PATELLA for row in rows)
    on_patella, on_other = ends if patella_first else ends[::-1]
    moved = poses.placement.apply(tuple(on_patella.T[..., None]))  # pyright: ignore
    law = fibres.stiffness, fibres.slack_length, fibres.transition_strain, fibres.transition_width
    paths = _polynomials(place, np.moveaxis(np.stack(moved), -1, 0))
    return Strands(jnp.swapaxes(paths, 1, 2), on_other, *(x[rows] for x in law))


def _polynomials(place: np.ndarray, values: np.ndarray) -> Array:
    """Coefficients `(k, ...)` of what `(poses, ...)` is along the path."""
    rows = np.polynomial.polynomial.polyfit(place, values.reshape(len(place), -1), _DEGREE)
    return jnp.asarray(rows.reshape(-1, *values.shape[1:]))


def on_path(knee: Knee, with_patella: Knee) -> Knee:
    """A knee of two bones whose patella rides on its path (paper 1).

    Args:
        knee: of two bones; its lines of constant tension, which stand for the patella, go.
        with_patella: the same knee of three bones, with the pull of its quadriceps.

    Returns:
        The knee, for every experiment and fit that takes one of two bones.

    Raises:
        ValueError: as `patella_path`; or the first knee has a patella already.

    Example:
        >>> import kneejax as kj
        >>> three = kj.load_knee("four_ligament", patella=True)
        >>> kj.on_path(three, three)
        Traceback (most recent call last):
        ValueError: four_ligament has its patella already: expected the knee of two bones
    """
    if PATELLA in knee.bodies:
        raise ValueError(f"{knee.name} has its patella already: expected the knee of two bones")
    return dataclasses.replace(knee, lines=(patella_path(with_patella),))
