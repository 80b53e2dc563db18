"""Joint files, axis points and landmarks; joints for OpenSim, read back and by OpenSim itself."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.files import (
    InputProblem,
    JointFile,
    export_joint,
    format_joint,
    read_axis_points,
    read_calibrated,
    read_femur_landmarks,
    read_joint,
    write_joint,
)
from kneejax.files.opensim.exact import turn_about
from kneejax.files.opensim.joints import read_joints
from kneejax.files.opensim.model import evaluate, read_model
from kneejax.geometry import Pose
from kneejax.joints import Joint, axis_between, generalised_axis, hinge, moving_axis

ENDS = np.array([[3.5, 0.1, 5.1, -3.4, -34.6, 4.8], [86.6, -2.6, 11.3, 10.6, -33.5, 2.6]])
AXES = np.array([[[6, 8, -21.5], [1, 11, 23]], [[0.5, 1.5, -21], [-2, 1, 23.5]]])
AXIS_TEXT = """
extension: {medial_mm: [6, 8, -21.5], lateral_mm: [1, 11, 23]}
flexion: {medial_mm: [0.5, 1.5, -21], lateral_mm: [-2, 1, 23.5]}
"""

def _joints() -> dict[str, Joint]:
    three = Pose.from_table([ENDS[0], [45.0, -1.6, 9.6, 4.0, -35.0, 2.7], ENDS[1]])
    return {
        "moving": moving_axis(AXES, Pose.from_table(ENDS)),
        "hinge": hinge(AXES[0], Pose.from_table(ENDS[0])),
        "general": generalised_axis(axis_between(*AXES, three.flexion), three),
    }


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", ["moving", "hinge", "general"])
def test_joint_files_round_trip(tmp_path, name, side):
    joint = _joints()[name]
    write_joint(JointFile(joint, name, side, "a test", "notes: none"), tmp_path / "joint.yaml")
    again = read_joint(tmp_path / "joint.yaml")
    assert (again.name, again.side) == (name, side)
    assert (again.source, again.notes) == ("a test", "notes: none")
    assert again.joint.interpolation == joint.interpolation
    np.testing.assert_allclose(again.joint.flexion, joint.flexion, rtol=1e-15)
    np.testing.assert_array_equal(again.joint.femoral, joint.femoral)
    np.testing.assert_array_equal(again.joint.tibial, joint.tibial)


def test_a_left_joint_is_written_with_z_to_the_right():
    text = format_joint(JointFile(_joints()["moving"], "left", "left"))
    assert "femoral_medial_mm: [6.0, 8.0, 21.5]" in text


GOOD = format_joint(JointFile(_joints()["moving"], "moving"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("side: right", "side: rihgt", "rihgt: expected one of right, left; did you mean right"),
        ("kneejax: joint", "kneejax: 1", "kneejax: 1: expected joint: this is no file that"),
        ("kneejax: joint", "", "kneejax: missing: expected joint"),
        ("interpolation", "interpolaton", "did you mean interpolation"),
        ("femoral_medial_mm: [6.0, 8.0, -21.5]", "femoral_medial_mm: [6.0, 8.0]", "list of 3"),
        ("l_medial_mm: [6.0, 8.0, -21.5]", "l_medial_mm: [6.0, 8.0, 60]", "not lateral"),
        ("flexion_deg: 86.6", "flexion_deg: 3.5", "3.5 degrees in poses 1 and 2"),
        ("flexion_deg: 86.6", "flexion_deg: 1.5", "3.5, then 1.5 degrees"),
        ("flexion_deg: 86.6", "flexion_deg: 866", "between -180 and 180 degrees"),
    ],
)
def test_bad_joint_files_are_named(tmp_path, old, new, said):
    assert old in GOOD
    path = tmp_path / "joint.yaml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputProblem, match=said):
        read_joint(path)


def test_axis_points_and_their_mirror(tmp_path):
    path = tmp_path / "axes.yaml"
    path.write_text(AXIS_TEXT)
    found = read_axis_points(path)
    np.testing.assert_array_equal(found.points, AXES)
    assert found.epicondyles is None
    np.testing.assert_array_equal(read_axis_points(path, "left").points, AXES * [1, 1, -1])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (AXIS_TEXT.replace("flexion:", "flexon:"), "flexon: .*did you mean flexion"),
        (AXIS_TEXT.replace("lateral_mm: [1, 11, 23]", "lateral_mm: [1, x, 23]"), "a number"),
        ("extension: {medial_mm: [0, 0, 0], lateral_mm: [0, 0, 1]}", "flexion: missing"),
    ],
)
def test_bad_axis_points_are_named(tmp_path, text, said):
    path = tmp_path / "axes.yaml"
    path.write_text(text)
    with pytest.raises(InputProblem, match=said):
        read_axis_points(path)


def test_landmarks(tmp_path):
    path = tmp_path / "landmarks.yaml"
    both = "epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}\n"
    path.write_text(both + "femoral_head: {near_mm: [0, 400, 0], within_mm: 30}\n")
    found = read_femur_landmarks(path, "left")
    assert found.head_within == 30 and found.epicondyles[0, 2] == 40
    path.write_text(both)
    with pytest.raises(InputProblem, match="hip_center_mm or femoral_head"):
        read_femur_landmarks(path)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ("{", "line 1: .*expected JSON"),
        ("[1]", "parameters: missing: expected a result.json"),
        ('{"parameters": {}}', "knee: missing"),
        ('{"knee": "k", "parameters": 3}', "parameters: 3: expected a mapping"),
        ('{"knee": "k", "parameters": {"ACL.stiffness": 3}}', "a mapping with the field value"),
        ('{"knee": "k", "parameters": {"a.b": {"value": NaN}}}', "parameters.a.b.value: nan"),
        ('{"knee": "k", "parameters": {}, "settings": [1]}', "settings: .*expected a mapping"),
        ('{"parameters": {}, "settings": {"knee": ["k"]}}', "settings.knee: .*expected a text"),
    ],
)
def test_bad_results_of_a_calibration_are_named(tmp_path, document, said):
    path = tmp_path / "result.json"
    path.write_text(document)
    with pytest.raises(InputProblem, match=said):
        read_calibrated(path)


def test_a_calibrated_knees_own_name_stands_in_its_settings(tmp_path):
    path = tmp_path / "result.json"
    path.write_text(
        '{"knee": "title", "parameters": {"ACL.stiffness": {"value": 4500}}, "frame_offset": null, '
        '"settings": {"knee": "file.yaml", "overrides": {"PCL.stiffness": 9000}}}'
    )
    found = read_calibrated(path)
    assert found.knee == "file.yaml" and found.frame_offset == {}
    assert found.values == {"PCL.stiffness": 9000.0, "ACL.stiffness": 4500.0}


def _placements(path, degrees):
    """Rotation and translation, mm, of the tibia by the package's own reader of OpenSim's files."""
    model = read_model(path)
    joint = next(j for j in read_joints(model) if j.kind == "CustomJoint")
    for flexion in np.deg2rad(degrees):
        rotation, shift = np.eye(3), np.zeros(3)
        for axis in joint.axes:
            amount = evaluate(axis.function, [flexion])
            if axis.turns:
                rotation = rotation @ turn_about(axis.direction, amount)
            else:
                shift = shift + 1e3 * amount * axis.direction
        yield rotation, shift


def _expected(joint, degrees, side="right"):
    place = joint.pose(jnp.deg2rad(jnp.asarray(degrees))).placement
    rotation = np.moveaxis(np.array(place.rotation), -1, 0)
    shift = np.stack([np.asarray(c) for c in place.translation], axis=-1)
    mirror = np.array([1.0, 1.0, -1.0 if side == "left" else 1.0])
    return rotation * mirror[:, None] * mirror, shift * mirror


SHOWN = [("moving", "right"), ("moving", "left"), ("hinge", "right"), ("general", "right")]
DEGREES = np.array([-9.3, 3.5, 3.50001, 17.0, 44.99, 60.0, 86.6, 101.7, 133.0])


@pytest.mark.parametrize(("name", "side"), SHOWN)
def test_export_reads_back(tmp_path, name, side):
    joint = _joints()[name]
    found = export_joint(JointFile(joint, "a <name> & more -- yes", side))
    assert found.error.max() < 1e-6
    path = tmp_path / "joint.osim"
    path.write_text(found.model)
    turns, shifts = _expected(joint, DEGREES, side)
    for (turn, shift), ours, moved in zip(_placements(path, DEGREES), turns, shifts, strict=True):
        assert np.rad2deg(np.abs(turn - ours)).max() < 1e-6
        assert np.abs(shift - moved).max() < 1e-6
    assert found.snippet.strip() in found.model


@pytest.mark.opensim
@pytest.mark.parametrize(("name", "side"), SHOWN)
def test_opensim_moves_the_same(tmp_path, name, side):
    osim = pytest.importorskip("opensim")
    joint = _joints()[name]
    path = tmp_path / "joint.osim"
    path.write_text(export_joint(JointFile(joint, name, side)).model)
    model = osim.Model(str(path))
    state = model.initSystem()
    coordinate = model.getCoordinateSet().get(f"knee_flexion_{side[0]}")
    femur, tibia = (model.getBodySet().get(f"{bone}_{side[0]}") for bone in ("femur", "tibia"))
    turns, shifts = _expected(joint, DEGREES, side)
    for flexion, ours, moved in zip(DEGREES, turns, shifts, strict=True):
        coordinate.setValue(state, float(np.deg2rad(flexion)))
        model.realizePosition(state)
        there = tibia.findTransformBetween(state, femur)
        turn = np.array([[there.R().get(i, j) for j in range(3)] for i in range(3)])
        shift = 1e3 * np.array([there.p().get(i) for i in range(3)])
        assert np.rad2deg(np.abs(turn - ours)).max() < 1e-6
        assert np.abs(shift - moved).max() < 1e-6
