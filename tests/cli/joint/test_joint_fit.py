"""`kneejax joint fit` and `kneejax joint export`."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import kneejax as kj
from kneejax.cli import main
from kneejax.files import read_axis_points, read_joint, read_poses
from kneejax.geometry import COLUMNS, FREE_COORDINATES, Pose, convert
from kneejax.joints import condyle_axes, touching_rows
from kneejax.mechanics import condyle_points

sys.path.insert(0, str(Path(__file__).parents[2] / "joints"))
from bones import PLATEAU, TOUCHING, write_bones, write_femur, write_scanned_bones
from condyles import CENTERS, condyles

SHARED = Path(__file__).parents[4] / "shared/data/lenhart2015"
ENDS = np.array([[3.5, 0.1, 5.1, -3.4, -34.6, 4.8], [86.6, -2.6, 11.3, 10.6, -33.5, 2.6]])
AXES = """
extension: {medial_mm: [6, 8, -21.5], lateral_mm: [1, 11, 23]}
flexion: {medial_mm: [0.5, 1.5, -21], lateral_mm: [-2, 1, 23.5]}
epicondyles: {medial_mm: [0, 2, -40], lateral_mm: [-1, 3, 41]}
"""


def _write_poses(path, table, columns=COLUMNS):
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, r)) for r in table)]))
    return str(path)


@pytest.fixture
def poses(tmp_path):
    middle = [[45.0, -1.6, 9.6, 4.0, -35.0, 2.7]]
    return _write_poses(tmp_path / "poses.csv", np.r_[ENDS[1:], middle, ENDS[:1]].tolist())


@pytest.fixture
def axes(tmp_path):
    (tmp_path / "axes.yaml").write_text(AXES)
    return str(tmp_path / "axes.yaml")


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    return write_femur(tmp_path_factory.mktemp("mesh") / "femur.obj")


@pytest.fixture
def figures():
    """A test that has it wants the figures."""


@pytest.fixture(autouse=True)
def drawn_only_where_wanted(request, monkeypatch):
    """Drawing takes longer than all else."""
    if "figures" not in request.fixturenames:
        monkeypatch.setattr("kneejax.cli.joint._fit._write_figures", lambda *_: None)


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
    poses = _write_poses(tmp_path / "gs.csv", there.tolist())
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


def test_landmarks_place_the_mesh(tmp_path, poses, mesh):
    """Landmarks 10 mm away from the mesh's origin: the points move by as much."""
    marks = tmp_path / "landmarks.yaml"
    marks.write_text(
        "hip_center_mm: [0, 400, 0]\n"
        "epicondyles: {medial_mm: [0, 10, -40], lateral_mm: [0, 10, 40]}\n"
    )
    for name, words in (("plain", []), ("placed", ["--landmarks", str(marks)])):
        out = ["--out", str(tmp_path / name)]
        assert main(["joint", "fit", poses, "--femur", mesh, *words, *out]) == 0
    plain, placed = (
        np.asarray(read_joint(tmp_path / name / "joint.yaml").joint.femoral)
        for name in ("plain", "placed")
    )
    np.testing.assert_allclose(placed, plain - [0, 10, 0], atol=1e-6)
    hinge = read_joint(tmp_path / "placed" / "hinge.yaml").joint
    np.testing.assert_allclose(hinge.femoral[0], [[0, 0, -40], [0, 0, 40]], atol=1e-9)


def _refused(words, capsys, out):
    assert main([*words, "--out", str(out)]) == 2
    assert not out.exists()
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    return line


def test_two_poses_at_one_flexion(tmp_path, axes, capsys):
    same = ENDS * [0, 1, 1, 1, 1, 1] + [30.0, 0, 0, 0, 0, 0]
    poses = _write_poses(tmp_path / "same.csv", same.tolist())
    line = _refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
    assert "rows 1 and 2 at the same flexion, 30 degrees" in line


def test_two_poses_in_radians(tmp_path, axes, capsys):
    poses = _write_poses(tmp_path / "rad.csv", np.c_[np.deg2rad(ENDS[:, :3]), ENDS[:, 3:]].tolist())
    line = _refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
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
    line = _refused(["joint", "fit", poses, "--axes", axes, *words], capsys, tmp_path / "out")
    assert said in line


