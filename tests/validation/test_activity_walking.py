"""Walking, as whole-body programs recorded it, against what they said of the same instants.

gait2392: OpenSim's static optimisation balances the knee's moment of its model exactly, so inverse
dynamics and muscles read here must too. lenhart2015: the person of the bundled knee walks; COMAK's
record has the knee's pose, so that all forces there must add up but for the contact's fit.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from kneejax.experiments import activity, evaluate
from kneejax.experiments.activity._activity import _of_ligaments, muscles_over
from kneejax.files import load_knee_file, read_activity, read_storage
from kneejax.files.opensim._activity import _acting as acting_of
from kneejax.files.opensim._activity import _below, _moved, _sorted
from kneejax.files.opensim._knee import find_knee
from kneejax.files.opensim._model import read_model
from kneejax.files.opensim._movement import Rigid, moved
from kneejax.files.opensim._muscle_lines import crossing
from kneejax.files.tables import common_times
from kneejax.geometry import TIBIA, Pose, State

DATA = Path(__file__).parents[3] / "shared" / "data"
WALK, GAIT = DATA / "lenhart2015", DATA / "gait2392"
pytestmark = [
    pytest.mark.skipif(not GAIT.exists(), reason="recorded walking is not beside the checkout"),
    pytest.mark.slow,
]
GAIT_MODEL = GAIT / "subject01_simbody_adjusted.osim"
GAIT_FILES = [
    GAIT / "subject01_walk1_kinematics.sto",
    GAIT / "subject01_static_optimization_force.sto",
    GAIT / "foot_floor_loads.xml",
]
WALK_FILES = [
    WALK / "walking" / name
    for name in ("comak_coordinates.sto", "comak_muscle_forces.sto", "external_loads.xml")
]


@pytest.fixture(scope="module")
def reduced():
    return load_knee_file("lenhart2015_reduced")


def test_the_moments_of_a_recorded_static_optimisation_cancel():
    """Moments about the model's own knee, by virtual work: 0.11 N m of 69 are left."""
    model, step = read_model(GAIT_MODEL), 1e-4
    bones = find_knee(model, "r")
    given = _sorted(model, bones, GAIT_FILES)
    time = common_times(given.tables)
    movement, around = _moved(model, bones, given.motion, time)
    below, tibia = _below(movement.joints, bones), movement.placed[bones.tibia]
    frame = Rigid(tibia.inverse().turn, 1e3 * tibia.inverse().shift)
    parts, _, _ = acting_of(given, movement, around, below, frame, time)
    whole = sum(parts.values())
    sides = [
        moved(model, movement.values | {"knee_angle_r": movement.values["knee_angle_r"] + way})
        for way in (-step, step)
    ]
    before, after = ({w.name: w.length for w in crossing(x, bones, below).muscles} for x in sides)
    table = given.muscles
    muscles = -sum(
        np.interp(time, table.time, table.columns[name]) * (after[name] - before[name])
        for name in before
    ) / (2.0 * step)
    first, last = (x.placed[bones.tibia] for x in sides)
    rate = (last.turn - first.turn) / (2.0 * step) @ np.swapaxes(tibia.turn, -1, -2)
    turn = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    shift = (last.shift - first.shift) / (2.0 * step)
    turn, shift = (np.einsum("nji,nj->ni", tibia.turn, x) for x in (turn, shift))
    outer = np.sum(whole[:, :3] * shift, 1) + np.sum(whole[:, 3:] * turn, 1) / 1e3
    assert np.abs(outer).max() > 60.0
    assert np.sqrt(np.mean((outer + muscles) ** 2)) < 0.2


def _pulls(muscles, pose):
    """What muscles do to the tibia together, `(n, 6)`."""
    state = State({TIBIA: Pose.from_table(pose)})
    return np.asarray(muscles.on_tibia(state)).sum(axis=0).T


def test_the_joint_reaction_is_that_of_opensim(reduced):
    """986.9 N along the tibia's long axis at 0.65 s; OpenSim 4.6 said 987 N."""
    record = read_activity(GAIT_MODEL, GAIT_FILES, side="r", knee=reduced.knee)
    whole = sum(record.acting.values()) + _pulls(record.muscles, record.pose)
    at = int(np.argmin(np.abs(record.time_s - 0.65)))
    assert whole[at, 1] == pytest.approx(987.0, abs=1.0)
    assert "right_foot takes its torque from left_foot_torque" in record.doubts[0]


