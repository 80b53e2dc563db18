"""`kneejax sensitivity --knees` and `kneejax reproduce 4`: files, status, bad input in one line."""

import csv
import json

import pytest
import yaml

from kneejax.cli import main
from kneejax.files import bundled_path
from kneejax.papers import knee_comparison, paper4
from tests.papers.compared_knees import comparison, study


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_knees_side_by_side_are_written_and_printed(tmp_path, monkeypatch, capsys):
    found = comparison(study("one"), study("two"))
    monkeypatch.setattr(knee_comparison, "compare_knees", lambda knees, progress: found)
    out = tmp_path / "out"
    assert main(["sensitivity", "--knees", "four_ligament", "--out", str(out), "--svg"]) == 0
    assert "MCL.prestretch" in capsys.readouterr().out
    scores = rows(out / "scores.csv")
    assert {row["knee"] for row in scores} == {"one", "two"}
    assert {row["outcome"] for row in scores} >= {"rmse_deg", "pressure_percent"}
    assert json.loads((out / "result.json").read_text())["knees"] == ["one", "two"]
    assert (out / "figures" / "scores.png").exists()
    page = (out / "report.html").read_text()
    assert "Highest scores: one: " in page and page.count("<svg") == 13
    assert (out / "figures" / "LCL-youngs_modulus.svg").exists()


def test_a_doubt_is_said_and_makes_the_status_1(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(knee_comparison, "compare_knees", lambda knees, progress: comparison())
    assert main(["sensitivity", "--knees", "four_ligament", "--out", str(tmp_path / "o")]) == 1
    assert "it holds 30 of 40 N m" in capsys.readouterr().out


@pytest.mark.parametrize("doubtful", [False, True])
def test_claims_that_fail_are_an_answer_and_doubts_are_not(tmp_path, monkeypatch, capsys, doubtful):
    found = comparison(study("one"), study("two", lost=doubtful))
    monkeypatch.setattr(paper4, "compare_knees", lambda knees, progress: found)
    out = tmp_path / "out"
    assert main(["reproduce", "4", "--out", str(out)]) == doubtful
    claims = rows(out / "reproduction.csv")
    assert {row["verdict"] for row in claims} == {
        "reproduced", "not reproduced", "cannot be judged"
    }  # fmt: skip
    assert all(row["reason"] for row in claims if row["verdict"] == "cannot be judged")
    assert "not reproduced" in capsys.readouterr().out
    assert (out / "report.html").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--knees", "four_ligamnet"], "four_ligament"),
        (["--knees", "four_ligament", "four_ligament"], "every knee once"),
        (["--knees", "four_ligament", "--global", "sobol"], "--global: sobol: expected a study,"),
        (["--knees", "four_ligament", "--samples", "4"], "--samples: 4: expected a study,"),
        (["--knees", "four_ligament", "--sweep", "ACL.stiffness=1:2:3"],
         "--sweep: ACL.stiffness: expected a study"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, capsys, words, said):
    out = tmp_path / "out"
    assert main(["sensitivity", *words, "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1
    assert not out.exists()


def test_a_knee_without_a_ligament_of_the_study_is_refused(tmp_path, capsys):
    document = yaml.safe_load(bundled_path("knees", "four_ligament").read_text())
    document["ligaments"]["XCL"] = document["ligaments"].pop("PCL")
    file = tmp_path / "odd.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    out = tmp_path / "out"
    assert main(["sensitivity", "--knees", str(file), "--out", str(out)]) == 2
    assert "has no ligament 'PCL'; did you mean" in capsys.readouterr().err
    assert not out.exists()


def test_papers_that_are_not_known_are_refused(capsys):
    assert main(["reproduce", "7"]) == 2
    assert "PAPER: 7: expected one of" in capsys.readouterr().err
