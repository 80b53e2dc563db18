"""Paper 4's simulation: varus and valgus moments under axial load, and peak contact pressure."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import Pose, Vector
from kneejax.mechanics import Knee, load_of
from kneejax.numerics import compiled
from kneejax.statics import Equilibria, LoadCases, Status

VARUS, VALGUS = "varus", "valgus"
#: Directions of the moment, and its sign about the floating axis.
DIRECTIONS = {VARUS: 1.0, VALGUS: -1.0}
#: Degrees or mm between neighbouring steps that no knee follows.
_JUMP = 10.0
#: Rings of an elliptical patch, and how much finer than its own a contact's points are.
_RINGS, _FINER = 200, 3


@dataclasses.dataclass(frozen=True)
class VarusValgusRamp:
    """Axial load in equal steps, then a moment in equal steps while that load stays.

    The axial load is `compression_N` of `kneejax.mechanics.load_of`, the moment its `varus_Nm`.
    Both act besides the loads and lines of the knee.
    """

    direction: str  # `varus` or `valgus`
    full_Nm: float  # moment at its end, positive
    body_weight_N: float  # the axial load is half of it
    axial_steps: int  # to reach the axial load; the last has no moment yet
    moment_steps: int  # to reach the moment
    flexion_deg: float = 0.0  # prescribed

    def __len__(self) -> int:
        return self.axial_steps + self.moment_steps

    @property
    def axial_N(self) -> np.ndarray:
        """`(steps,)`."""
        rise = np.arange(1, self.axial_steps + 1) / self.axial_steps
        return 0.5 * self.body_weight_N * np.r_[rise, np.ones(self.moment_steps)]

    @property
    def moment_Nm(self) -> np.ndarray:
        """`(steps,)`, positive in varus."""
        full = DIRECTIONS[self.direction] * self.full_Nm
        turn = full * np.arange(1, self.moment_steps + 1) / self.moment_steps
        return np.r_[np.zeros(self.axial_steps), turn]

    @property
    def loaded(self) -> np.ndarray:
        """Whether the axial load is complete, `(steps,)`."""
        return self.axial_N >= self.axial_N[-1]

    @property
    def time(self) -> np.ndarray:
        """Time in paper 4's Table 2, `(steps,)`: axial load from 1.5 to 2, moment from 2 to 3."""
        return 1.5 + 0.5 * self.axial_N / self.axial_N[-1] + np.abs(self.moment_Nm) / self.full_Nm

    @property
    def load_cases(self) -> LoadCases:
        """Flexion and loads, in order: each moment is reached through the lighter ones."""
        loads = load_of(compression_N=self.axial_N), load_of(varus_Nm=self.moment_Nm)
        return LoadCases.at(np.full(len(self), self.flexion_deg), loads)


@dataclasses.dataclass(frozen=True)
class VarusValgus:
    """A knee, or variants of it, on such a ramp.

    A load that only grows ends where the knee cannot follow: at the first step without a balance,
    with an unstable one, with one where surfaces meet outside their fitted regions (what lies
    there is not known), or with one so far from the step before (10 degrees or mm) that the knee
    must have jumped.
    """

    ramp: VarusValgusRamp  # the loads
    balances: Equilibria  # of the variants at the steps of the ramp, also beyond such an end

    @functools.cached_property
    def reached(self) -> np.ndarray:
        """Number of steps that each variant holds before its end, `(variants,)`."""
        apart = np.abs(np.diff(self.balances.table, axis=1)).max(axis=-1, initial=0.0)
        jumps = np.pad(apart > _JUMP, ((0, 0), (1, 0)))
        fine = (self.balances.status == Status.BALANCED) & ~jumps
        return np.where(fine.all(axis=1), len(self.ramp), np.argmin(fine, axis=1))

    @property
    def held(self) -> np.ndarray:
        """Whether a variant got to a step, `(variants, steps)`."""
        return np.arange(len(self.ramp)) < self.reached[:, None]

    @property
    def ending(self) -> tuple[str, ...]:
        """What ends the ramp of each variant: a word of `Status`, `jump`, or empty at its top."""
        words = {int(status): status.word for status in Status} | {int(Status.BALANCED): "jump"}
        runs = zip(self.balances.status, self.reached, strict=True)
        return tuple(words[int(row[x])] if x < len(row) else "" for row, x in runs)

    @property
    def adduction_deg(self) -> np.ndarray:
        """Varus rotation, `(variants, steps)`; NaN beyond what was reached."""
        return np.where(self.held, self.balances.table[..., 0], np.nan)

    @property
    def time_reached(self) -> np.ndarray:
        """Last time held, as paper 4 counts it (`VarusValgusRamp.time`), `(variants,)`."""
        return np.r_[1.5, self.ramp.time][self.reached]

    @property
    def moment_reached_Nm(self) -> np.ndarray:
        """Last moment held, positive in varus, `(variants,)`."""
        return np.r_[0.0, self.ramp.moment_Nm][self.reached]


