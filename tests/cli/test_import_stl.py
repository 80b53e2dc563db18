"""`kneejax import stl` writes a knee that computes, a report and a picture; or nothing."""

import csv

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import load_knee_file
from tests.files.meshes import meshed_knee as made


@pytest.fixture
def words(tmp_path):
    femur = made.written(tmp_path / "femur.stl", made.femoral())
    tibia = made.written(tmp_path / "tibia.stl", made.tibial())
    return [
        "import", "stl", "--femur-cartilage", str(femur), "--tibia-cartilage", str(tibia),
        "--side", "r", "--out", str(tmp_path / "out"),
    ]  # fmt: skip


def test_contacts_alone(words, tmp_path, capsys):
    patella = made.written(tmp_path / "patella.stl", made.patellar())
    words += ["--patella-cartilage", str(patella)]
    assert main([*words, "--layer-thickness", "4.5", "--law", "log", "--modulus", "5"]) == 0
    out = tmp_path / "out"
    assert "contact region" in capsys.readouterr().out
    knee = load_knee_file(out / "knee.yaml")
    assert knee.knee.contact_names == ("medial", "lateral")
    assert knee.document["ligaments"] == {}
    contact = knee.document["contacts"]["medial"]
    assert contact["layer_thickness_mm"] == 4.5 and contact["law"] == "log"
    assert contact["youngs_modulus_MPa"] == 5.0
    with (out / "fit_report.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["surface"] for row in rows] == [
        "medial condyle", "medial plateau", "lateral condyle", "lateral plateau", "patella",
        "trochlea",
    ]  # fmt: skip
    # The groove falls off into the notch, which no cartilage covers.
    most = {"trochlea": 0.1}
    assert all(float(row["rms_mm"]) < most.get(row["surface"], 0.01) for row in rows)
    assert list(knee.surfaces) == ["patella"]
    assert main(["describe", str(out / "knee.yaml")]) == 0
    assert "Surface of the patella, not in contact: plateau, " in capsys.readouterr().out
    assert "| medial condyle |" in (out / "fit_report.md").read_text()
    page = (out / "report.html").read_text(encoding="utf-8")
    assert ">medial condyle</td>" in page and "<svg" in page and "http" not in page.split("<svg")[0]
    assert (out / "figures" / "surface_fits.png").stat().st_size > 10000


def test_the_ligaments_of_a_knee_are_kept(words, tmp_path, capsys):
    name = "four_ligament"
    assert main([*words, "--knee", name]) == 0
    capsys.readouterr()
    new, old = load_knee_file(tmp_path / "out" / "knee.yaml"), load_knee_file(name)
    assert new.document["ligaments"] == old.document["ligaments"]
    assert new.knee.contacts[0].form == "quadrature"
    np.testing.assert_array_equal(new.knee.ligaments.slack_length, old.knee.ligaments.slack_length)


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--thickness", "field"], "both bone meshes"),
        (["--knee", "nowhere"], "a bundled knee"),
        (["--layer-thickness", "-2"], "between 0.1 and 50 mm"),
        (["--femur-cartilage", "missing.stl"], "missing"),
    ],
)
def test_bad_input_writes_nothing(words, tmp_path, capsys, more, line):
    assert main([*words, *more]) == 2
    assert line in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_side_than_the_knees_is_refused(words, tmp_path, capsys):
    words[words.index("r")] = "l"
    assert main([*words, "--knee", "four_ligament"]) == 2
    assert "--side" in capsys.readouterr().err
