"""`kneejax joint fit` of meshes: landmarks place them, facets are where bones touch."""

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import read_joint
from kneejax.geometry import Pose
from kneejax.joints import condyle_axes, touching_rows
from tests.cli.joint.fitting import refused, write_poses
from tests.joints.bones import PLATEAU, TOUCHING, write_bones, write_scanned_bones
from tests.joints.condyles import CENTERS, condyles


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


def test_facets_are_where_bones_touch_wherever_a_scanner_saw_them(tmp_path, capsys):
    """Balls of bone and landmarks bring meshes back into the frames of the poses, on both sides."""
    poses = write_poses(tmp_path / "touching.csv", TOUCHING)
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
        assert "\nwithin 2.5 mm of the tibia at -10.0 and 60.0 degrees" in said
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
    poses = write_poses(tmp_path / "away.csv", away.tolist())
    words = ["joint", "fit", poses, "--femur", str(tmp_path / "femur.obj")]
    words += ["--tibia", str(tmp_path / "tibia.obj")]
    line = refused(words, capsys, tmp_path / "out")
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
    poses = write_poses(tmp_path / "touching.csv", TOUCHING)
    words = ["joint", "fit", poses, "--landmarks", str(marks)]
    words += ["--femur", str(tmp_path / "femur.obj"), "--tibia", str(tmp_path / "tibia.obj")]
    line = refused(words, capsys, tmp_path / "out")
    assert said in line and "marks.yaml: " in line


def test_collinear_landmarks(tmp_path, poses, mesh, capsys):
    marks = tmp_path / "landmarks.yaml"
    marks.write_text(
        "hip_center_mm: [0, 0, 400]\n"
        "epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}\n"
    )
    words = ["joint", "fit", poses, "--femur", mesh, "--landmarks", str(marks)]
    assert "nearly collinear" in refused(words, capsys, tmp_path / "out")
