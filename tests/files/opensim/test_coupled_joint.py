"""Secondary motion of a knee put into a model as splines of flexion."""

from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import SMALLEST_MODEL, InputProblem, coupled_motion, read_poses, write_poses
from kneejax.files.opensim.coupled import couple_knee
from kneejax.files.opensim.exact import Rigid, poses_of
from kneejax.files.opensim.frames import SAME, Registration
from kneejax.files.opensim.joints import moved
from kneejax.files.opensim.knee import find_knee
from kneejax.files.opensim.model import read_model
from kneejax.geometry import FEMUR, TIBIA
from tests.files.opensim.test_opensim_reference import FOREIGN

LENHART = Path(__file__).parents[3] / "../shared/data/lenhart2015/lenhart2015.osim"
FLEXION = np.arange(0.0, 101.0, 10.0)
#: A made-up motion, smooth in flexion: adduction, internal rotation, degrees, and mm.
POSES = np.column_stack([
    FLEXION, 0.03 * FLEXION, 12.0 * np.sin(np.deg2rad(FLEXION)), 0.05 * FLEXION,
    -3.0 * (1.0 - np.cos(np.deg2rad(FLEXION))), 0.4 * np.cos(np.deg2rad(FLEXION)),
])  # fmt: skip
#: A knee of three coordinates whose frames are shifted, one of which a constraint drives.
JOINT = """<CustomJoint name="knee_r">
        <socket_parent_frame>above</socket_parent_frame>
        <socket_child_frame>below</socket_child_frame>
        <coordinates><Coordinate name="knee_angle_r"/><Coordinate name="shift_r"/></coordinates>
        <frames>
          <PhysicalOffsetFrame name="above"><socket_parent>/bodyset/femur_r</socket_parent>
            <translation>0.003 -0.4 0.001</translation></PhysicalOffsetFrame>
          <PhysicalOffsetFrame name="below"><socket_parent>/bodyset/tibia_r</socket_parent>
            <translation>-0.002 0.01 0</translation></PhysicalOffsetFrame>
        </frames>
        <SpatialTransform>
          <TransformAxis name="rotation1"><coordinates>knee_angle_r</coordinates><axis>0 0 1</axis>
            <LinearFunction name="function"><coefficients>SIGN 0</coefficients></LinearFunction>
          </TransformAxis>
          <TransformAxis name="translation1"><coordinates>shift_r</coordinates><axis>1 0 0</axis>
            <LinearFunction name="function"><coefficients>1 0</coefficients></LinearFunction>
          </TransformAxis>
        </SpatialTransform>
      </CustomJoint>"""
CONSTRAINT = """<ConstraintSet><objects><CoordinateCouplerConstraint name="drives">
        <independent_coordinate_names>knee_angle_r</independent_coordinate_names>
        <dependent_coordinate_name>shift_r</dependent_coordinate_name>
      </CoordinateCouplerConstraint></objects></ConstraintSet>"""


def walker(side="r", sign="1", more=CONSTRAINT):
    """A model of that knee; flexion is the coordinate with a sign."""
    begin, end = SMALLEST_MODEL.index("<PinJoint"), SMALLEST_MODEL.index("</PinJoint>")
    text = SMALLEST_MODEL[:begin] + JOINT.replace("SIGN", sign) + SMALLEST_MODEL[end + 11 :]
    text = text.replace("<ForceSet>", f"{more}<ForceSet>")
    return text.replace("_r", f"_{side}").encode()


def coupled(data, side, motion, shifts=SAME):
    """The model with the motion, its knee, and what changed."""
    model = read_model("walker.osim", data)
    changes = couple_knee(model, find_knee(model, side), motion, shifts)
    again = read_model("walker.osim", model.file.written())
    return again, find_knee(again, side), changes