def test_one_pose(tmp_path, axes, capsys):
    poses = _write_poses(tmp_path / "one.csv", ENDS[:1].tolist())
    line = _refused(["joint", "fit", poses, "--axes", axes], capsys, tmp_path / "out")
    assert "poses: 1: expected two or more" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--unit", "m"], "expected 30 to 200"),
        (["--extension-facet", "65", "66"], "medial extension facet"),
    ],
)
def test_bad_regions_of_a_mesh(tmp_path, poses, mesh, capsys, words, said):
    line = _refused(["joint", "fit", poses, "--femur", mesh, *words], capsys, tmp_path / "out")
    assert said in line


def test_a_mesh_in_metres(tmp_path, poses, capsys):
    """It is recognised; forced to be mm, it is refused."""
    metres = write_femur(tmp_path / "metres.obj", scale=1e-3)
    assert main(["joint", "fit", poses, "--femur", metres, "--out", str(tmp_path / "good")]) == 0
    capsys.readouterr()
    words = ["joint", "fit", poses, "--femur", metres, "--unit", "mm"]
    assert "in metres" in _refused(words, capsys, tmp_path / "out")


def test_facets_are_where_bones_touch_wherever_a_scanner_saw_them(tmp_path, capsys):
    """Balls of bone and landmarks bring meshes back into the frames of the poses, on both sides."""
    poses = _write_poses(tmp_path / "touching.csv", TOUCHING)
    found = {}
    for side in ("", "right", "left"):
        folder = tmp_path / f"seen {side}"
        folder.mkdir()
        write_scanned_bones(folder, side) if side else write_bones(folder)
        words = ["--femur", str(folder / "femur.obj"), "--tibia", str(folder / "tibia.obj")]
        words += ["--landmarks", str(folder / "landmarks.yaml"), "--side", side] if side else []
        words += ["--touching-within", "2.5", "--out", str(folder / "out")]
        assert main(["joint", "fit", poses, *words]) == 0
        said = capsys.readouterr().out
        assert "facets: within 2.5 mm of the tibia at -10.0 and 60.0 degrees" in said
        found[side] = read_joint(folder / "out" / "joint.yaml")
        if side:
            assert found[side].side == side
            own = found[""].joint.femoral
            np.testing.assert_allclose(found[side].joint.femoral, own, atol=1e-6)
            hinge = read_joint(folder / "out" / "hinge.yaml").joint
            np.testing.assert_allclose(hinge.femoral[0], [[0, 0, -40], [0, 0, 40]], atol=1e-6)
    points, normals = condyles(step_deg=2.0, step_mm=2.0)
    touching = [touching_rows(points, PLATEAU, Pose.from_table(row), 2.5) for row in TOUCHING]
    expected = condyle_axes(points, normals, touching=tuple(touching)).points
    np.testing.assert_allclose(found[""].joint.femoral, expected, atol=1e-9)
    # Arcs of 50 degrees, round across: known to this along the radius.
    assert np.abs(expected - CENTERS)[..., :2].max() < 0.8


def test_bones_that_do_not_touch(tmp_path, capsys):
    write_bones(tmp_path)
    away = np.array(TOUCHING) - [0, 0, 0, 0, 30, 0]
    poses = _write_poses(tmp_path / "away.csv", away.tolist())
    words = ["joint", "fit", poses, "--femur", str(tmp_path / "femur.obj")]
    words += ["--tibia", str(tmp_path / "tibia.obj")]
    line = _refused(words, capsys, tmp_path / "out")
    assert "tibia.obj: femur and tibia at -10.0 degrees: " in line
    assert "nearer than 4 mm" in line and "--touching-within" in line


