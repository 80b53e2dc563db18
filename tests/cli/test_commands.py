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

POSES = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"
#: 25 angles each, as many as the bundled study has: one program serves all commands.
PASSIVE = ["simulate", "passive-flexion", "--knee", "four_ligament"]
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
    needy = "title: Needy\nmeasured:\n  file: ../mine/poses.csv\n  source: Doe 2020\n"
    (tmp_path / "studies" / "needy.yaml").write_text(needy)
    (tmp_path / "studies" / "twin.yaml").write_text("title: Twin\nsynthetic: {}\n")
    monkeypatch.setattr(_bundled, "_data_folder", lambda: tmp_path)

    assert main(["knees"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("not bundled") == 1
    assert "not bundled (Doe 2020): name its `file` in a copy" in " ".join(printed.split())
    assert str(tmp_path) not in printed  # a file inside the package is nobody's to write
    assert printed.index("Needy") < printed.index("not bundled") < printed.index("Twin")

    table = tmp_path / "mine" / "poses.csv"
    table.parent.mkdir()
    table.write_text(POSES)
    assert main(["knees"]) == 0
    assert "not bundled" not in capsys.readouterr().out


@pytest.mark.long
def test_simulate_then_evaluate(tmp_path, capsys):
    out = tmp_path / "passive"
    assert main([*PASSIVE, "--flexion", FLEXION, "--out", str(out)]) == 0
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
        main([*PASSIVE, "--flexion", FLEXION, "--out", str(out), *load])
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
    assert "How the tibia moves, anterior force 50 N, at" in printed
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
    asked = [*PASSIVE, "--flexion", FLEXION, "--load", "anterior_N=20"]
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


@pytest.mark.long
def test_calibrate_writes_everything(tmp_path, capsys):
    assert main(["calibrate", "--out", str(tmp_path), "--verbose"]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["success"] is True
    # A search, its slopes, the mechanics of a pose, and where contacts meet; and small ones.
    programs = result["programs"]
    assert set(programs) == {"compiled", "seconds", "large", "read"}
    assert programs["large"] <= 4 and programs["compiled"] + programs["read"] <= 100
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
    kinds = {one["interval"] for one in result["parameters"].values()}
    assert kinds == {"standard error"}
    # One fit, and nothing to warn of; the tibia turns inwards.
    assert list(result["per_procedure"]) == ["III"] and result["warnings"] == []
    turned = [float(row["internal_rotation_deg"]) for row in rows(tmp_path / "poses.csv")]
    assert turned[18] - turned[0] > 10.0
    assert result["objective"] < 1e-2 * result["objective_start"]
    assert set(result["versions"]) >= {"jax", "optimistix", "numpy"}
    page = (tmp_path / "report.html").read_text()
    assert "<svg" in page and "http://" not in page.replace("http://www.w3.org", "")
    assert len(rows(tmp_path / "poses.csv")) == 25
    assert len(rows(tmp_path / "parameters.csv")) == 8
    said = capsys.readouterr()
    assert "ACL.stiffness" in said.out and "read from the cache" in said.err
    assert "rocedure" not in said.out and "warning" not in said.out
    # One call in Python does the same.
    own = kj.calibrate(kj.read_study("passive_flexion"))
    names = ("*.stiffness", "*.reference_strain")
    parameters = {name: one["value"] for name, one in result["parameters"].items()}
    assert {e.name: e.value for e in own.fit.estimates} == parameters
    assert [fit.evaluations for fit in own.fits] == [
        one["evaluations"] for one in result["per_procedure"].values()
    ]
    assert json.loads(json.dumps(own.settings)) == result["settings"]
    # Other commands take the knee that was found.
    start = kj.load_knee("four_ligament_fitted")
    chosen = kj.select(start, names)
    fitted = chosen.apply(start, np.array([parameters[name] for name in chosen.names]))
    for file in ("knee.yaml", "result.json"):
        for one, two in zip(
            jax.tree.leaves(kj.load_knee(tmp_path / file)), jax.tree.leaves(fitted), strict=True
        ):
            np.testing.assert_allclose(one, two, rtol=1e-12)
    assert main(["describe", str(tmp_path / "knee.yaml")]) == 0
    assert "four_ligament_fitted calibrated" in capsys.readouterr().out


def test_flexion_outside_the_surfaces_is_said(tmp_path, capsys):
    out = str(tmp_path)
    assert main([*PASSIVE, "--flexion", BEYOND, "--out", out]) == 1
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


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
@pytest.mark.parametrize(("command", "status"), [("evaluate", 1), ("knees", 2)])
def test_a_full_place_to_print_to_costs_no_file(tmp_path, monkeypatch, capsys, command, status):
    """Results are written whatever becomes of what is printed; both are said."""
    words = [command]
    if command == "evaluate":
        poses = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm"
        (tmp_path / "poses.csv").write_text(f"{poses}\n30,0,2,1,-28,0.5\n")
        words += ["four_ligament", str(tmp_path / "poses.csv"), "--out", str(tmp_path / "out")]
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert main(words) == status
    assert capsys.readouterr().err == "kneejax: stdout: No space left on device\n"
    assert (tmp_path / "out" / "settings.json").exists() == (command == "evaluate")
