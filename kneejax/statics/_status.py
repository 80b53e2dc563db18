"""What became of a search for a balance, and what is wrong with a pose, found or given."""

__all__ = [
    "FAILURES", "ContactFaults", "Status", "converged", "fails", "failures_of", "sound",
    "worst_fault",
]

import enum
from collections.abc import Collection, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import OFF_SURFACE_MM, FibreFaults, dislocated


class Status(enum.IntEnum):
    """Outcome of a search for balance; the worst that applies to a pose.

    In order of severity. Below `TOO_DEEP` forces balance and every number of the pose stands;
    from there on nothing does, and coordinates are NaN.

    Attributes:
        fault: what is wrong with the pose; empty where nothing is.
        advice: what to try next.

    Example:
        >>> from kneejax import Status
        >>> Status.TOO_DEEP.converged, Status["UNSTABLE"].word
        (False, 'unstable')
    """

    BALANCED = 0, "", ""
    OUTSIDE_REGION = (
        1,
        f"contact reaches more than {OFF_SURFACE_MM:g} mm off the fitted surfaces",
        "fit them over a larger region, or leave this pose out",
    )
    OVERSTRETCHED = (
        2,
        "a fibre is stretched beyond its failure strain and would have torn",
        "lower the load or the fibre's reference strain, or correct its failure strain",
    )
    WAY_FLIPPED = (
        3,
        "a fibre passes its obstacle on the other side than at the pose before: its length and "
        "force jump",
        "move the obstacle or an attachment, or leave this pose out",
    )
    PAST_WRAP = (
        4,
        "a fibre touches its cylinder beyond the cylinder's length",
        "make the cylinder longer, or check its place",
    )
    WRAP_INSIDE = (
        5,
        "an end of a fibre lies inside its obstacle: its length means nothing",
        "make the obstacle smaller, move the attachment, or leave this pose out",
    )
    UNSTABLE = (
        6,
        "the tangent stiffness is not positive definite: a small push would move the knee away",
        "check slack lengths and add compression",
    )
    DISLOCATED = (
        7,
        "the knee is dislocated",
        "lower the load, or add what holds this direction: a fibre, compression, a muscle's line",
    )
    TOO_DEEP = (
        8,
        "the surfaces overlap by more than the cartilage layer",
        "check frames, units and slack lengths, lower the load, or stiffen the layer",
    )
    NO_PATCH = (
        9,
        "no elliptical patch fits where the surfaces meet: they are too flat against each other",
        "give this contact the form quadrature in the knee file",
    )
    THROUGH_BONE = (
        10,
        "bone has passed through bone",
        "check frames, units and the convention of the poses, or lower the load",
    )
    GIVES_WAY = (
        11,
        "no balance is connected with the unloaded knee beyond this load: the knee gives way "
        "(turning point)",
        "lower the load, or add what holds this direction: a fibre, compression, a muscle's line",
    )
    NOT_CONVERGED = (
        12,
        "no balance found",
        "look for a fibre too tight or a load that nothing holds, or leave this pose out",
    )

    fault: str
    advice: str

    def __new__(cls, value: int, fault: str, advice: str) -> "Status":
        member = int.__new__(cls, value)
        member._value_ = value
        member.fault, member.advice = fault, advice
        return member

    @property
    def converged(self) -> bool:
        """Whether the pose is a balance (its numbers are not NaN)."""
        return bool(converged(self))

    @property
    def sound(self) -> bool:
        """Whether it is a stable balance of a knee that holds together."""
        return bool(sound(self))

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()

    @property
    def remark(self) -> str:
        """Fault and advice of a pose that was given, not balanced; empty where nothing is wrong."""
        return f"{self.fault}: {self.advice}" if self.fault else ""

    @property
    def sentence(self) -> str:
        """What became of a search for balance, and what to try next."""
        if not self.fault:
            return "balanced and stable"
        return f"forces balance, but {self.remark}" if self.converged else self.remark


def converged(status):
    """Where forces balance and numbers are not NaN.

    Args:
        status: `Status` values, a number or an array of NumPy or JAX.

    Returns:
        Truth values of the same shape.

    Example:
        >>> converged(np.array([int(Status.BALANCED), int(Status.NOT_CONVERGED)])).tolist()
        [True, False]
    """
    return status < Status.TOO_DEEP


