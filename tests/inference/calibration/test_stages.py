"""A search in stages: each frees some parameters and asks some of the data."""

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.files import InputProblem, write_rows
from kneejax.inference.calibration import CalibrationProblem, Stage, run_procedure
from kneejax.inference.calibration._question import SeveralKnees
from kneejax.inference.fit import Noise, Problem

NAMES = ("ACL.stiffness", "ACL.reference_strain", "MCL.reference_strain")
NOISE = np.full(5, 0.1)


@pytest.fixture(scope="module")
def problem():
    knee = kj.load_knee("four_ligament")
    (test,) = kj.lab_tests("drawer", [20.0, 60.0], force_N=60.0, both=True, steps=2)
    (curves,) = kj.load_curves(knee, test)
    passive = np.asarray(kj.passive_flexion(knee, [0.0, 30.0, 60.0]).to_table())
    test = kj.MeasuredTest.of(curves)
    return Problem.of(knee, kj.select(knee, NAMES), passive, NOISE**-2.0, tests=[test])


def searched(problem, stages, start):
    truth = np.asarray(problem.selection.read(problem.knee))
    wide = 0.5 * np.abs(truth)
    bounds = truth - wide, truth + wide
    one = CalibrationProblem(problem, Noise.of(), start, *bounds, ("S",), tuple(stages))
    (found,) = run_procedure(SeveralKnees.of([one]), "S", [problem.begin(start[None])])
    return found


@pytest.mark.long
def test_a_stage_leaves_what_it_does_not_free(problem):
    truth = np.asarray(problem.selection.read(problem.knee))
    start = truth * [1.2, 1.1, 1.0]
    found = searched(problem, [Stage(("ACL.stiffness",), ("drawer",))], start)
    assert found.x[1:] == pytest.approx(start[1:], abs=1e-14)
    assert found.x[0] != pytest.approx(start[0], rel=1e-3)
    residual, _ = problem.residual(found.known)
    assert found.objective == pytest.approx(residual @ residual)


@pytest.mark.long
def test_stages_end_where_all_data_are_fitted_once_the_last_frees_all(problem):
    truth = np.asarray(problem.selection.read(problem.knee))
    stages = [Stage(("*.reference_strain",), ("poses",)), Stage(data=("drawer",)), Stage()]
    found = searched(problem, stages, truth * 1.1)
    assert found.x == pytest.approx(truth, rel=1e-4)
    assert set(found.counts) == {"S.1", "S.2", "S.3"}


def test_data_of_a_stage_are_those_of_its_tests_alone(problem):
    rows = len(problem.cases.load_cases)
    poses, test = (problem.with_data([name]).used for name in ("poses", "drawer"))
    assert poses.tolist() == [True] * 3 + [False] * (rows - 3)
    assert (test == ~poses).all()
    assert problem.with_data(()).used.all()


@pytest.fixture
def study(tmp_path):
    write_rows(tmp_path / "drawer.csv", ["flexion_deg", "anterior_N", "anterior_mm"],
               [(30.0, 45.0, 2.5), (30.0, 90.0, 4.0)])  # fmt: skip

    def read(**fields):
        document = {
            "title": "S", "knee": "four_ligament", "parameters": ["ACL.stiffness"],
            "tests": [{"name": "drawer", "file": "drawer.csv"}],
        }  # fmt: skip
        (tmp_path / "study.yaml").write_text(yaml.safe_dump(document | fields))
        return kj.read_study(tmp_path / "study.yaml")

    return read


def test_stages_of_a_study_are_its_procedure(study):
    read = study(stages=[{"parameters": ["*.stiffness"], "data": ["drawer"]}, {}])
    assert read.procedures == ("S",)
    assert read.stages == (Stage(("*.stiffness",), ("drawer",)), Stage())
    assert read.settings()["stages"][0]["data"] == ["drawer"]
    assert study().procedures == ("III",)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"stages": [{"data": ["drawr"]}]}, "did you mean drawer"),
        ({"stages": [{"data": ["poses"]}]}, "expected one of drawer"),
        ({"stages": [{"parameters": ["MCL.stiffness"]}]}, "one of the study's free parameters"),
        ({"stages": [{"parametrs": []}]}, "did you mean parameters"),
        ({"stages": [{}], "procedures": ["III"]}, "S among procedures and stages, or neither"),
        ({"procedures": ["S"]}, "S among procedures and stages, or neither"),
    ],
)
def test_stages_of_what_there_is_not_are_refused(study, fields, says):
    with pytest.raises(InputProblem, match=says):
        study(**fields)
