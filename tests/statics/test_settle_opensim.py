"""Balanced poses against OpenSim, which lets go of the same knee and waits until it rests."""

from __future__ import annotations

import numpy as np
import pytest

import kneejax as kj
from tests.statics.opensim_knee import SettlingKnee, sphere_knee

pytestmark = pytest.mark.opensim
FLEXION = (20.0, 60.0)


@pytest.fixture(scope="module")
def motion():
    pytest.importorskip("opensim")
    return kj.passive_flexion(sphere_knee(), FLEXION)


@pytest.fixture(scope="module")
def rests(motion):
    """Where OpenSim rests at each angle, on spheres of 5,120 and of 20,480 triangles."""
    answer = []
    for subdivisions in (4, 5):
        peer, begin = SettlingKnee(sphere_knee(), subdivisions), np.zeros(6)
        for angle in FLEXION:
            answer.append(peer.solve_equilibrium(angle, begin))
            begin = answer[-1].pose
    return np.reshape(np.array(answer), (2, len(FLEXION)))


def _apart(motion, rests):
    """Between OpenSim's poses and ours, `(meshes, angles, 6)`, degrees and mm."""
    poses = np.array([[rest.pose for rest in of_mesh] for of_mesh in rests])
    return np.abs(poses - np.asarray(motion.to_table()))


@pytest.mark.long
def test_opensim_rests_where_kneejax_balances(motion, rests):
    assert (np.asarray(motion.status) == 0).all()
    apart = _apart(motion, rests)[1]
    assert apart[:, :3].max() < 0.05
    assert apart[:, 3:].max() < 0.05
    # Somewhere else than where either began.
    table = np.asarray(motion.to_table())
    assert np.abs(table[:, 1:]).max() > 1.0 and np.abs(table[1] - table[0])[1:].max() > 1.0


def test_what_is_between_them_is_the_mesh(motion, rests):
    """Half the edge, a quarter of the difference: it vanishes with the triangles."""
    coarse, fine = _apart(motion, rests).max(axis=(1, 2))
    assert coarse / fine == pytest.approx(4.0, abs=0.4)


def test_opensim_has_come_to_rest(motion, rests):
    """What its accelerations at rest would still move the knee is far less than the criterion."""
    for row, rest in enumerate(rests[1]):
        tangent = np.asarray(motion.equilibrium.tangent)[:, :, row]
        left = np.linalg.solve(tangent, rest.unbalanced)
        assert np.abs(np.rad2deg(left[:2])).max() < 0.005
        assert np.abs(left[2:]).max() < 0.005