@pytest.mark.parametrize("side", ["r", "l"])
@pytest.mark.parametrize("sign", ["1", "-1"])
@pytest.mark.parametrize("away", [0.0, 4.0])
def test_the_model_moves_as_the_poses(side, sign, away):
    """Between the knots too; also where the knee's frames are not the model's."""
    femur, tibia = away * np.array([1.0, -2.0, 0.5]), away * np.array([-0.3, 1.0, 0.2])
    shifts = Registration(femur, tibia, not away, ())
    motion = coupled_motion(POSES)
    model, bones, _ = coupled(walker(side, sign), side, motion, shifts)
    assert [c.name for c in bones.joints[0].coordinates] == [f"knee_angle_{side}"]
    flexion = np.array([0.0, 13.0, 50.0, 77.7, 100.0])
    # Rotation by 1 about Z extends: flexion is minus the angle.
    angle = np.deg2rad(flexion) * (-1.0 if sign == "1" else 1.0)
    there = moved(model, {f"knee_angle_{side}": angle})
    frames = [shifts.in_knee(there.placed[body], bone, side)
              for body, bone in ((bones.femur, FEMUR), (bones.tibia, TIBIA))]  # fmt: skip
    found = frames[0].after(frames[1].inverse())
    table = poses_of(Rigid(found.turn, found.shift / 1e3), "r")
    assert np.abs(table - np.column_stack([flexion, motion.at(flexion)])).max() < 1e-6


def test_what_acts_on_coordinates_that_go_goes_too():
    model, _, changes = coupled(walker(), "r", coupled_motion(POSES))
    assert "CoordinateCouplerConstraint drives: taken out" in changes
    assert not [e for e in model.elements if e.tag == "CoordinateCouplerConstraint"]


def test_what_depends_on_them_otherwise_is_refused():
    turned = CONSTRAINT.replace("knee_angle_r", "other").replace("shift_r", "knee_angle_r")
    with pytest.raises(InputProblem, match="drives.*shift_r: expected a coordinate that stays"):
        coupled(walker(more=turned.replace("other", "shift_r")), "r", coupled_motion(POSES))


def test_a_knee_of_another_kind_is_refused():
    with pytest.raises(InputProblem, match="PinJoint knee_r: expected one CustomJoint"):
        coupled(SMALLEST_MODEL.encode(), "r", coupled_motion(POSES))


def test_a_motion_that_returns_is_met_by_least_squares():
    """Twice through the same flexions, 0.2 degrees of adduction apart: the mean of both."""
    there = np.linspace(5.0, 65.0, 61)
    both = np.r_[there, there[::-1]]
    poses = np.zeros((122, 6))
    poses[:, 0], poses[:, 2] = both, 0.1 * both
    poses[:61, 1], poses[61:, 1] = 0.1, -0.1
    found = coupled_motion(poses)
    assert np.abs(found.at(there)[:, 0]).max() < 1e-9
    assert np.abs(found.at(there)[:, 1] - 0.1 * there).max() < 1e-9
    assert found.rms == pytest.approx([0.1, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_three_flexions_are_no_motion(tmp_path):
    write_poses(tmp_path / "poses.csv", POSES[:3])
    with pytest.raises(InputProblem, match="flexion_deg: 3 of them: expected 4 or more"):
        coupled_motion(read_poses(tmp_path / "poses.csv"), str(tmp_path / "poses.csv"))


@pytest.mark.opensim
def test_opensim_moves_the_knee_as_the_poses(tmp_path):
    """The knee of the model of a person, whose six coordinates become one."""
    osim = pytest.importorskip("opensim")
    if not LENHART.exists():
        pytest.skip("the shared data are not here")
    write_poses(tmp_path / "poses.csv", POSES)
    new = tmp_path / "coupled.osim"
    words = ["export", "osim", "lenhart2015", str(LENHART), "--coupled"]
    assert main([*words, str(tmp_path / "poses.csv"), "--out", str(new)]) == 0
    new.write_text(FOREIGN.sub("", new.read_text(encoding="utf-8")), encoding="utf-8")
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(new))
    state = model.initSystem()
    bodies = [model.getBodySet().get(name) for name in ("femur_distal_r", "tibia_proximal_r")]
    flexion = np.array([0.0, 34.0, 95.0])
    table = np.column_stack([flexion, coupled_motion(POSES).at(flexion)])
    for row, angle in zip(table, np.deg2rad(flexion), strict=True):
        model.getCoordinateSet().get("knee_flex_r").setValue(state, angle)
        there = bodies[1].findTransformBetween(state, bodies[0])
        turn = np.array([[there.R().get(i, j) for j in range(3)] for i in range(3)])
        place = np.array([there.p().get(i) for i in range(3)])
        assert np.abs(poses_of(Rigid(turn, place), "r") - row).max() < 1e-6
