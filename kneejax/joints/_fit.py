"""Joints from measured poses and the axis points of a femur."""

__all__ = ["JointFit", "calibration_rows", "fit_joints"]

import dataclasses
from collections.abc import Sequence

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry import BY_COORDINATE, COLUMNS, Pose
from kneejax.joints._frames import UnsuitablePoses
from kneejax.joints._joint import Joint, axis_between, generalised_axis, hinge, moving_axis
from kneejax.numerics import Named

#: A calibration pose is at most this far from the flexion that was asked for, degrees.
FARTHEST_DEG = 5.0
#: First and last calibration pose are at least this far apart, degrees.
LEAST_SPAN_DEG = 5.0


@dataclasses.dataclass(frozen=True)
class JointFit(Named):
    """Simple joints of one knee.

    Attributes:
        moving: the axis that moves from the extension to the flexion centres; through two poses
            paper 5's joint, through more its generalisation.
        hinge: the fixed axis, exact at the first calibration pose.
        rows: of the measured poses that were used, by increasing flexion.
        poses: those poses, shape `(k, 6)`, degrees and mm, in the order of
            `kneejax.geometry.COLUMNS`.
        rmse: of the moving joint and of the hinge over all measured poses at their flexion, shape
            `(2, 5)`, degrees and mm, in the order of `kneejax.geometry.FREE_COORDINATES`.
    """

    moving: Joint
    hinge: Joint
    rows: tuple[int, ...]
    poses: np.ndarray
    rmse: np.ndarray

    OVER = {"joint coordinate": {"rmse": ""}, "pose": {"rows": ""}}

    def _named(self) -> dict[str, tuple]:
        poses = {name: ("pose", x) for name, x in zip(COLUMNS, self.poses.T, strict=True)}
        joints = {"joint": ("joint", ["moving", "hinge"])}
        return super()._named() | poses | joints | BY_COORDINATE


def fit_joints(
    poses: ArrayLike,
    points: ArrayLike,
    hinge_points: ArrayLike,
    at_deg: Sequence[float] = (),
    interpolation: str | None = None,
) -> JointFit:
    """Calibrate a moving axis and a hinge on measured poses.

    Args:
        poses: measured, or of a contact knee, shape `(n, 6)`, degrees and mm, in the package's
            convention; rows of NaN (poses that are not known) are left out.
        points: medial and lateral point of the extension, then of the flexion axis, in the femur,
            shape `(2, 2, 3)`, mm.
        hinge_points: of the hinge's axis, shape `(2, 3)`, mm; paper 5 takes the epicondyles.
        at_deg: flexions whose nearest poses are used; the first and the last in flexion otherwise.
        interpolation: `linear` or `monotone`; by default linear through two poses, as in paper 5,
            and monotone through more.

    Returns:
        The joints.

    Raises:
        UnsuitablePoses: as in `calibration_rows`.
        UnsuitableAxis: the points make no transverse axis.

    Source: paper 5, section 2.5.

    Example:
        >>> import kneejax as kj
        >>> poses = [[0.0, 0, 0, 0, 0, 0], [45.0, 0, 0, 1, 0, 0], [90.0, 0, 0, 2, 0, 0]]
        >>> ends = [[[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], [[-4.0, 0.0, -40.0], [-4.0, 0.0, 40.0]]]
        >>> found = kj.fit_joints(poses, ends, [[-2.0, 0.0, -40.0], [-2.0, 0.0, 40.0]])
        >>> found.rows, found.rmse.shape
        ((0, 2), (2, 5))
    """
    table = np.asarray(poses, float).reshape(-1, 6)
    rows = calibration_rows(table, at_deg)
    used = Pose.from_table(table[rows])
    if len(rows) == 2 and interpolation in (None, "linear"):
        moving = moving_axis(points, used)
    else:
        extension, flexed = np.asarray(points, float)
        femoral = axis_between(extension, flexed, used.flexion)
        moving = generalised_axis(femoral, used, interpolation or "monotone")
    fixed = hinge(hinge_points, Pose.from_table(table[rows[0]]))
    known = table[np.isfinite(table).all(axis=1)]
    wanted = np.deg2rad(known[:, 0])
    apart = [np.asarray(j.pose(wanted).to_table()) - known for j in (moving, fixed)]
    rmse = np.sqrt(np.mean(np.square(apart), axis=1))[:, 1:]
    return JointFit(moving, fixed, tuple(int(i) for i in rows), table[rows], rmse)


def calibration_rows(poses: ArrayLike, at_deg: Sequence[float] = ()) -> np.ndarray:
    """Which poses a joint is calibrated on.

    Args:
        poses: shape `(n, 6)`, degrees and mm; rows of NaN are passed over.
        at_deg: flexions whose nearest poses are used; the first and the last in flexion otherwise.

    Returns:
        Their rows, by increasing flexion.

    Raises:
        UnsuitablePoses: fewer than two poses, two at the same flexion, all within 5 degrees, or
            none near one asked for.

    Example:
        >>> table = np.zeros((4, 6))
        >>> table[:, 0] = [90.0, 45.0, 0.0, 20.0]
        >>> table = np.vstack([table, [100.0, *[np.nan] * 5]])  # no balance there
        >>> calibration_rows(table).tolist(), calibration_rows(table, (1.0, 43.0)).tolist()
        ([2, 0], [2, 1])
    """
    table = np.asarray(poses, float).reshape(-1, 6)
    known = np.flatnonzero(np.isfinite(table).all(axis=1))
    flexion = table[:, 0]
    if len(known) < 2:
        raise UnsuitablePoses("poses", str(len(known)), "two or more")
    rows = known
    if len(at_deg):
        if len(at_deg) < 2:
            raise UnsuitablePoses("flexion", f"{at_deg[0]:g} degrees alone", "two flexions or more")
        rows = np.array([known[np.argmin(np.abs(flexion[known] - angle))] for angle in at_deg])
        for angle, row in zip(at_deg, rows, strict=True):
            if not abs(flexion[row] - angle) <= FARTHEST_DEG:  # nothing is near NaN
                found = f"the nearest is at {flexion[row]:.1f}"
                expected = f"one within {FARTHEST_DEG:g} degrees"
                raise UnsuitablePoses(f"pose at {angle:g} degrees", found, expected)
    rows = rows[np.argsort(flexion[rows], kind="stable")]
    rows = rows if len(at_deg) else rows[[0, -1]]
    for one, other in zip(rows, rows[1:], strict=False):
        if np.isclose(flexion[one], flexion[other], rtol=0.0, atol=1e-6):
            which = f"row {one + 1} twice" if one == other else f"rows {one + 1} and {other + 1}"
            found = f"{which} at the same flexion, {flexion[one]:g} degrees"
            raise UnsuitablePoses("calibration poses", found, "poses at different flexions")
    span = flexion[rows[-1]] - flexion[rows[0]]
    if span < LEAST_SPAN_DEG:
        expected = f"at least {LEAST_SPAN_DEG:g} from the first to the last; are angles in radians?"
        raise UnsuitablePoses("calibration poses", f"{span:.3g} degrees apart", expected)
    return rows
