"""The leg raise of paper 3 with its rigid patella, and what all parts do to the tibia."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np

from kneejax.experiments import Shank, evaluate
from kneejax.geometry import PATELLA, TIBIA, State
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.reproduction.paper3._rigid_leg import RigidLeg, rigid_leg
from kneejax.reproduction.paper3._simple_surfaces import rigid_patella_of

#: Flexions, degrees.
LEG_DEG = np.arange(0.0, 91.0, 5.0)
#: Of the person whose leg it is: the paper prints neither mass nor length of its leg.
BODY_KG, HEIGHT_M = 75.0, 1.75


@dataclasses.dataclass(frozen=True)
class RaisedLeg:
    """A held leg, and its forces.

    Attributes:
        leg: as it was found.
        tension: group of ligaments or ligament -> its tension, `(poses,)`, N.
        shear: part -> what it does to the tibia forwards along the tibia's own axis, `(poses,)`, N.
    """

    leg: RigidLeg
    tension: dict[str, np.ndarray]
    shear: dict[str, np.ndarray]

    @property
    def held(self) -> np.ndarray:
        """Where a quadriceps that pulls holds the leg, `(poses,)`."""
        return self.leg.quadriceps_N > 0.0


def raised_leg(knee: Knee, with_patella: Knee) -> RaisedLeg:
    """Raise the leg of a person of 75 kg and 1.75 m.

    Args:
        knee: of two bones; a line that stands for the patella is left out.
        with_patella: the same with its patella, through whose surfaces those of paper 3 are laid.

    Returns:
        The leg and its forces.
    """
    alone = dataclasses.replace(knee, lines=())
    patella = rigid_patella_of(with_patella)
    start = with_patella.other_bones[PATELLA]
    shank = Shank.of_person(BODY_KG, HEIGHT_M)
    leg = rigid_leg(alone, patella, start, LEG_DEG, shank)
    found = evaluate(alone, leg.tibia)
    lanes, state = add_lane_axis(alone.ligaments), State({TIBIA: leg.tibia})
    own = np.asarray(found.tension).T
    ways = leg.tibia.placement.turn_back(tuple(jnp.asarray(lanes.unit_pulls(state))))
    forward = own * np.asarray(ways[0])
    names = list(alone.ligaments.names)
    rows = {name: [names.index(one) for one in members] for name, members in alone.groups}
    rows |= {name: [names.index(name)] for name in names}
    tension = {name: own[each].sum(axis=0) for name, each in rows.items()}
    shear = {
        "patellar tendon": leg.tendon_force[:, 0],
        "contact": np.asarray(found.contact_force)[:, :, 0].sum(axis=1),
        "weight": leg.weight_force[:, 0],
        **{name: forward[k] for k, name in enumerate(names)},
    }
    return RaisedLeg(leg, tension, shear)
