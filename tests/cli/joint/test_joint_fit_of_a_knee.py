"""`kneejax joint fit --knee`: the simple joint that moves most like a contact knee."""

import csv
import json

import numpy as np

import kneejax as kj
from kneejax.cli import main
from kneejax.files import read_axis_points, read_joint, read_poses
from kneejax.geometry import FREE_COORDINATES, Pose
from kneejax.joints import condyle_axes
from kneejax.mechanics import condyle_points
from tests.cli.joint.fitting import refused

#: Both ends of what is asked for and 26 flexions: one program for all, and for joint compare's.
BENT = ["--flexion", "0:100:4"]


def test_a_contact_knee_becomes_a_simple_joint(tmp_path, capsys, figures):
    """Exact where it was calibrated, its axis through the condyles; and what it loses between."""
    out = tmp_path / "out"
    assert main(["joint", "fit", "--knee", "four_ligament", *BENT, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "moving axis, linear: calibrated at 0.0, 100.0 degrees" in said
    assert "RMSE over passive flexion of four_ligament, 26 poses from 0 to 100 degrees" in said
    knee = read_poses(out / "knee_poses.csv")
    joint = read_joint(out / "joint.yaml").joint
    apart = np.asarray(joint.pose(np.deg2rad(knee[:, 0])).to_table()) - knee
    assert np.abs(apart[[0, -1]]).max() < 1e-9 < np.abs(apart[13]).max()
    condyle = condyle_axes(*condyle_points(kj.load_knee("four_ligament")))
    np.testing.assert_allclose(joint.femoral, condyle.points, atol=1e-9)
    document = json.loads((out / "result.json").read_text())
    rmse = [document["rmse"]["moving"][name] for name in FREE_COORDINATES]
    np.testing.assert_allclose(rmse, np.sqrt(np.mean(apart**2, axis=0))[1:], rtol=1e-9)
    assert document["doubts"] == [] and document["settings"]["knee"] == "four_ligament"
    np.testing.assert_allclose(read_axis_points(out / "axes.csv").points, joint.femoral, atol=1e-9)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "How closely a moving axis and a hinge follow passive flexion of four_ligament" in page
    for name in ("axes", "motion"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000


def test_a_calibration_becomes_the_joint_of_its_measured_frames(tmp_path):
    """A shift between frames moves the axis in the femur and leaves it in the tibia."""
    result, out = tmp_path / "result.json", tmp_path / "out"
    document = {"parameters": {}, "settings": {"knee": "four_ligament"}}
    document["frame_offset"] = {"lateral_mm": {"value": 12.0}, "anterior_mm": {"value": -2.0}}
    result.write_text(json.dumps(document))
    assert main(["joint", "fit", "--knee", str(result), *BENT, "--out", str(out)]) == 0
    joint = read_joint(out / "joint.yaml").joint
    own = condyle_axes(*condyle_points(kj.load_knee("four_ligament"))).points
    np.testing.assert_allclose(joint.femoral, own + [-2.0, 0.0, 12.0], atol=1e-9)
    there = read_poses(out / "knee_poses.csv")[[0, -1]] - [0, 0, 0, -2.0, 0, 12.0]
    unmoved = kj.moving_axis(own, Pose.from_table(there))
    np.testing.assert_allclose(joint.tibial, unmoved.tibial, atol=1e-9)


def test_an_unknown_parameter_of_a_calibration_is_said_with_its_file(tmp_path, capsys):
    result = tmp_path / "result.json"
    number = {"ACL.stifness": {"value": 3000.0}}
    result.write_text(json.dumps({"parameters": number, "settings": {"knee": "four_ligament"}}))
    line = refused(["joint", "fit", "--knee", str(result)], capsys, tmp_path / "out")
    assert f"{result}: unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?" in line


def test_poses_without_balance_arerefused_or_said(tmp_path, capsys):
    words = ["joint", "fit", "--knee", "four_ligament", "--flexion=-30:170:8"]
    line = refused(words, capsys, tmp_path / "none")
    assert "four_ligament: pose at -30 degrees: not_converged: expected a flexion with" in line
    assert "choose by --at, from" in line
    out = tmp_path / "out"
    assert main([*words, "--at", "10", "50", "90", "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "axis through 3 poses, monotone: calibrated at 10.0, 50.0, 90.0 degrees" in said
    assert "warning: four_ligament: " in said and "not_converged: no balance found" in said
    with (out / "knee_poses.csv").open() as stream:
        rows = {float(row["flexion_deg"]): row for row in csv.DictReader(stream)}
    assert rows[-30.0]["status"] == "not_converged" and rows[-30.0]["anterior_mm"] == "nan"
    document = json.loads((out / "result.json").read_text())
    assert document["doubts"] and np.isfinite(document["rmse"]["moving"]["anterior"])