@pytest.fixture(scope="module")
def walk(reduced):
    model = WALK / "lenhart2015.osim"
    return read_activity(model, WALK_FILES, side="r", knee=reduced.knee, document=reduced.document)


def test_the_record_has_the_poses_of_its_own_coordinates(walk):
    columns = read_storage(WALK_FILES[0]).columns
    names = [f"knee_{x}_r" for x in ("flex", "add", "rot", "tx", "ty", "tz")]
    scale = [1.0, 1.0, 1.0, 1e3, 1e3, 1e3]
    said = np.stack([columns[n] * s for n, s in zip(names, scale, strict=True)], axis=1)
    assert walk.same_frames
    assert np.allclose(walk.pose, said, atol=1e-9)


def test_at_the_recorded_poses_all_forces_add_up(walk):
    """The flexion moment closes within 0.9 N m rms, forces within 11, 20 and 13 N rms."""
    knee = load_knee_file("lenhart2015").knee
    bare, state = dataclasses.replace(knee, lines=()), State({TIBIA: Pose.from_table(walk.pose)})
    found = evaluate(bare, state.tibia)
    contact = np.concatenate(
        [np.asarray(x).sum(axis=1) for x in (found.contact_force, found.contact_moment)], axis=1
    )
    acting = sum(walk.acting.values()) + _pulls(muscles_over(knee, walk), walk.pose)
    left = acting + np.asarray(_of_ligaments(bare, state)).T + contact
    rms = np.sqrt(np.mean(left**2, axis=0))
    assert np.all(rms[:3] < 25.0)
    assert rms[5] < 1000.0


@pytest.fixture(scope="module")
def let_go(reduced, walk):
    """The walk at every fourth instant."""
    rows = np.arange(0, len(walk.time_s), 4)
    return activity(reduced.knee, walk.at(rows))


def test_the_walk_is_in_balance_near_its_record(let_go):
    """What docs/activity.md says of 112 instants, at 28 of them."""
    assert let_go.holds.all()
    away = np.asarray(let_go.motion.to_table()) - let_go.record.pose
    rms = np.sqrt(np.mean(away**2, axis=0))
    assert np.all(rms < [1e-9, 1.0, 8.5, 1.0, 0.35, 0.85])
    residual = let_go.residual_Nm
    assert np.sqrt(np.mean(residual**2)) < 4.0 and np.abs(residual).max() < 11.0
    peak = np.linalg.norm(np.asarray(let_go.mechanics.contact_force), axis=-1).max(axis=0)
    assert np.allclose(peak, [2367.0, 1196.0], rtol=0.05)


def test_what_acts_on_the_tibia_is_what_it_is_held_by(let_go):
    """Joint reaction in equals contacts and ligaments within 0.1 %: asked for; 1e-6 is kept."""
    _assert_closed(let_go)


def _assert_closed(found):
    there, some = found.motion.settled.state.tibia.placement, found.holds
    left, acting = found.left_over[some], found.total[some]
    size = np.linalg.norm(acting[:, :3], axis=1)
    assert np.all(np.linalg.norm(left[:, :3], axis=1) < 1e-6 * size)
    # Of the moment nothing is left but what holds flexion, about the femur's transverse axis.
    transverse = [np.asarray(x) for x in there.turn_back((0.0, 0.0, 1.0))]
    transverse = np.stack(np.broadcast_arrays(*transverse), axis=1)[some]
    along = np.sum(left[:, 3:] * transverse, axis=1)
    across = left[:, 3:] - along[:, None] * transverse
    assert np.all(np.linalg.norm(across, axis=1) < 1e-6 * np.linalg.norm(acting[:, 3:], axis=1))
    assert np.allclose(along, 1000.0 * found.residual_Nm[some], atol=1e-3)


def test_gait2392_closes_as_well(reduced):
    """Another person's walk, its knee reaction taken up by contacts, ligaments and muscles."""
    record = read_activity(GAIT_MODEL, GAIT_FILES, side="r", knee=reduced.knee)
    found = activity(reduced.knee, record.at(np.arange(0, len(record.time_s), 6)))
    assert found.holds.sum() >= 23
    _assert_closed(found)
