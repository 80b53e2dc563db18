"""`kneejax joint compare`: tables, figure, status, and bad input in one line."""

import csv
import errno
import json
import os
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

from kneejax.cli import main
from kneejax.files import JointFile, write_joint, write_poses
from kneejax.geometry import Pose
from kneejax.joints import MEASURES, clinical_measures, hinge, moving_axis

FLEXION = np.array([0.0, 20.0, 45.0, 60.0, 90.0])
FACETS = np.array([[[6.0, 8.0, -20.0], [2.0, 12.0, 22.0]], [[0.0, 1.0, -21.0], [-2.0, 1.0, 22.0]]])
EPICONDYLES = np.array([[2.0, 3.0, -40.0], [2.0, -1.0, 40.0]])


def motion(subject):
    """A made-up person's motion: what a moving axis cannot follow, and something of its own."""
    rng = np.random.default_rng(subject)
    t = FLEXION / 90.0
    table = np.stack(
        [FLEXION, -2.0 * t, 5.0 + 6.0 * t, -3.0 + 14.0 * t, -34.0 - t**2, 4.0 - 2.0 * t], axis=1
    )
    table[:, 1:] += rng.normal(size=5) + 0.4 * rng.normal(size=(5, 5))
    return table


@pytest.fixture
def cohort(tmp_path):
    """Four persons: their tables, and a moving axis and a hinge of each."""
    files = {"measured": [], "moving": [], "hinge": []}
    for subject in range(4):
        table = motion(subject)
        files["measured"].append(tmp_path / f"s{subject}.csv")
        write_poses(files["measured"][-1], table)
        ends = Pose.from_table(table[[0, -1]])
        start = jax.tree.map(lambda x: x[0], ends)
        for name, joint in (
            ("moving", moving_axis(FACETS, ends)), ("hinge", hinge(EPICONDYLES, start))
        ):  # fmt: skip
            files[name].append(tmp_path / f"{name}{subject}.yaml")
            write_joint(JointFile(joint, f"{name}"), files[name][-1])
    return {name: [str(path) for path in paths] for name, paths in files.items()}


def write_axes(path, change=lambda points: points):
    """A file of axis points; its name."""
    named = zip(("extension", "flexion", "epicondyles"), (*FACETS, EPICONDYLES), strict=True)
    sides = ("medial_mm", "lateral_mm")
    points = {name: dict(zip(sides, change(pair).tolist(), strict=True)) for name, pair in named}
    path.write_text(yaml.safe_dump(points))
    return str(path)


@pytest.fixture
def axes(tmp_path):
    """A file of axis points."""
    return write_axes(tmp_path / "axes.yaml")


