"""Maps, identification and reproductions from the command line."""

import csv
import json

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.parameters import MEANING

pytestmark = pytest.mark.usefixtures("optimised_code")

STUDY = """
title: A short motion
knee: four_ligament
synthetic:
  parameters: {PCL.stiffness: 2814, PCL.reference_strain: -0.047}
  flexion_deg: "0:120:5"
  noise_mm: 0.1
  noise_deg: 0.1
parameters: [PCL.stiffness, PCL.reference_strain]
procedures: [III]
"""
PAIR = ("--pair", "PCL.stiffness", "PCL.reference_strain")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "study.yaml"
    path.write_text(STUDY, encoding="utf-8")
    return str(path)


def table(path):
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def mapped(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("map") / "out"
    return out, main(["map", study, *PAIR, "--grid", "7x5", "--out", str(out)])


def test_a_map_is_written_as_data_table_and_figure(mapped):
    xarray = pytest.importorskip("xarray")
    out, status = mapped
    assert status == 0
    with xarray.open_dataset(out / "map.nc") as data:
        assert dict(data.sizes) == {"PCL.stiffness": 7, "PCL.reference_strain": 5}
        assert data["PCL.stiffness"].attrs["units"] == "N"
        lowest = float(data["objective"].min())
        assert "kneejax" in json.loads(data.attrs["versions"])
    row = table(out / "maps.csv")[0]
    assert float(row["objective_minimum"]) == pytest.approx(lowest)
    assert sum(int(row[word]) for word in ("sound", "outside_region", "no_balance")) <= 35
    assert (out / "figures" / "map.png").stat().st_size > 20_000
    assert not (out / "parts").exists()
    assert json.loads((out / "result.json").read_text())["about"]["grid"] == "7x5"


def test_a_map_of_a_result_begins_at_its_fit(study, tmp_path):
    pytest.importorskip("xarray")
    fitted = {"PCL.stiffness": 2800.0, "PCL.reference_strain": -0.05}
    result = {"settings": {"path": study, "knee": "four_ligament"}, **MEANING}
    result["parameters"] = {name: {"value": value} for name, value in fitted.items()}
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    out = tmp_path / "out"
    assert main(["map", str(tmp_path), *PAIR, "--grid", "3", "--out", str(out)]) == 0
    row = table(out / "maps.csv")[0]
    begun = [float(row["x_start"]), float(row["y_start"])]
    assert begun == pytest.approx([*fitted.values()])
    assert float(row["objective_start"]) < float(row["objective_minimum"])
    assert "the fit has a lower objective" in (out / "report.html").read_text(encoding="utf-8")


def test_a_result_whose_study_has_gone_is_refused(tmp_path, capsys):
    result = {"settings": {"path": "gone.yaml", "knee": "four_ligament"}, "parameters": {}}
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    assert main(["map", str(tmp_path), *PAIR, "--out", str(tmp_path / "out")]) == 2
    said = "settings.path: gone.yaml: expected the file of its study, which must be there still"
    assert said in capsys.readouterr().err


def test_the_folder_of_a_map_belongs_to_its_study(mapped, study, capsys):
    pytest.importorskip("xarray")
    out, _ = mapped
    before = (out / "map.nc").read_bytes()
    assert main(["map", study, *PAIR, "--grid", "9", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "its grid is 7x5, not 9x9" in said and said.count("\n") == 1
    assert (out / "map.nc").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--pair", "PCL.stifness", "ACL.stiffness"], "did you mean 'PCL.stiffness'"),
        (["--pair", "PCL.stiffness", "PCL.stiffness"], "two different parameters"),
        ([*PAIR, *PAIR], "every pair once"),
        ([*PAIR, "--grid", "1"], "--grid: points: 1: expected a whole number from 2 to 2000"),
        ([*PAIR, "--grid", "4y5"], "as in 41 or 41x61"),
        ([*PAIR, "--range", "PCL.stiffness=900:300"], "[900.0, 300.0]: expected a lower and"),
        ([*PAIR, "--range", "PCL.stifness=300:900"], "did you mean PCL.stiffness?"),
        ([*PAIR, "--range", "PCL.stiffness=300"], "NAME=LOW:HIGH"),
        ([], "--pair: parameters: none: expected two, e.g. PCL.stiffness"),
        ([*PAIR, "--gird", "4"], "did you mean --grid?"),
    ],
)
def test_mistakes_in_a_map_are_said(study, words, said, tmp_path, capsys, unmeasured):
    out = tmp_path / "out"
    assert main(["map", study, *words, "--out", str(out)]) == 2
    assert said in (line := capsys.readouterr().err) and line.count("\n") == 1
    assert not out.exists()


@pytest.fixture(scope="module")
def identified(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("identify") / "out"
    candidates = out.parent / "tests.csv"
    candidates.write_text(
        "flexion_deg,anterior_N,name\n20,100,Lachman\n90,-100,drawer\n20,0,none\n", encoding="utf-8"
    )
    words = ["identify", study, "--candidates", str(candidates), "--next-tests", "2"]
    return out, main([*words, "--out", str(out)])


@pytest.mark.long
def test_identify_writes_estimates_profiles_and_tests(identified):
    out, status = identified
    assert status == 0
    rows = {row["name"]: row for row in table(out / "parameters.csv")}
    assert list(rows) == ["PCL.stiffness", "PCL.reference_strain"]
    stiffness = rows["PCL.stiffness"]
    assert float(stiffness["profile_low"]) < 2814.0 < float(stiffness["profile_high"])
    assert not stiffness["profile_low_open"] and not stiffness["profile_high_open"]
    followed = [row for row in table(out / "profiles.csv") if row["parameter"] == "PCL.stiffness"]
    assert min(float(row["rise_of_chi2"]) for row in followed) == pytest.approx(0.0, abs=1e-6)
    assert len(table(out / "candidates.csv")) == 3
    document = json.loads((out / "result.json").read_text())
    assert len(document["next_tests"]) == 2
    assert "kneejax" in document["versions"] and document["warnings"] == []
    assert np.isfinite(document["chi2"])
    for name in ("profiles", "spectrum", "correlation", "next_tests", "standard_errors"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
    page = (out / "report.html").read_text()
    first = page[: page.index("<details>")]
    assert "The data determine 2 of 2 parameters. Next: " in first
    assert "<td>PCL.stiffness</td>" in first and "test to make next" in first


def test_a_parameter_that_is_not_determined_is_a_doubt(tmp_path, capsys):
    """A PCL that is slack in extension leaves no trace in a motion up to 30 degrees."""
    study, out = tmp_path / "slack.yaml", tmp_path / "out"
    slack = STUDY.replace("-0.047", "-0.19").replace("0:120:5", "0:30:5")
    study.write_text(slack, encoding="utf-8")
    assert main(["identify", str(study), "--criterion", "A", "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "not determined" in said and "standard error" in said.split("What to measure next")[1]
    warnings = json.loads((out / "result.json").read_text())["warnings"]
    assert any("not determined" in warning for warning in warnings)


@pytest.mark.parametrize(("failures", "status"), [("[dislocated]", 0), ("[overstretched]", 1)])
def test_identify_warns_of_what_its_study_calls_a_failure(failures, status, tmp_path, capsys):
    """The PCL of the identified knee is longer by 6 % at 120 degrees; here it tears at 5 %."""
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    torn = f"{STUDY}set: {{PCL.failure_strain: 0.05}}\nfailures: {failures}\n"
    study.write_text(torn, encoding="utf-8")
    assert main(["identify", str(study), "--next-tests", "1", "--out", str(out)]) == status
    warnings = json.loads((out / "result.json").read_text())["warnings"]
    assert ["overstretched" in warning for warning in warnings] == [True] * status
    assert ("PCL" in capsys.readouterr().out) and len(warnings) == status


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--noise-mm", "0"], "noise_mm"),
        (["--noise-deg", "-1"], "noise_deg"),
        (["--next-tests", "0"], "--next-tests"),
        (["--prior", "PCL.stiffness=3000:0"], "PCL.stiffness"),
        (["--prior", "PCL.stifness=3000:10"], "PCL.stiffness"),
        (["--next-tests", "100"], "100 tests wanted, of 72 candidates"),
        (["--posterior", "--chains", "1"], "chains: 1: expected 2 or more"),
        (["--candidates", "nowhere.csv"], "nowhere.csv"),
    ],
)
def test_mistakes_in_identify_are_said(study, words, said, tmp_path, capsys, unmeasured):
    out = tmp_path / "out"
    assert main(["identify", study, *words, "--out", str(out)]) == 2
    assert said in (line := capsys.readouterr().err) and line.count("\n") == 1
    assert not out.exists()


def test_only_judged_papers_can_be_asked_for(capsys):
    assert main(["reproduce", "6"]) == 2
    assert "PAPER: 6: expected one of 1, 2, 3, 4, 5" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["4", "--knee", "four_ligament"], "reproduce: --knee: 4: expected paper 1 with it"),
        (["1", "--knee", "four_ligamnt"], "did you mean four_ligament?"),
        (["1", "--knee", "lenhart2015_reduced"], "expected those of paper 1: ACL, PCL, MCL, LCL"),
    ],
)
def test_a_knee_is_for_paper_1_and_has_its_four_ligaments(words, said, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["reproduce", *words, "--out", str(out)]) == 2
    assert said in (line := capsys.readouterr().err) and line.count("\n") == 1
    assert not out.exists()
