"""Mistakes of people who bring a knee of their own: one line each, status 2, nothing written."""

from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.cli.options.joints import JointFit
from kneejax.cli.options.knees import ImportOsim
from tests.files.meshes import meshed_knee as made

MODELS = Path(__file__).parents[1] / "files" / "opensim" / "models"
LEFT, RIGHT = MODELS / "left_schema4.osim", MODELS / "right_schema3.osim"
HEADER = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm"


def refusal(words, capsys, out):
    status = main([str(word) for word in words])
    error = capsys.readouterr().err
    assert status == 2, error
    assert error.count("\n") == 1 and not out.exists()
    return error


def model(folder, *pairs):
    text = RIGHT.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "model.osim"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([("Blankevoort1991Ligament", "Other")],
         ("Model meadow", "ligaments: none", "Blankevoort1991Ligament")),
        ([("<body>Unterschenkel_r", "<body>Unterschenke_r")],
         ("PathPoint b2", "body: Unterschenke_r", "did you mean Unterschenkel_r?")),
        ([("</ForceSet>", "</Forces>")],
         ("line 178, column 14: mismatched tag Forces for ForceSet of line 133",
          "well-formed XML")),
        ([("<radius>0.0155", "<radius>0")], ("WrapSphere Knauf", "radius: 0:", "above 0")),
        ([("0.001 -0.405 -0.043", "0.001 -0.405 -0.023")],
         ("Band1", "b1: 13.3 mm inside the sphere Knauf", "--inside straight")),
    ],
)  # fmt: skip
def test_a_bad_model(pairs, words, tmp_path, capsys):
    out = tmp_path / "out"
    line = refusal(
        ["import", "osim", model(tmp_path, *pairs), "--side", "r", "--out", out], capsys, out
    )
    assert str(tmp_path / "model.osim") in line
    for word in words:
        assert word in line


def test_no_model_at_all(tmp_path, capsys):
    out, binary = tmp_path / "out", tmp_path / "knee.stl"
    binary.write_bytes(bytes(range(200)))
    (tmp_path / "empty.osim").touch()
    for path, words in (
        (binary, "binary data: expected an OpenSim model"),
        (tmp_path, "a folder"),
        (tmp_path / "empty.osim", "empty"),
        (tmp_path / "emty.osim", "did you mean empty.osim?"),
    ):
        line = refusal(["import", "osim", path, "--side", "r", "--out", out], capsys, out)
        assert words in line


def test_a_side_is_given_by_its_letter_or_in_full(tmp_path, capsys):
    out = tmp_path / "out"
    line = refusal(["import", "osim", RIGHT, "--side", "both", "--out", out], capsys, out)
    assert "expected one of r, l" in line and "did you mean" not in line
    assert ImportOsim.read({"file": RIGHT, "side": "right"}).side == "r"
    assert JointFit.read({"knee": "four_ligament", "side": "l"}).side == "left"


def test_femur_and_tibia_that_changed_places_are_doubted(tmp_path, capsys):
    words = ["--femur", "Unterschenkel_r", "--tibia", "Oberschenkel_r", "--inside", "straight"]
    out = str(tmp_path / "out")
    assert main(["import", "osim", str(RIGHT), "--side", "r", *words, "--out", out]) == 1
    assert "have --femur and --tibia changed places?" in capsys.readouterr().out


@pytest.fixture
def meshes(tmp_path):
    return {
        "femur": made.written(tmp_path / "femur.stl", made.femoral()),
        "tibia": made.written(tmp_path / "tibia.stl", made.tibial()),
    }


def from_meshes(meshes, out, *more):
    return [
        "import", "stl", "--femur-cartilage", meshes["femur"], "--tibia-cartilage",
        meshes["tibia"], "--side", "r", "--out", out, *more,
    ]  # fmt: skip


def test_meshes_of_no_knee(meshes, tmp_path, capsys):
    out, (points, faces) = tmp_path / "out", made.tibial()
    one = made.written(tmp_path / "one.stl", (points[:3], np.array([[0, 1, 2]])))
    far = made.written(tmp_path / "far.stl", (points - [0.0, 90.0, 0.0], faces))
    (tmp_path / "words.stl").write_text("solid ideas", encoding="utf-8")
    (tmp_path / "knee.vtk").write_text("<VTKFile/>", encoding="utf-8")
    for changed, words in (
        ({"tibia": one}, "one.stl: faces: 1 triangle: expected"),
        ({"tibia": far}, "far.stl: place: 90 mm apart: expected within 50 mm"),
        ({"femur": tmp_path / "words.stl"}, "no triangles"),
        ({"femur": tmp_path / "knee.vtk"}, "ending in .stl, .ply, .obj, .vtp"),
        ({"femur": meshes["tibia"], "tibia": meshes["femur"]}, "changed places?"),
        ({"tibia": meshes["femur"]}, "--tibia-cartilage: file: "),
    ):
        assert words in refusal(from_meshes(meshes | changed, out), capsys, out)


