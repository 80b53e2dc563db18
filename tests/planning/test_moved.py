"""A plan's knees in a movement in which the quadriceps pulls on a patella."""

import dataclasses

import numpy as np
import pytest

from kneejax.experiments import activity
from kneejax.mechanics import LegRecord, Muscles
from kneejax.planning import PLANNED, footprint_of, operated_knees, reconstruction_of
from kneejax.statics import converged
from kneejax.studies import read_plan

COUNT = 5


def push_off():
    """A knee straightens from 40 degrees, pressed together; a head of the quadriceps ends on the
    tibia, as in models without a patella."""
    pose = np.zeros((COUNT, 6))
    pose[:, 0] = np.linspace(40.0, 20.0, COUNT)
    ends = np.array([[40.0, 20.0, 5.0], [35.0, -48.0, 13.0]])[:, :, None] * np.ones(COUNT)
    muscles = Muscles(ends[:1], ends[1:], np.full((1, COUNT), 300.0), ("vas_int_r",))
    acting = {"ground": np.tile([20.0, 400.0, 0.0, 0.0, 0.0, 0.0], (COUNT, 1))}
    none = np.zeros(COUNT)
    time, ground = np.linspace(0.0, 0.2, COUNT), np.zeros((COUNT, 3))
    return LegRecord(time, pose, acting, muscles, none, ground, True, 4.0)


@pytest.mark.long
def test_a_planned_graft_pulls_while_the_patella_is_pulled(pulled_knee):
    tibia, femur = (footprint_of(pulled_knee, "ACL", bone) for bone in ("tibia", "femur"))
    plan = read_plan("ten_bundle")
    surgery = dataclasses.replace(
        plan.surgery, plan=reconstruction_of(pulled_knee), tibia=tibia, femur=femur
    )
    plan = dataclasses.replace(plan, own=pulled_knee, surgery=surgery)
    knees = operated_knees(plan)
    assert len(knees) == 11
    intact = activity(knees["intact"], push_off())
    found = {"intact": intact, PLANNED: activity(knees[PLANNED], push_off(), near=intact)}
    for name, one in found.items():
        assert np.asarray(converged(one.motion.status)).all(), name
        assert one.motion.knee.other_bones and "vas_int_r" not in one.acting
        assert np.abs(one.left_over[:, :3]).max() < 1e-3
        names, tension = one.motion.knee.ligaments.names, np.asarray(one.mechanics.tension)
        acts = tension[:, names.index("graft")] > 0.0
        assert acts.all() if name == PLANNED else not acts.any()
        tendon = [k for k, own in enumerate(names) if own.startswith("PT")]
        assert (tension[:, tendon].sum(axis=1) > 150.0).all()
