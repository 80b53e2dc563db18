"""What `kneejax simulate` refuses of a quadriceps, before a knee is read."""


import pytest

from kneejax.cli import main
from kneejax.files import load_knee_file, write_knee


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["leg-raise", "--quadriceps_N", "100"], "expected patellar-tracking or extension with it"),
        (["leg-raise", "--body_kg", "700"], "between 20 and 300 kg"),
        (["leg-raise", "--height_m", "175"], "cm are suspected"),
        (["leg-raise", "--ankle_kg", "-1"], "between 0 and 100 kg"),
        (["leg-raise", "--branches"], "expected passive-flexion with it"),
        (["extension", "--force_N", "10"], "expected a test under load with it"),
        (["extension", "--steps", "0"], "between 1 and 200"),
        (["patellar-tracking", "--quadriceps_N", "-5"], "between 1 and 12,000 N"),
        (["patellar-tracking", "--femur_deg", "10"], "leg-raise, or a motion in time with it"),
        (["drawer", "--body_kg", "70"], "leg-raise, or a motion in time with it"),
        (["leg-rise"], "did you mean leg-raise?"),
        (["patellar-tracking", "--quadriceps_mm", "0,5"], "extension or leg-raise with it"),
        (["leg-raise", "--quadriceps_mm", "5", "--flexion", "30"], "without it: a result"),
        (["extension", "--quadriceps_mm", "0,-1", "--steps", "9"], "without it: a result"),
        (["extension", "--quadriceps_mm", "0:5"], "expected FROM:TO:STEP or a comma separated"),
        (["extension", "--quadriceps_mm", "0:5:-1"], "leads from the first length to the last"),
        (["extension", "--quadriceps_mm", "500"], "lengths between -20 and 100 mm"),
        (["drawer", "--quadriceps_mm", "5"], "extension or leg-raise with it"),
        (["leg-raise", "--dynamic", "--quadriceps_mm", "5"], "in time --loads gives lengths"),
    ],
)
def test_options_that_mean_nothing_are_refused_in_one_line(words, said, tmp_path, capsys):
    assert main(["simulate", *words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_knee_without_a_patella_says_so(tmp_path, capsys):
    document = dict(load_knee_file("four_ligament").document)
    del document["patella"]
    write_knee(document, tmp_path / "knee.yaml")
    words = ["simulate", "leg-raise", "--knee", str(tmp_path / "knee.yaml")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert "patella: missing: expected this section" in capsys.readouterr().err
