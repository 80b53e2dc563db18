"""Small knees with mass that tests of dynamics share; few programs serve them all."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from kneejax.dynamics import MovingKnee
from kneejax.geometry import COORDINATES, Pose
from kneejax.mechanics import Knee, Ligaments, Mass

#: Of 32 steps, with which a program is compiled, 5 belong to the first interval.
STEPS = 28
ALL_BUT_FLEXION = tuple(COORDINATES)[1:]
ALL_BUT_SUPERIOR = tuple(name for name in COORDINATES if name != "superior")
HERE = Pose.from_table([0.0] * 6)
INERTIA = [[3e4, 300.0, 0.0], [300.0, 4e3, 100.0], [0.0, 100.0, 2.8e4]]
SHANK = Mass(2.0, [5.0, -200.0, -8.0], INERTIA)


def bare(ligaments=None, contacts=(), loads=()):
    """A tibia without what is not named."""
    nothing = Ligaments([], [], [], [], [], [], [])
    names = tuple(str(k) for k in range(len(contacts)))
    return Knee(ligaments or nothing, contacts, loads, (), HERE, names)


def fibres(first, second, stiffness=1e4, strain=0.02, toe=0.002, width=1e-5):
    """Between femur and tibia, with a strain at the reference pose."""
    count = len(first)
    made = Ligaments(first, second, [stiffness] * count, [1.0] * count, [toe] * count,
                     [width] * count, [f"f{k}" for k in range(count)],
                     failure_strain=[1.0] * count)  # fmt: skip
    slack = np.linalg.norm(np.asarray(second) - np.asarray(first), axis=1) / (1.0 + strain)
    return dataclasses.replace(made, slack_length=jnp.asarray(slack))


def in_a_vice(stiffness=4000.0):
    """Three points of the tibia held in six directions, from both sides, with a mass."""
    axes = np.eye(3)
    points = np.array([[15.0, 0.0, 0.0]] * 3 + [[-10.0, 12.0, 0.0]] * 2 + [[0.0, -5.0, 14.0]])
    along = axes[[0, 1, 2, 1, 2, 0]]
    away = np.concatenate([points + 30.0 * along, points - 30.0 * along])
    held = fibres(away, np.concatenate([points, points]), stiffness, toe=0.03, width=1e-3)
    return MovingKnee.of(bare(held), SHANK)
