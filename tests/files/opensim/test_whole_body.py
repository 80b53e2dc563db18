"""OpenSim's own inverse dynamics and static optimisation, against what was recorded of them."""

from pathlib import Path

import numpy as np
import pytest

from kneejax.cli._activity import _reaction_off
from kneejax.files import (
    InputProblem,
    ask_opensim,
    couple_model,
    coupled_motion,
    load_knee_file,
    read_activity,
    read_storage,
    registered,
    whole_body,
)
from tests.files.opensim.test_coupled_joint import POSES

GAIT = Path(__file__).parents[3] / "../shared/data/gait2392"
MODEL, LOADS = GAIT / "subject01_simbody_adjusted.osim", GAIT / "foot_floor_loads.xml"
MOTION, ACTUATORS = GAIT / "subject01_walk1_kinematics.sto", GAIT / "residual_actuators.xml"
RECORDED = GAIT / "subject01_static_optimization_force.sto"
pytestmark = [
    pytest.mark.opensim,
    pytest.mark.skipif(not GAIT.exists(), reason="the recorded walk is not beside the checkout"),
]


@pytest.fixture(scope="module")
def osim():
    return pytest.importorskip("opensim")


@pytest.fixture(scope="module")
def knee():
    return load_knee_file("lenhart2015_reduced")


@pytest.fixture(scope="module")
def walk(osim, tmp_path_factory):
    """The movement, and OpenSim's tables of it at sixteen instants."""
    body = whole_body(MODEL, MOTION, LOADS, side="r", actuators=ACTUATORS, instants=16)
    return body, ask_opensim(body, tmp_path_factory.mktemp("walk"))


def test_muscle_forces_are_the_recorded_ones(walk):
    """OpenSim's own record of the same optimisation; ground forces were cut to every fifth row."""
    ours, theirs = read_storage(walk[1].forces), read_storage(RECORDED)
    assert ours.columns.keys() == theirs.columns.keys() and len(ours.time) == 16
    apart = [x - np.interp(ours.time, theirs.time, theirs.columns[name])
             for name, x in ours.columns.items()]  # fmt: skip
    assert max(x.max() for x in theirs.columns.values()) > 1800.0
    assert np.sqrt(np.mean(np.square(apart))) < 1.0 and np.abs(apart).max() < 16.0


def test_inverse_dynamics_is_what_the_recorded_forces_do(walk, osim):
    """The knee's moment is that of the recorded muscle forces about OpenSim's moment arms."""
    moments, forces = read_storage(walk[1].moments), read_storage(RECORDED)
    motion = read_storage(MOTION)
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(MODEL))
    state = model.initSystem()
    knee = model.getCoordinateSet().get("knee_angle_r")
    times = forces.time[5::15]
    theirs = []
    for time in times:
        for name, values in motion.columns.items():
            coordinate = model.updCoordinateSet().get(name)
            angle = coordinate.getMotionType() == 1
            value = float(np.interp(time, motion.time, values))
            coordinate.setValue(state, np.deg2rad(value) if angle else value, False)
        model.realizePosition(state)
        total = 0.0
        for name, values in forces.columns.items():
            if model.getMuscles().contains(name):
                arm = model.getMuscles().get(name).computeMomentArm(state, knee)
                total += arm * float(np.interp(time, forces.time, values))
            elif name == "knee_angle_r_reserve":
                total += float(np.interp(time, forces.time, values))
        theirs.append(total)
    ours = np.interp(times, moments.time, moments.columns["knee_angle_r_moment"])
    assert np.abs(ours).max() > 30.0
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.3


@pytest.mark.parametrize("coupled", [False, True], ids=["as it is", "with a secondary motion"])
def test_the_reaction_is_the_sum_of_what_is_read(walk, knee, coupled, tmp_path):
    """Weight, inertia, ground and muscles as kneejax reads them, against OpenSim's own reaction."""
    body, said = walk
    shifts = registered(MODEL, "r", knee.knee, knee.document, "auto")
    model = MODEL
    if coupled:
        poses = POSES.copy()
        poses[:, 0] = np.linspace(-5.0, 80.0, len(poses))
        model = tmp_path / "coupled.osim"
        model.write_bytes(couple_model(MODEL, "r", coupled_motion(poses), shifts))
        said = ask_opensim(body, tmp_path, model)
    known = {"side": "r", "knee": knee.knee, "frames": shifts}
    known |= {"femur": body.bones[0], "tibia": body.bones[1]}
    record = read_activity(model, [body.motion, said.forces, body.loads], **known)
    theirs = read_activity(model, [body.motion, said.reactions], **known)
    assert _reaction_off(record, theirs) < 1.0
    if coupled:
        found = coupled_motion(poses).at(record.pose[:, 0])
        assert np.abs(record.pose[:, 1:] - found).max() < 1e-4
    reaction = read_storage(said.reactions).columns["knee_r_on_tibia_r_in_tibia_r_fy"]
    assert reaction.min() < -1500.0


def test_where_opensim_stops_its_reason_is_one_line(osim, tmp_path):
    """An actuator on a body that the model has not: only OpenSim looks at that."""
    wrong = tmp_path / "wrong.xml"
    text = ACTUATORS.read_text(encoding="utf-8")
    wrong.write_text(text.replace("<body>pelvis<", "<body>pelwis<"), encoding="utf-8")
    body = whole_body(MODEL, MOTION, LOADS, side="r", instants=4, actuators=wrong)
    said = "OpenSim: stopped: expected .*: PointActuator: Unknown body .pelwis."
    with pytest.raises(InputProblem, match=said) as problem:
        ask_opensim(body, tmp_path / "out")
    assert "\n" not in str(problem.value)