def status(*words):
    """Exit status of `kneejax joint compare`."""
    return main(["joint", "compare", *words])


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_persons_with_joints_of_their_own(cohort, tmp_path, capsys, figures):
    pytest.importorskip("pingouin")
    out = tmp_path / "out"
    words = [*cohort["measured"], "--joint", "moving axis=" + ",".join(cohort["moving"])]
    words += ["--joint", ",".join(cohort["hinge"])]
    assert main(["joint", "compare", *words, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "calibrated at 0, 90 degrees" in said and "moving axis - hinge" in said
    assert max(map(len, said.splitlines()[:-1])) < 100  # the last line names a folder
    summary = {(r["motion"], r["condition"]): r for r in rows(out / "summary.csv")}
    for end in ("0", "90"):
        for column in ("ML_mm_mean", "IE_deg_sd"):
            exact, seen = (float(summary[m, end][column]) for m in ("moving axis", "measured"))
            assert exact == pytest.approx(seen, abs=1e-9)
    assert ("measured", "ROM") in summary and ("measured", "average compared") in summary
    differences = rows(out / "differences.csv")
    assert {r["condition"] for r in differences} == {"20", "45", "60", "average"}
    apart = []
    for subject, file in enumerate(cohort["moving"]):
        table = motion(subject)
        joint = moving_axis(FACETS, Pose.from_table(table[[0, -1]]))
        own = joint.pose(jnp.deg2rad(FLEXION)).to_table()
        apart.append((clinical_measures(table) - clinical_measures(own))[2, 1])
        assert file
    row = next(r for r in differences if r["second"] == "moving axis" and r["condition"] == "45")
    assert float(row["AP_mm_mean"]) == pytest.approx(np.mean(apart), abs=1e-9)
    assert float(row["AP_mm_se"]) == pytest.approx(np.std(apart, ddof=1) / 2.0, abs=1e-9)
    tests = rows(out / "tests.csv")
    assert len(tests) == 45 and {r["df_error"] for r in tests} == {"6"}
    document = json.loads((out / "result.json").read_text())
    assert document["tested"] and document["models"] == ["moving axis", "hinge"]
    assert "kneejax" in document["versions"] and document["settings"]["sources"]["hinge"]
    assert (out / "figures" / "joints.png").stat().st_size > 20_000
    assert "moving axis: RMSE</td>" in (out / "report.html").read_text(encoding="utf-8")


def test_one_person_with_joints_fitted_on_the_way(cohort, axes, tmp_path, capsys):
    out = tmp_path / "out"
    words = [cohort["measured"][0], "--calibrate-at", "0", "90", "--axes", axes]
    assert main(["joint", "compare", *words, "--out", str(out)]) == 0
    assert "One subject" in capsys.readouterr().out
    assert not (out / "tests.csv").exists()
    predictions = rows(out / "predictions.csv")
    assert {r["model"] for r in predictions} == {"moving axis", "hinge"}
    assert {r["points"] for r in predictions} == {"3"}
    # The same as from the joint files.
    files = ["--joint", cohort["moving"][0], "--joint", cohort["hinge"][0]]
    again = tmp_path / "again"
    assert main(["joint", "compare", cohort["measured"][0], *files, "--out", str(again)]) == 0
    for one, other in zip(predictions, rows(again / "predictions.csv"), strict=True):
        assert float(one["rmse"]) == pytest.approx(float(other["rmse"]), rel=1e-9)


def test_joints_are_fitted_to_each_person_on_its_own_axis_points_of_a_left_knee(tmp_path):
    """Two persons, flexed a little differently; points with Z to the person's right."""
    tables, measured, axes, lines = [], [], [], []
    for i in range(2):
        tables.append(motion(i) + [0.3 * i, 0, 0, 0, 0, 0])
        measured.append(str(tmp_path / f"left{i}.csv"))
        write_poses(measured[-1], tables[-1])
        lines.append(FACETS + [0.0, 2.0 * i, 0.0])
        axes.append(
            write_axes(
                tmp_path / f"axes{i}.yaml", lambda x, i=i: (x + [0.0, 2.0 * i, 0.0]) * [1, 1, -1]
            )
        )
    out = tmp_path / "out"
    words = [*measured, "--calibrate-at", "0", "90", "--axes", ",".join(axes), "--side", "left"]
    assert main(["joint", "compare", *words, "--out", str(out)]) == 0
    apart = []
    for table, line in zip(tables, lines, strict=True):
        joint = moving_axis(line, Pose.from_table(table[[0, -1]]))
        own = joint.pose(jnp.deg2rad(table[:, 0])).to_table()
        apart.append((clinical_measures(table) - clinical_measures(own))[1:4])
    seen = rows(out / "differences.csv")
    rows_of_axis = [r for r in seen if (r["first"], r["second"]) == ("measured", "moving axis")]
    assert [r["condition"] for r in rows_of_axis] == ["20.15", "45.15", "60.15", "average"]
    for i, row in enumerate(rows_of_axis[:3]):
        means = [float(row[f"{one.column}_mean"]) for one in MEASURES]
        assert means == pytest.approx(np.mean(apart, axis=0)[i], abs=1e-9)
    document = json.loads((out / "result.json").read_text())
    assert document["settings"]["sources"]["hinge"] == axes and document["subjects"] == 2


def test_columns_of_other_names(cohort, tmp_path):
    """As OpenSim's users call them; a table with unused names beside."""
    text = Path(cohort["measured"][0]).read_text()
    table = tmp_path / "other.csv"
    table.write_text(text.replace("flexion_deg", "knee_flex", 1).replace("lateral_mm", "tz", 1))
    words = ["--column", "flexion_deg=knee_flex", "--column", "lateral_mm=tz"]
    words += ["--joint", cohort["hinge"][0], "--out"]
    assert status(str(table), *words, str(tmp_path / "other")) == 0
    assert status(cohort["measured"][0], *words[4:], str(tmp_path / "plain")) == 0
    one, other = (rows(tmp_path / name / "summary.csv") for name in ("plain", "other"))
    assert one == other


def test_a_joint_file_is_left_out_where_it_is_exact_beside_fitted_joints(cohort, axes, tmp_path):
    """Fitted at 0 and 90; where the file's own joint was calibrated foretells nothing either."""
    table = motion(0)
    joint = moving_axis(FACETS, Pose.from_table(table[[1, 2]]))
    write_joint(JointFile(joint, "inner"), tmp_path / "inner.yaml")
    dense = tmp_path / "dense.csv"
    write_poses(dense, np.insert(table, [2, 3], table[2:4] - [5.0, 0, 0, 0, 0, 0], axis=0))
    out = tmp_path / "out"
    words = [str(dense), "--calibrate-at", "0", "90", "--axes", axes]
    words += ["--joint", str(tmp_path / "inner.yaml")]
    assert main(["joint", "compare", *words, "--out", str(out)]) == 0
    assert {r["condition"] for r in rows(out / "differences.csv")} == {"40", "55", "60", "average"}


def test_a_generalised_axis_joins_where_there_are_more_poses(axes, tmp_path):
    out = tmp_path / "out"
    dense = tmp_path / "dense.csv"
    table = np.array([np.interp(np.linspace(0, 90, 19), FLEXION, c) for c in motion(0).T]).T
    write_poses(dense, table)
    words = [str(dense), "--axes", axes, "--calibrate-at", "0", "45", "90"]
    words += ["--average-within", "5"]
    assert main(["joint", "compare", *words, "--out", str(out)]) == 0
    # Seven of the nineteen poses were averaged, and foretell nothing.
    assert {r["points"] for r in rows(out / "predictions.csv")} == {"12"}
    rmse = {(r["model"], r["measure"]): float(r["rmse"]) for r in rows(out / "predictions.csv")}
    assert rmse["generalised axis", "AP"] < rmse["moving axis", "AP"] < rmse["hinge", "AP"]


@pytest.mark.long
def test_a_contact_knee_beside_joints(cohort, tmp_path):
    """four_ligament, and the same as a calibration would leave it; offsets shift its motion."""
    result = tmp_path / "result.json"
    result.write_text(
        json.dumps(
            {
                "knee": "four_ligament",
                "parameters": {"ACL.stiffness": {"value": 4500.0}},
                "frame_offset": {"lateral_mm": {"value": 3.0, "standard_error": 0.1}},
                "settings": {"knee": "four_ligament", "overrides": {}},
            }
        )
    )
    out = tmp_path / "out"
    words = [cohort["measured"][0], "--knee", "four_ligament", "--knee", str(result)]
    assert main(["joint", "compare", *words, "--out", str(out)]) in (0, 1)
    summary = {(r["motion"], r["condition"]): r for r in rows(out / "summary.csv")}
    names = [name for name, condition in summary if condition == "ROM" and name != "measured"]
    assert names == ["four_ligament", "four_ligament calibrated"]
    assert float(summary[names[0], "45"]["CD_mm_mean"]) == pytest.approx(
        float(summary[names[1], "45"]["CD_mm_mean"]), abs=0.5
    )
    lateral = [float(summary[name, "45"]["ML_mm_mean"]) for name in names]
    assert lateral[1] - lateral[0] == pytest.approx(3.0, abs=0.5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--joint, --knee, or --calibrate-at"),
        (["--joint", "nowhere.yaml"], "nowhere.yaml"),
        (["--knee", "four_ligamnet"], "four_ligament"),
        (["--knee", "nothing.json"], "nothing.json"),
        (["--calibrate-at", "0", "90"], "--axes: missing"),
        (["--calibrate-at", "0", "30", "--axes", "AXES"], "a flexion within 0.5 degrees"),
        (["--calibrate-at", "0", "--axes", "AXES"], "--calibrate-at: degrees"),
        (["--calibrate-at", "0", "0", "--axes", "AXES"], "farther apart"),
        (["--calibrate-at", "0,90", "--axes", "AXES"], "several have blanks between them"),
        (["--calibrate-at", "0", "nan", "--axes", "AXES"],
         "--calibrate-at: nan: expected a finite number"),
        (["--calibrate-at", "0", "90", "--axes", "AXES,AXES"], "2 files: expected one for all"),
        (["--calibrate-at", "0", "90", "--axes", "LEFT"], "axis in the femur: the lateral point"),
        (["--joint", "HINGE", "--joint", "HINGE"], "a name of its own"),
        (["--joint", "measured=HINGE"], "none for the measured one"),
        (["--joint", "HINGE", "--calibrate-at", "0", "90", "--axes", "AXES"], "another NAME=FILE"),
        (["--joint", ""], "--joint: empty: expected a value, not an empty text"),
        (["--joint", "mine="], "--joint: file 1: empty: expected the name of a file"),
        (["--joint", "HINGE", "--anova"], "1 subject: expected at least 3"),
        (["--joint", "HINGE", "--alpha", "7"], "--alpha: 7: expected a number above 0 and below 1"),
        (["--joint", "HINGE", "--spread", "nan"], "--spread: nan: expected a finite number"),
        (["--joint", "HINGE", "--average-within", "-1"], "--average-within: -1"),
        (["--joint", "HINGE", "--side", "left"], "--side: left: expected --calibrate-at"),
        (["--joint", "HINGE", "--average-within", "2"],
         "--average-within: 2: expected --calibrate-at"),
        (["--joint", "HINGE", "--column", "flexion=knee_flex"], "did you mean flexion_deg?"),
        (["--joint", "HINGE", "--column", "lateral_mm="], "one lateral_mm=COLUMN of the table"),
        (["--joint", "HINGE", "--column", "lateral_mm=tz"], "tz: missing: expected this column"),
        (["--joint", "AXES"], "kneejax: missing: expected joint"),
        (["--knee", "HINGE"], "1, as in a knee file; this file holds a joint"),
        (["--knee", "four_ligament", "--knee", "four_ligament"], "four_ligament is twice"),
        (["MEASURED", "--joint", "HINGE"], "every subject once"),
        (["--joint", "x=HINGE,HINGE"], "2 files"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(cohort, axes, words, said, tmp_path, capsys):
    out = tmp_path / "out"
    left = write_axes(tmp_path / "left.yaml", lambda points: points * [1, 1, -1])
    files = {"AXES": axes, "LEFT": left, "MEASURED": cohort["measured"][0]}
    files["HINGE"] = cohort["hinge"][0]
    made = [re.sub("[A-Z]{4,}", lambda found: files[found.group()], w) for w in words]
    assert status(cohort["measured"][0], *made, "--out", str(out)) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1
    assert not out.exists()


def test_a_place_that_may_not_be_written_to_is_known_before_the_work(tmp_path, monkeypatch, capsys):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "mkdir", refuse)
    assert status("nothing.csv", "--out", str(tmp_path / "new" / "out")) == 2
    assert "--out: folder:" in (line := capsys.readouterr().err) and "a place to write" in line


def test_subjects_must_be_measured_alike(cohort, axes, tmp_path, capsys):
    bent, short = tmp_path / "bent.csv", tmp_path / "short.csv"
    table = motion(9)
    table[2, 0] = 48.0
    write_poses(bent, table)
    write_poses(short, table[:4])
    base = ["joint", "compare", cohort["measured"][0]]
    joint = ["--joint", cohort["hinge"][0], "--no-anova", "--out", str(tmp_path / "out")]
    assert main([*base, str(bent), *joint]) == 2
    assert "45 within 1 degrees (--spread)" in capsys.readouterr().err
    assert main([*base, str(short), *joint]) == 2
    assert "5 flexions, as" in capsys.readouterr().err
    bare = tmp_path / "bare.yaml"
    points = yaml.safe_load(Path(axes).read_text())
    bare.write_text(yaml.safe_dump({name: points[name] for name in ("extension", "flexion")}))
    words = ["--calibrate-at", "0", "90", "--axes", axes, "--axes", str(bare)]
    words += ["--out", str(tmp_path / "out")]
    assert main([*base, cohort["measured"][1], *words]) == 2
    assert "bare.yaml: epicondyles: missing: expected epicondyles in" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*base, str(bent), *joint, "--spread", "5"]) == 0


def test_too_few_conditions(tmp_path, axes, capsys):
    file = tmp_path / "two.csv"
    write_poses(file, motion(0)[[0, 2, 4]])
    words = [str(file), "--calibrate-at", "0", "90", "--axes", axes]
    assert main(["joint", "compare", *words, "--out", str(tmp_path / "out")]) == 2
    assert "1 values to compare" in capsys.readouterr().err


def test_paper_5_is_reproduced_with_synthetic_numbers_labelled(tmp_path, monkeypatch, capsys):
    pytest.importorskip("pingouin")
    from kneejax.papers import paper5_study

    monkeypatch.setattr(paper5_study, "COHORTS", 1)
    monkeypatch.setattr(paper5_study, "DRAWS", 50)
    out = tmp_path / "out"
    assert main(["reproduce", "5", "--out", str(out)]) == 0
    assert "cannot be judged" in capsys.readouterr().out
    claims = rows(out / "reproduction.csv")
    assert {row["verdict"] for row in claims} == {
        "reproduced", "not reproduced", "cannot be judged"
    }  # fmt: skip
    assert "SYNTHETIC" in (out / "report.html").read_text()
    assert {path.name for path in out.glob("synthetic_*.csv")} == {
        f"synthetic_{name}.csv" for name in ("summary", "differences", "predictions", "tests")
    }
    sources = {(row["motion"], row["source"]) for row in rows(out / "means.csv")}
    assert ("EOS", "printed") in sources and ("moving axis", "ours, facets contact") in sources
