"""The extensor mechanism: quadriceps, patella, patellar tendon, and gravity on the leg."""

__all__ = ["TENDON", "Shank", "leg_of_person"]

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics import gravity_of
from kneejax.experiments._evaluate import Mechanics
from kneejax.geometry import PATELLA, TIBIA, Vector
from kneejax.mechanics import QUADRICEPS, Knee, Load, Mass, add_lane_axis, pull_of
from kneejax.numerics import compiled, numpy_for, traced
from kneejax.statics import Equilibrium, LoadCases, differentiable, force_along

#: Of body mass, and of the shank's length from the knee: shank with foot (Winter, Biomechanics and
#: Motor Control of Human Movement, 4th ed. 2009, Table 4.1: leg and foot).
MASS_SHARE, CENTER_SHARE = 0.061, 0.606
#: Of body height: length of the shank (same source, Figure 4.1).
LENGTH_SHARE = 0.246
#: Radius of gyration of shank and foot about their centre, across, by the shank's length (Winter,
#: Biomechanics and Motor Control of Human Movement, 4th ed. 2009, Table 4.1: leg and foot).
ACROSS = 0.416
#: Of the shank about its own axis, by its length (de Leva, J Biomech 29, 1996, Table 4, males).
SHANK_ALONG = 0.103
#: Of body mass: the foot; of its length from the ankle: radius of gyration about the ankle (Winter
#: 2009, Table 4.1).
FOOT_SHARE, FOOT_FROM_ANKLE = 0.0145, 0.690
#: Of body height: length of the foot (same source, Figure 4.1), half of which is taken for the
#: way from the ankle to the heads of the metatarsals.
FOOT_LENGTH = 0.152


@dataclasses.dataclass(frozen=True)
class Shank:
    """Shank and foot as one weight that hangs on the tibia.

    Attributes:
        mass_kg: of both.
        center_mm: of mass, tibia frame, shape `(3,)`.
        ankle_kg: an additional weight at the ankle.
        ankle_mm: where that is, tibia frame, shape `(3,)`.
        femur_deg: of the femur from the horizontal, knee above hip positive: 0 for a person who
            sits, -90 for one who stands.

    Example:
        >>> shank = Shank.of_person(75.0, 1.78)
        >>> round(shank.mass_kg, 2), [round(x) for x in shank.center_mm]
        (4.58, [0, -265, 0])
    """

    mass_kg: float
    center_mm: tuple[float, float, float]
    ankle_kg: float = 0.0
    ankle_mm: tuple[float, float, float] = (0.0, -400.0, 0.0)
    femur_deg: float = 0.0

    def __post_init__(self):
        for name in ("mass_kg", "ankle_kg"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"Shank.{name} is {getattr(self, name)}; expected 0 or more")

    @classmethod
    def of_person(
        cls, body_kg: float, height_m: float, ankle_kg: float = 0.0, femur_deg: float = 0.0
    ) -> "Shank":
        """Of a person of usual proportions (Winter 2009).

        Args:
            body_kg: mass of the body.
            height_m: of the body.
            ankle_kg: an additional weight at the ankle.
            femur_deg: as in the attributes.
        """
        length = 1000.0 * LENGTH_SHARE * height_m
        center = (0.0, -CENTER_SHARE * length, 0.0)
        return cls(MASS_SHARE * body_kg, center, ankle_kg, (0.0, -length, 0.0), femur_deg)

    def load(self) -> Load:
        """Both weights as one force in the direction that it keeps in the femur's frame."""
        mass = self.mass_kg + self.ankle_kg
        moments = self.mass_kg * np.array(self.center_mm) + self.ankle_kg * np.array(self.ankle_mm)
        force = mass * np.array(gravity_of(self.femur_deg))
        return weight_of(force, moments / mass if mass else np.zeros(3))


def weight_of(force_N: ArrayLike = (0.0,) * 3, point_mm: ArrayLike = (0.0,) * 3) -> Load:
    """A weight on the tibia, or none: of one form, so that one compiled program serves all."""
    return Load(np.asarray(force_N, float), point=np.asarray(point_mm, float), name="weight")


def leg_of_person(body_kg: float, height_m: float, ankle_kg: float = 0.0) -> Mass:
    """Shank and foot of a person of usual proportions, as one rigid body.

    Its centre lies on the tibia's long axis, and the axes of its inertia are the tibia's: the foot
    counts for the moment about the long axis, not for a centre before it.

    Args:
        body_kg: mass of the body.
        height_m: of the body.
        ankle_kg: a weight at the ankle besides.

    Source: Winter (2009), Table 4.1 and Figure 4.1; de Leva (1996), Table 4.

    Example:
        >>> leg = leg_of_person(75.0, 1.75)
        >>> [round(float(x)) for x in (leg.center_mm[1], *np.diag(leg.inertia_kg_mm2))]
        [-261, 146732, 16016, 146732]
    """
    shank = Shank.of_person(body_kg, height_m, ankle_kg)
    length = -shank.ankle_mm[1]
    across = shank.mass_kg * (ACROSS * length) ** 2
    foot_kg = FOOT_SHARE * body_kg
    foot = foot_kg * (FOOT_FROM_ANKLE * 500.0 * FOOT_LENGTH * height_m) ** 2
    along = (shank.mass_kg - foot_kg) * (SHANK_ALONG * length) ** 2 + foot
    leg = Mass(shank.mass_kg, shank.center_mm, np.diag([across, along, across]))
    return leg.with_point(ankle_kg, shank.ankle_mm) if ankle_kg else leg


