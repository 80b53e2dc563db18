"""A motion through time against OpenSim, which integrates the same knee with the same dampers."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.dynamics import MovingKnee, move_within
from kneejax.experiments import leg_of_person
from tests.statics.opensim_knee import SettlingKnee, sphere_knee

pytestmark = pytest.mark.opensim
TIMES = np.linspace(0.0, 0.5, 101)
AWAY = [0.0, 1.0, -2.0, 3.0, 0.0, 1.0]


def damped_knee():
    """Four ligaments and two spheres on planes, damped as OpenSim damps them."""
    knee = sphere_knee()
    fibres = dataclasses.replace(knee.ligaments, damping=jnp.full(4, 60.0))
    knee = dataclasses.replace(knee, ligaments=fibres)
    contacts = {name: 1e-3 for name in knee.contact_names}
    return MovingKnee.of(knee, leg_of_person(75.0, 1.75), contact_dissipation=contacts)


def begin_of(moving):
    """The pose at which it is let go: degrees and mm, and rad and mm."""
    rest = np.asarray(kj.passive_flexion(moving.knee, 20.0).to_table())[0]
    begin = rest + AWAY
    return begin, begin / np.r_[np.rad2deg([1.0, 1.0, 1.0]), 1.0, 1.0, 1.0]


@pytest.mark.long
def test_opensim_integrates_the_same_motion():
    """Half a second after the tibia was let go 3 mm before its balance and turned by 2 degrees."""
    pytest.importorskip("opensim")
    moving = damped_knee()
    begin, start = begin_of(moving)
    ours = move_within(1e-3, moving, start, TIMES, held=("flexion",))
    theirs = SettlingKnee(moving.knee, 5, moving).motion(begin, TIMES, 1e-6)
    apart = np.abs(ours.to_table() - theirs.poses)
    assert apart.max() < 0.05, apart.max(axis=0)
    travelled = np.abs(np.diff(theirs.poses, axis=0)).sum(axis=0)
    assert (travelled[1:] > 1.0).all() and float(ours.account().part_missing) < 1e-3