def sound(status):
    """Where a balance is stable and the knee holds together; warnings do not count.

    Args:
        status: as in `converged`.

    Returns:
        Truth values of the same shape.

    Example:
        >>> sound(np.array([int(Status.BALANCED), int(Status.DISLOCATED)])).tolist()
        [True, False]
    """
    return status < Status.UNSTABLE


#: Stiffness, as a part of that where a load or a displacement begins, below which a branch that
#: ends has turned: it falls like the root of the distance to a limit point, and 1/16384 is tried.
SOFT = 0.1
#: Where a search ended on the way to a load that says nothing of what would hold the knee.
_NO_POSES = (Status.TOO_DEEP, Status.NO_PATCH, Status.THROUGH_BONE)


def gives_way(lost: np.ndarray, way: np.ndarray, singular: np.ndarray, fault: np.ndarray):
    """Whether a knee that followed a load up to a part of it, and no further, gives way there: it
    had become singular, or the last search, however little farther, ended in a pose that a knee can
    have."""
    return lost & (way > 0.0) & (singular | ~np.isin(fault, _NO_POSES))


#: What makes a pose count for nothing unless a study says otherwise.
FAILURES = (Status.UNSTABLE, Status.DISLOCATED)


def fails(status: np.ndarray, failures: Collection[Status] = FAILURES) -> np.ndarray:
    """Where a pose counts for nothing: no balance, or one with a status that is no option.

    Args:
        status: `Status` values.
        failures: those that count as failures, of balances.

    Returns:
        Truth values of the same shape.

    Example:
        >>> status = [Status.BALANCED, Status.UNSTABLE, Status.NOT_CONVERGED]
        >>> fails(np.array([int(one) for one in status])).tolist()
        [False, True, True]
    """
    return ~converged(np.asarray(status)) | np.isin(status, [int(one) for one in failures])


def failures_of(words: Collection[str]) -> tuple[Status, ...]:
    """The statuses that a study names as failures; the usual ones where it names none.

    Example:
        >>> [one.word for one in failures_of(["dislocated"])]
        ['dislocated']
    """
    return tuple(Status[word.upper()] for word in words) or FAILURES


class ContactFaults(NamedTuple):
    """What may be wrong where two surfaces meet, each of the shape of the poses."""

    depth: Array  # largest overlap, mm; minus the gap where they are apart
    outside_region: Array  # contact reaches more than `OFF_SURFACE_MM` off the fitted surfaces
    too_deep: Array  # the overlap is the whole layer somewhere
    no_patch: Array  # they touch where no elliptical patch fits
    through_bone: Array  # the condyle has passed through the plateau


def worst_fault(
    contacts: Sequence[ContactFaults], fibres: FibreFaults, displaced: Array
) -> Array:
    """The worst that is wrong with poses, balanced or not.

    Args:
        contacts: of each compartment.
        fibres: of any fibre.
        displaced: see `kneejax.mechanics.displacement`, `(5, ...)`.

    Returns:
        `Status` values of the shape of the poses; `BALANCED` where nothing is wrong.
    """
    none = jnp.zeros(displaced.shape[1:], bool)
    outside = deep = flat = through = none
    gap = jnp.full(displaced.shape[1:], -jnp.inf)
    for contact in contacts:
        outside, deep = outside | contact.outside_region, deep | contact.too_deep
        flat, through = flat | contact.no_patch, through | contact.through_bone
        gap = jnp.maximum(gap, -contact.depth)
    worst = jnp.asarray(int(Status.BALANCED))
    for where, what in (
        (outside, Status.OUTSIDE_REGION),
        (fibres.overstretched, Status.OVERSTRETCHED),
        (fibres.past_wrap, Status.PAST_WRAP),
        (fibres.wrap_inside, Status.WRAP_INSIDE),
        (dislocated(displaced, gap), Status.DISLOCATED),
        (deep, Status.TOO_DEEP),
        (flat, Status.NO_PATCH),
        (through, Status.THROUGH_BONE),
    ):
        worst = jnp.where(where, int(what), worst)
    return worst
