"""Study files: what they mean, and one line for everything that they cannot mean."""

import pickle
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml

from kneejax.files import (
    InputProblem,
    InputProblems,
    bundled_measurements,
    bundled_path,
    write_poses,
)
from kneejax.geometry import FREE_COORDINATES
from kneejax.numerics import MissingPackage
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.statics import Status
from kneejax.studies import FAULTS, Study, read_study

TABLE = np.array([[x, 1.0, -2.0, 3.0, -20.0, 2.0] for x in (0.0, 30.0, 60.0, 90.0)])


@pytest.fixture
def folder(tmp_path):
    shutil.copy(bundled_path("knees", "four_ligament"), tmp_path / "knee.yaml")
    (tmp_path / "measured").mkdir()
    write_poses(tmp_path / "measured" / "poses.csv", TABLE, convention="tibial")
    (tmp_path / "studies").mkdir()
    return tmp_path


def study(**changes):
    document = {
        "title": "a trial",
        "knee": "../knee.yaml",
        "measured": {
            "file": "../measured/poses.csv", "convention": "tibial", "source": "a laboratory",
        },
        "parameters": ["*.stiffness", "ACL.reference_strain"],
    }
    document |= changes
    return {name: value for name, value in document.items() if value is not None}


def read(folder, document):
    path = folder / "studies" / "study.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return read_study(path)


def refusal(folder, document):
    with pytest.raises(InputProblem) as caught:
        read(folder, document)
    line = str(caught.value)
    assert "\n" not in line and "expected " in line
    assert line.startswith(f"{folder / 'studies' / 'study.yaml'}: ")
    return line


def test_defaults(folder):
    found = read(folder, study())
    assert found.parameters == ("*.stiffness", "ACL.reference_strain")
    assert found.bounds == {} and found.limits["LCL.stiffness"] == (300, 10000)
    assert found.limits["ACL.reference_strain"] == (-0.2, 0.2)
    assert found.weights == {} and found.procedures == ("III",)
    assert (found.starts, found.seed, found.method) == (1, 0, "least_squares")
    assert found.frame_offset == ()
    assert found.start == found.truth == {} and found.synthetic is None
    assert found.noise == (None, None)
    np.testing.assert_allclose(found.measured, TABLE, atol=1e-11)


def test_everything_stated(folder):
    measured = study()["measured"] | {"mirror": True}
    found = read(folder, study(
        measured=measured, start={"ACL.stiffness": 4000}, set={"*.transition_strain": 0.06},
        bounds={"ACL.stiffness": [1000, 5000], "stiffness": [100, 9000]},
        weights={"deg": 4.0, "anterior": 2.0}, procedures=["III"], starts=3, seed=7,
        frame_offset=True, method="lbfgsb", flexion_deg=[30, 60], noise_mm=0.3,
    ))  # fmt: skip
    assert found.limits["ACL.stiffness"] == (1000, 5000)
    assert found.limits["PCL.stiffness"] == (100, 9000)
    assert list(found.weights.values()) == [4, 4, 2, 1, 1]
    assert found.frame_offset == FREE_COORDINATES
    assert found.noise == (0.3, None)
    assert set(found.knee.ligaments.transition_strain.tolist()) == {0.06}
    assert found.knee_at_start.ligaments.stiffness[0] == 4000 != found.knee.ligaments.stiffness[0]
    settings = found.settings()
    assert settings["overrides"] == {"*.transition_strain": 0.06}
    assert settings["measured"]["mirror"] is True and settings["flexion_deg"] == [30, 60]
    assert settings["knee"].endswith("knee.yaml") and settings["path"] == found.file
    expected = TABLE[1:3] * [1, -1, -1, 1, 1, -1]
    np.testing.assert_allclose(found.measured, expected, atol=1e-11)


