"""Commands end to end: files, exit status, one line for every bad input."""

import csv
import json
import os
import subprocess
import sys

import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax.cli import main
from kneejax.files import bundled_path

POSES = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"
#: 25 angles each, as many as the bundled study has: one program serves all commands.
FLEXION, BEYOND = "0:120:5", "40:160:5"


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_knees_and_describe_print(capsys):
    assert main(["knees"]) == 0
    assert "four_ligament" in capsys.readouterr().out
    assert main(["describe", "four_ligament"]) == 0
    printed = capsys.readouterr().out
    for word in ("ACL", "4500", "medial", "condyle", "mm rms", "Adapted"):
        assert word in printed


def test_knees_says_which_study_lacks_its_measurement(tmp_path, monkeypatch, capsys):
    from kneejax.files import _bundled

    for kind in ("knees", "studies"):
        (tmp_path / kind).mkdir()
    needy = "title: Needy\nmeasured:\n  file: ../mine/poses.csv\n"
    (tmp_path / "studies" / "needy.yaml").write_text(needy)
    (tmp_path / "studies" / "twin.yaml").write_text("title: Twin\nsynthetic: {}\n")
    monkeypatch.setattr(_bundled, "_data_folder", lambda: tmp_path)
    table = tmp_path / "mine" / "poses.csv"

    assert main(["knees"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("not bundled") == 1
    assert f"not bundled: {table}\n" in printed
    assert str(tmp_path / "studies" / "needy.yaml") in printed
    assert printed.index("Needy") < printed.index("not bundled") < printed.index("Twin")

    table.parent.mkdir()
    table.write_text(POSES)
    assert main(["knees"]) == 0
    assert "not bundled" not in capsys.readouterr().out


def test_simulate_then_evaluate(tmp_path, capsys):
    out = tmp_path / "passive"
    assert main(["simulate", "passive-flexion", "--flexion", FLEXION, "--out", str(out)]) == 0
    poses = rows(out / "poses.csv")
    assert [float(row["flexion_deg"]) for row in poses] == list(range(0, 121, 5))
    assert {row["status"] for row in poses} == {"balanced"}
    assert (out / "figures" / "simulation.png").stat().st_size > 10_000

    assert main(["evaluate", "four_ligament", str(out / "poses.csv"), "--out", str(tmp_path)]) == 0
    forces = rows(out / "forces.csv")
    simulated = {(row["flexion_deg"], row["part"]): float(row["force_N"]) for row in forces}
    for row in rows(tmp_path / "ligaments.csv"):
        expected = simulated[row["flexion_deg"], row["ligament"]]
        assert float(row["force_N"]) == pytest.approx(expected, abs=1e-6)
    contact = rows(tmp_path / "contact.csv")
    assert len(contact) == 50
    for row in contact:
        parts = [float(row[f"force_{a}_N"]) for a in ("anterior", "superior", "lateral")]
        assert np.linalg.norm(parts) == pytest.approx(float(row["force_N"]))
    capsys.readouterr()


def test_a_drawer_is_read_along_the_axis_it_pulls_along(tmp_path, capsys):
    """What the femur's anterior axis shows of a drawer fades with flexion; the floating axis shows
    all of it at every angle, and so does the default of what is printed."""
    tables = []
    for load in ([], ["--load", "anterior_N=50"]):
        out = tmp_path / f"load{len(load)}"
        main(["simulate", "passive-flexion", "--flexion", FLEXION, "--out", str(out), *load])
        tables.append([float(row["anterior_mm"]) for row in rows(out / "poses.csv")])
    femoral = np.array(tables[1]) - np.array(tables[0])
    moved = [float(row["anterior_change_mm"]) for row in rows(out / "displacement.csv")]
    assert min(moved) > 0.6
    assert moved[0] == pytest.approx(femoral[0], abs=1e-3)
    at_90 = [float(row["flexion_deg"]) for row in rows(out / "poses.csv")].index(90.0)
    assert moved[at_90] == pytest.approx(0.68, abs=0.01) and femoral[at_90] < 0.2
    assert not (tmp_path / "load0" / "displacement.csv").exists()

    printed = capsys.readouterr().out
    assert "Poses, femoral: translations of the tibia's origin along the femur's axes" in printed
    assert "four_ligament, anterior force 50 N" in printed
    shown = printed.split("What the load moved, along its own axes")[1].splitlines()
    assert [line.split()[3] for line in shown if line.split()[:1] == ["90.0"]] == ["0.68"]
    settings = json.loads((out / "settings.json").read_text())
    assert settings["knee"] == "four_ligament" and settings["load"]["anterior_N"] == 50.0


LIBRARY = """
import jax, sys
jax.config.update("jax_enable_x64", True)
import kneejax as kj
from kneejax.files import write_poses
from kneejax.mechanics import load_of
from kneejax.numerics import compiler_options
assert compiler_options(), "without shared fusion kneejax asks XLA for none"
drawer = [load_of(anterior_N=20.0)]
motion = kj.passive_flexion(kj.load_knee("four_ligament"), list(range(0, 121, 5)), drawer)
write_poses(sys.argv[1], motion.to_table())
"""


@pytest.mark.slow
def test_a_command_and_a_library_without_flags_find_the_poses_of_a_test(tmp_path, capsys):
    """The command sets XLA up before anything is computed, a library leaves XLA as it is, and the
    tests' own process has flags of its own: up to three programs, one motion."""
    asked = ["simulate", "passive-flexion", "--flexion", FLEXION, "--load", "anterior_N=20"]
    main([*asked, "--out", str(tmp_path / "here")])
    flags = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    library = tmp_path / "library.csv"
    processes = [
        subprocess.Popen(
            [sys.executable, *words], env=flags, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        for words in (
            ["-m", "kneejax.cli", *asked, "--out", str(tmp_path / "there")],
            ["-c", LIBRARY, str(library)],
        )
    ]
    for process in processes:
        said, _ = process.communicate()
        assert process.returncode == 0, said.decode()
    tables = [
        np.array([[float(row[c]) for c in POSES.strip().split(",")] for row in rows(file)])
        for file in (tmp_path / "here" / "poses.csv", tmp_path / "there" / "poses.csv", library)
    ]
    np.testing.assert_allclose(tables[1], tables[0], atol=1e-7)
    np.testing.assert_allclose(tables[2], tables[0], atol=1e-7)
    capsys.readouterr()


def test_calibrate_writes_everything(tmp_path, capsys):
    assert main(["calibrate", "--out", str(tmp_path)]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["success"] is True
    assert set(result["parameters"]["ACL.stiffness"]) == {
        "value",
        "start",
        "lower",
        "upper",
        "standard_error",
        "at_bound",
        "low",
        "high",
        "interval",
    }
    assert result["outcome"] == "Converged" and result["noise"]["lateral"] == 0.1
    kinds = {name: one["interval"] for name, one in result["parameters"].items()}
    # Beside paper 1's bound of 10,000 N the data give no upper limit.
    assert kinds["MCL.stiffness"] == "one-sided" and kinds["ACL.stiffness"] == "standard error"
    assert result["objective"] < 1e-2 * result["objective_start"]
    assert set(result["versions"]) >= {"jax", "optimistix", "numpy"}
    page = (tmp_path / "report.html").read_text()
    assert "<svg" in page and "http://" not in page.replace("http://www.w3.org", "")
    assert len(rows(tmp_path / "poses.csv")) == 25
    assert len(rows(tmp_path / "parameters.csv")) == 8
    assert "ACL.stiffness" in capsys.readouterr().out
    # One call in Python does the same.
    own, names = kj.run(kj.read_study("paper1")), ("*.stiffness", "*.reference_strain")
    parameters = {name: one["value"] for name, one in result["parameters"].items()}
    assert {e.name: e.value for e in own.fit.estimates} == parameters
    assert [fit.evaluations for fit in own.fits] == [
        one["evaluations"] for one in result["per_procedure"].values()
    ]
    assert json.loads(json.dumps(own.settings)) == result["settings"]
    # Other commands take the knee that was found.
    start, chosen = kj.load_knee("four_ligament"), kj.select(kj.load_knee("four_ligament"), names)
    fitted = chosen.apply(start, np.array([parameters[name] for name in chosen.names]))
    for file in ("knee.yaml", "result.json"):
        for one, two in zip(
            jax.tree.leaves(kj.load_knee(tmp_path / file)), jax.tree.leaves(fitted), strict=True
        ):
            np.testing.assert_allclose(one, two, rtol=1e-12)
    assert main(["describe", str(tmp_path / "knee.yaml")]) == 0
    assert "four_ligament calibrated" in capsys.readouterr().out


def bad_knee(tmp_path, old, new):
    text = bundled_path("knees", "four_ligament").read_text()
    assert old in text
    path = tmp_path / "knee.yaml"
    path.write_text(text.replace(old, new, 1))
    return ["describe", str(path)]


def bad_table(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ["evaluate", "four_ligament", str(path), "--out", str(tmp_path / "out")]


def study(tmp_path, text):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return ["calibrate", str(path), "--out", str(tmp_path / "out")]


def simulate(tmp_path, *words):
    return ["simulate", "passive-flexion", *words, "--out", str(tmp_path / "o")]


TWIN = bundled_path("studies", "paper1").read_text()

BAD = {
    "unknown command": (lambda t: ["calibrat"], "calibrate"),
    "unknown option": (lambda t: ["calibrate", "--outt", "x"], "did you mean --out?"),
    "field of a study as an option": (
        lambda t: ["calibrate", "--weigths", "x"], "did you mean the field weights of a study file?"
    ),
    "misspelt option with a value": (
        lambda t: ["simulate", "passive-flexion", "--flx=3"], "did you mean --flexion?"
    ),
    "unknown choice": (
        lambda t: ["evaluate", "four_ligament", "x.csv", "--convention", "tibal"],
        "did you mean tibial?",
    ),
    "unknown experiment": (
        lambda t: ["simulate", "passive-flexon"], "did you mean passive-flexion?"
    ),
    "too many words": (lambda t: ["calibrate", "paper1", "extra"], "unrecognized arguments: extra"),
    "unknown knee": (lambda t: ["describe", "four_ligamnt"], "did you mean four_ligament?"),
    "unknown knee as a file": (
        lambda t: ["describe", str(t / "four_ligamnt.yaml")], "did you mean four_ligament?"
    ),
    "unknown study": (lambda t: ["calibrate", "papr1"], "did you mean paper1?"),
    "unknown study as a file": (
        lambda t: ["calibrate", str(t / "papr1.yaml")], "did you mean paper1?"
    ),
    "no such study": (
        lambda t: ["calibrate", str(t / "nostudy.yaml")],
        "a bundled study (average_knee, four_ligament_fitted, lenhart2015_mri, paper1",
    ),
    "study of another name beside it": (
        lambda t: [study(t, TWIN)[0], str(t / "stdy.yaml")], "did you mean study.yaml?"
    ),
    "negative stiffness": (lambda t: bad_knee(t, "stiffness_N: 4500.0", "stiffness_N: -1"), "-1"),
    "unknown field": (lambda t: bad_knee(t, "stiffness_N: 4500.0", "stifness_N: 1"), "stiffness_N"),
    "slack length zero": (
        lambda t: bad_knee(t, "reference_strain: 0.03", "slack_length_mm: 0"),
        "slack_length_mm",
    ),
    "metres": (
        lambda t: bad_knee(t, "[-1.151, -0.054, 5.299]", "[-1151, -54, 5299]"),
        "femoral_attachment_mm",
    ),
    "directory": (lambda t: ["describe", str(t)], "directory"),
    "empty table": (lambda t: bad_table(t, ""), "empty"),
    "binary table": (lambda t: bad_table(t, bytes(range(256))), "poses.csv"),
    "NaN in a table": (lambda t: bad_table(t, POSES + "0,0,nan,0,0,1\n"), "nan"),
    "missing file": (lambda t: ["evaluate", "four_ligament", str(t / "no.csv")], "no.csv"),
    "unknown parameter": (
        lambda t: ["simulate", "passive-flexion", "--set", "ACL.stifness=3", "--out", str(t / "o")],
        "ACL.stiffness",
    ),
    "set: a parameter of no ligament": (
        lambda t: simulate(t, "--set", "meniscus.tension=3"),
        "--set: unknown parameter 'meniscus.tension': expected a ligament, a group or a part of",
    ),
    "unknown parameter of a study": (
        lambda t: study(t, TWIN.replace('"*.stiffness"', "ACL.stifness")),
        "study.yaml: unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?",
    ),
    "unknown bounds of a study": (
        lambda t: study(t, TWIN.replace("stiffness: [300, 10000]", "ACL.stifness: [300, 10000]")),
        "study.yaml: unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?",
    ),
    "unknown ligament": (lambda t: simulate(t, "--cut", "foo"), "expected one of ACL, PCL"),
    "unknown load": (
        lambda t: simulate(t, "--load", "anterio_N=3"), "did you mean anterior_N?",
    ),
    "a load without its unit": (
        lambda t: simulate(t, "--load", "internal_rotation=5"), "did you mean internal_Nm?",
    ),
    "a moment in N mm": (
        lambda t: simulate(t, "--load", "varus_Nm=10000"), "N mm are suspected",
    ),
    "an absurd load": (
        lambda t: simulate(t, "--load", "anterior_N=1e30"), "between -100,000 and 100,000 N",
    ),
    "a load given twice": (
        lambda t: simulate(t, "--load", "varus_Nm=1", "--load", "varus_Nm=2"), "every name once",
    ),
    "set: negative stiffness": (
        lambda t: simulate(t, "--set", "ACL.stiffness=-5"), "--set: ACL.stiffness: -5: expected",
    ),
    "set: slack length zero": (
        lambda t: simulate(t, "--set", "ACL.slack_length=0"), "between 1 and 300 mm",
    ),
    "set: a strain that no length has": (
        lambda t: simulate(t, "--set", "ACL.reference_strain=-1.5"), "between -0.9 and 0.5",
    ),
    "set: an attachment far off": (
        lambda t: simulate(t, "--set", "ACL.tibial_attachment.superior=-900"),
        "--set: ACL.length: 900.1 mm",
    ),
    "absurd flexion": (
        lambda t: simulate(t, "--flexion", "0,1e30"), "between -30 and 180 degrees",
    ),
    "absurd pose": (
        lambda t: bad_table(t, POSES + "0,0,0,1e30,0,1\n"), "between -1000 and 1000 mm",
    ),
    "absurd range of a map": (
        lambda t: ["map", "paper1", "--pair", "ACL.stiffness", "PCL.stiffness", "--range",
                   "ACL.stiffness=1:1e30", "--out", str(t / "o")], "10,000,000 N",
    ),
    "absurd sweep": (
        lambda t: ["sensitivity", "--sweep", "ACL.reference_strain=-5:5", "--out", str(t / "o")],
        "a strain, not percent",
    ),
    "absurd width": (
        lambda t: ["sensitivity", "--prior", "ACL.stiffness=1e-300", "--out", str(t / "o")],
        "--prior: ACL.stiffness: 1e-300: expected between 0.01 and",
    ),
    "flexion not a range": (
        lambda t: ["simulate", "passive-flexion", "--flexion", "0:x:5", "--out", str(t / "o")],
        "flexion",
    ),
    "bounds exclude the start": (
        lambda t: study(t, TWIN.replace("stiffness: [300, 10000]", "stiffness: [300, 4000]")),
        "exclude the start 4500",
    ),
    "unknown study field": (lambda t: study(t, TWIN + "boundz: 3\n"), "bounds"),
}


@pytest.mark.parametrize("name", ["knee.yaml", "result.json"])
def test_the_knee_of_a_study_is_not_overwritten(name, tmp_path, unmeasured, capsys):
    knee = tmp_path / name
    found = json.dumps({"knee": "four_ligament", "parameters": {}})
    text = bundled_path("knees", "four_ligament").read_text() if name == "knee.yaml" else found
    knee.write_text(text)
    words = study(tmp_path, TWIN.replace("knee: four_ligament", f"knee: {name}"))
    assert main([*words[:2], "--out", str(tmp_path)]) == 2
    assert "another file than the knee that is calibrated" in capsys.readouterr().err
    assert knee.read_text() == text and not (tmp_path / "figures").exists()


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_status_2(case, tmp_path, capsys):
    arguments, expected = BAD[case]
    try:
        status = main(arguments(tmp_path))
    except SystemExit as stop:
        status = stop.code
    printed = capsys.readouterr()
    assert status == 2
    assert len(printed.err.strip().splitlines()) == 1
    assert expected in printed.err
    assert not (tmp_path / "out").exists() and not (tmp_path / "o").exists()


def test_an_option_that_is_like_no_other_is_offered_none(capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", "--set", "ACL.stiffness=3"])
    assert "did you mean" not in capsys.readouterr().err


def test_flexion_outside_the_surfaces_is_said(tmp_path, capsys):
    out = str(tmp_path)
    assert main(["simulate", "passive-flexion", "--flexion", BEYOND, "--out", out]) == 1
    assert "160 degrees: " in capsys.readouterr().out
    status = {row["flexion_deg"]: row["status"] for row in rows(tmp_path / "poses.csv")}
    assert status["40.0"] == "balanced" and status["160.0"] != "balanced"


def test_a_reader_that_has_seen_enough_is_no_error():
    command = [sys.executable, "-m", "kneejax.cli", "knees"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (0, b"")


@pytest.mark.parametrize(
    ("command", "ended", "status"),
    [
        ("simulate passive-flexion", 0, 0),
        ("simulate passive-flexion", 1, 1),
        ("simulate passive-flexion", BrokenPipeError, 1),
        ("knees", BrokenPipeError, 0),
    ],
)
def test_a_reader_that_has_seen_enough_hides_no_doubt(
    tmp_path, monkeypatch, command, ended, status
):
    """What a command found stands; one that was cut short may not have written its files."""

    def run(_):
        print("a line")
        if isinstance(ended, type):
            raise ended
        return ended

    words = command.split()
    monkeypatch.setattr(f"kneejax.cli._{words[0]}.run", run)
    words += ["--out", str(tmp_path / "out")] if words[0] == "simulate" else []
    reads, writes = os.pipe()
    os.close(reads)
    with os.fdopen(writes, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        assert main(words) == status
