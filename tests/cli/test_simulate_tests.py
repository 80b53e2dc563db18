"""`kneejax simulate TEST`: the files of a laboratory, and what is said where a knee gives way."""

import copy
import csv
import re

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.cli.options.simulate import TESTS
from kneejax.experiments import READY
from kneejax.files import bundled_path, read_knee, write_knee

KNEE = ["--knee", "four_ligament"]


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_command_knows_every_ready_test():
    assert set(TESTS) == {*READY, "envelope", "load"}


def test_a_drawer_writes_curves_and_laxity(tmp_path, capsys):
    asked = ["simulate", "drawer", *KNEE, "--flexion", "20,30", "--force_N", "60", "--both"]
    assert main([*asked, "--steps", "3", "--out", str(tmp_path)]) == 0
    curves, laxity = rows_of(tmp_path / "curves.csv"), rows_of(tmp_path / "laxity.csv")
    assert list(curves[0]) == [
        "test", "flexion_deg", "step", "anterior_force_N", "adduction_deg",
        "internal_rotation_deg", "anterior_mm", "superior_mm", "lateral_mm",
        "anterior_change_mm", "counted_from", "converged", "stable", "status", "doubt",
    ]  # fmt: skip
    first = [float(row["anterior_force_N"]) for row in curves if row["flexion_deg"] == "20.0"]
    assert first == [0, 20, 40, 60, 40, 20, 0, -20, -40, -60, -40, -20, 0]
    assert [row["flexion_deg"] for row in laxity] == ["20.0", "30.0"]
    assert all(float(row["positive"]) > 0 > float(row["negative"]) for row in laxity)
    parts = rows_of(tmp_path / "forces.csv")
    assert {row["part"] for row in parts} >= {"ACL", "medial"}
    assert len(rows_of(tmp_path / "poses.csv")) == 2 * 7
    assert {x.name for x in (tmp_path / "figures").iterdir()} == {"curves.png", "laxity.png"}
    assert "posterior" not in capsys.readouterr().err


