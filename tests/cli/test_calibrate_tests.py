"""`kneejax calibrate` and `identify` of a study with tests under load."""

import csv
import json

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.cli import main
from kneejax.files import write_rows
from kneejax.mechanics import NAMED_LOADS

TRUTH = {"ACL.stiffness": 4000.0, "MCL.stiffness": 7000.0}


@pytest.fixture(scope="module")
def specimen(tmp_path_factory):
    """A made specimen's drawer, as its own laboratory recorded it, and a study of it."""
    folder = tmp_path_factory.mktemp("specimen")
    knee = kj.load_knee("four_ligament").replace(TRUTH)
    (test,) = kj.lab_tests("drawer", [20.0, 60.0], force_N=60.0, both=True, steps=3)
    (curves,) = kj.load_curves(knee, test)
    rows = np.random.default_rng(0)
    moved = np.asarray(curves.displacement)
    moved = moved + 0.02 * rows.standard_normal(moved.shape) + 3.0
    write_rows(
        folder / "drawer.csv",
        ["flexion_deg", "Applied Load", "Posterior"],
        [
            (flexion, 60.0 * part, -x)
            for flexion, own in zip(test.flexion_deg, moved, strict=True)
            for part, x in zip(test.path, own, strict=True)
        ],
    )
    columns = {"anterior_N": "Applied Load", "anterior_mm": "-Posterior"}
    study = {
        "title": "A specimen", "knee": "four_ligament", "parameters": list(TRUTH),
        "tests": [{"name": "drawer", "file": "drawer.csv", "columns": columns,
                   "counted_from": "offset_each_flexion"}],
        "noise_mm": 0.02, "noise_deg": 0.02, "procedures": ["III"],
    }  # fmt: skip
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    return folder