@pytest.mark.slow
def test_cartilage_thinner_than_zero(meshes, tmp_path, capsys):
    out = tmp_path / "out"
    bones = [
        "--femur-bone", made.written(tmp_path / "a.stl", made.femoral(inwards=-1.5)),
        "--tibia-bone", made.written(tmp_path / "b.stl", made.tibial(down=3.0)),
    ]  # fmt: skip
    line = refusal(from_meshes(meshes, out, *bones), capsys, out)
    assert "a.stl: thickness: negative over 100 % of the cartilage" in line


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--modulus", "0"], "--modulus: Young's modulus: 0.0"),
        (["--modulus", "1e30"], "between 0.001 and 100,000 MPa; Pa are suspected"),
        (["--modulus", "nan"], "--modulus: Young's modulus: nan"),
        (["--poisson-ratio", "0.5"], "between 0 and 0.4999"),
        (["--layer-thickness", "0.006"], "between 0.1 and 50 mm; metres"),
        (["--layer-thickness", "6", "--thickness", "field"], "where --layer-thickness gives"),
        (["--femur-bone", "bone.stl"], "--tibia-bone: file: missing"),
        (["--angle", "200", "60"], "--angle: region: 200 60"),
        (["--angle", "0.6", "4.2"], "in degrees"),
        (["--split", "90"], "--split: compartments: 90.0"),
        (["--axis-rotation", "1", "2", "0"], "--axis-point: axis: missing"),
        (["--unit", "m"], "is the unit right?"),
    ],
)
def test_choices_are_refused_before_the_fit(more, words, meshes, tmp_path, capsys):
    out = tmp_path / "out"
    assert words in refusal(from_meshes(meshes, out, *more), capsys, out)


def test_another_file_in_the_place_of_a_knee(meshes, tmp_path, capsys):
    out, poses = tmp_path / "out", tmp_path / "poses.csv"
    poses.write_text(f"{HEADER}\n0,0,0,0,1,0\n", encoding="utf-8")
    (tmp_path / "imported").mkdir()
    (tmp_path / "imported" / "knee.yaml").touch()
    for knee, words in (
        (RIGHT, "an OpenSim model: expected a knee file, which kneejax import osim makes"),
        (meshes["femur"], "a mesh: expected a knee file, which kneejax import stl makes"),
        (poses, "a table of poses is given after the knee"),
        (tmp_path / "imported", f"did you mean {tmp_path / 'imported' / 'knee.yaml'}?"),
    ):
        for command in ("evaluate", "view"):
            assert words in refusal([command, knee, poses, "--out", out], capsys, out)
    swapped = ["export", "osim", RIGHT, tmp_path / "imported" / "knee.yaml", "--out", out]
    assert "kneejax import osim makes" in refusal(swapped, capsys, out)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (HEADER.replace(",anterior_mm", "") + "\n0,0,0,1,0\n", "anterior_mm: missing"),
        ("name: a knee\nside: right\n", f"{HEADER.replace(',', ', ')}: missing"),
        (HEADER + "\n0,0,0,0.001,-0.03,0.001\n", "metres are suspected"),
    ],
)
def test_a_bad_table_of_poses(table, words, tmp_path, capsys):
    out, poses = tmp_path / "out", tmp_path / "poses.csv"
    poses.write_text(table, encoding="utf-8")
    line = refusal(["evaluate", "four_ligament", poses, "--out", out], capsys, out)
    assert words in line and "did you mean superior_mm?" not in line


def test_a_place_that_is_none_is_refused_before_the_work(tmp_path, capsys):
    file = tmp_path / "results"
    file.touch()
    for out in (file, file / "deeper"):
        for words in (
            ["import", "osim", RIGHT, "--side", "r"],
            ["evaluate", "four_ligament", tmp_path / "poses.csv"],
            ["view", "four_ligament"],
        ):
            line = refusal([*words, "--out", out], capsys, tmp_path / "never")
            assert line.startswith("kneejax: --out: folder: ")
    line = refusal(
        ["export", "osim", "four_ligament", RIGHT, "--out", tmp_path], capsys, tmp_path / "never"
    )
    assert "this is a folder" in line


def test_a_model_that_the_knee_is_not_from(tmp_path, capsys):
    arguments = ["import", "osim", str(RIGHT), "--side", "r", "--out", str(tmp_path / "knee")]
    assert main(arguments) == 0
    capsys.readouterr()
    new = tmp_path / "new.osim"
    words = ["export", "osim", tmp_path / "knee" / "knee.yaml", LEFT, "--out", new]
    assert "the model that the knee came from, right_schema3.osim" in refusal(words, capsys, new)