MARKS = """
hip_center_mm: [0, 400, 0]
epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}
tibia:
  plateau: {medial_mm: [0, 0, -36], lateral_mm: [0, 0, 36]}
  ankle_center_mm: [0, -370, 0]
"""
ANKLE = "ankle_center_mm: [0, -370, 0]"
BALL = "{medial_ball: {near_mm: [0, -370, -30], within_mm: 9}, lateral_mm: [0, -370, 30]}"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (MARKS[MARKS.index("tibia") :], "", "tibia: missing: expected landmarks of the tibia"),
        ("tibia:", "tibya:", "did you mean tibia?"),
        ("plateau:", "platau:", "did you mean plateau?"),
        (ANKLE, "", "tibia: neither: expected ankle_center_mm or malleoli"),
        (ANKLE, "malleoli: {}", "tibia.malleoli: neither: expected medial_mm or medial_ball"),
        (ANKLE, "malleoli: {medial_bal: 1}", "did you mean medial_ball?"),
        (ANKLE, f"malleoli: {BALL}", "points within 9 mm of (0, -370, -30) mm: 0: expected at le"),
        (ANKLE, "ankle_center_mm: [0, x, 0]", "tibia.ankle_center_mm[1]: x: expected a number"),
        (ANKLE, "ankle_center_mm: [0, 0, 370]", "nearly collinear"),
        ("medial_mm: [0, 0, -36]", "medial_mm: [0, 0, 35.9]", "medial edge and lateral edge: 0.1"),
        (
            "hip_center_mm: [0, 400, 0]",
            "femoral_head: {near_mm: [0, 400, 0], within_mm: 30}",
            "points within 30 mm of (0, 400, 0) mm: 0",
        ),
    ],
)
def test_bad_landmarks(tmp_path, capsys, old, new, said):
    write_bones(tmp_path)
    marks = tmp_path / "marks.yaml"
    marks.write_text(MARKS.replace(old, new))
    poses = _write_poses(tmp_path / "touching.csv", TOUCHING)
    words = ["joint", "fit", poses, "--landmarks", str(marks)]
    words += ["--femur", str(tmp_path / "femur.obj"), "--tibia", str(tmp_path / "tibia.obj")]
    line = _refused(words, capsys, tmp_path / "out")
    assert said in line and "marks.yaml: " in line


def test_a_flat_facet_is_doubtful(tmp_path, poses, mesh, capsys, monkeypatch):
    monkeypatch.setattr("kneejax.cli.joint._axes.FLATTEST_MM", 29.5)
    out = tmp_path / "out"
    assert main(["joint", "fit", poses, "--femur", mesh, "--out", str(out)]) == 1
    assert "! medial extension facet: a radius of 30 mm is nearly flat" in capsys.readouterr().out
    assert "nearly flat" in json.loads((out / "result.json").read_text())["doubts"][0]


def test_collinear_landmarks(tmp_path, poses, mesh, capsys):
    marks = tmp_path / "landmarks.yaml"
    marks.write_text(
        "hip_center_mm: [0, 0, 400]\n"
        "epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}\n"
    )
    words = ["joint", "fit", poses, "--femur", mesh, "--landmarks", str(marks)]
    assert "nearly collinear" in _refused(words, capsys, tmp_path / "out")


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
    line = _refused(["joint", "fit", poses, "--axes", str(table)], capsys, tmp_path / "out")
    assert said in line and "axes.csv: " in line


def test_an_unknown_column_of_axis_points(tmp_path, poses, capsys):
    table = tmp_path / "axes.csv"
    table.write_text(TABLE.replace("_mm\n", "_mm,note\n").replace("1\n", "1,x\n"))
    rows = [row + ",x" * (5 - row.count(",")) for row in table.read_text().splitlines()]
    table.write_text("\n".join(rows))
    line = _refused(["joint", "fit", poses, "--axes", str(table)], capsys, tmp_path / "out")
    assert "header: note: expected only axis, side" in line


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
    line = _refused(["joint", "fit", "--knee", str(result)], capsys, tmp_path / "out")
    assert f"{result}: unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?" in line


