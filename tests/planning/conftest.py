"""A surgery in closed form: what searches of a plan are held against, without a knee."""

import types

import numpy as np
import pytest

from kneejax.geometry import FEMUR, TIBIA
from kneejax.planning import SEMI_AXES_MM as SEMI
from kneejax.planning import Followed, Footprint, Limits, Near, Outcome, Protocol
from kneejax.statics import Slopes

OWN_LAXITY_MM, BASE = 3.0, np.array([0.0, 0.0, 0.0, 0.0, 80.0])


class MadeUp:
    """One bundle. Laxity is linear in the five choices, and grows with the square of the femoral
    tunnel's place; the graft's force is its pretension; all strains grow with the tibial tunnel's
    first coordinate and are the intact knee's where that is `right`."""

    window = 1

    def __init__(self, off=0.0, by=(0.0,) * 5, curved=0.0, right=None, band=2.0):
        self.off, self.by, self.curved, self.right = off, np.array(by), curved, right
        self.limits = Limits(140.0, band, (20.0, 150.0))
        self.protocol = Protocol(np.array([10.0, 0.0]), (20.0,), 100.0)
        self.plan = types.SimpleNamespace(bundles=("graft",))
        nowhere, plane = np.zeros(3), np.eye(3)[:2]
        self.tibia, self.femur = (
            Footprint(bone, nowhere, plane, SEMI[bone], np.zeros((1, 2))) for bone in (TIBIA, FEMUR)
        )
        self.intact_strain = np.full((2, 1), 0.05)
        self.before, self.count = None, 0

    def laxity(self, before):
        return np.array([[OWN_LAXITY_MM]])

    def footprint(self, bone):
        return {TIBIA: self.tibia, FEMUR: self.femur}[bone]

    def strain(self, followed):
        return followed.strain

    def try_out(self, choices, *, slopes=False, near=None, grid=None, progress=None):
        choices = np.atleast_2d(choices)
        count = len(choices)
        self.count += count
        unit, wide = np.eye(5), np.zeros(5) if self.right is None else 0.01 * np.eye(5)[0]
        off = choices[:, 0] - (choices[:, 0] if self.right is None else self.right)
        strain = np.repeat(0.05 + 0.01 * off[:, None, None], 2, axis=1)
        laxity = (
            OWN_LAXITY_MM + self.off + (choices - BASE) @ self.by
            + self.curved * (choices[:, 2:4] ** 2).sum(axis=1)
        )  # fmt: skip
        by_laxity = np.tile(self.by, (count, 1))
        by_laxity[:, 2:4] += 2.0 * self.curved * choices[:, 2:4]
        sound, zero = np.zeros((count, 1), int), np.zeros((count, 1))
        place = Slopes(
            choices, zero[:, None], np.zeros((count, 1, 1, 5)), np.zeros((count, 1, 0, 2)),
            np.zeros((count, 1, 0, 2, 5)), zero[:, None, None], sound,
        )  # fmt: skip
        tension = choices[:, None, 4:]
        followed = Followed(strain, strain, tension, laxity[:, None], sound)
        by = {
            "total": np.sign(off)[:, None] * 2.0 * wide,
            "strain": np.broadcast_to(wide, (count, 2, 1, 5)),
            "laxity_mm": by_laxity[:, None],
            "graft_N": np.broadcast_to(unit[4], (count, 1, 1, 5)),
        }
        return Outcome(
            choices, zero, np.abs(strain - 0.05).sum(axis=1), laxity[:, None], tension, zero,
            sound[:, 0], followed, by if slopes else None, Near(place, place) if slopes else None,
        )  # fmt: skip


@pytest.fixture(scope="session")
def made_up():
    return MadeUp
