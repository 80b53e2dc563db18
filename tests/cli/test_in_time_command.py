"""What `kneejax simulate` refuses of a motion through time, before a knee is read."""

import pytest

from kneejax.cli import main
from kneejax.files import InputProblem, read_loads_over_time


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lachman", "--duration_s", "2"], "expected --dynamic, or settle or drop, with it"),
        (["lachman", "--from", "anterior_mm=2"], "--from: lachman: expected --dynamic"),
        (["lachman", "--dynamic", "--flexion", "0,20"], "one angle through time"),
        (["lachman", "--dynamic", "--both"], "a test without --dynamic with it"),
        (["lachman", "--dynamic", "--displacement_mm", "5"], "a test without --dynamic with it"),
        (["lachman", "--dynamic", "--body_kg", "-75"], "between 20 and 300 kg"),
        (["lachman", "--dynamic", "--critical", "-1"], "between 0 and 100"),
        (["lachman", "--dynamic", "--every_ms", "0.01"], "1 to 20000 rows in 1 s"),
        (["lachman", "--dynamic", "--loads", "x.csv"], "load --dynamic with it"),
        (["load", "--dynamic"], "loads as NAME=SIZE, or --loads FILE.csv"),
        (["envelope", "--dynamic"], "one test under load with it"),
        (["passive-flexion", "--dynamic"], "one test under load with it"),
        (["extension", "--dynamic"], "expected leg-raise, or a test under load"),
        (["leg-raise", "--dynamic", "--flexion", "0,20"], "four angles at least"),
        (["leg-raise", "--dynamic", "--load", "anterior_N=5"], "a test under load with it"),
        (["leg-raise", "--dynamic", "--from", "anterior_mm=5"], "--from: leg-raise"),
        (["leg-raise", "--dynamic", "--femur_deg", "120"], "between -90 and 90 degrees"),
        (["settle", "--free", "critical"], "--free: critical: expected --recorded FILE.csv"),
        (["settle", "--recorded", "x.csv"], "--recorded: x.csv: expected --free with one of"),
        (["settle", "--recorded", "x.csv", "--free", "critica"], "did you mean critical?"),
        (["lachman", "--free", "critical"], "expected --dynamic, or settle or drop, with it"),
        (["leg-raise", "--dynamic", "--recorded", "x.csv", "--free", "critical"],
         "--recorded: leg-raise: expected settle, drop or a test under load"),
        (["settle", "--dissipation_s_per_mm", "20"], "s/m are suspected"),
        (["settle", "--force_N", "10"], "a test under load with it"),
        (["settle", "--from", "anterior=2"], "did you mean anterior_mm?"),
        (["drop", "--quadriceps_N", "100"], "patellar-tracking or extension with it"),
    ],
)
def test_options_that_mean_nothing_are_refused_in_one_line(words, said, tmp_path, capsys):
    assert main(["simulate", *words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_shortened_option_is_not_taken_for_one_in_another_unit(capsys):
    assert main(["simulate", "settle", "--dissipation_s_per_m", "0.01"]) == 2
    assert "did you mean --dissipation-s-per-mm?" in capsys.readouterr().err


def test_a_table_for_a_motor_holds_nothing_but_lengths(tmp_path, capsys):
    words = ["simulate", "leg-raise", "--dynamic", "--loads", str(tmp_path / "way.csv")]
    for header, said in (
        ("quadricep_mm", "did you mean quadriceps_mm?"), ("anterior_N", "expected time_s, quad"),
    ):  # fmt: skip
        (tmp_path / "way.csv").write_text(f"time_s,{header}\n0,210\n5,200\n")
        assert main([*words, "--out", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("time_s,anterior_N\n0,0\n0.2,50\n0.1,100\n", r"row 3 \(line 4\), time_s: 0.1"),
        ("time_s,anterior_N\n0,0\n", "two times at least"),
        ("anterior_N\n0\n", "time_s"),
        ("time_s,anterior\n0,0\n1,2\n", "did you mean anterior_N"),
        ("time_s,flexion\n0,0\n1,2\n", "did you mean flexion_deg"),
        ("time_s,anterior_N\n0,0\n1,many\n", "expected a number"),
    ],
)
def test_a_table_over_time_that_is_none_is_refused(table, said, tmp_path):
    path = tmp_path / "loads.csv"
    path.write_text(table)
    with pytest.raises(InputProblem, match=said):
        read_loads_over_time(path)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("time_s,anterior_m\n0,0\n1,2\n", "did you mean anterior_mm?"),
        ("time_s,anterior_N\n0,0\n1,2\n", "loads stand in --loads"),
        ("time_s,flexion_deg\n0,0\n1,2\n", "flexion_deg: expected one of"),
        ("time_s,anterior_mm\n0.5,0\n1,2\n", "row 1, time_s: 0.5: expected 0, where the motion"),
    ],
)
def test_a_record_that_is_none_is_refused_in_one_line(table, said, tmp_path, capsys):
    (tmp_path / "record.csv").write_text(table)
    words = ["simulate", "settle", "--recorded", str(tmp_path / "record.csv")]
    assert main([*words, "--free", "critical", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
