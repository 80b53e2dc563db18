"""Loads by the names that laboratories give them, along the axes of Grood and Suntay."""

__all__ = ["NAMED_LOADS", "NamedLoad", "load_called", "load_of", "load_opposite_to", "load_words"]

import dataclasses
import re
from collections.abc import Mapping

from jax.typing import ArrayLike

from kneejax.mechanics._loads import GROOD_SUNTAY, Load
from kneejax.numerics import numpy_for

#: N mm of a newton metre.
_NMM = 1000.0


@dataclasses.dataclass(frozen=True)
class NamedLoad:
    """One load of a test.

    Attributes:
        name: with its unit, e.g. `anterior_N`.
        unit: `N` or `N m`.
        positive: what it is called where it is positive.
        negative: what it is called where it is negative.
        does: what a positive one does, in a sentence.
        also_called: other words for it, with which people look for it.
        opposite: words for its negative.

    Example:
        >>> one = NAMED_LOADS["anterior_N"]
        >>> one.unit, one.positive, one.negative
        ('N', 'anterior force', 'posterior force')
    """

    name: str
    unit: str
    positive: str
    negative: str
    does: str
    also_called: tuple[str, ...]
    opposite: tuple[str, ...]

    def words(self, size: float) -> str:
        """What a load of this size is called, e.g. `posterior force 134 N`."""
        return f"{self.positive if size > 0 else self.negative} {abs(size):g} {self.unit}"


#: Name -> load. The same names stand for the same loads in every command, table and function.
NAMED_LOADS = {
    load.name: load
    for load in (
        NamedLoad(
            "lateral_N", "N", "lateral force", "medial force",
            "pushes the tibia laterally, along the femur's transverse axis",
            ("lateral", "medial"), ("medial",),
        ),
        NamedLoad(
            "anterior_N", "N", "anterior force", "posterior force",
            "draws the tibia forwards along the floating axis: a drawer, at every flexion",
            ("anterior", "posterior", "drawer"), ("posterior",),
        ),
        NamedLoad(
            "compression_N", "N", "compression", "distraction",
            "presses the tibia against the femur, along the tibia's long axis",
            ("superior", "superior_N", "axial", "axial_N", "compression", "distraction"),
            ("distraction", "traction", "inferior"),
        ),
        NamedLoad(
            "varus_Nm", "N m", "varus moment", "valgus moment",
            "turns the tibia into varus about the floating axis",
            ("adduction", "adduction_Nmm", "adduction_Nm", "varus", "valgus", "varus_Nmm"),
            ("valgus", "abduction"),
        ),
        NamedLoad(
            "internal_Nm", "N m", "internal torque", "external torque",
            "turns the tibia inwards about its long axis",
            ("internal_rotation", "internal_rotation_Nmm", "internal_rotation_Nm", "internal",
             "external", "internal_Nmm"),
            ("external", "external_rotation"),
        ),
    )
}  # fmt: skip


def load_of(
    *,
    lateral_N: ArrayLike = 0.0,
    anterior_N: ArrayLike = 0.0,
    compression_N: ArrayLike = 0.0,
    varus_Nm: ArrayLike = 0.0,
    internal_Nm: ArrayLike = 0.0,
    point: ArrayLike = (0.0, 0.0, 0.0),
    point_in: str = "tibia",
    axes: str = GROOD_SUNTAY,
    name: str = "load",
) -> Load:
    """A load on the tibia along the axes of Grood and Suntay.

    With flexion prescribed the anterior force does work on their anterior translation alone, the
    varus moment on adduction alone and the internal torque on internal rotation alone. The femur's
    transverse and the tibia's long axis are not square in varus: there, a lateral force also pushes
    a little along the tibia and compression a little sideways.

    Args:
        lateral_N: along the femur's transverse axis. Numbers, or arrays of one shape `(n,)` for
            `kneejax.statics.LoadCases`; so are the others.
        anterior_N: along the floating axis.
        compression_N: along the tibia's long axis, towards the femur.
        varus_Nm: about the floating axis.
        internal_Nm: about the tibia's long axis.
        point: where the force acts, mm; the tibia's origin by default.
        point_in: bone in whose frame the point is given, and to which it is fixed.
        axes: `tibia` where forces and moments follow the tibia's own axes instead, as those of
            what is strapped to it do: its X stands for the floating axis, its Z for the femur's.
        name: what reports call it.

    Source: Grood and Suntay (1983).

    Example:
        >>> lachman = load_of(anterior_N=134.0)
        >>> lachman.axes, lachman.force.tolist()
        ('grood_suntay', [134.0, 0.0, 0.0])
        >>> load_of(varus_Nm=10.0).moment.tolist()
        [10000.0, 0.0, 0.0]
    """
    sizes = (anterior_N, compression_N, lateral_N, varus_Nm, internal_Nm)
    xp = numpy_for(sizes, point)
    numbers = xp.broadcast_arrays(*(xp.asarray(size, float) for size in sizes))
    forward, up, outward, varus, internal = numbers
    still = xp.zeros_like(varus)
    return Load(
        xp.stack([forward, up, outward], -1),
        _NMM * xp.stack([varus, internal, still], -1),
        xp.broadcast_to(xp.asarray(point, float), (*varus.shape, 3)),
        axes=axes,
        point_in=point_in,
        name=name,
    )


def load_words(sizes: Mapping[str, float]) -> str:
    """A load in clinical words.

    Args:
        sizes: name of a load -> its size, in the unit of its name.

    Returns:
        What acts, or `no load`.

    Example:
        >>> load_words({"anterior_N": -134.0, "internal_Nm": 1.5})
        'posterior force 134 N, internal torque 1.5 N m'
    """
    acting = [load.words(sizes[name]) for name, load in NAMED_LOADS.items() if sizes.get(name)]
    return ", ".join(acting) or "no load"


def load_opposite_to(word: str) -> str | None:
    """The name of the load whose negative a word means, if it means one; its unit may follow.

    Example:
        >>> load_opposite_to("posterior_N"), load_opposite_to("valgus"), load_opposite_to("varus")
        ('anterior_N', 'varus_Nm', None)
    """
    bare = re.sub(r"(_force|_moment|_torque)?(_k?N|_Nm|_Nmm)?$", "", word.strip(), flags=re.I)
    return next((x.name for x in NAMED_LOADS.values() if bare.lower() in x.opposite), None)


def load_called(word: str) -> str | None:
    """The name of the load that a word means, if it means one.

    Example:
        >>> load_called("valgus"), load_called("internal_rotation"), load_called("flexion")
        ('varus_Nm', 'internal_Nm', None)
    """
    meant = (x.name for x in NAMED_LOADS.values() if word in (x.name, *x.also_called))
    return next(meant, None)
