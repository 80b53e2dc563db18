"""`kneejax import meniscus` puts a ring made of a mesh into a knee; or writes nothing."""

import csv

import numpy as np
import pytest

import kneejax as kj
from kneejax.cli import main
from kneejax.files import load_knee_file
from tests.files.meshes import meshed_meniscus as made
from tests.files.meshes.meshed_knee import written

KNEE = "average_knee"


@pytest.fixture
def words(tmp_path):
    mesh = written(tmp_path / "MM.stl", made.wedge(load_knee_file(KNEE).document, "medial"))
    return ["import", "meniscus", str(mesh), "--knee", KNEE, "--compartment", "medial",
            "--hoop-modulus", "100", "--out", str(tmp_path / "out")]  # fmt: skip


def test_the_ring_takes_the_place_of_the_meniscus(words, tmp_path, capsys):
    assert main(words) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "cross-section 23.1 mm2 on average" in printed and "270 degrees from horn" in printed
    read = load_knee_file(tmp_path / "out" / "knee.yaml")
    assert [*read.document["contacts"]] == [*load_knee_file(KNEE).document["contacts"]]
    part = read.document["contacts"]["medial_meniscus"]
    assert "youngs_modulus_MPa: given at import" in part["source"]["ring"]
    assert "horn_stiffness_N_per_mm: 18 springs of 10 N/mm" in part["source"]["ring"]
    numbers = ["medial_meniscus.hoop_modulus", "medial_meniscus.cross_section"]
    chosen = kj.select(read.knee, numbers).read(read.knee)
    np.testing.assert_allclose(chosen, [100.0, made.AREA], rtol=0.01)
    with open(tmp_path / "out" / "sections.csv", newline="") as file:
        rows = [*csv.DictReader(file)]
    np.testing.assert_allclose([float(row["area_mm2"]) for row in rows], made.AREA, rtol=0.01)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "it replaces the one there was" in page and "horns at -225 and 45 degrees" in page
    assert main(["describe", str(tmp_path / "out" / "knee.yaml")]) == 0
    assert "Contact medial_meniscus: quadrature" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--modulus", "-1"], "youngs_modulus_MPa"),
        (["--horn-stiffness", "-1"], "horn_stiffness_N_per_mm"),
        (["--compartment", "lateral"], " mm beside its middle: expected a mesh over the lateral"),
        (["--unit", "m"], "mm: expected a meniscus 15 to 80 mm wide; is the unit right?"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_written(words, more, said, tmp_path, capsys):
    if more[0] in words:
        words[words.index(more[0]) + 1] = more[1]
        more = []
    assert main([*words, *more]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out" / "knee.yaml").exists()


@pytest.mark.long
def test_the_knee_bears_load_on_it_and_without_it(words, tmp_path):
    assert main(words) == 0
    knee, out = str(tmp_path / "out" / "knee.yaml"), str(tmp_path / "run")
    simulate = ["simulate", "compression", "--knee", knee, "--flexion", "0", "--cut",
                "medial_meniscus", "--out", out]  # fmt: skip
    assert main(simulate) == 0
    with open(tmp_path / "run" / "contact.csv", newline="") as file:
        rows = {(row.get("knee", ""), row["contact"]): row for row in csv.DictReader(file)}
    force = {key: float(row["force_N"]) for key, row in rows.items()}
    without = [key for key in force if "without" in key[0]]
    assert force[without[0][0], "medial_meniscus"] == 0.0
    assert max(x for key, x in force.items() if key[1] == "medial_meniscus") > 50.0
