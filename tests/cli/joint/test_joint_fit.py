"""`kneejax joint fit` and `kneejax joint export`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import read_joint, read_poses
from kneejax.geometry import convert
from tests.cli.joint.fitting import ENDS, refused, write_poses
from tests.joints.bones import write_femur
from tests.joints.condyles import CENTERS

SHARED = Path(__file__).parents[4] / "shared/data/lenhart2015"
def test_from_axis_points(tmp_path, poses, axes, capsys, figures):
    out = tmp_path / "out"
    assert main(["joint", "fit", poses, "--axes", axes, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "moving axis, linear: calibrated at 3.5, 86.6 degrees" in text
    shown = [line for line in text.splitlines() if not line.startswith("written to")]
    assert max(map(len, shown)) <= 100
    moving, fixed = (read_joint(out / f"{name}.yaml").joint for name in ("joint", "hinge"))
    np.testing.assert_allclose(moving.pose(moving.flexion).to_table(), ENDS, atol=1e-9)
    np.testing.assert_allclose(fixed.pose(moving.flexion[:1]).to_table(), ENDS[:1], atol=1e-9)
    np.testing.assert_allclose(fixed.femoral[0], [[0, 2, -40], [-1, 3, 41]])
    table = read_poses(out / "poses.csv")
    np.testing.assert_allclose(table, moving.pose(np.deg2rad(table[:, 0])).to_table(), atol=1e-9)
    assert table[:, 0] == pytest.approx(np.arange(0, 121, 5))
    document = json.loads((out / "result.json").read_text())
    assert document["calibration_flexion_deg"] == [3.5, 86.6]
    assert document["rmse"]["hinge"]["adduction"] > document["rmse"]["moving"]["adduction"]
    for name in ("axes", "motion"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
        assert not (out / "figures" / f"{name}.svg").exists()


def test_three_poses_make_the_general_joint(tmp_path, poses, axes, capsys):
    out = tmp_path / "out"
    words = ["joint", "fit", poses, "--axes", axes, "--at", "85", "45", "5", "--out", str(out)]
    assert main(words) == 0
    assert "axis through 3 poses, monotone" in capsys.readouterr().out
    joint = read_joint(out / "joint.yaml").joint
    assert np.rad2deg(joint.flexion) == pytest.approx([3.5, 45.0, 86.6])
    met = joint.pose(joint.flexion).to_table()
    np.testing.assert_allclose(met[1, 3:], [4, -35, 2.7], atol=1e-9)


def test_another_convention_is_read(tmp_path, axes):
    unit = np.array([180 / np.pi] * 3 + [1] * 3)
    there = np.asarray(convert((ENDS / unit).T, "femoral", "grood-suntay")).T * unit
    poses = write_poses(tmp_path / "gs.csv", there.tolist())
    out = tmp_path / "out"
    words = ["joint", "fit", poses, "--axes", axes, "--convention", "grood-suntay"]
    assert main([*words, "--out", str(out)]) == 0
    joint = read_joint(out / "joint.yaml").joint
    np.testing.assert_allclose(joint.pose(joint.flexion).to_table(), ENDS, atol=1e-9)


def test_from_a_mesh_of_either_side(tmp_path, poses, mesh, capsys, figures):
    out = tmp_path / "right"
    assert main(["joint", "fit", poses, "--femur", mesh, "--out", str(out)]) == 0
    assert "cylinder through both condyles" in capsys.readouterr().out
    right = read_joint(out / "joint.yaml").joint
    assert np.abs(np.asarray(right.femoral)[1, :, :2] - CENTERS[1, :, :2]).max() < 0.3
    with (out / "facets.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["facet"] for row in rows] == ["extension"] * 2 + ["flexion"] * 2
    # A left knee's mesh is the mirror image; its joint is the same, its file the mirror image.
    left = write_femur(tmp_path / "left.obj", mirror=-1)
    words = ["joint", "fit", poses, "--femur", left, "--side", "left"]
    assert main([*words, "--out", str(tmp_path / "left")]) == 0
    other = read_joint(tmp_path / "left" / "joint.yaml")
    assert other.side == "left"
    np.testing.assert_allclose(other.joint.femoral, right.femoral, atol=1e-6)


def test_two_poses_at_one_flexion(tmp_path, axes, capsys):
    same = ENDS * [0, 1, 1, 1, 1, 1] + [30.0, 0, 0, 0, 0, 0]
    poses = write_poses(tmp_path / "same.csv", same.tolist())
    line = refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
    assert "rows 1 and 2 at the same flexion, 30 degrees" in line


def test_two_poses_in_radians(tmp_path, axes, capsys):
    poses = write_poses(tmp_path / "rad.csv", np.c_[np.deg2rad(ENDS[:, :3]), ENDS[:, 3:]].tolist())
    line = refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
    assert "calibration poses: 1.45 degrees apart: expected at least 5 from" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--at", "20", "86"], "pose at 20 degrees: the nearest is at 3.5: expected one within 5"),
        (["--at", "3", "5"], "row 3 twice at the same flexion, 3.5 degrees"),
        (["--at", "86"], "86 degrees alone"),
        (["--flexion", "0:x"], "--flexion"),
        (["--medial-epicondyle", "0", "0", "-40"], "both epicondyles, or none"),
        (["--medial-epicondyle", *"0 0 40".split(), "--lateral-epicondyle", *"0 0 -40".split()],
         "changed places"),
    ],
)  # fmt: skip
def test_bad_choices(tmp_path, poses, axes, capsys, words, said):
    line = refused(["joint", "fit", poses, "--axes", axes, *words], capsys, tmp_path / "out")
    assert said in line


def test_one_pose(tmp_path, axes, capsys):
    poses = write_poses(tmp_path / "one.csv", ENDS[:1].tolist())
    line = refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
    assert "poses: 1: expected two or more" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--unit", "m"], "expected 30 to 200"),
        (["--extension-facet", "65", "66"], "medial extension facet"),
    ],
)
def test_bad_regions_of_a_mesh(tmp_path, poses, mesh, capsys, words, said):
    line = refused(["joint", "fit", poses, "--femur", mesh, *words], capsys, tmp_path / "out")
    assert said in line


def test_a_mesh_in_metres(tmp_path, poses, capsys):
    """It is recognised; forced to be mm, it is refused."""
    metres = write_femur(tmp_path / "metres.obj", scale=1e-3)
    assert main(["joint", "fit", poses, "--femur", metres, "--out", str(tmp_path / "good")]) == 0
    capsys.readouterr()
    words = ["joint", "fit", poses, "--femur", metres, "--unit", "mm"]
    assert "in metres" in refused(words, capsys, tmp_path / "out")


def test_a_flat_facet_is_doubtful(tmp_path, poses, mesh, capsys, monkeypatch):
    monkeypatch.setattr("kneejax.cli._joint_fit.FLATTEST_MM", 29.5)
    out = tmp_path / "out"
    assert main(["joint", "fit", poses, "--femur", mesh, "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "warning: medial extension facet: a radius of 30 mm is nearly flat" in said
    assert "nearly flat" in json.loads((out / "result.json").read_text())["doubts"][0]


TABLE = """axis,side,anterior_mm,superior_mm,lateral_mm
epicondyles,lateral,-1,3,41
epicondyles,medial,0,2,-40
extension,medial,6,8,-21.5
flexion,lateral,-2,1,23.5
flexion,medial,0.5,1.5,-21
extension,lateral,1,11,23
"""

@pytest.mark.parametrize("side", ["right", "left"])
def test_axis_points_in_a_table_mean_the_same_on_both_sides(tmp_path, poses, side):
    """In YAML Z is to the person's right; in a table lateral is lateral."""
    table, out = tmp_path / "axes.csv", tmp_path / "out"
    table.write_text(TABLE)
    words = ["joint", "fit", poses, "--axes", str(table), "--side", side]
    assert main([*words, "--out", str(out)]) == 0
    joint, hinge = (read_joint(out / f"{name}.yaml").joint for name in ("joint", "hinge"))
    points = [[[6, 8, -21.5], [1, 11, 23]], [[0.5, 1.5, -21], [-2, 1, 23.5]]]
    np.testing.assert_array_equal(joint.femoral, points)
    np.testing.assert_array_equal(hinge.femoral[0], [[0, 2, -40], [-1, 3, 41]])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("flexion,medial", "flexon,medial", "row 5 (line 6), axis: flexon: expected one of exten"),
        ("flexion,medial", "flexon,medial", "did you mean flexion?"),
        ("flexion,medial", "flexion,medal", "did you mean medial?"),
        ("flexion,medial", "flexion,lateral", "row 5 (line 6): flexion lateral again, as row 4"),
        ("flexion,medial,0.5,1.5,-21\n", "", "flexion medial: missing: expected this row beside"),
        ("epicondyles,medial,0,2,-40\n", "", "epicondyles medial: missing: expected this row"),
        ("6,8,-21.5", "6,high,-21.5", "row 3 (line 4), superior_mm: high: expected a number"),
        ("6,8,-21.5", "6,,-21.5", "row 3 (line 4), superior_mm: empty: expected a number"),
        ("6,8,-21.5", "6,inf,-21.5", "row 3 (line 4), superior_mm: inf: expected a finite number"),
        ("6,8,-21.5", "6,8", "row 3 (line 4): 4 cells: expected 5 cells"),
        ("superior_mm", "superior", "superior_mm: missing: expected this column"),
        ("6,8,-21.5", "1,11,22.9", "extension: medial and lateral point 0.1 mm apart: expected po"),
        (TABLE[TABLE.index("\n") + 1 :], "", "rows: none"),
    ],
)
def test_bad_tables_of_axis_points(tmp_path, poses, capsys, old, new, said):
    table = tmp_path / "axes.csv"
    table.write_text(TABLE.replace(old, new))
    line = refused(["joint", "fit", poses, "--axes", str(table)], capsys, tmp_path / "out")
    assert said in line and "axes.csv: " in line


