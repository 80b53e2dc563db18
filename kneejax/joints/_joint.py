"""A simple joint that stands for the knee: its motion over flexion.

The tibia turns about an axis through a medial and a lateral point, which femur and tibia both
know; both points move with flexion. Given flexion, a pose follows in closed form.
"""

__all__ = [
    "INTERPOLATIONS", "Joint", "axis_between", "check_joint", "generalised_axis", "hinge",
    "moving_axis",
]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import AXES, Matrix, Pose, Vector, angles_from_rotation
from kneejax.joints._frames import UnsuitableAxis
from kneejax.numerics import filled, traced


def between(knots: Array, values: Array, slopes: Array | None, x: Array) -> Array:
    """Values `(..., lanes)` at `x` between knots `(k,)`, the first and last outside; pieces are
    cubic with `slopes` at the knots, straight without.

    The answer is the first of the values `(k, ...)` and what every interval adds to it, each with
    its argument clipped to its ends: no interval is looked for, and derivatives exist by
    everything. At a knot a derivative by `x` is the mean of those on both sides.
    """
    answer = jnp.broadcast_to(values[0][..., None], (*values.shape[1:], *x.shape))
    for i in range(len(knots) - 1):
        width = knots[i + 1] - knots[i]
        u = jnp.clip((x - knots[i]) / width, 0.0, 1.0)
        rise = (values[i + 1] - values[i])[..., None]
        if slopes is None:
            answer = answer + rise * u
            continue
        first, last = width * slopes[i][..., None], width * slopes[i + 1][..., None]
        # Hermite's cubic, in powers of u.
        bend, twist = 3 * rise - 2 * first - last, first + last - 2 * rise
        answer = answer + u * (first + u * (bend + u * twist))
    return answer


def monotone_slopes(knots: Array, values: Array) -> Array:
    """Slopes `(k, ...)` of the cubic pieces that rise and fall only where the values do (PCHIP):
    Fritsch and Butland, SIAM J Sci Stat Comput 5 (1984); at the ends Moler, Numerical Computing
    with Matlab (2004), section 3.4. Where a value equals both neighbours, a slope has no derivative
    with respect to the values; zero is given."""
    width = jnp.diff(knots).reshape(-1, *[1] * (values.ndim - 1))
    secant = jnp.diff(values, axis=0) / width
    if len(knots) == 2:
        return jnp.concatenate([secant, secant])
    left, right = secant[:-1], secant[1:]
    wide, narrow = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same = left * right > 0
    # A weighted harmonic mean of the secants, zero at a turning point.
    inverse = wide / jnp.where(same, left, 1.0) + narrow / jnp.where(same, right, 1.0)
    inner = jnp.where(same, (wide + narrow) / jnp.where(same, inverse, 1.0), 0.0)
    first = _end_slope(width[0], width[1], secant[0], secant[1])
    last = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return jnp.concatenate([first[None], inner, last[None]])


def _end_slope(width: Array, next_width: Array, secant: Array, next_secant: Array) -> Array:
    """Slope of the parabola through three points, kept from turning round."""
    slope = ((2 * width + next_width) * secant - width * next_secant) / (width + next_width)
    slope = jnp.where(slope * secant > 0, slope, 0.0)
    overshoots = (secant * next_secant <= 0) & (jnp.abs(slope) > 3 * jnp.abs(secant))
    return jnp.where(overshoots, 3 * secant, slope)


#: How points move between calibration angles: straight (paper 5), or along monotone cubics.
INTERPOLATIONS = ("linear", "monotone")

_SAME_FLEXION_DEG = 1e-6
_STEEPEST_DEG = 45.0