def test_what_a_knee_does_not_hold_is_said(tmp_path, capsys):
    asked = ["simulate", "drawer", *KNEE, "--cut", "PCL", "--flexion", "90", "--both"]
    asked += ["--steps", "2"]
    assert main([*asked, "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "of 100 N of posterior force: gives_way" in said
    assert "drawer at 90 degrees (-100 to -50 N): no balance is connected" in said


def test_a_cut_knee_is_counted_from_the_intact_ones_path(tmp_path, capsys):
    asked = ["simulate", "drawer", *KNEE, "--flexion", "30", "--force_N", "60", "--steps", "1"]
    found = {}
    for name, words in {
        "intact": [], "own": ["--cut", "ACL"],
        "counted": ["--cut", "ACL", "--counted_from", "intact"],
    }.items():  # fmt: skip
        assert main([*asked, *words, "--out", str(tmp_path / name)]) == 0
        (found[name],) = rows_of(tmp_path / name / "laxity.csv")
    end, rest = ({k: float(x[c]) for k, x in found.items()} for c in ("positive", "neutral"))
    moved = rest["own"] - rest["intact"]
    assert abs(moved) > 0.2
    assert end["counted"] == pytest.approx(end["own"] + moved, abs=1e-6)
    assert [x["counted_from"] for x in found.values()] == ["unloaded", "unloaded", "intact"]
    curve = rows_of(tmp_path / "counted" / "curves.csv")
    changes = [float(row["anterior_change_mm"]) for row in curve]
    assert changes == pytest.approx([moved, end["counted"], moved], abs=1e-6)
    assert "along the load's own axes, from the intact knee, mm" in capsys.readouterr().out


@pytest.mark.long
def test_any_wrench_and_axial_load(tmp_path):
    words = [*KNEE, "--flexion", "30", "--steps", "1"]
    wrench = ["--load", "internal_Nm=1", "--load", "anterior_N=20"]
    assert main(["simulate", "load", *words, *wrench, "--out", str(tmp_path / "a")]) == 0
    row = rows_of(tmp_path / "a" / "curves.csv")[1]
    assert (row["anterior_force_N"], row["internal_moment_Nm"]) == ("20.0", "1.0")
    axial = ["--load", "compression_N=200"]
    assert main(["simulate", "drawer", *words, *axial, "--out", str(tmp_path / "b")]) == 0
    rows = rows_of(tmp_path / "b" / "curves.csv")
    assert [row["compression_N"] for row in rows] == ["200.0"] * 3


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["drawer", "--moment_Nm", "3"], "--moment-Nm: drawer: expected force_N, which"),
        (["drawer", "--force_N", "-3"], "--both"),
        (["torsion", "--moment_Nm", "5000"], "N mm are suspected"),
        (["drawer", "--steps", "0"], "between 1 and 1000"),
        (["load"], "NAME=SIZE"),
        (["load", "--force_N", "3", "--load", "anterior_N=3"], "--load NAME=SIZE"),
        (["passive-flexion", "--both"], "a test under load"),
        (["passive-flexion", "--hold", "adduction"], "a test under load"),
        (["drawer", "--rotation_deg", "3"], "--rotation-deg: drawer: expected displacement_mm"),
        (["drawer", "--displacement_mm", "50"], "between 0 and 30"),
        (["torsion", "--hold", "internal_rotation"], "expected no coordinate that the test"),
        (["drawer", "--hold", "flexion"], "adduction"),
        (["drawr"], "did you mean drawer?"),
        (["drawer", "--counted_from", "intact"], "expected --cut too, or unloaded"),
        (["passive-flexion", "--counted_from", "intact"], "a test under load"),
    ],
)
def test_a_test_that_cannot_be_made_is_refused(tmp_path, capsys, words, says):
    assert main(["simulate", *words, "--out", str(tmp_path / "o")]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.long
def test_a_machine_moves_the_tibia_and_holds_its_rotation(tmp_path, capsys):
    asked = ["simulate", "drawer", *KNEE, "--flexion", "30", "--displacement_mm", "4", "--both"]
    asked += ["--hold", "internal_rotation", "--steps", "2"]
    assert main([*asked, "--out", str(tmp_path)]) == 0
    rows = rows_of(tmp_path / "curves.csv")
    assert list(rows[0])[3:5] == ["anterior_force_N", "held_internal_moment_Nm"]
    forces = [float(row["anterior_force_N"]) for row in rows]
    assert forces[2] > forces[1] > abs(forces[0])
    assert forces[6] < forces[5] < -abs(forces[0])
    assert len({row["internal_rotation_deg"][:9] for row in rows}) == 1
    (laxity,) = rows_of(tmp_path / "laxity.csv")
    assert float(laxity["positive"]) == pytest.approx(4.0)
    assert float(laxity["held_positive"]) == pytest.approx(forces[2])
    said = capsys.readouterr().out
    assert "drawer: anterior translation 4 mm and the opposite, internal rotation held" in said
    assert "what it takes of anterior force, N" in said


def test_of_a_single_angle_the_page_shows_the_curve_and_of_several_the_laxity(tmp_path):
    captions = ("Load against displacement, a", "Laxity over flexion.")
    for flexion, first in zip(("20", "0,20"), captions, strict=True):
        out = tmp_path / flexion
        words = ["simulate", "lachman", "--knee", "four_ligament", "--flexion", flexion]
        assert main([*words, "--out", str(out)]) == 0
        page = (out / "report.html").read_text(encoding="utf-8")
        assert min(captions, key=page.index) == first


@pytest.fixture
def knee_with_a_meniscus(tmp_path):
    """The four-ligament knee with a ring on its medial plateau, 0.5 mm high."""
    document = read_knee(bundled_path("knees", "four_ligament")).document
    medial = document["contacts"]["medial"]
    rim = copy.deepcopy(medial) | {"form": "quadrature", "points": [14, 14], "law": "linear"}
    turns = np.deg2rad(np.linspace(140.0, 400.0, 24))
    rims = [np.stack([2.0 + 18.0 * s * np.cos(turns), -17.0 + 14.0 * s * np.sin(turns)], axis=1)
            for s in (1.0, 0.4)]  # fmt: skip
    rim["tibial_surface"]["outline_mm"] = np.concatenate([rims[0], rims[1][::-1]]).tolist()
    rim["tibial_surface"]["coefficients_mm"][0][0] += 0.5
    rim["ring"] = {
        "youngs_modulus_MPa": 100.0, "cross_section_mm2": 30.0, "horn_stiffness_N_per_mm": 200.0,
        "coronary_stiffness_N_per_mm": 100.0, "middle_mm": [2.0, -17.0], "horns_deg": [-220, 40],
    }  # fmt: skip
    document["contacts"]["medial_meniscus"] = rim
    path = tmp_path / "knee.yaml"
    write_knee(document, path)
    return str(path)


@pytest.mark.long
def test_compression_says_how_menisci_share_the_load(knee_with_a_meniscus, tmp_path, capsys):
    asked = ["simulate", "compression", "--knee", knee_with_a_meniscus, "--flexion", "20"]
    asked += ["--force_N", "300", "--steps", "2", "--cut", "medial_meniscus"]
    assert main([*asked, "--out", str(tmp_path / "out")]) in (0, 1)
    contact = rows_of(tmp_path / "out" / "contact.csv")
    assert list(contact[0]) == [
        "knee", "flexion_deg", "compression_N", "contact", "force_N", "area_mm2",
        "max_pressure_MPa", "mean_pressure_MPa", "load_share", "max_extrusion_mm",
        "mean_extrusion_mm",
    ]  # fmt: skip
    full = {(row["knee"] == "intact", row["contact"]): row for row in contact
            if row["compression_N"] == "300.0"}  # fmt: skip
    assert len(full) == 6 and len(contact) == 18
    whole, gone = (full[intact, "medial_meniscus"] for intact in (True, False))
    assert 0.05 < float(whole["load_share"]) < 1.0 and float(whole["max_extrusion_mm"]) > 0.0
    assert {gone[x] for x in ("force_N", "area_mm2", "max_pressure_MPa", "load_share")} == {"0.0"}
    shares = [float(full[True, name]["load_share"]) for name in ("medial", "medial_meniscus")]
    assert sum(shares) == pytest.approx(1.0)
    printed = capsys.readouterr().out
    assert "Contact under the full compression" in printed
    assert re.search(r"intact +20\.0 +300 +medial_meniscus ", printed)


def test_a_knee_without_menisci_says_so(tmp_path, capsys):
    asked = ["simulate", "compression", *KNEE, "--cut", "medial_meniscus"]
    assert main([*asked, "--out", str(tmp_path)]) == 2
    assert "'four_ligament' has no menisci" in capsys.readouterr().err