def test_poses_without_balance_are_refused_or_said(tmp_path, capsys):
    words = ["joint", "fit", "--knee", "four_ligament", "--flexion=-30:170:8"]
    line = _refused(words, capsys, tmp_path / "none")
    assert "four_ligament: pose at -30 degrees: not_converged: expected a pose with bal" in line
    assert "choose by --at, from" in line
    out = tmp_path / "out"
    assert main([*words, "--at", "10", "50", "90", "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "axis through 3 poses, monotone: calibrated at 10.0, 50.0, 90.0 degrees" in said
    assert "! four_ligament: " in said and "not_converged: no balance found" in said
    with (out / "knee_poses.csv").open() as stream:
        rows = {float(row["flexion_deg"]): row for row in csv.DictReader(stream)}
    assert rows[-30.0]["status"] == "not_converged" and rows[-30.0]["anterior_mm"] == "nan"
    document = json.loads((out / "result.json").read_text())
    assert document["doubts"] and np.isfinite(document["rmse"]["moving"]["anterior"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "joint fit: poses: none: expected a CSV of measured poses, or --knee"),
        (["POSES", "--knee", "four_ligament"], "a table and --knee: expected a CSV of meas"),
        (["POSES"], "joint fit: axis points: none: expected --femur MESH, --axes FILE"),
        (["--knee", "four_ligamnt"], "did you mean four_ligament?"),
        (["--knee", "nothing.json"], "nothing.json"),
        (["--knee", "four_ligament", "--side", "left"], "--side: side: left: expected right, as"),
        (["--knee", "four_ligament", "--convention", "tibial"], "beside a CSV of poses only"),
        (["--knee", "four_ligament", "--column", "flexion_deg=a"], "flexion_deg=a: expected this"),
        (["--knee", "four_ligament", "--flexion", "30"], "--flexion: poses: 1: expected two"),
        (["--knee", "four_ligament", "--at", "45"], "--at: flexion: 45 degrees alone: expected tw"),
        (["--knee", "four_ligament", "--at", "10", "12"], "--at: calibration poses: 2 degrees ap"),
        (["--knee", "four_ligament", "--at", "0", "500"], "--at: degrees: 0.0,500.0: expected ang"),
        (["--knee", "four_ligament", "--extension-facet", "65", "66"], "medial extension facet"),
        (["--knee", "four_ligament", "--tibia", "t.stl"], "--tibia: option: t.stl: expected this"),
        (["POSES", "--axes", "AXES", "--landmarks", "m.yaml"], "--landmarks: option: m.yaml"),
        (["POSES", "--axes", "AXES", "--unit", "mm"], "this option beside --femur only"),
        (["POSES", "--axes", "AXES", "--flexion-facet", "9", "99"], "--flexion-facet: option: 9 9"),
        (["POSES", "--femur", "f.obj", "--touching-within", "3"], "beside --tibia only"),
        (["POSES", "--femur", "f.obj", "--tibia", "t.obj", "--flexion-facet", "9", "99"],
         "this option or --tibia, one of both"),
    ],
)  # fmt: skip
def test_options_that_do_not_go_together(tmp_path, poses, axes, capsys, words, said):
    made = [{"POSES": poses, "AXES": axes}.get(word, word) for word in words]
    assert said in _refused(["joint", "fit", *made], capsys, tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["joint", "fit", "p.csv", "--axs", "a"], "--axes"),
        (["joint", "fit", "p.csv", "--axes", "a", "--conventoin", "tibial"], "mean --convention"),
        (["joint", "fit", "p.csv", "--touching-within", "0"], "0: expected mm above 0"),
        (["joint", "exprt", "j.yaml"], "did you mean export"),
    ],
)
def test_unknown_options(words, said, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
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
    assert "did you mean joint.yaml" in _refused(words, capsys, tmp_path / "none")


@pytest.mark.skipif(not SHARED.is_dir(), reason="the measured knee is not here")
def test_the_measured_knee(tmp_path):
    """Calibrated on its two ends: exact there, and nearer to what lies between than the hinge."""
    names = [f"knee_{word}" for word in "flex_deg add_deg rot_deg tx_mm ty_mm tz_mm".split()]
    with (SHARED / "measured/dynamic_mri_passive_knee_kinematics.csv").open() as stream:
        table = [[float(row[name]) for name in names] for row in csv.DictReader(stream)]
    poses = _write_poses(tmp_path / "measured.csv", table)
    mesh = SHARED / "meshes/lenhart2015-R-femur-cartilage.stl"
    out = tmp_path / "out"
    assert main(["joint", "fit", poses, "--femur", str(mesh), "--out", str(out)]) == 0
    joint = read_joint(out / "joint.yaml").joint
    ends = sorted(table)[0], sorted(table)[-1]
    np.testing.assert_allclose(joint.pose(joint.flexion).to_table(), ends, atol=1e-9)
    rmse = json.loads((out / "result.json").read_text())["rmse"]
    for name in ("anterior", "superior", "lateral"):
        assert rmse["moving"][name] < rmse["hinge"][name]
