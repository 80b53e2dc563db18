"""`kneejax sensitivity` end to end: files, exit status, one line for every bad input."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.geometry import COLUMNS

pytest.importorskip("SALib")

STUDY = """\
title: Two parameters
knee: four_ligament
synthetic:
  parameters: {{ACL.reference_strain: 0.04}}
  flexion_deg: 0,20,50
parameters: [ACL.stiffness, ACL.reference_strain]
start: {{{start}}}
frame_offset: {offset}
"""

def study_file(folder, start="", offset="false"):
    path = folder / "study.yaml"
    path.write_text(STUDY.format(start=start, offset=offset))
    return str(path)


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One run with everything; the folder, the exit status and what was printed."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("sensitivity")
    printed = io.StringIO()
    words = ["sensitivity", study_file(folder), "--sweep", "ACL.stiffness=1000:9000:3"]
    words += ["--sweep", "*.reference_strain=0.03:0.1:2", "--global", "morris", "--samples", "4"]
    with contextlib.redirect_stdout(printed):
        status = main([*words, "--out", str(folder / "out")])
    return folder / "out", status, printed.getvalue()


def test_everything_is_written(done):
    out, status, printed = done
    assert status == 0
    names = {path.name for path in (out / "figures").glob("*.png")}
    assert names == {
        "sweep_ACL_stiffness.png",
        *(f"sweep_{name}_reference_strain.png" for name in ("ACL", "PCL", "MCL", "LCL")),
        "local_curves.png",
        "local_heatmap.png",
        "morris_fit.png",
        "morris_poses.png",
    }
    assert f"written: {out}/report.html, sweeps.csv" in printed
    first, *_ = (out / "report.html").read_text().split("<details")
    for words in ("The knee moves most with", "Effect of each parameter", "Morris indices"):
        assert words in first
    result = json.loads((out / "result.json").read_text())
    assert result["doubts"] == [] and result["own_motion"] == ["balanced"] * 3
    assert {"jax", "numpy", "SALib"} <= set(result["versions"])
    assert result["options"]["samples"] == 4 and result["global"]["runs"] == 12
    assert result["study"]["parameters"] == ["ACL.stiffness", "ACL.reference_strain"]
    assert set(result["seconds"]) == {"local", "sweeps", "global", "figures"}


def test_tables_agree_with_each_other(done):
    out, _, _ = done
    swept = rows(out / "sweeps.csv")
    assert len(swept) == (3 + 4 * 2) * 3
    assert {row["status"] for row in swept} <= {"balanced", "outside_region"}
    slopes = rows(out / "local_sensitivity.csv")
    assert [row["flexion_deg"] for row in slopes] == ["0.0", "20.0", "50.0"] * 2
    for row in slopes:
        per_unit, per_step = float(row["anterior_mm_per_unit"]), float(row["anterior_mm_per_step"])
        assert per_step == pytest.approx(per_unit * float(row["step"]))
    # A stiffer ACL, a tibia further back: the sweep's sign is the slope's.
    at = {
        float(row["value"]): float(row["anterior_mm"])
        for row in swept
        if row["parameter"] == "ACL.stiffness" and row["flexion_deg"] == "20.0"
    }
    assert at[9000.0] < at[5000.0] < at[1000.0]
    assert float(slopes[1]["anterior_mm_per_unit"]) < 0
    indices = rows(out / "global_indices.csv")
    assert {row["parameter"] for row in indices} == {"ACL.stiffness", "ACL.reference_strain"}
    assert len(indices) == 2 * (5 * 3 + 5 + 1)
    assert all(np.isfinite(float(row["mu_star_half_width"])) for row in indices)


def test_the_screen_is_narrow_ascii_and_says_who_moves_what(done):
    _, _, printed = done
    lines = printed.splitlines()
    assert printed.isascii() and max(map(len, lines[:-1])) < 100
    table = {line.split()[0]: line for line in reversed(lines) if line.startswith("ACL.")}
    assert "*" in table["ACL.reference_strain"]
    assert re.search(r"[+-]\d\.\d\d at +\d+", table["ACL.stiffness"])
    assert "Morris indices of the objective (12 motions" in printed


def test_a_knee_that_does_not_balance_itself_is_doubtful(tmp_path, capsys):
    poses = "".join(f"{angle},0.5,0.5,0.5,0.5,0.5\n" for angle in (20.0, 50.0, 170.0))
    (tmp_path / "poses.csv").write_text(",".join(COLUMNS) + "\n" + poses)
    study = study_file(tmp_path, "", "[anterior]")
    text = re.sub("synthetic:.*?50\n", "measured: {file: poses.csv, source: nobody}\n",
                  Path(study).read_text(), flags=re.DOTALL)  # fmt: skip
    Path(study).write_text(text)
    words = ["--sweep", "*.reference_strain=0.03:0.1:2", "--sweep", "ACL.stiffness=1000:9000:3"]
    out = tmp_path / "out"
    assert main(["sensitivity", study, *words, "--out", str(out)]) == 1
    printed = capsys.readouterr().out
    assert "warning: the knee itself at 170 degrees: no balance found" in " ".join(printed.split())
    result = json.loads((out / "result.json").read_text())
    assert result["own_motion"][2] == "not_converged" and len(result["doubts"]) == 1
    slopes = [row for row in rows(out / "local_sensitivity.csv") if row["flexion_deg"] == "170.0"]
    assert {row["anterior_mm_per_step"] for row in slopes} == {"nan"}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--sweep", "ACL.stifness"], "did you mean 'ACL.stiffness'"),
        (["--sweep", "ACL.stiffness=300:9000:1"], "a whole number from 2 to 1000"),
        (["--sweep", "ACL.stiffness=300:9000:2.5"], "2.5: expected a whole number from 2"),
        (["--sweep", "ACL.stiffness=9000:300"], "a lower and a larger upper limit"),
        (["--sweep", "ACL.stiffness=weak:strong"], "expected NAME[=LOW:HIGH[:COUNT]]"),
        (["--sweep", "ACL.stiffness", "--sweep", "ACL.stiffness=1:2"], "every name once"),
        (["--sweep", "*.stiffness", "--sweep", "ACL.stiffness"], "is swept twice"),
        (["--prior", "ACL.stiffness=0"], "expected between 0.01 and"),
        (["--prior", "ACL.stifness=5"], "did you mean 'ACL.stiffness'"),
        (["--prior", "ACL.stiffness"], "NAME=SD"),
        (["--prior", "ACL.stiffness=5", "--scale", "percent"], "--scale prior"),
        (["--global", "sobol", "--samples", "4"], "at least 32"),
        (["--global", "sobol", "--samples", "0"], "at least 32"),
        (["--global", "sobol", "--samples", "100"], "such as 128"),
        (["--global", "morris", "--samples", "2"], "at least 4"),
        (["--samples", "64"], "--global sobol or morris"),
        (["--range", "ACL.stiffness=1:2"], "--global sobol or morris"),
        (["--global", "morris", "--range", "ACL.stiffness=2:1"], "a larger upper limit"),
        (["--global", "morris", "--range", "ALC.strain=1:2"], "did you mean"),
        (["--global", "sobl"], "did you mean sobol"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, capsys, words, expected, unmeasured):
    out = tmp_path / "out"
    assert main(["sensitivity", study_file(tmp_path), *words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert expected in error and error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("failures", "sound"), [("[dislocated]", "3000"), ("[overstretched]", "4500")]
)
def test_a_sweep_is_sound_as_far_as_its_study_says(failures, sound, tmp_path, capsys):
    """The softest ACL is longer by more than 5 % in extension, where it is said to tear."""
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    torn = f"set: {{ACL.failure_strain: 0.05}}\nfailures: {failures}\n"
    study.write_text(Path(study_file(tmp_path)).read_text() + torn)
    words = ["sensitivity", str(study), "--sweep", "ACL.stiffness=3000:6000:3"]
    assert main([*words, "--out", str(out)]) == 0
    assert f"{sound} to 6000" in capsys.readouterr().out
    torn = [row["value"] for row in rows(out / "sweeps.csv") if row["status"] == "overstretched"]
    assert torn == ["3000.0"]