class Joint(eqx.Module):
    """A joint whose axis passes through points that move with flexion.

    Frames are those of `kneejax.geometry.Pose`: X anterior, Y superior, Z lateral of a right knee.
    Beyond the first and the last calibration angle the axis stays where it was there.

    Attributes:
        flexion: calibration angles, shape `(k,)`, rad, increasing; one makes a hinge.
        femoral: medial and lateral point of the axis in the femur at each angle, shape
            `(k, 2, 3)`, mm.
        tibial: the same points in the tibia, shape `(k, 2, 3)`, mm.
        interpolation: one of `INTERPOLATIONS`; `linear` is paper 5's, `monotone` is continuously
            differentiable from the first calibration angle to the last.

    Source: paper 5, Eqs 1 to 4.

    Example:
        >>> axis = [[0.0, 0.0, -20.0], [0.0, 0.0, 20.0]]
        >>> joint = hinge(axis, Pose.from_table([0.0, 0.0, 0.0, 0.0, -30.0, 0.0]))
        >>> [f"{x:.6f}" for x in joint.pose(jnp.array([0.0, jnp.pi / 2])).anterior]
        ['0.000000', '-30.000000']
    """

    flexion: Array
    femoral: Array
    tibial: Array
    interpolation: str = eqx.field(static=True, default="linear")

    def __check_init__(self):
        expected = (*jnp.shape(self.flexion), 2, 3)
        if len(expected) != 3 or expected[0] < 1:
            raise ValueError(f"flexion has shape {jnp.shape(self.flexion)}; expected (k,)")
        for name in ("femoral", "tibial"):
            found = jnp.shape(getattr(self, name))
            if found != expected:
                raise ValueError(f"{name} has shape {found}; expected {expected}")
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(f"interpolation is {self.interpolation!r}: one of {INTERPOLATIONS}")

    def axis_points(self, flexion: ArrayLike) -> tuple[Array, Array]:
        """Medial and lateral point of the axis.

        Args:
            flexion: shape `(lanes,)`, rad.

        Returns:
            In the femur and in the tibia, each of shape `(2, 3, lanes)`, mm.

        Raises:
            ValueError: flexion has another shape.
        """
        flexion = jnp.asarray(flexion, float)
        if flexion.ndim != 1:
            raise ValueError(f"flexion has shape {flexion.shape}; expected (lanes,)")

        def there(points: Array) -> Array:
            bent = self.interpolation == "monotone" and len(self.flexion) > 1
            slopes = monotone_slopes(self.flexion, points) if bent else None
            return between(self.flexion, points, slopes, flexion)

        return there(self.femoral), there(self.tibial)

    def pose(self, flexion: ArrayLike) -> Pose:
        """Pose of the tibia in the femur.

        Args:
            flexion: shape `(lanes,)`, rad, within a half turn.

        Returns:
            The pose with just this flexion, fields of shape `(lanes,)`. Make tables of it outside
            a `jax.jit` of your own: stacks inside may cost more than the poses.

        Raises:
            ValueError: flexion has another shape.
        """
        if traced(self, flexion) or np.ndim(flexion) != 1 or not np.size(flexion):
            return _pose(self, jnp.asarray(flexion, float))
        found = _pose(self, filled(np.asarray(flexion, float)))
        return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[: len(flexion)]), found)


@jax.jit
def _pose(joint: Joint, flexion: Array) -> Pose:
    femoral, tibial = joint.axis_points(flexion)
    rotation = _rotation(flexion, _untwisted(femoral), _untwisted(tibial))
    _, adduction, internal = angles_from_rotation(rotation)
    shift = (Vector.of(femoral[0]) - rotation @ Vector.of(tibial[0])).full()
    return Pose(flexion, adduction, internal, *shift)


def hinge(femoral: ArrayLike, pose: Pose) -> Joint:
    """A hinge: the axis through two points of the femur, fixed in both bones.

    Args:
        femoral: medial and lateral point, shape `(2, 3)`, mm; paper 5 takes the epicondyles.
        pose: where the tibia is known to be, fields of shape `()`.

    Returns:
        The joint, exact at that pose.

    Raises:
        UnsuitableAxis: the points do not make a transverse axis.

    Example:
        >>> joint = hinge([[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], Pose.from_table(jnp.zeros(6)))
        >>> float(joint.pose([jnp.pi / 2]).to_table()[0, 0].round(1))
        90.0
    """
    femoral = jnp.asarray(femoral, float)
    at_it = jax.tree.map(lambda x: jnp.asarray(x)[None], pose)
    return generalised_axis(femoral[None], at_it, "linear")


