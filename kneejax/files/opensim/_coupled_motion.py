"""Secondary motion of a knee as splines of its flexion."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.files.opensim._functions import simm_splines
from kneejax.files.reading import InputProblem

#: Between knots where many poses share a flexion, degrees.
_APART_DEG = 10.0
#: Weight of a spline's bending beside a pose's distance, for knots between which no pose lies.
_STIFF = 1e-3
_FEWEST = 4


@dataclasses.dataclass(frozen=True)
class CoupledMotion:
    """Splines of OpenSim's kind over flexion.

    Attributes:
        flexion_deg: knots, increasing, `(k,)`.
        secondary: at the knots, degrees and mm, `(k, 5)`, in the order of
            `kneejax.geometry.FREE_COORDINATES`.
        rms: what the splines leave of the poses, `(5,)`, likewise.
    """

    flexion_deg: np.ndarray
    secondary: np.ndarray
    rms: np.ndarray

    def at(self, flexion_deg: np.ndarray) -> np.ndarray:
        """The secondary motion at flexions `(n,)`, `(n, 5)`; straight beyond the knots."""
        return simm_splines(self.flexion_deg, self.secondary, flexion_deg)


def coupled_motion(
    poses: np.ndarray, file: str = "poses", knots_deg: np.ndarray | None = None
) -> CoupledMotion:
    """Splines of flexion through poses, or between them.

    Where flexion grows or falls from row to row, splines pass through every pose. Otherwise, as in
    a step of walking, which is bent to one angle several times, they are the nearest to all poses
    by least squares, with knots every 10 degrees.

    Args:
        poses: table rows, `(n, 6)`, degrees and mm.
        file: from which they come, for errors.
        knots_deg: of the splines, to compare several motions; by default as above.

    Raises:
        InputProblem: fewer than four flexions.

    Example:
        >>> flexion = np.array([0.0, 30.0, 60.0, 90.0])
        >>> table = np.column_stack([flexion, *[0.01 * flexion] * 5])
        >>> coupled_motion(table).at(np.array([45.0])).round(6).tolist()
        [[0.45, 0.45, 0.45, 0.45, 0.45]]
    """
    flexion, secondary = poses[:, 0], poses[:, 1:]
    steps = np.diff(flexion)
    ordered = (steps > 0).all() or (steps < 0).all()
    if len(np.unique(flexion)) < _FEWEST:
        found = f"{len(np.unique(flexion))} of them"
        raise InputProblem(file, "flexion_deg", found, f"{_FEWEST} or more different ones")
    if ordered and knots_deg is None:
        rows = np.argsort(flexion)
        return CoupledMotion(flexion[rows], secondary[rows], np.zeros(secondary.shape[1]))
    knots = knots_deg
    if knots is None:
        count = max(_FEWEST, 1 + round(float(np.ptp(flexion)) / _APART_DEG))
        knots = np.linspace(flexion.min(), flexion.max(), count)
    # Splines are linear in their values at the knots.
    by_value = simm_splines(knots, np.eye(len(knots)), flexion)
    bend = np.sqrt(_STIFF * len(flexion)) * np.diff(np.eye(len(knots)), 2, axis=0)
    wanted = np.vstack([secondary, np.zeros((len(bend), secondary.shape[1]))])
    values = np.linalg.lstsq(np.vstack([by_value, bend]), wanted, rcond=None)[0]
    rms = np.sqrt(np.mean((by_value @ values - secondary) ** 2, axis=0))
    return CoupledMotion(knots, values, rms)
