"""Drawer by displacement and torsion by torque, as paper 3 makes them."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.experiments import lab_tests, laxity, load_curves, mechanics_of
from kneejax.mechanics import Knee
from kneejax.statics import Status

#: Flexions of its Figure 11; those of the drawer are given with the tests' sizes.
TORSION_DEG = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0)
STEPS = 10


@dataclasses.dataclass(frozen=True)
class Paper3Study:
    """What the claims are judged by.

    Attributes:
        drawer_deg: flexions of the drawer, `(n,)`.
        moved_mm: anterior displacement from the neutral pose, in order, `(m,)`.
        force_N: that holds the tibia there, `(n, m)`; NaN where no balance was found.
        tension: ligament or group -> its tension there, N, `(n, m)`.
        torsion_deg: flexions of the torsion, `(k,)`.
        internal_deg: rotation under the full internal torque, `(k,)`; NaN where the knee gives way.
        external_deg: under the full external one, negative, `(k,)`.
        held_Nm: largest torques that the knee holds, external (negative) and internal, `(k, 2)`.
        torque_Nm: the full torque.
        status: flexion -> the worst of the drawer and of the torsion there.
    """

    drawer_deg: np.ndarray
    moved_mm: np.ndarray
    force_N: np.ndarray
    tension: dict[str, np.ndarray]
    torsion_deg: np.ndarray
    internal_deg: np.ndarray
    external_deg: np.ndarray
    held_Nm: np.ndarray
    torque_Nm: float
    status: dict[float, Status]

    @property
    def total_deg(self) -> np.ndarray:
        """Rotation between the two torques, `(k,)`, degrees."""
        return self.internal_deg - self.external_deg

    def at(self, flexion_deg: float) -> np.ndarray:
        """Force of the drawer at a flexion, `(m,)`, N."""
        return self.force_N[int(np.argmin(np.abs(self.drawer_deg - flexion_deg)))]


def paper3_study(
    knee: Knee, drawer_deg: np.ndarray, displacement_mm: float, torque_Nm: float
) -> Paper3Study:
    """Make the tests that paper 3's claims are judged by.

    Args:
        knee: with the twelve bundles of its Table 1 (`twelve_bundle`).
        drawer_deg: flexions of the drawer.
        displacement_mm: how far the tibia is moved each way.
        torque_Nm: how hard it is turned each way.

    Returns:
        The `Paper3Study`.
    """
    (drawer,) = lab_tests(
        "drawer", drawer_deg, displacement_mm=displacement_mm, both=True, steps=STEPS
    )
    (torsion,) = lab_tests("torsion", TORSION_DEG, moment_Nm=torque_Nm, both=True, steps=STEPS)
    (drawn,), (turned,) = load_curves(knee, [drawer]), load_curves(knee, [torsion])
    mechanics = mechanics_of(drawn)
    order = np.argsort(drawn.part)
    rows = drawn.nodes[:, order]
    known = np.isfinite(np.asarray(drawn.displacement_by_load)[:, order])
    force = np.where(known, np.asarray(drawn.driving_load)[:, order], np.nan)
    each = np.where(known[..., None], np.asarray(mechanics.tension)[rows], np.nan)
    names = list(knee.ligaments.names)
    tension = {name: each[..., k] for k, name in enumerate(names)}
    for group, members in knee.groups:
        tension[group] = np.sum([tension[one] for one in members], axis=0)
    turning = mechanics_of(turned)
    found = laxity(turned, turned.status(turning))
    status: dict[float, Status] = {}
    for row in (*laxity(drawn, drawn.status(mechanics)), *found):
        worst = max(int(row.status), int(status.get(row.flexion_deg, 0)))
        status[row.flexion_deg] = Status(worst)
    return Paper3Study(
        np.asarray(drawer_deg, float), displacement_mm * np.sort(drawn.part), force, tension,
        np.array(TORSION_DEG), np.array([row.positive for row in found]),
        np.array([row.negative for row in found]),
        np.array([(row.held_negative, row.held_positive) for row in found]), torque_Nm, status,
    )  # fmt: skip