def test_synthetic(folder):
    found = read(folder, study(measured=None, synthetic={
        "parameters": {"ACL.stiffness": 5876}, "flexion_deg": "10:50:5", "noise_mm": 0.1,
    }))  # fmt: skip
    np.testing.assert_array_equal(found.synthetic.flexion_deg, np.arange(10.0, 51.0, 5.0))
    assert (found.synthetic.noise_mm, found.synthetic.noise_deg) == (0.1, 0.0)
    # Without noise in the rotations their scatter must be estimated.
    assert found.noise == (0.1, None) and found.measured is None
    assert found.settings()["noise_mm"] == 0.1


def test_flexion_that_a_plain_yaml_reader_takes_for_a_time(folder):
    path = folder / "studies" / "study.yaml"
    text = yaml.safe_dump(study(measured=None))
    path.write_text(text + "synthetic: {parameters: {ACL.stiffness: 1e3}, flexion_deg: 10:50:5}\n")
    found = read_study(path).synthetic
    assert len(found.flexion_deg) == 9 and found.parameters == {"ACL.stiffness": 1000.0}


MEASURED = study()["measured"]
SYNTHETIC = {"parameters": {"ACL.stiffness": 5876}, "flexion_deg": "0:120:5"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"title": None}, "title: missing"),
        ({"paramters": ["x"]}, "no such field"),
        ({"weight": {}}, "did you mean weights?"),
        ({"measured": None}, "exactly one of measured, synthetic"),
        ({"synthetic": SYNTHETIC}, "measured and synthetic"),
        ({"knee": "../kneee.yaml"}, "knee: ../kneee.yaml"),
        ({"measured": MEASURED | {"file": "poses.csv"}}, "measured.file: poses.csv"),
        ({"measured": MEASURED | {"file": "../measured"}}, "measured.file: ../measured"),
        ({"measured": MEASURED | {"convention": "tibal"}}, "did you mean tibial?"),
        ({"measured": MEASURED | {"columns": {"flexion": "x"}}}, "did you mean flexion_deg?"),
        ({"measured": MEASURED | {"mirror": "yes"}}, "true or false"),
        ({"parameters": []}, "a list of names"),
        ({"parameters": ["a b"]}, "a name such as ACL.stiffness"),
        ({"parameters": ["*.stiffness"] * 2}, "every name once"),
        ({"start": {"ACL.stiffness": "high"}}, "start.ACL.stiffness: high"),
        ({"bounds": {"stiffness": [10000, 300]}}, "a lower and a larger upper limit"),
        ({"bounds": {"stiffness": 300}}, "a list of 2 numbers"),
        ({"weights": {"mm": -1}}, "-1: expected 0, or between 1e-09 and 1,000,000,000"),
        ({"weights": {"mm": 1e-300}}, "weights.mm: 1e-300: expected 0, or between"),
        ({"starts": 10**9}, "a whole number from 1 to 1000"),
        ({"start": {"ACL.stiffness": 1e30}}, "start.ACL.stiffness: 1e+30: expected between 0.001"),
        ({"set": {"*.slack_length": 0.04}}, "between 1 and 700 mm; metres are suspected"),
        ({"bounds": {"stiffness": [-5, 1e4]}}, "bounds.stiffness[0]: -5: expected between 0.001"),
        ({"bounds": {"reference_strain": [-20, 20]}}, "0.5; a strain, not percent"),
        ({"weights": {"mm": 0, "deg": 0}}, "above 0"),
        ({"weights": {"anteriorr": 1}}, "did you mean anterior?"),
        ({"procedures": ["IV"]}, "one of I, II, III"),
        ({"procedures": ["I", "I"]}, "every name once"),
        ({"starts": 0}, "a whole number from 1 to 1000"),
        ({"starts": 1.5}, "a whole number"),
        ({"seed": -1}, "at least 0"),
        ({"frame_offset": ["anterior", "medial"]}, "frame_offset[1]: medial"),
        ({"frame_offset": "all"}, "true, false, or a list"),
        ({"frame_offset": ["flexion"]}, "flexion is prescribed as it was measured"),
        ({"noise_mm": 0}, "a standard deviation above 0"),
        ({"noise_deg": -0.1}, "between 1e-06 and 90"),
        ({"noise": 0.1}, "did you mean noise_mm?"),
        ({"method": "least_square"}, "did you mean least_squares?"),
        ({"flexion_deg": [90, 0]}, "a lower and a larger upper limit"),
        ({"measured": None, "synthetic": SYNTHETIC | {"flexion_deg": "0:120"}}, "FROM:TO:STEP"),
        ({"measured": None, "synthetic": SYNTHETIC | {"noise_mm": -1}}, "1e-06 and 100 mm"),
        ({"measured": None, "synthetic": {"flexion_deg": [0]}}, "parameters: missing"),
        ({"measured": None, "synthetic": SYNTHETIC, "flexion_deg": [0, 9]}, "no limits beside"),
        ({"failures": []}, "failures: []: expected a value (or omit the field)"),
        ({"start": {"ACL.tibial_attachment.superior": -900}}, "ACL.length: 900.1 mm"),
    ],
)
def test_a_bad_study_is_refused(folder, changes, words):
    assert words in refusal(folder, study(**changes))


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"parameters": ["ACL.stifness"]}, UnknownParameter, "did you mean 'ACL.stiffness'?"),
        ({"bounds": {"ACL.stifness": [300, 500]}}, UnknownParameter, "'ACL.stifness'"),
        ({"start": {"ALC.stiffness": 300}}, UnknownParameter, "'ALC.stiffness'"),
        (
            {"measured": None, "synthetic": SYNTHETIC | {"parameters": {"XL.stiffness": 3}}},
            UnknownParameter,
            "'XL.stiffness'",
        ),
        ({"bounds": {"stiffness": [300, 4000]}}, UnsuitableData, "exclude the start 4500"),
    ],
)
def test_what_does_not_suit_the_knee_is_refused_with_the_file(folder, changes, error, words):
    """All of it once stood for a motion of the knee, or longer, before it was said."""
    with pytest.raises(error) as caught:
        read(folder, study(**changes))
    assert str(caught.value).startswith(f"{folder / 'studies' / 'study.yaml'}: ")
    assert words in str(caught.value)