def test_an_unknown_column_of_axis_points(tmp_path, poses, capsys):
    table = tmp_path / "axes.csv"
    table.write_text(TABLE.replace("_mm\n", "_mm,note\n").replace("1\n", "1,x\n"))
    rows = [row + ",x" * (5 - row.count(",")) for row in table.read_text().splitlines()]
    table.write_text("\n".join(rows))
    line = refused(["joint", "fit", poses, "--axes", str(table)], capsys, tmp_path / "out")
    assert "header: note: expected only axis, side" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "joint fit: POSES: none: expected a CSV of measured poses, or --knee"),
        (["POSES", "--knee", "four_ligament"], "a table and --knee: expected a CSV of meas"),
        (["POSES"], "joint fit: axis points: none: expected --femur MESH, --axes FILE"),
        (["--knee", "four_ligamnt"], "did you mean four_ligament?"),
        (["--knee", "nothing.json"], "nothing.json"),
        (["--knee", "four_ligament", "--side", "left"], "--side: side: left: expected right, as"),
        (["--knee", "four_ligament", "--convention", "tibial"],
         "--convention: tibial: expected a CSV of poses with it"),
        (["--knee", "four_ligament", "--column", "flexion_deg=a"],
         "--column: flexion_deg: expected a CSV of poses"),
        (["--knee", "four_ligament", "--flexion", "30"], "--flexion: poses: 1: expected two"),
        (["--knee", "four_ligament", "--at", "45"], "--at: flexion: 45 degrees alone: expected tw"),
        (["--knee", "four_ligament", "--at", "10", "12"], "--at: calibration poses: 2 degrees ap"),
        (["--knee", "four_ligament", "--at", "0", "500"], "--at: degrees: 0.0,500.0: expected ang"),
        (["--knee", "four_ligament", "--extension-facet", "65", "66"], "medial extension facet"),
        (["--knee", "four_ligament", "--tibia", "t.stl"],
         "--tibia: t.stl: expected --femur with it"),
        (["POSES", "--axes", "AXES", "--landmarks", "m.yaml"],
         "--landmarks: m.yaml: expected --femur"),
        (["POSES", "--axes", "AXES", "--unit", "mm"], "--unit: mm: expected --femur with it"),
        (["POSES", "--axes", "AXES", "--flexion-facet", "9", "99"],
         "--flexion-facet: 9 99: expected no"),
        (["POSES", "--femur", "f.obj", "--touching-within", "3"],
         "--touching-within: 3: expected --tibia with"),
        (["POSES", "--femur", "f.obj", "--tibia", "t.obj", "--flexion-facet", "9", "99"],
         "--flexion-facet: 9 99: expected no --axes or --tibia with it"),
    ],
)  # fmt: skip
def test_options_that_do_not_go_together(tmp_path, poses, axes, capsys, words, said):
    made = [{"POSES": poses, "AXES": axes}.get(word, word) for word in words]
    assert said in refused(["joint", "fit", *made], capsys, tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["joint", "fit", "p.csv", "--axs", "a"], "--axes"),
        (["joint", "fit", "p.csv", "--axes", "a", "--conventoin", "tibial"], "mean --convention"),
        (["joint", "fit", "p.csv", "--touching-within", "0"], "0: expected a number above 0"),
        (["joint", "exprt", "j.yaml"], "did you mean export"),
    ],
)
def test_unknown_options(words, said, capsys):
    assert main(words) == 2
    assert said in capsys.readouterr().err


