"""What a pose is, from what is wrong with it: the one place that decides.

A search asks it of the poses that it ends at, an evaluation of the poses that it was given; both
get the same answer for the same pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.mechanics import FibreFaults, dislocated
from kneejax.statics._status import Status


class ContactFaults(NamedTuple):
    """What may be wrong where two surfaces meet, each of the shape of the poses.

    Attributes:
        depth: largest overlap, mm; minus the gap where they are apart.
        outside_region: whether contact reaches more than `kneejax.mechanics.OFF_SURFACE_MM` off
            the fitted surfaces.
        too_deep: whether the overlap is the whole layer somewhere.
        no_patch: whether they touch where no elliptical patch fits.
        through_bone: whether the condyle has passed through the plateau.
    """

    depth: Array
    outside_region: Array
    too_deep: Array
    no_patch: Array
    through_bone: Array


class Faults(eqx.Module):
    """What may be wrong with poses, balanced or not; truth values of one shape.

    Attributes:
        outside_region: of any contact; likewise `too_deep`, `no_patch` and `through_bone`.
        fibres: of any fibre.
        dislocated: see `kneejax.mechanics.dislocated`.
    """

    outside_region: Array
    fibres: FibreFaults
    dislocated: Array
    too_deep: Array
    no_patch: Array
    through_bone: Array

    @classmethod
    def of(cls, contacts: Sequence[ContactFaults], fibres: FibreFaults, displaced: Array) -> Faults:
        """Gather what is wrong with the parts of a knee.

        Args:
            contacts: of each compartment.
            fibres: of the ligaments.
            displaced: see `kneejax.mechanics.displacement`, `(5, ...)`.
        """
        none = jnp.zeros(displaced.shape[1:], bool)
        outside = deep = flat = through = none
        gap = jnp.full(displaced.shape[1:], -jnp.inf)
        for contact in contacts:
            outside, deep = outside | contact.outside_region, deep | contact.too_deep
            flat, through = flat | contact.no_patch, through | contact.through_bone
            gap = jnp.maximum(gap, -contact.depth)
        return cls(outside, fibres, dislocated(displaced, gap), deep, flat, through)

    @property
    def status(self) -> Array:
        """The worst that applies, `Status` values; balanced where nothing does."""
        worst = jnp.asarray(int(Status.BALANCED))
        for where, what in (
            (self.outside_region, Status.OUTSIDE_REGION),
            (self.fibres.overstretched, Status.OVERSTRETCHED),
            (self.fibres.past_wrap, Status.PAST_WRAP),
            (self.fibres.wrap_inside, Status.WRAP_INSIDE),
            (self.dislocated, Status.DISLOCATED),
            (self.too_deep, Status.TOO_DEEP),
            (self.no_patch, Status.NO_PATCH),
            (self.through_bone, Status.THROUGH_BONE),
        ):
            worst = jnp.where(where, int(what), worst)
        return worst