def moving_axis(femoral: ArrayLike, poses: Pose) -> Joint:
    """Paper 5's joint: the axis moves linearly with flexion between two poses.

    Args:
        femoral: extension, then flexion facet centres, medial then lateral, shape `(2, 2, 3)`, mm.
        poses: the two calibration poses, fields of shape `(2,)`, by increasing flexion.

    Returns:
        The joint, exact at both poses.

    Raises:
        UnsuitableAxis: flexion does not increase, or the points do not make a transverse axis.
        ValueError: there are not two poses.

    Source: paper 5, section 2.5.

    Example:
        >>> poses = Pose.from_table([[0.0, 0, 0, 0, 0, 0], [90.0, 0, 0, 2.0, 0, 0]])
        >>> ends = [[[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], [[-4.0, 0.0, -40.0], [-4.0, 0.0, 40.0]]]
        >>> float(moving_axis(ends, poses).pose([jnp.pi / 2]).to_table()[0, 3].round(1))
        2.0
    """
    femoral = jnp.asarray(femoral, float)
    if jnp.shape(femoral) != (2, 2, 3) or jnp.shape(poses.flexion) != (2,):
        shapes = f"{jnp.shape(femoral)} and {jnp.shape(poses.flexion)}"
        raise ValueError(f"points and poses of shapes {shapes}; expected (2, 2, 3) and (2,)")
    return generalised_axis(femoral, poses, "linear")


def generalised_axis(femoral: ArrayLike, poses: Pose, interpolation: str = "monotone") -> Joint:
    """The moving axis through any number of poses, along smooth lines.

    Args:
        femoral: medial and lateral point at each pose, shape `(k, 2, 3)`, mm; see `axis_between`.
        poses: calibration poses, fields of shape `(k,)`, by increasing flexion.
        interpolation: one of `INTERPOLATIONS`.

    Returns:
        The joint, exact at every pose.

    Raises:
        UnsuitableAxis: flexion does not increase, or the points do not make a transverse axis.
        ValueError: shapes differ.

    Example:
        >>> poses = Pose.from_table([[x, 0, 0, 0, 0, 0] for x in (0.0, 45.0, 90.0)])
        >>> joint = generalised_axis(3 * [[[0, 0, -40.0], [0, 0, 40.0]]], poses)
        >>> float(joint.pose([0.5]).to_table()[0, 1].round(3)) + 0.0
        0.0
    """
    femoral, flexion = jnp.asarray(femoral, float), jnp.asarray(poses.flexion, float)
    if femoral.shape != (*flexion.shape, 2, 3) or flexion.ndim != 1:
        shapes = f"{femoral.shape} and {flexion.shape}"
        raise ValueError(f"points and poses of shapes {shapes}; expected (k, 2, 3) and (k,)")
    joint = Joint(flexion, femoral, _in_the_tibia(femoral, poses), interpolation)
    check_joint(joint)
    return joint


def axis_between(extension: ArrayLike, flexed: ArrayLike, flexion: ArrayLike) -> Array:
    """Points of the femur on the way from extension to flexion centres, in proportion to flexion.

    Args:
        extension: medial and lateral point at the first angle, shape `(2, 3)`, mm.
        flexed: at the last, likewise.
        flexion: shape `(k,)`, increasing.

    Returns:
        Points at each angle, shape `(k, 2, 3)`, mm.

    Example:
        >>> ends = [[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]]
        >>> later = [[-4.0, 0.0, -40.0], [-4.0, 0.0, 40.0]]
        >>> axis_between(ends, later, [0.0, 0.5, 1.0])[1, 0].tolist()
        [-2.0, 0.0, -40.0]
    """
    flexion = jnp.asarray(flexion, float)
    share = (flexion - flexion[0]) / (flexion[-1] - flexion[0])
    extension, flexed = jnp.asarray(extension, float), jnp.asarray(flexed, float)
    return extension + share[:, None, None] * (flexed - extension)


@jax.jit
def _in_the_tibia(femoral: Array, poses: Pose) -> Array:
    """Points of the femur `(k, 2, 3)`, each pair at its pose."""
    placement = poses.placement
    sides = [placement.apply_inverse(Vector.of(femoral[:, side].T)) for side in range(2)]
    return jnp.stack([jnp.stack([*side], axis=-1) for side in sides], axis=1)