def test_a_method_that_is_not_installed_is_known_at_once(folder, monkeypatch):
    found = read(folder, study(method="lbfgsb"))
    assert found.method == "lbfgsb"
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(MissingPackage, match="lbfgsb needs jaxopt.*pip install"):
        read(folder, study(method="lbfgsb"))


def test_no_measured_pose_within_the_limits(folder):
    with pytest.raises(InputProblem, match="limits within 0 and 90"):
        read(folder, study(flexion_deg=[100, 120]))


@pytest.mark.parametrize("content", [b"", b"title: [", b"\x00\x01", b"- 1", b"title: \xff"])
def test_a_file_that_is_no_study(tmp_path, content):
    path = tmp_path / "study.yaml"
    path.write_bytes(content)
    with pytest.raises(InputProblem, match="expected "):
        read_study(path)
    with pytest.raises(InputProblem, match="a folder"):
        read_study(tmp_path)


def test_measurements_carry_title_and_source(folder, monkeypatch):
    (folder / "knees").mkdir()
    # Of which the study's knee has its patella.
    shutil.copy(bundled_path("knees", "lenhart2015_reduced"), folder / "knees")
    monkeypatch.setattr("kneejax.files._bundled._data_folder", lambda: folder)
    (folder / "measurements").mkdir()
    table = folder / "measurements" / "walker.csv"
    write_poses(table, TABLE)
    with pytest.raises(InputProblem, match="walker.yaml: file: missing"):
        bundled_measurements()
    table.with_suffix(".yaml").write_text("title: Mean of many knees\nsource: a paper\n")
    assert bundled_measurements()["walker"].source == "a paper"
    found = read(folder, study(measured={"file": "walker", "source": "a paper"}))
    np.testing.assert_array_equal(found.measured, TABLE)


