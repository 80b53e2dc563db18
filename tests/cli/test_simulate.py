"""What `kneejax simulate` says of other balances and of searches that end elsewhere."""

import csv
import json

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.experiments import Branch
from kneejax.statics import Status

pytestmark = pytest.mark.usefixtures("optimised_code")

ASKED = ["simulate", "passive-flexion", "--knee", "four_ligament", "--flexion", "20"]


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def two_balances(monkeypatch):
    """Of a knee at 20 degrees: the one that a test finds, and another."""

    def found(knee, flexion, loads):
        tested = Branch(0, np.array([20.0, 1, 2, 3, 4, 5]), Status.BALANCED, True, 0.0, 40)
        other = Branch(0, np.array([20.0, 9, 8, 7, 6, 5]), Status.OUTSIDE_REGION, False, 8.5, 24)
        return tested, other

    monkeypatch.setattr("kneejax.experiments.branches", found)


def test_other_balances_are_printed_written_and_recorded(two_balances, tmp_path, capsys):
    asked = [*ASKED, "--branches", "--out", str(tmp_path)]
    assert main([*asked, "--convention", "femoral"]) == 0
    tested, other = rows(tmp_path / "branches.csv")
    assert (tested["by_test"], other["by_test"]) == ("1", "0")
    assert other["status"] == "outside_region" and float(other["apart_mm"]) == 8.5
    assert float(other["adduction_deg"]) == 9.0 and other["starts"] == "24"
    assert json.loads((tmp_path / "settings.json").read_text())["branches"] is True
    printed = capsys.readouterr().out
    assert "There are other stable equilibria:" in printed and "branches.csv" in printed
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Passive flexion of four_ligament" in page and "1 pose passes every check" in page
    # What else was found is folded below the picture.
    below = page.index("There are other stable equilibria")
    assert page.index("<svg") < page.index("<details") < below


def test_without_the_option_nobody_looks_for_others(two_balances, tmp_path):
    assert main([*ASKED, "--out", str(tmp_path)]) == 0
    assert not (tmp_path / "branches.csv").exists()
    assert json.loads((tmp_path / "settings.json").read_text())["branches"] is False


@pytest.mark.parametrize(
    ("flexion", "change", "status", "told"),
    [
        ("20", ["--cut", "MCL", "--load", "varus_Nm=-40"], Status.GIVES_WAY, "held valgus moment"),
        ("0", ["--set", "MCL.reference_strain=-0.1"], Status.NOT_CONVERGED, "no motion leads"),
    ],
)
def test_a_lost_pose_says_how_far_it_was_and_what_was_in_the_way(
    flexion, change, status, told, tmp_path, capsys
):
    asked = [*ASKED[:-1], flexion, *change]
    assert main([*asked, "--out", str(tmp_path)]) == 1
    (pose,) = rows(tmp_path / "poses.csv")
    printed = capsys.readouterr().out
    assert pose["status"] == status.word and status.sentence in " ".join(printed.split())
    (line,) = [line for line in printed.splitlines() if line.startswith(f"  at {flexion}: ")]
    assert told in line


def test_the_terminal_prints_the_poses_that_are_written(tmp_path, capsys):
    """Once it printed femoral numbers whatever the convention of poses.csv."""
    assert main([*ASKED, "--convention", "tibial", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out.splitlines()
    (row,) = [line.split() for line in printed if line.split()[:1] == ["20.0"]]
    (pose,) = rows(tmp_path / "poses.csv")
    assert pose["convention"] == "tibial" and any("Poses, tibial:" in line for line in printed)
    written = [float(number) for number in list(pose.values())[:6]]
    assert [float(number) for number in row[:6]] == pytest.approx(written, abs=0.051)


@pytest.mark.filterwarnings("default")
def test_a_value_of_one_fibre_is_doubted_on_the_screen(tmp_path, capsys):
    """A structure's stiffness was once the mean of its fibres; what it is now is said."""
    asked = ["simulate", "passive-flexion", "--knee", "lenhart2015_reduced", "--out", str(tmp_path)]
    asked += ["--cut", "none", "--set"]
    assert main([*asked, "ACL.stiffness=655"]) == 2
    doubt, refusal = capsys.readouterr().err.splitlines()
    assert doubt == (
        "doubtful: ACL.stiffness: 655 N is of the whole ACL, drawn as 2 fibres with 9,840 N in "
        "this knee; one fibre has 4,920 N in the mean"
    )
    assert "no ligament 'none'" in refusal
    assert main([*asked, "ACL.stiffness=9310"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