def check_joint(joint: Joint) -> None:
    """Refuse calibration angles or axes that no knee has; numbers being traced pass.

    Args:
        joint: any joint.

    Raises:
        UnsuitableAxis: flexion does not increase, a number is not finite, or an axis is not
            transverse (within 45 degrees of Z, its lateral point lateral).

    Example:
        >>> import kneejax as kj
        >>> turning = kj.hinge([[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], kj.Pose.from_table([0.0] * 6))
        >>> check_joint(turning)
    """
    if traced(joint):
        return
    angles = np.rad2deg(np.asarray(joint.flexion))
    part, expected = "flexion of the calibration poses", "finite angles, each larger than the last"
    if not np.isfinite(angles).all():
        raise UnsuitableAxis(part, "not finite", expected)
    steps = np.diff(angles)
    if (np.abs(steps) < _SAME_FLEXION_DEG).any():
        i = int(np.argmin(np.abs(steps)))
        raise UnsuitableAxis(part, f"{angles[i]:g} degrees in poses {i + 1} and {i + 2}", expected)
    if (steps < 0).any():
        i = int(np.argmin(steps))
        raise UnsuitableAxis(part, f"{angles[i]:g}, then {angles[i + 1]:g} degrees", expected)
    for bone, points in (("femur", joint.femoral), ("tibia", joint.tibial)):
        part, axis = f"axis in the {bone}", np.asarray(points[:, 1] - points[:, 0])
        if not np.isfinite(axis).all():
            raise UnsuitableAxis(part, "a point that is not finite", "finite coordinates")
        if (axis[:, 2] <= 0).any():
            found = "the lateral point is not lateral of the medial one"
            wanted = "points of a right knee, or of a left one mirrored; have they changed places?"
            raise UnsuitableAxis(part, found, wanted)
        tilt = np.rad2deg(np.arccos(np.clip(axis[:, 2] / np.linalg.norm(axis, axis=1), -1.0, 1.0)))
        if tilt.max() > _STEEPEST_DEG:
            found = f"{tilt.max():.0f} degrees off the medial-lateral direction"
            raise UnsuitableAxis(part, found, f"at most {_STEEPEST_DEG:g}")


def _untwisted(points: Array) -> Matrix:
    """Axes whose Z lies along the axis, not turned about Z in the sequence Z, X, Y, `Rx Ry`: an
    invisible segment of paper 5. With Z known, sine and cosine of both angles are algebraic."""
    line = Vector.of(points[1]) - Vector.of(points[0])
    x, y, z = line / line.norm()
    cosine = jnp.sqrt(y * y + z * z)
    up, forward = z / cosine, -y / cosine  # cosine and sine of the turn about X
    return Matrix(Vector(cosine, 0.0, x), Vector(forward * x, up, y), Vector(-up * x, forward, z))


def _rotation(flexion: Array, femoral: Matrix, tibial: Matrix) -> Matrix:
    """The turn about the common axis that makes flexion what it shall be, in closed form."""
    # `R = femoral Rz(-turn) tibial^T` has this flexion where its second column, the tibia's long
    # axis, is normal to `n = (cos, -sin, 0)`: `a cos(turn) + b sin(turn) + c = 0`. Of the two roots
    # the one is taken that lets the tibia point away from the femur.
    u, v, w = femoral.T
    p, q, r = tibial[1]
    n = Vector(jnp.cos(flexion), -jnp.sin(flexion), 0.0)
    nu, nv, nw = n @ u, n @ v, n @ w
    a, b, c = nu * p + nv * q, nu * q - nv * p, nw * r
    # a^2 + b^2 - c^2, with u, v, w and p, q, r orthonormal.
    root = jnp.sqrt(1.0 - nw * nw - r * r)
    size = a * a + b * b
    cosine, sine = (b * root - a * c) / size, -(a * root + b * c) / size
    turn = Matrix(Vector(cosine, sine, 0.0), Vector(-sine, cosine, 0.0), AXES.z)
    return (femoral @ turn) @ tibial.T
