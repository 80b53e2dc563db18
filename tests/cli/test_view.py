"""`kneejax view` end to end, and what it says where it cannot draw."""

import sys

import pytest

from kneejax import report
from kneejax.cli import main
from kneejax.files import read_patella_poses
from kneejax.statics import Status

POSES = (
    "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"
    "0,0,0,0,0.5,0\n30,1,4,2,-0.5,0.5\n"
)


@pytest.fixture
def poses(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(POSES)
    return path


@pytest.fixture
def drawn(monkeypatch):
    """Pictures in space replaced by a word: this machine may draw none."""
    monkeypatch.setattr("kneejax.cli._look.check_installed", lambda package, extra: None)
    monkeypatch.setattr(report, "scene_page", lambda scenes: f"page of {len(scenes)}")
    monkeypatch.setattr(report, "scene_figure", lambda scene: None)
    monkeypatch.setattr(report, "scenes_figure", lambda scenes: None)
    monkeypatch.setattr(report, "picture_png", lambda figure: b"picture")
    monkeypatch.setattr(report, "film", lambda scenes: b"film")


def test_a_motion_is_drawn_and_named(drawn, poses, tmp_path, capsys):
    out = tmp_path / "view"
    assert main(["view", "four_ligament", str(poses), "--out", str(out)]) == 0
    names = {"scene.html", "scene.png", "pressure.png", "motion.png", "motion.gif"}
    names.add("settings.json")
    assert {path.name for path in out.iterdir()} == names
    printed = capsys.readouterr().out
    assert "2 poses" in printed and all(name in printed for name in names)
    assert (out / "scene.html").read_text() == "page of 2"


def test_without_poses_the_reference_pose_is_drawn(drawn, tmp_path):
    assert main(["view", "four_ligament", "--out", str(tmp_path)]) == 0
    assert not (tmp_path / "motion.png").exists()
    assert (tmp_path / "scene.html").read_text() == "page of 1"


def test_a_pose_that_is_no_knee_is_drawn_and_said(drawn, tmp_path, capsys):
    poses, out = tmp_path / "poses.csv", tmp_path / "view"
    poses.write_text(POSES + "30,1,4,2,40,0.5\n")
    assert main(["view", "four_ligament", str(poses), "--out", str(out)]) == 1
    assert (out / "scene.html").exists()
    assert f"2 (row): {Status.THROUGH_BONE.remark}" in capsys.readouterr().out


def test_without_a_driver_the_page_is_there_and_the_reason_is_said(
    drawn, poses, tmp_path, capsys, monkeypatch
):
    def fail(scene):
        raise report.CannotRender("nothing to draw with")

    monkeypatch.setattr(report, "scene_figure", fail)
    assert main(["view", "four_ligament", str(poses), "--out", str(tmp_path / "o")]) == 1
    assert "nothing to draw with" in capsys.readouterr().err
    assert {p.name for p in (tmp_path / "o").iterdir()} == {
        "scene.html", "settings.json", "pressure.png",
    }  # fmt: skip


def test_without_the_extra_nothing_is_written(poses, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert main(["view", "four_ligament", str(poses), "--out", str(tmp_path / "o")]) == 2
    said = capsys.readouterr().err
    assert "pip install 'kneejax[view]'" in said and said.count("\n") == 1
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("name", ["four_ligamnt", "missing.yaml"])
def test_an_unknown_knee_is_refused(name, tmp_path, capsys):
    assert main(["view", name, "--out", str(tmp_path / "o")]) == 2
    assert not (tmp_path / "o").exists()


def block(path, center_mm, unit=1.0):
    """A box as an STL file."""
    import trimesh

    box = trimesh.creation.box((60.0 * unit, 60.0 * unit, 80.0 * unit))
    box.apply_translation([x * unit for x in center_mm])
    box.export(path)
    return str(path)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_bones_are_shown_in_mm(drawn, poses, tmp_path, monkeypatch, unit):
    seen = []
    monkeypatch.setattr(report, "scene_page", lambda scenes: seen.append(scenes) or "page")
    femur = block(tmp_path / "femur.stl", (0.0, 20.0, 0.0), unit)
    tibia = block(tmp_path / "tibia.stl", (0.0, -50.0, 0.0), unit)
    bones = ["--femur-bone", femur, "--tibia-bone", tibia]
    out = ["--out", str(tmp_path / "o")]
    assert main(["view", "four_ligament", str(poses), *bones, *out]) == 0
    assert [bone.bone for bone in seen[0][1].bones] == ["femur", "tibia"]
    still = seen[0][1].bones[1].points_mm
    assert still.max(axis=0) == pytest.approx([30.0, -20.0, 40.0], abs=1e-4)


def test_a_bone_in_another_frame_is_refused(drawn, poses, tmp_path, capsys):
    far = block(tmp_path / "femur.stl", (0.0, 700.0, 0.0))
    out = tmp_path / "o"
    assert main(["view", "four_ligament", "--femur-bone", far, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "--femur-bone" in said and "frame" in said and said.count("\n") == 1
    assert not out.exists()


def test_a_table_says_where_the_patella_is_or_which_column_is_missing(tmp_path, capsys):
    names = POSES.splitlines()[0]
    own = ("flexion_deg", "rotation_deg", "tilt_deg", "anterior_mm", "superior_mm", "lateral_mm")
    columns = [f"patella_{name}" for name in own]
    table = tmp_path / "poses.csv"
    table.write_text(f"{names},{','.join(columns)}\n30,1,4,2,-0.5,0.5,20,1,-2,45,3,4\n")
    assert read_patella_poses(table).tolist() == [[20.0, 1.0, -2.0, 45.0, 3.0, 4.0]]
    table.write_text(f"{names},{','.join(columns[:2])}\n30,1,4,2,-0.5,0.5,20,1\n")
    assert main(["view", "four_ligament", str(table), "--out", str(tmp_path / "out")]) == 2
    missing = ", ".join(columns[2:])
    assert f"{missing}: missing" in capsys.readouterr().err
    table.write_text(f"{names}\n30,1,4,2,-0.5,0.5\n")
    assert read_patella_poses(table) is None
    assert main(["view", "four_ligament", str(table), "--patella", "--out", str(tmp_path)]) == 2
    assert f"{', '.join(columns)}: missing" in capsys.readouterr().err