@compiled()
def peak_pressure(
    lanes: Knee, poses: Pose, contact_points: Array, share: ArrayLike = 0.1
) -> tuple[Array, Array]:
    """Mean pressure over the highest tenth of each touching area, MPa, `(poses, contacts)`, 0
    without contact, and where that is in the tibia, mm, `(poses, contacts, 3)`, or else NaN.

    A finite element model averages the tenth of its faces with the highest pressure. Here a tenth
    of the area counts, to a part of an element, so that nothing jumps when elements are few. An
    elliptical patch is cut into rings of equal area; of a contact that sums over points the
    tibial surface is sampled three times as finely along both parameters (paper 4, 2.4.1). Contact
    points of patches, `(n, 2, poses)`, are as a balance gives them.
    """
    row, peaks = 0, []
    for contact in lanes.contacts:
        if contact.has_patch:
            gap = contact.gap(poses.placement, contact_points[row])
            row += 1
            # Rings, along an axis before the poses: depth falls as the square of the radius, and
            # so, linearly, with the area inside.
            inside = (jnp.arange(_RINGS)[:, None] + 0.5) / _RINGS
            depth, area = gap.depth * (1.0 - inside), jnp.ones_like(inside)
            pressure = contact.pressure(depth)
            place = contact.tibial.frame.placement.apply(gap.point)
        else:
            first, second = contact.points
            fine = dataclasses.replace(contact, points=(_FINER * first, _FINER * second))
            sampled = fine.foundation.sample(poses.placement)
            points, depth = sampled.points, sampled.depth
            pressure, area, place = points.pressure(depth), points.area, points.point
        peaks.append(_highest(jnp.where(depth > 0, pressure, 0.0), area, place, share))
    if not peaks:
        nothing = jnp.zeros((*jnp.shape(poses.flexion), 0))
        return nothing, nothing[..., None] * jnp.ones(3)
    pressure, center = (jnp.stack(x, axis=-1) for x in zip(*peaks, strict=True))
    return pressure, jnp.moveaxis(center, 0, -1)


def _highest(pressure: Array, area: Array, place: Vector, share: ArrayLike) -> tuple[Array, Array]:
    """Mean pressure `(elements, poses)` and place over the share of area where it is highest."""
    order = jnp.argsort(-pressure, axis=0)
    area = jnp.where(pressure > 0, area, 0.0)
    every = (jnp.broadcast_to(x, pressure.shape) for x in (pressure, area, *place))
    pressure, area, *places = (jnp.take_along_axis(x, order, axis=0) for x in every)
    before = jnp.cumsum(area, axis=0) - area
    counted = jnp.clip(share * jnp.sum(area, axis=0) - before, 0.0, area)
    total = jnp.sum(counted, axis=0)
    touches = total > 0
    weight = counted / jnp.where(touches, total, 1.0)
    center = jnp.where(touches, jnp.sum(weight * jnp.stack(places), axis=1), jnp.nan)
    return jnp.sum(weight * pressure, axis=0), center