def test_a_study_may_choose_what_counts_as_a_failure(folder):
    assert read(folder, study()).failures == ()
    chosen = read(folder, study(failures=["dislocated", "overstretched"]))
    assert chosen.failures == ("dislocated", "overstretched")
    line = refusal(folder, study(failures=["dislocatd"]))
    assert "failures" in line and "dislocated" in line
    # Those are the faults that a balance can have.
    assert FAULTS == tuple(s.word for s in Status if s.converged and s is not Status.BALANCED)


def test_all_mistakes_of_a_file_are_said_at_once(folder):
    wrong = study(
        knee="four_ligamen", weigths={"mm": 1}, starts=0, noise_mm=-3, failures=["dislocatd"],
        start={"ACL.stiffness": -1, "PCL.stiffness": "high"},
        tests=[{"name": 3, "file": "nowhere.csv", "sd_m": 0.1}, {"nme": "a", "file": "walker1988"}],
    )  # fmt: skip
    with pytest.raises(InputProblems) as caught:
        read(folder, wrong)
    lines = str(caught.value).splitlines()
    file = folder / "studies" / "study.yaml"
    assert len(lines) == len(caught.value.problems) == 11
    assert all(line.startswith(f"{file}: ") and "expected " in line for line in lines)
    for words in (
        "weigths: {'mm': 1}: expected no such field", "did you mean weights?",
        "knee: four_ligamen: ", "did you mean four_ligament?", "start.ACL.stiffness: -1: ",
        "start.PCL.stiffness: high: ", "starts: 0: ", "noise_mm: -3: ", "did you mean dislocated?",
        "tests[0].name: 3: expected a text", "tests[0].file: nowhere.csv: ",
        "tests[0].sd_m: 0.1: ", "did you mean sd_mm?", "did you mean name?",
    ):  # fmt: skip
        assert words in str(caught.value)
    # A field that is only misspelt is not missing too.
    assert "missing" not in str(caught.value)


def test_all_that_does_not_suit_the_knee_is_said_at_once(folder):
    fields = {"parameters": ["ACL.stifness", "*.stiffness"], "start": {"ALC.stiffness": 300.0}}
    with pytest.raises(InputProblems) as caught:
        read(folder, study(**fields, prior={"stiffness": 500.0}))
    prior, first, second = str(caught.value).splitlines()
    assert "prior: stiffness: expected noise_mm and noise_deg too" in prior
    assert "'ACL.stifness'; did you mean 'ACL.stiffness'?" in first and "'ALC.stiff" in second


def test_a_study_in_python_may_name_what_a_file_names(folder):
    table = {"file": str(folder / "measured" / "poses.csv"), "source": "us", "convention": "tibial"}
    named = Study(
        title="named", knee="four_ligament", parameters=["ACL.stiffness"], measured=table,
        tests=[{"name": "walker", "file": "walker1988"}], set={"PCL.stiffness": 4000.0},
    )  # fmt: skip
    np.testing.assert_allclose(named.measured, TABLE, atol=1e-11)
    assert named.tests[0].counted_from == "extension" and named.knee_name == "four_ligament"
    assert float(named.knee.ligaments.stiffness[1]) == 4000.0
    again = named.replace(seed=5)
    assert again.settings() == named.settings() | {"seed": 5}
    assert pickle.loads(pickle.dumps(named)).settings() == named.settings()


def test_what_is_wrong_by_itself_is_answered_without_jax(folder):
    path = folder / "studies" / "study.yaml"
    path.write_text(yaml.safe_dump(study(weigths={"mm": 1}, starts=0)))
    said = subprocess.run([sys.executable, "-c", SCRIPT, path], capture_output=True, text=True)
    assert said.stdout.split() == ["2", "False"], said.stderr


SCRIPT = """
import sys
from kneejax.files import InputProblems
from kneejax.studies import Identify, Map, Sensitivity, read_study
try:
    read_study(sys.argv[1])
except InputProblems as problem:
    print(len(problem.problems), "jax" in sys.modules)
"""
