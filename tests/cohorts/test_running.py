"""A cohort from its files to its report: bad knees among good ones, parts, and what is there."""

import csv
import math
import resource
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.cli import main
from kneejax.cli._results_folder import ResultsFolder, owned
from kneejax.cohorts import read_cohort
from kneejax.files import load_knee, write_poses, write_text
from kneejax.inference import synthetic_motion
from kneejax.parameters import UnsuitableData
from kneejax.studies import read_study, run_side_by_side

pytestmark = pytest.mark.usefixtures("optimised_code")

FLEXION = np.linspace(0.0, 120.0, 25)
TRUTHS = [{"ACL.stiffness": 4000.0 + 600.0 * k, "MCL.stiffness": 7000.0 + 400.0 * k}
          for k in range(3)]  # fmt: skip
KNEES = [f"K{k}" for k in range(3)]


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    """Knees that differ in what is known of their LCL, and one whose ligaments are all slack."""
    folder = tmp_path_factory.mktemp("cohort")
    rows = ["name,measured.file,set.LCL.stiffness,set.*.reference_strain"]
    for k, (name, truth) in enumerate(zip(KNEES, TRUTHS, strict=True)):
        lcl = 5500.0 + 200.0 * k
        knee = load_knee("four_ligament").replace({"LCL.stiffness": lcl})
        table = synthetic_motion(knee, truth, FLEXION, noise_mm=0.02, noise_deg=0.02, seed=k)
        write_poses(folder / f"{name}.csv", table)
        rows.append(f"{name},{name}.csv,{lcl},")
    # Where a knee whose ligaments are all slack has no balance.
    write_poses(folder / "bad.csv", np.eye(6)[:1] * np.array([[110.0], [115.0], [120.0]]))
    rows.append("bad,bad.csv,,-0.5")
    (folder / "knees.csv").write_text("\n".join(rows) + "\n")
    study = {
        "title": "Knee", "knee": "four_ligament", "parameters": list(TRUTHS[0]),
        "measured": {"file": "", "source": "made"}, "procedures": ["III"],
        "noise_mm": 0.02, "noise_deg": 0.02,
    }  # fmt: skip
    document = {"title": "Three knees", "study": study, "knees": "knees.csv"}
    (folder / "cohort.yaml").write_text(yaml.safe_dump(document))
    return folder


@pytest.fixture(scope="module")
def calibrated(cohort):
    out = cohort.parent / "calibrated"
    return main(["calibrate", str(cohort), "--out", str(out), "--bootstrap", "25"]), out


def rows_of(out):
    with open(out / "cohort.csv") as file:
        return list(csv.DictReader(file))


@pytest.mark.long
def test_good_knees_have_an_answer_beside_a_bad_one(calibrated):
    status, out = calibrated
    assert status == 1
    rows = rows_of(out)
    (failed,) = [row for row in rows if row["kind"] == "failed"]
    assert failed["knee"] == "bad" and "balance" in failed["name"]
    known = [row for row in rows if row["kind"] == "parameter"]
    assert len(known) == 6
    held = [
        float(row["low"]) <= TRUTHS[KNEES.index(row["knee"])][row["name"]] <= float(row["high"])
        for row in known
    ]
    assert sum(held) >= 5
    for row in known:  # what linear limits say, data that are made again say too
        assert float(row["bootstrap_low"]) < float(row["value"]) < float(row["bootstrap_high"])
        half = 0.5 * (float(row["high"]) - float(row["low"]))
        assert float(row["bootstrap_sd"]) == pytest.approx(half / 1.96, rel=0.5)


@pytest.mark.long
def test_what_knees_say_together_is_a_prior_for_the_next(cohort, calibrated):
    out = calibrated[1]
    said = yaml.safe_load((out / "prior.yaml").read_text())
    values = [truth["ACL.stiffness"] for truth in TRUTHS]
    assert said["start"]["ACL.stiffness"] == pytest.approx(np.mean(values), rel=0.2)
    assert said["prior"]["ACL.stiffness"] == pytest.approx(np.std(values, ddof=1), rel=3.0)
    study = yaml.safe_load((cohort / "cohort.yaml").read_text())["study"]
    study |= {"measured": {"file": "K0.csv", "source": "made"}, "prior": str(out / "prior.yaml")}
    (cohort.parent / "next.yaml").write_text(yaml.safe_dump(study))
    write_poses(cohort.parent / "K0.csv", np.zeros((2, 6)) + [[0.0], [30.0]])
    read = read_study(cohort.parent / "next.yaml")
    assert read.prior["ACL.stiffness"] == said["prior"]["ACL.stiffness"]
    assert read.start["MCL.stiffness"] == said["start"]["MCL.stiffness"]
    own = study | {"start": {"ACL.stiffness": 4000.0}}
    (cohort.parent / "next.yaml").write_text(yaml.safe_dump(own))
    with pytest.raises(kj.InputProblem, match="this start left out"):
        read_study(cohort.parent / "next.yaml")


def test_figures_of_a_knee_stand_in_its_page_and_are_drawn_once(calibrated):
    for name in KNEES:
        folder = calibrated[1] / "knees" / name
        assert (folder / "report.html").read_text().count("<svg") == 5
        assert not (folder / "figures").exists()


def test_the_page_links_to_every_knee_that_has_a_report(calibrated):
    out = calibrated[1]
    page = (out / "report.html").read_text()
    for name in KNEES:
        assert f'href="knees/{name}/report.html"' in page
        assert (out / "knees" / name / "report.html").is_file()
    assert 'href="knees/bad' not in page and "No answer" in page


