"""A cohort is read whole: what it takes from its table, and every mistake of every row at once."""

import numpy as np
import pytest
import yaml

from kneejax.cli import main
from kneejax.cohorts import is_cohort, plan, read_cohort
from kneejax.files import InputProblem, InputProblems, write_poses

POSES = np.array([[0.0, 0.5, 1.0, 2.0, -1.0, 0.5], [30.0, 1.0, 4.0, 2.5, -2.0, 0.4]])
STUDY = {
    "title": "Knee", "knee": "four_ligament", "parameters": ["*.stiffness"],
    "measured": {"file": "", "source": "made"}, "procedures": ["III"],
}  # fmt: skip


def written(folder, rows, study=STUDY, **more):
    """A cohort with this table."""
    write_poses(folder / "poses.csv", POSES)
    (folder / "knees.csv").write_text("\n".join(rows) + "\n")
    document = {"title": "Knees", "study": study, "knees": "knees.csv", **more}
    (folder / "cohort.yaml").write_text(yaml.safe_dump(document))
    return folder


def test_a_row_says_what_is_its_own(tmp_path):
    rows = [
        "name,side,measured.file,set.ACL.stiffness,noise_mm,mass_kg",
        "A1,right,poses.csv,4000,,70",
        "A2,left,poses.csv,,0.5,82.5",
    ]
    first, second = read_cohort(written(tmp_path, rows, about=["mass_kg"])).members
    assert float(first.study.knee.ligaments.stiffness[0]) == 4000.0
    assert float(second.study.knee.ligaments.stiffness[0]) == 4500.0
    assert (first.study.noise_mm, second.study.noise_mm) == (None, 0.5)
    assert (first.about, second.about) == ({"mass_kg": 70}, {"mass_kg": 82.5})
    # Of a left knee adduction, internal rotation and lateral shift change their sign.
    turned = second.study.measured[1] / first.study.measured[1]
    assert turned.tolist() == [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    assert first.study.title == "Knee: A1"


def test_every_mistake_of_every_row_is_said_at_once(tmp_path, capsys):
    rows = [
        "name,measured.file,knee,noise_mm,measured.mirorr",
        "A1,poses.csv,,,",
        "A2,absent.csv,absent.yaml,,",
        "A3,poses.csv,,-1,",
        "a1,poses.csv,,,",
        ",poses.csv,,,",
        "A5,poses.csv,,,true",
    ]
    with pytest.raises(InputProblems) as found:
        read_cohort(written(tmp_path, rows))
    said = [*map(str, found.value.problems)]
    place = f"{tmp_path / 'knees.csv'}: row"
    for number, words in enumerate(
        ["2 (A2): knee: absent.yaml", "2 (A2): measured.file: absent.csv", "3 (A3): noise_mm: -1",
         "5: name: missing", "6 (A5): measured.mirorr"]
    ):  # fmt: skip
        assert said[number].startswith(f"{place} {words}"), said[number]
    assert "did you mean mirror?" in said[4]
    assert said[5].startswith(f"{place} 4 (a1): name") and len(said) == 6
    out = tmp_path / "out"
    assert main(["calibrate", str(tmp_path), "--out", str(out)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 7 and lines[-1] == "kneejax: 6 mistakes; nothing was computed"
    assert not out.exists()


def test_a_folder_or_a_pattern_of_studies_is_a_cohort(tmp_path):
    with pytest.raises(InputProblem, match="cohort.yaml, or studies as"):
        read_cohort(tmp_path)
    write_poses(tmp_path / "poses.csv", POSES)
    study = STUDY | {"measured": {"file": "poses.csv", "source": "made"}}
    for name in ("one.yaml", "two.yaml"):
        (tmp_path / name).write_text(yaml.safe_dump(study))
    (tmp_path / "own_knee.yaml").write_text("kneejax: 1\n")
    assert [one.name for one in read_cohort(tmp_path).members] == ["one", "two"]
    pattern = f"{tmp_path}/t*.yaml"
    assert [one.name for one in read_cohort(pattern).members] == ["two"]
    assert is_cohort(tmp_path) and is_cohort(pattern) and not is_cohort(tmp_path / "one.yaml")
    with pytest.raises(InputProblem, match="at least one study file"):
        read_cohort(f"{tmp_path}/x*.yaml")


def test_blocks_are_those_of_the_plan_and_named_by_what_they_depend_on(tmp_path):
    rows = ["name,measured.file,set.ACL.stiffness,parameters"]
    rows += [f"K{k},poses.csv,{4000 + k}," for k in range(5)]
    tasks = plan(read_cohort(written(tmp_path, rows)), 2)
    assert [task.names for task in tasks] == [("K0", "K1"), ("K2", "K3"), ("K4",)]
    again = plan(read_cohort(tmp_path), 2)
    assert [one.fingerprint for one in tasks] == [one.fingerprint for one in again]
    rows[4] = "K3,poses.csv,5000,"
    changed = plan(read_cohort(written(tmp_path, rows)), 2)
    same = [a.fingerprint == b.fingerprint for a, b in zip(tasks, changed, strict=True)]
    assert same == [True, False, True]
    # A knee that is asked something else stands in a block of its own.
    rows[1] = "K0,poses.csv,4000,"
    other = STUDY | {"noise_mm": 0.1}
    assert plan(read_cohort(written(tmp_path, rows, other)), 2)[0].fingerprint != (
        tasks[0].fingerprint
    )


def test_a_bundled_study_or_a_file_may_be_the_template(tmp_path):
    rows = ["name,set.ACL.stiffness", "one,4000", "two,5000"]
    (first, _) = read_cohort(written(tmp_path, rows, "paper1")).members
    assert first.study.truth["ACL.stiffness"] == 5876.0
    (tmp_path / "templates").mkdir()
    write_poses(tmp_path / "templates" / "shared.csv", POSES)
    study = STUDY | {"measured": {"file": "shared.csv", "source": "made"}}
    (tmp_path / "templates" / "study.yaml").write_text(yaml.safe_dump(study))
    rows = ["name,measured.file", "one,", "two,poses.csv"]
    members = read_cohort(written(tmp_path, rows, "templates/study.yaml")).members
    assert [len(one.study.measured) for one in members] == [2, 2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--shard", "3/2"], "--shard: 3/2: expected I/N with I from 1 to N"),
        (["--jobs", "0"], "--jobs: 0: expected a whole number between 1 and 1024"),
        (["--bootstrap", "0"], "--bootstrap: 0: expected a whole number between 1 and 1,000,000"),
        (["--jobs", "2", "--scheduler", "x"], "--scheduler: x: expected one of"),
    ],
)
def test_an_option_that_means_nothing_is_one_line(tmp_path, capsys, words, said):
    rows = ["name,measured.file", "A1,poses.csv"]
    folder = written(tmp_path, rows)
    out = tmp_path / "out"
    assert main(["calibrate", str(folder), *words, "--out", str(out)]) == 2
    assert capsys.readouterr().err.startswith(f"kneejax: calibrate: {said}")
    assert not out.exists()


@pytest.mark.parametrize("words", [["--jobs", "2"], ["--scheduler", "tcp://127.0.0.1:9"]])
def test_a_missing_dask_is_said_before_anything_is_read(tmp_path, capsys, monkeypatch, words):
    folder = written(tmp_path, ["name,measured.file", "A1,absent.csv"])
    out = tmp_path / "out"
    with monkeypatch.context() as without:
        without.setattr("importlib.util.find_spec", lambda _: None)
        assert main(["calibrate", str(folder), *words, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "kneejax[cohorts]" in line and not out.exists()


def test_a_single_study_refuses_what_only_a_cohort_can_be_asked(capsys):
    assert main(["calibrate", "paper1", "--jobs", "2"]) == 2
    assert "with a cohort alone" in capsys.readouterr().err
    assert main(["calibrate", "paper1", "--blocks"]) == 2
    assert "--blocks: given: expected --bootstrap N" in capsys.readouterr().err


@pytest.mark.parametrize(("knee", "same"), [("four_ligament", True), ("ten_bundle", False)])
def test_answers_of_an_older_meaning_are_another_tasks(knee, same, tmp_path, monkeypatch):
    """Stiffness of a structure drawn as several fibres was once their mean."""
    study = STUDY | {"knee": knee, "parameters": ["ACL.stiffness"]}
    cohort = read_cohort(written(tmp_path, ["name,measured.file", "A,poses.csv"], study))
    (now,) = plan(cohort)
    monkeypatch.setattr("kneejax.cohorts._tasks.MEANING", {})
    (before,) = plan(cohort)
    assert (now.fingerprint == before.fingerprint) is same
