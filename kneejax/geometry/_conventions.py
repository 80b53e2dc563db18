"""Four ways in which laboratories write down the same pose.

Every convention uses the same six names by meaning (flexion, adduction, internal rotation,
anterior, superior, lateral), in rad and mm; they differ in the axes along which translations are
measured and in the order of rotations.
"""

__all__ = [
    "CLINICAL", "CONVENTIONS", "CONVENTION_WORDS", "FEMORAL", "convert", "convert_table",
    "grood_suntay_axes",
]

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry._pose import Placement, angles_from_rotation, rotation_from_angles
from kneejax.geometry._vectors import AXES, Matrix, Vector
from kneejax.numerics import filled, safe_sqrt, traced


def _from_grood_suntay(c: Array) -> Placement:
    flexion, adduction, _, anterior, superior, lateral = c
    # In axes turned by flexion the floating axis is X and the tibia's long axis (0, cos, sin).
    floating = Vector(
        anterior, superior * jnp.cos(adduction), lateral + superior * jnp.sin(adduction)
    )
    return Placement(
        rotation_from_angles(c[0], c[1], c[2]), Matrix.about_z(-flexion) @ floating
    )


def _to_grood_suntay(place: Placement) -> tuple[Array, ...]:
    flexion, adduction, rotation = angles_from_rotation(place.rotation)
    x, y, z = Matrix.about_z(flexion) @ place.translation
    return flexion, adduction, rotation, x, y / jnp.cos(adduction), z - y * jnp.tan(adduction)


def _from_tibial(c: Array) -> Placement:
    rotation = rotation_from_angles(c[0], c[1], c[2])
    return Placement(rotation, rotation @ Vector.of(c[3:]))


def _to_tibial(place: Placement) -> tuple[Array, ...]:
    back = place.turn_back(place.translation)
    return *angles_from_rotation(place.rotation), *back


def _to_femur_in_tibia(place: Placement) -> tuple[Array, ...]:
    femur = place.inverse()
    flexion, adduction, rotation = angles_from_rotation(femur.rotation)
    return -flexion, -adduction, -rotation, *femur.translation


def grood_suntay_axes(tibia: Placement) -> Matrix:
    """The axes of Grood and Suntay, which a knee's clinical translations and rotations refer to.

    Args:
        tibia: its placement in the femur.

    Returns:
        Three unit vectors in femur axes: the floating axis (forwards; perpendicular to the other
        two), the tibia's long axis (towards the femur), the femur's transverse axis (lateral). The
        last two stand at a right angle only without adduction. At 90 degrees of adduction they
        coincide, and the floating axis is zero.

    Source: Grood and Suntay (1983), Fig 2.

    Example:
        >>> import numpy as np
        >>> from kneejax.geometry import Pose
        >>> bent = Pose.from_table([90.0, 0.0, 20.0, 0.0, 0.0, 0.0]).placement
        >>> floating, long, transverse = np.array(grood_suntay_axes(bent)).round(6) + 0.0
        >>> floating.tolist(), long.tolist()
        ([0.0, -1.0, 0.0], [1.0, 0.0, 0.0])
    """
    long = tibia.turn(AXES.y)
    x, y, _ = long
    length = safe_sqrt(x * x + y * y)
    share = 1.0 / jnp.where(length > 0, length, 1.0)
    return Matrix(Vector(y * share, -x * share, 0.0), long, AXES.z)


#: The package's own convention.
FEMORAL = "femoral"
#: That along whose translations loads act and laxity is read.
CLINICAL = "grood-suntay"
#: What the translations of each convention are, in words.
CONVENTION_WORDS = {
    "femoral": "translations of the tibia's origin along the femur's axes",
    "grood-suntay": "translations of the tibia's origin along the floating axis (anterior), the "
    "tibia's long axis (superior) and the femur's transverse axis (lateral)",
    "tibial": "translations of the tibia's origin along the tibia's axes",
    "femur-in-tibia": "translations of the femur's origin along the tibia's axes",
}

#: Convention name -> (six coordinates to a placement, a placement to six coordinates).
CONVENTIONS: dict[
    str, tuple[Callable[[Array], Placement], Callable[[Placement], tuple[Array, ...]]]
] = {
    "femoral": (
        lambda c: Placement(rotation_from_angles(c[0], c[1], c[2]), Vector.of(c[3:])),
        lambda place: (*angles_from_rotation(place.rotation), *place.translation),
    ),
    "grood-suntay": (_from_grood_suntay, _to_grood_suntay),
    "tibial": (_from_tibial, _to_tibial),
    "femur-in-tibia": (
        lambda c: Placement(rotation_from_angles(-c[0], -c[1], -c[2]), Vector.of(c[3:])).inverse(),
        _to_femur_in_tibia,
    ),
}


def convert(coordinates: ArrayLike, source: str, target: str) -> Array:
    """Express poses in another convention.

    Args:
        coordinates: shape `(6, ...)`: flexion, adduction, internal rotation in rad, then
            anterior, superior, lateral in mm, as `source` defines them.
        source: one of `CONVENTIONS`: `femoral` (translation of the tibia's origin in femur axes;
            the package's own), `grood-suntay` (translations along the femoral medial-lateral,
            the floating and the tibial long axis, which are not orthogonal), `tibial`
            (translation in tibia axes; paper 3), `femur-in-tibia` (the femur's origin in tibia
            axes and its own rotation sequence, signs chosen so that flexion, varus and internal
            rotation stay positive; paper 1).
        target: likewise.

    Returns:
        The six coordinates as `target` defines them, shape `(6, ...)`.

    Raises:
        KeyError: if a convention is unknown.

    Source: Grood and Suntay (1983); paper 1, Eq 1; paper 3, section 3.

    Example:
        >>> import jax.numpy as jnp
        >>> pose = jnp.array([0.5, 0.1, 0.0, 1.0, 2.0, 3.0])
        >>> gs = convert(pose, "femoral", "grood-suntay")
        >>> bool(jnp.allclose(convert(gs, "grood-suntay", "femoral"), pose))
        True
    """
    read, _ = CONVENTIONS[source]
    _, write = CONVENTIONS[target]
    if traced(coordinates) or np.ndim(coordinates) != 2 or not np.size(coordinates):
        return _rewritten(jnp.asarray(coordinates, float), read, write)
    table = np.asarray(coordinates, float)
    return jnp.asarray(np.asarray(_rewritten(filled(table), read, write))[:, : table.shape[1]])


@partial(jax.jit, static_argnums=(1, 2))
def _rewritten(coordinates: Array, read: Callable, write: Callable) -> Array:
    return jnp.stack(jnp.broadcast_arrays(*write(read(coordinates))))


def convert_table(table: ArrayLike, source: str, target: str) -> np.ndarray:
    """Rows of degrees and mm in another convention.

    Args:
        table: shape `(n, 6)`, in the order of `COLUMNS`, as `source` defines them.
        source: one of `CONVENTIONS`.
        target: likewise.

    Returns:
        Shape `(n, 6)`, degrees and mm, as `target` defines them.

    Raises:
        KeyError: if a convention is unknown.

    Example:
        >>> found = convert_table([[90.0, 0.0, 0.0, 0.0, -3.0, 0.0]], "femoral", "grood-suntay")
        >>> [abs(round(x, 9)) for x in found[0].tolist()]
        [90.0, 0.0, 0.0, 3.0, 0.0, 0.0]
    """
    table = np.asarray(table, float)
    if source == target:
        return table
    unit = np.array([180.0 / np.pi] * 3 + [1.0] * 3)
    return np.asarray(convert((table / unit).T, source, target), float).T * unit