def test_parts_make_the_very_same_and_what_is_there_is_not_computed_again(
    cohort, calibrated, numbers, capsys, monkeypatch
):
    out = cohort.parent / "parts"
    monkeypatch.setattr("kneejax.report.write_report", lambda *_, **__: None)  # pages of knees
    for number in (2, 1):
        words = ["--shard", f"{number}/2", "--bootstrap", "25"]
        main(["calibrate", str(cohort), "--out", str(out), *words])
    assert "left to other parts" in capsys.readouterr().out
    assert numbers(out) == numbers(calibrated[1])
    monkeypatch.setattr("kneejax.cli._cohort.run_side_by_side", None)
    monkeypatch.setattr("kneejax.cli._cohort.bootstrapped", None)
    for path in (out / "cohort.csv", out / "cohort.nc", out / "prior.yaml"):
        path.unlink()
    assert main(["calibrate", str(cohort), "--out", str(out), "--bootstrap", "25"]) == 1
    assert numbers(out) == numbers(calibrated[1])


def test_what_ends_a_task_is_met_once_more_and_then_said(cohort, capsys, monkeypatch):
    out, met = cohort.parent / "full", []

    def full(*_, **options):
        met.append(1)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("kneejax.cli._cohort.write_results", full)
    found = "kneejax.cli._cohort.run_side_by_side"
    monkeypatch.setattr(found, lambda studies: [None] * len(studies))
    assert main(["calibrate", str(cohort), "--out", str(out)]) == 1
    assert len(met) == 4
    assert "K1: OSError: [Errno 28] No space left on device" in capsys.readouterr().out


def test_a_cohort_takes_the_place_of_a_study_and_mends_what_was_damaged(
    cohort, tmp_path, monkeypatch
):
    """Once its report.html stood beside the study's result.json and poses.csv."""
    out, computed = tmp_path / "kneejax-calibration", []
    study = ResultsFolder(out)
    with study.gathered({"study": "paper1", "out": out}):
        for name in ("result.json", "poses.csv", "report.html", "figures/fit.png"):
            write_text(out / name, "of a study")
        study.commit({"command": "calibrate"})
    (out / "notes.txt").write_text("mine")

    def answered(studies):
        computed.append(len(studies))
        return [UnsuitableData("it does not balance") for _ in studies]

    monkeypatch.setattr("kneejax.cli._cohort.run_side_by_side", answered)
    words = ["calibrate", str(cohort), "--out", str(out)]
    assert main(words) == 1
    marks = {f"knees/{name}/task.json" for name in (*KNEES, "bad")}
    held = {x.relative_to(out).as_posix() for x in out.rglob("*") if x.is_file()}
    summary = {"cohort.csv", "cohort.nc", "report.html", "settings.json"}
    assert held == summary | marks | {"notes.txt"} and owned(out) == held - {"notes.txt"}
    first, whole = computed[:], (out / "cohort.csv").read_bytes()
    for damage in (lambda data: data[: len(data) // 2], lambda data: b"", lambda data: b"text"):
        path = out / "knees" / "K1" / "task.json"
        path.write_bytes(damage(path.read_bytes()))
        computed.clear()
        assert main(words) == 1
        assert len(computed) == 1 < len(first) and (out / "cohort.csv").read_bytes() == whole


def test_a_disk_that_is_too_full_is_said_before_the_work(cohort, capsys, monkeypatch):
    out = cohort.parent / "no_room"
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=0.6e6))
    assert main(["calibrate", str(cohort), "--out", str(out)]) == 2
    said = "expected at least 1 MB free for results of 4 knees; there are 0.6 MB"
    assert said in capsys.readouterr().err and not out.exists()


def test_what_a_full_disk_ends_is_no_file_and_goes_on_later(
    cohort, calibrated, numbers, capsys, monkeypatch
):
    """No file may grow beyond 4 kB, which the results of a knee and the netCDF need."""
    out = shutil.copytree(calibrated[1], cohort.parent / "full_later")
    whole = {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    for path in (out / "cohort.nc", *(out / "knees" / "K0").glob("*.*")):
        path.unlink()
    monkeypatch.setattr("kneejax.report.write_report", lambda *_, **__: None)  # pages of knees
    monkeypatch.setattr("kneejax.numerics._kept_programs._kept_in", None)
    words = ["calibrate", str(cohort), "--out", str(out), "--bootstrap", "25"]
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4_000, usual[1]))
    try:
        assert main(words) in (1, 2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    said = capsys.readouterr()
    assert "File too large" in said.out + said.err and "Traceback" not in said.err
    for path in out.rglob("*"):
        if path.suffix in (".draws", ".nc") or path.name == "result.json":
            assert path.read_bytes() == whole[path.relative_to(out)]
    assert not (out / "knees" / "K0" / "task.json").exists()
    assert not [path for path in out.rglob(".*") if path.is_file()]
    assert main(words) == calibrated[0]
    assert numbers(out) == numbers(calibrated[1])


def test_a_knee_among_others_is_what_it_is_alone(cohort):
    studies = [member.study for member in read_cohort(cohort).members][:3]
    together = run_side_by_side(studies)
    (alone,) = run_side_by_side(studies[1:2])
    for own, other in zip(together[1].fit.estimates, alone.fit.estimates, strict=True):
        assert own.value == pytest.approx(other.value, rel=1e-6)
        assert (own.low, own.high) == pytest.approx((other.low, other.high), rel=1e-5)
        assert own.interval is other.interval and math.isfinite(own.low)
