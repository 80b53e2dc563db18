"""`kneejax joint fit` and `kneejax joint export`."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import read_joint, read_poses
from kneejax.geometry import COLUMNS, convert

sys.path.insert(0, str(Path(__file__).parents[1] / "joints"))
from condyles import CENTERS, condyles

SHARED = Path(__file__).parents[3] / "shared/data/lenhart2015"
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
    """The made-up femur as an OBJ file: strips of triangles, facing outwards."""
    points, normals = condyles(step_deg=2.0, step_mm=2.0)
    return _obj(tmp_path_factory.mktemp("mesh") / "femur.obj", points, normals)


def _obj(path, points, normals):
    faces, first = [], 0
    for low, high in ((60, 108), (60, 108), (112, 195), (112, 195)):
        wide, rows = len(np.arange(low, high, 2.0)), 11
        for i in range(rows - 1):
            for j in range(wide - 1):
                a = first + i * wide + j
                faces += [[a, a + wide, a + 1], [a + 1, a + wide, a + wide + 1]]
        first += wide * rows
    faces = np.array(faces)
    corner = points[faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inwards = np.einsum("ij,ij->i", across, normals[faces[:, 0]]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def test_from_axis_points(tmp_path, poses, axes, capsys):
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
        assert (out / "figures" / f"{name}.svg").exists()


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


def test_from_a_mesh_of_either_side(tmp_path, poses, mesh, capsys):
    out = tmp_path / "right"
    assert main(["joint", "fit", poses, "--femur", mesh, "--out", str(out)]) == 0
    assert "cylinder through both condyles" in capsys.readouterr().out
    right = read_joint(out / "joint.yaml").joint
    assert np.abs(np.asarray(right.femoral)[1, :, :2] - CENTERS[1, :, :2]).max() < 0.3
    with (out / "facets.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["facet"] for row in rows] == ["extension"] * 2 + ["flexion"] * 2
    # A left knee's mesh is the mirror image; its joint is the same, its file the mirror image.
    points, normals = condyles(step_deg=2.0, step_mm=2.0)
    mirror = [1, 1, -1]
    left = _obj(tmp_path / "left.obj", points * mirror, normals * mirror)
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
    points, normals = condyles(step_deg=2.0, step_mm=2.0)
    metres = _obj(tmp_path / "metres.obj", points * 1e-3, normals)
    assert main(["joint", "fit", poses, "--femur", metres, "--out", str(tmp_path / "good")]) == 0
    capsys.readouterr()
    words = ["joint", "fit", poses, "--femur", metres, "--unit", "mm"]
    assert "in metres" in _refused(words, capsys, tmp_path / "out")


def test_collinear_landmarks(tmp_path, poses, mesh, capsys):
    marks = tmp_path / "landmarks.yaml"
    marks.write_text(
        "hip_center_mm: [0, 0, 400]\n"
        "epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}\n"
    )
    words = ["joint", "fit", poses, "--femur", mesh, "--landmarks", str(marks)]
    assert "nearly collinear" in _refused(words, capsys, tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["joint", "fit", "p.csv", "--axs", "a"], "--axes"),
        (["joint", "fit", "p.csv", "--axes", "a", "--conventoin", "tibial"], "mean --convention"),
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
