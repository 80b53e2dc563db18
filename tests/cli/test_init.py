"""Files to begin with: each is read as it was written, and so is what is copied."""

import pytest

from kneejax.cli import main
from kneejax.cohorts import read_cohort
from kneejax.files import bundled_files, load_knee, said_of
from kneejax.studies import read_plan, read_study

READ = {"study": read_study, "knee": load_knee, "cohort": read_cohort, "plan": read_plan}


@pytest.mark.parametrize("kind", READ)
def test_a_file_to_begin_with_can_be_used_as_it_is(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", kind]) == 0
    file = tmp_path / f"{kind}.yaml"
    said = capsys.readouterr().out
    assert f"written: {kind}.yaml" in said and "next: kneejax " in said
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# ") and max(map(len, text.splitlines()[:20])) <= 105
    assert READ[kind](file) is not None
    assert main(["init", kind]) == 2
    assert "a file that is not there yet" in capsys.readouterr().err
    assert main(["init", kind, "--out", "other.yaml"]) == 0
    assert (tmp_path / "other.yaml").read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("four_ligament", {"four_ligament.yaml"}),
        ("studies/average_knee",
         {"average_knee.yaml", *(f"average_knee_{table}.csv" for table in
                                 ("compression", "coupled", "passive", "room", "torsion",
                                  "unloaded"))}),
        ("paper1", {"paper1.yaml"}),
        ("plans/ten_bundle", {"ten_bundle.yaml"}),
        ("walker1988", {"walker1988.csv", "walker1988.yaml"}),
    ],
)  # fmt: skip
def test_anything_bundled_can_be_copied(name, files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["knees", "--copy", name]) == 0
    assert {path.name for path in tmp_path.iterdir()} == files
    assert main(["knees", "--copy", name]) == 2
    assert "no such file or folder here yet" in capsys.readouterr().err


def test_a_copied_study_is_read_with_its_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["knees", "--copy", "studies/four_ligament_fitted"]) == 0
    assert read_study(tmp_path / "four_ligament_fitted.yaml").tests


def test_every_bundled_name_is_offered_for_another_one(capsys):
    assert main(["knees", "--copy", "papr1"]) == 2
    error = capsys.readouterr().err
    assert "did you mean paper1?" in error and all(x in error for x in bundled_files("knees"))


def listed(capsys, *words):
    assert main(["describe", *words, "--parameters"]) == 0
    return {line.split()[0]: line.split()[1] for line in capsys.readouterr().out.splitlines()[3:]}


def test_parameters_are_listed_by_names_that_set_takes(capsys):
    found = listed(capsys, "four_ligament")
    assert {"ACL.stiffness", "LCL.slack_length", "medial.youngs_modulus"} <= set(found)
    assert float(found["ACL.stiffness"]) == 4500.0
    assert "ACL.patellar_attachment.lateral" not in found
    knee = load_knee("four_ligament")
    for name, value in found.items():
        if "strain" not in name and "slack" not in name and value != "none":
            with said_of("--set"):
                knee.replace({name: float(value)})


def test_fibres_of_a_structure_are_listed_on_demand(capsys):
    structures = listed(capsys, "lenhart2015_reduced")
    every = listed(capsys, "lenhart2015_reduced", "--fibres")
    assert "ACL.stiffness" in structures and "ACLam.stiffness" in set(every) - set(structures)
    assert float(every["ACL.stiffness"]) == pytest.approx(
        float(every["ACLam.stiffness"]) + float(every["ACLpl.stiffness"]), rel=1e-3
    )
