"""`kneejax simulate settle`, from the command to the tables."""

import csv

import pytest

from kneejax.cli import main


@pytest.mark.slow
def test_a_knee_that_is_let_go_ends_in_its_balance(tmp_path, capsys, hinged_file):
    words = ["simulate", "settle", "--knee", str(hinged_file), "--every_ms", "2"]
    words += ["--from", "anterior_mm=2"]
    assert main([*words, "--out", str(tmp_path / "first")]) == 0
    said = capsys.readouterr().out
    (line,) = [x for x in said.splitlines() if x.startswith("from the balance")]
    assert float(line.split()[-2]) < 1e-6
    with open(tmp_path / "first" / "motion.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 1001 and float(rows[-1]["time_s"]) == 2.0
    assert float(rows[0]["anterior_mm"]) - float(rows[-1]["anterior_mm"]) == pytest.approx(2.0)
    assert abs(float(rows[-1]["anterior_mm_per_s"])) < 1e-4
    with open(tmp_path / "first" / "energy.csv", newline="") as file:
        last = list(csv.DictReader(file))[-1]
    lost, missing = -float(last["potential_Nmm"]), float(last["missing_Nmm"])
    assert float(last["dissipated_Nmm"]) == pytest.approx(lost + missing, rel=1e-6)
    assert abs(missing) < 0.02 * lost
    assert main(["rerun", str(tmp_path / "first"), "--out", str(tmp_path / "again")]) == 0
    again = (tmp_path / "again" / "motion.csv").read_text()
    assert again == (tmp_path / "first" / "motion.csv").read_text()