def test_export(tmp_path, poses, axes, capsys):
    fitted, out = tmp_path / "fit", tmp_path / "export"
    assert main(["joint", "fit", poses, "--axes", axes, "--out", str(fitted)]) == 0
    assert main(["joint", "export", str(fitted / "joint.yaml"), "--out", str(out)]) == 0
    assert "SimmSpline" in (out / "custom_joint.xml").read_text()
    assert (out / "joint.osim").read_text().startswith("<?xml")
    table = read_poses(out / "coupled_coordinates.csv")
    joint = read_joint(fitted / "joint.yaml").joint
    np.testing.assert_allclose(table, joint.pose(np.deg2rad(table[:, 0])).to_table(), atol=1e-9)
    capsys.readouterr()
    words = ["joint", "export", str(fitted / "jiont.yaml")]
    assert "did you mean joint.yaml" in refused(words, capsys, tmp_path / "none")


@pytest.mark.skipif(not SHARED.is_dir(), reason="the measured knee is not here")
def test_the_measured_knee(tmp_path):
    """Calibrated on its two ends: exact there, and nearer to what lies between than the hinge."""
    names = [f"knee_{word}" for word in "flex_deg add_deg rot_deg tx_mm ty_mm tz_mm".split()]
    with (SHARED / "measured/dynamic_mri_passive_knee_kinematics.csv").open() as stream:
        table = [[float(row[name]) for name in names] for row in csv.DictReader(stream)]
    poses = write_poses(tmp_path / "measured.csv", table)
    mesh = SHARED / "meshes/lenhart2015-R-femur-cartilage.stl"
    out = tmp_path / "out"
    assert main(["joint", "fit", poses, "--femur", str(mesh), "--out", str(out)]) == 0
    joint = read_joint(out / "joint.yaml").joint
    ends = sorted(table)[0], sorted(table)[-1]
    np.testing.assert_allclose(joint.pose(joint.flexion).to_table(), ends, atol=1e-9)
    rmse = json.loads((out / "result.json").read_text())["rmse"]
    for name in ("anterior", "superior", "lateral"):
        assert rmse["moving"][name] < rmse["hinge"][name]