def needs_patella(knee: Knee) -> None:
    """Refuse a knee that has no patella or no quadriceps."""
    if PATELLA not in knee.bodies or knee.muscles is None or not knee.muscles.quadriceps:
        raise ValueError(
            f"{knee.name} has no patella with a quadriceps: expected a knee read with its patella"
        )


#: What pulls on the tibia for the quadriceps, among what acts.
TENDON = "patellar tendon"


def tendon_of(knee: Knee, mechanics: Mechanics) -> Array:
    """Size of what the patellar tendon does to the tibia, `(poses,)`, N."""
    force = mechanics.ligament_force[:, tendon_rows(knee)]
    xp = numpy_for(force)
    return xp.linalg.norm(xp.asarray(force).sum(axis=1), axis=-1)


def tendon_rows(knee: Knee) -> np.ndarray:
    """Which ligaments are the patellar tendon's."""
    return np.array([k for k, p in enumerate(knee.ligaments.bodies) if p == (PATELLA, TIBIA)], int)


# XLA's older emitters write out a path around bones anew for every row of a stack: minutes.
@compiled(effort="most")
def pulls(knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium) -> tuple[Array, Array]:
    """Forces of muscles and loads in tibia axes, `(3, parts, poses)` each."""
    lanes, state = load_cases.load(add_lane_axis(knee)), equilibrium.state
    tibia = state.tibia.placement

    def turned(force: Vector) -> Array:
        return jnp.stack(jnp.broadcast_arrays(*tibia.turn_back(force)))

    nothing = jnp.zeros((3, 0, *state.shape))
    muscles = nothing
    if lanes.muscles is not None:
        muscles = turned(lanes.muscles.tension * lanes.muscles.unit_pulls(state))
    forces = [tibia.turn_back(x.wrench(tibia).force) for x in lanes.loads if isinstance(x, Load)]
    loads = [jnp.stack(jnp.broadcast_arrays(*force, equilibrium.q[0])[:3]) for force in forces]
    return muscles, jnp.stack(loads, axis=1) if loads else nothing


class ByPull(NamedTuple):
    """What a stronger quadriceps does at flexions that are held."""

    moment: Array  # about the flexion axis that holds them, `(poses,)`, N mm: that of extension
    # How fast it grows with the pull, `(poses,)`, mm. As both are mixed derivatives of one energy,
    # this is also how fast the quadriceps becomes longer with flexion while all that is free stays
    # balanced: the moment arm by virtual work.
    arm: Array
    q: Array  # how fast the free coordinates move with the pull, `(free, poses)`


def by_pull(knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium) -> ByPull:
    """See `ByPull`: exact, from the stiffness that a balance already has."""
    if traced((knee, load_cases, equilibrium)):
        return _by_pull(knee, load_cases, equilibrium)
    known = np.asarray(equilibrium.converged)
    change = np.where(known, _of_one_newton(knee, load_cases, equilibrium), np.nan)
    free, row = len(load_cases.free), sorted(load_cases.prescribed).index("flexion")
    stiffness = np.where(known, equilibrium.tangent, np.eye(free)[..., None])
    q = -np.linalg.solve(np.moveaxis(stiffness, -1, 0), change[:free].T[..., None])[..., 0].T
    arm = change[free] + np.einsum("fp,fp->p", equilibrium.coupling[row], q)
    moment = np.where(known, equilibrium.reaction[row], np.nan)
    return ByPull(*map(jnp.asarray, (moment, arm, q)))


@compiled()
def _of_one_newton(knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium) -> Array:
    """What one newton more of the quadriceps changes of the unbalanced force, free coordinates and
    flexion, `(free + 1, poses)`, the pose held."""
    return jax.jvp(*_pulled(knee, load_cases, lambda lanes: equilibrium))[1][0]


@compiled()
def _by_pull(knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium) -> ByPull:
    """By the implicit rule, to be differentiated."""

    def balance(lanes: Knee) -> Equilibrium:
        return differentiable(lanes, load_cases.prescribed, equilibrium)

    (rows, _), (slope, q) = jax.jvp(*_pulled(knee, load_cases, balance))
    return ByPull(rows[-1], slope[-1], q)


def _pulled(knee: Knee, load_cases: LoadCases, balance: Callable[[Knee], Equilibrium]):
    """A function of the pull that is added, where it is none, and one newton: for `jax.jvp`."""

    def answer(pull: Array) -> tuple[Array, Array]:
        loads = (*load_cases.loads, pull_of(QUADRICEPS, pull))
        lanes = dataclasses.replace(load_cases, loads=loads).load(add_lane_axis(knee))
        there = balance(lanes)
        rows = force_along(lanes, there.state, there.contact_points, (*load_cases.free, "flexion"))
        return rows, there.q

    none = jnp.zeros(len(load_cases))
    return answer, (none,), (jnp.ones_like(none),)