@pytest.mark.long
def test_laxity_leads_back_to_the_ligaments_that_made_it(specimen, capsys):
    out = specimen / "calibrated"
    assert main(["calibrate", str(specimen / "study.yaml"), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "test under load" in said
    assert "tests.csv" in said
    result = json.loads((out / "result.json").read_text())
    for name, value in TRUTH.items():
        found = result["parameters"][name]
        assert found["low"] < value < found["high"]
    whole = next(row for row in result["tests"] if row["flexion_deg"] is None)
    assert whole["fitted"] < 0.03 < 0.1 < whole["start"]
    with open(out / "tests.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 13
    # What the knee does stands in the laboratory's frame, like what was measured.
    assert all(abs(float(r["fitted"]) - float(r["measured"])) < 0.1 for r in rows)
    assert (out / "figures" / "tests.png").stat().st_size > 10_000
    page = (out / "report.html").read_text()
    assert "Tests under load" in page
    # No pose was measured, so nothing is drawn or said of a motion.
    assert "<h2>Motion</h2>" not in page
    assert "root mean square error  " not in said


def test_identify_reads_the_same_study(specimen, capsys):
    out = specimen / "identified"
    words = ["identify", str(specimen / "study.yaml"), "--next-tests", "1", "--out", str(out)]
    assert main(words) in (0, 1)
    result = json.loads((out / "result.json").read_text())
    # Twenty-six readings, one unknown constant of the laboratory.
    assert "26" in capsys.readouterr().out
    assert set(TRUTH) <= set(json.dumps(result).replace('"', " ").split())


@pytest.mark.long
def test_a_recommended_test_is_measured_and_added_to_the_study(specimen):
    out = specimen / "next"
    words = ["identify", str(specimen / "study.yaml"), "--next-tests", "2", "--out", str(out)]
    assert main(words) in (0, 1)
    with open(out / "next_tests.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2
    assert all(row["anterior_mm"] == "" and row["flexion_deg"] != "" for row in rows)
    knee = kj.load_knee("four_ligament").replace(TRUTH)
    loads = {name: [float(row[name]) for row in rows] for name in rows[0] if name in NAMED_LOADS}
    flexion = [float(row["flexion_deg"]) for row in rows]
    measured = kj.passive_flexion(knee, flexion, [kj.load_of(**loads)]).to_table("grood-suntay")
    header = [*rows[0]]
    filled = [
        [*(row[name] for name in header[: -5]), *pose]
        for row, pose in zip(rows, np.asarray(measured)[:, 1:].tolist(), strict=True)
    ]
    write_rows(specimen / "next.csv", header, filled)
    study = yaml.safe_load((specimen / "study.yaml").read_text())
    study["tests"].append({"name": "next", "file": "next.csv", "counted_from": "absolute"})
    (specimen / "more.yaml").write_text(yaml.safe_dump(study))
    assert main(["calibrate", str(specimen / "more.yaml"), "--out", str(specimen / "more")]) == 0
    found = [json.loads((specimen / name / "result.json").read_text())["parameters"]
             for name in ("calibrated", "more")]  # fmt: skip
    for name, value in TRUTH.items():
        before, after = (one[name]["high"] - one[name]["low"] for one in found)
        assert after < before
        assert found[1][name]["low"] < value < found[1][name]["high"]


@pytest.mark.long
def test_curves_that_simulate_wrote_are_a_test_of_a_study(tmp_path, capsys):
    """As docs/my_specimen.md says: a model's laboratory is read like a real one."""
    lab = ["simulate", "drawer", "--knee", "four_ligament", "--set", "ACL.stiffness=6000"]
    size = ["--flexion", "20,60", "--force_N", "60", "--both", "--steps", "2"]
    assert main([*lab, *size, "--out", str(tmp_path / "robot")]) == 0
    item = {"name": "drawer", "file": "robot/curves.csv", "convention": "femoral",
            "counted_from": "least_load"}  # fmt: skip
    study = {
        "title": "Like a robot", "knee": "four_ligament", "parameters": ["ACL.stiffness"],
        "tests": [item], "noise_mm": 0.1, "noise_deg": 0.1, "procedures": ["III"],
    }  # fmt: skip
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    out = tmp_path / "out"
    assert main(["calibrate", str(tmp_path / "study.yaml"), "--out", str(out)]) == 0
    found = json.loads((out / "result.json").read_text())["parameters"]["ACL.stiffness"]
    assert found["value"] == pytest.approx(6000.0, rel=1e-4)


@pytest.mark.long
def test_a_cut_knee_and_a_load_cell_calibrate_from_the_command(tmp_path, capsys):
    """A robot's table of an intact and a cut knee, with the pull of the ACL beside the pose."""
    truth = kj.load_knee("four_ligament")
    truth = kj.select(truth, list(TRUTH)).apply(truth, np.array(list(TRUTH.values())))
    (test,) = kj.lab_tests("drawer", [20.0, 60.0], force_N=60.0, both=True, steps=2)
    for name, knee in (("intact", truth), ("cut", kj.cut(truth, ["LCL"]))):
        (curves,) = kj.load_curves(knee, test)
        moved, load = np.asarray(curves.displacement), np.asarray(curves.load("anterior_N"))
        pull = np.asarray(curves.motion.tension("ACL"))[curves.nodes[:, curves.steps]]
        flexion = np.repeat(test.flexion_deg, len(test.path))
        rows = np.column_stack([flexion, load.ravel(), moved.ravel(), pull.ravel()])
        header = ["flexion_deg", "anterior_N", "anterior_mm", "ACL.tension_N"]
        write_rows(tmp_path / f"{name}.csv", header, rows.tolist())
    both = [
        {"name": "intact", "file": "intact.csv", "sd_N": 2.0, "weight": "by_load"},
        {"name": "cut", "file": "cut.csv", "sd_N": 2.0, "cut": "LCL"},
    ]
    study = {
        "title": "Robot", "knee": "four_ligament", "parameters": list(TRUTH), "tests": both,
        "noise_mm": 0.05, "noise_deg": 0.05, "procedures": ["III"],
    }  # fmt: skip
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    out = tmp_path / "out"
    assert main(["calibrate", str(tmp_path / "study.yaml"), "--out", str(out)]) in (0, 1)
    result = json.loads((out / "result.json").read_text())
    for name, value in TRUTH.items():
        assert result["parameters"][name]["value"] == pytest.approx(value, rel=1e-3)
    errors = {(row["test"], row["coordinate"]): row for row in result["tests"]
              if row["flexion_deg"] is None}  # fmt: skip
    assert errors["cut", "ACL.tension_N"]["fitted"] < 0.1 < errors["cut", "ACL.tension_N"]["start"]
    with open(out / "tests.csv") as file:
        units = {(row["coordinate"], row["unit"], row["counted_from"])
                 for row in csv.DictReader(file)}  # fmt: skip
    assert units == {("anterior", "mm", "unloaded"), ("ACL.tension_N", "N", "absolute")}
    assert "ACL tension, N" in capsys.readouterr().out
