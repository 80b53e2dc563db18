"""Questions to a study are checked whole before a knee moves."""

import inspect
import math
from typing import get_args

import numpy as np
import pytest

import kneejax as kj
from kneejax import inference, studies
from kneejax.experiments import COUNTED_FROM
from kneejax.geometry import CONVENTIONS, FREE_COORDINATES, OTHER_COLUMNS
from kneejax.inference import calibration
from kneejax.inference.calibration._question import USUAL_CYCLES
from kneejax.inference.fit import DEFAULT_WEIGHTS
from kneejax.mechanics import AXES, NAMED_LOADS
from kneejax.numerics import MissingPackage
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.studies import _fields, _lab_tests, _reading, _schema


@pytest.fixture(scope="module")
def study():
    return kj.read_study("paper1")


@pytest.fixture(autouse=True)
def unmoved(monkeypatch):
    def never(*_, **__):
        raise AssertionError("the knee has moved before the mistake was said")

    monkeypatch.setattr("kneejax.inference.synthetic_motion", never)


ANSWERS = {kj.Sensitivity: kj.sensitivity, kj.Map: kj.sensitivity_map, kj.Identify: kj.identify}
PAIR = [("PCL.stiffness", "PCL.reference_strain")]


@pytest.mark.parametrize(
    ("asked", "fields", "words"),
    [
        (kj.Sensitivity, dict(indices="sobol", samples=4), "4 points .*: expected at least 32"),
        (kj.Sensitivity, dict(indices="sobol", samples=100), "such as 128"),
        (kj.Sensitivity, dict(indices="sobol", samples=10**7), "from 0 to 1000000"),
        (kj.Sensitivity, dict(indices="morris", samples=2), "at least 4"),
        (kj.Sensitivity, dict(indices="moris"), "expected one of sobol, morris"),
        (kj.Sensitivity, dict(indices="sobol", range={"ACL.stifness": (1, 2)}), "ACL.stiffness"),
        (kj.Sensitivity, dict(indices="sobol", range={"ACL.stiffness": (2, 1)}),
         "larger upper limit"),
        (kj.Sensitivity, dict(range={"ACL.stiffness": (1, 2)}), "global indices"),
        (kj.Sensitivity, dict(samples=64), "global indices"),
        (kj.Sensitivity, dict(scale="percent", prior={"ACL.stiffness": 5.0}), "--scale prior"),
        (kj.Sensitivity, dict(scale="per cent"), "expected one of prior, percent"),
        (kj.Sensitivity, dict(prior={"ACL.stifness": 5.0}), "did you mean 'ACL.stiffness'"),
        (kj.Sensitivity, dict(prior={"ACL.stiffness": 1e-300}), "between 0.01 and"),
        (kj.Sensitivity, dict(sweep={"ACL.stifness": None}), "did you mean 'ACL.stiffness'"),
        (kj.Sensitivity, dict(sweep={"*.stiffness": None, "ACL.stiffness": None}),
         "is swept twice"),
        (kj.Sensitivity, dict(sweep={"ACL.stiffness": (300.0, 9000.0, 1)}), "from 2 to 1000"),
        (kj.Sensitivity, dict(sweep={"ACL.stiffness": (300.0, 9000.0, 2.5)}), "a whole number"),
        (kj.Sensitivity, dict(sweep={"ACL.reference_strain": (-5.0, 5.0)}),
         "a strain, not percent"),
        (kj.Map, dict(), "expected two, e.g. ACL.stiffness PCL.stiffness"),
        (kj.Map, dict(pair=PAIR, grid=(1, 5)), "from 2 to 2000"),
        (kj.Map, dict(pair=[*PAIR, PAIR[0][::-1]]), "every pair once"),
        (kj.Map, dict(pair=[("PCL.stiffness",) * 2]), "two different parameters"),
        (kj.Map, dict(pair=[("*.stiffness", "ACL.stiffness")]), "a map takes one per side"),
        (kj.Map, dict(pair=PAIR, range={"PCL.stifness": (300.0, 900.0)}),
         "did you mean PCL.stiffness"),
        (kj.Map, dict(pair=PAIR, range={"PCL.stiffness": (300.0, math.nan)}), "finite"),
        (kj.Identify, dict(next_tests=0),
         "next_tests: next_tests: 0: expected a whole number from 1"),
        (kj.Identify, dict(next_tests=73), "73 tests wanted, of 72 candidates"),
        (kj.Identify, dict(criterion="E"), "expected one of D, A"),
        (kj.Identify, dict(candidates=[]), "no candidates"),
        (kj.Identify, dict(noise_mm=0.0), "noise_mm: 0.0: expected"),
        (kj.Identify, dict(posterior=True, chains=1), "chains: 1: expected 2 or more"),
        (kj.Identify, dict(posterior=True, draws=5), "draws: 5: expected 20 or more"),
        (kj.Identify, dict(prior={"ACL.stifness": (4500.0, 900.0)}),
         "did you mean 'ACL.stiffness'"),
        (kj.Identify, dict(prior={"*.slack_length": (40.0, 2.0)}), "which is not free"),
        (kj.Identify, dict(prior={"ACL.stiffness": (4500.0, 0.0)}), "prior: ACL.stiffness: 0.0"),
        (kj.Identify, dict(prior={"ACL.stiffness": (math.inf, 9.0)}), "prior: ACL.stiffness: inf"),
        (kj.Identify, dict(prior={"ACL.stiffness": (20000.0, 9.0)}),
         "exclude the prior's mean 20000"),
    ],
)  # fmt: skip
def test_what_cannot_be_answered_is_refused_before_the_knee_moves(study, asked, fields, words):
    """Most of it once came after sweeps, maps or a whole identification."""
    errors = (kj.InputProblem, UnknownParameter, UnsuitableData)
    with pytest.raises(errors, match=words) as caught:
        ANSWERS[asked](study, asked(**fields))
    assert "\n" not in str(caught.value)


def test_too_few_data_to_estimate_their_noise_are_known_at_once(study):
    poses = np.array([[30.0, 0.0, 2.0, 1.0, 0.0, 0.5]])
    few = study.replace(synthetic=None, measured=poses)
    with pytest.raises(UnsuitableData, match="5 measured numbers for 8 unknowns"):
        kj.identify(few)
    studies.check(few, kj.Identify(noise_mm=0.1, noise_deg=0.1))


def test_a_prior_may_be_flat_and_a_study_may_bound_what_is_not_free(study):
    """Usual bounds of strains were once handed to a posterior of stiffnesses, which refused."""
    alone = study.replace(parameters=["ACL.stiffness"])
    studies.check(alone, kj.Identify(posterior=True, prior={"*.stiffness": (4500.0, math.inf)}))


def test_a_package_that_is_missing_is_known_at_once(study, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(MissingPackage, match="the posterior needs blackjax"):
        kj.identify(study, posterior=True)
    with pytest.raises(MissingPackage, match="global indices need SALib"):
        kj.sensitivity(study, indices="sobol")


def defaults(function):
    parameters = inspect.signature(function).parameters.items()
    return {name: one.default for name, one in parameters if one.default is not one.empty}


@pytest.mark.parametrize(
    ("given", "function", "called"),
    [
        (kj.Identify(), inference.posterior, {"chains": "chains", "draws": "draws"}),
        (kj.Identify(), inference.design_tests, {"next_tests": "count", "criterion": "criterion"}),
        (kj.Map(), inference.sensitivity_maps, {"grid": "grid"}),
        (kj.Sensitivity(), inference.local_sensitivity, {"scale": "scale"}),
        (kj.Sensitivity(), inference.motion_indices, {"samples": "samples", "seed": "seed"}),
    ],
)
def test_a_question_and_the_function_that_answers_it_have_the_same_defaults(
    given, function, called
):
    usual = defaults(function)
    assert {name: getattr(given, name) for name in called} == {
        name: usual[argument] for name, argument in called.items()
    }


def test_names_that_are_known_without_jax_are_those_of_what_computes():
    names = {name: field.annotation for name, field in kj.Study.model_fields.items()}
    assert get_args(names["method"]) == tuple(calibration.METHODS)
    assert get_args(_schema.Procedure) == tuple(calibration.PROCEDURES)
    assert kj.Study.model_fields["cycles"].default == USUAL_CYCLES
    assert get_args(_lab_tests.CountedFrom) == tuple(COUNTED_FROM)
    assert {*get_args(_lab_tests.Axes)} == {*AXES}
    assert {*_fields.LOAD_NAMES} == {*NAMED_LOADS}
    assert get_args(_schema.Measured.model_fields["convention"].annotation) == tuple(CONVENTIONS)
    assert tuple(_fields.UNITS) == FREE_COORDINATES
    assert _lab_tests.COORDINATES == (
        *FREE_COORDINATES, *(one.name for one in OTHER_COLUMNS.values())
    )  # fmt: skip
    paper1 = kj.read_study("paper1")
    np.testing.assert_allclose(paper1.first_weights, DEFAULT_WEIGHTS, rtol=1e-12)
    assert _reading.usual_procedures(paper1) == calibration.USUAL_PROCEDURES


def test_the_fingerprint_of_a_map_knows_study_and_question(study):
    question = kj.Map(pair=PAIR)
    own = studies.fingerprint(study, question)
    assert own == studies.fingerprint(kj.read_study("paper1"), kj.Map(pair=PAIR))
    made = study.synthetic.replace(seed=study.synthetic.seed + 1)
    others = [
        (study, kj.Map(pair=PAIR, grid=(5, 5))),
        (study.replace(synthetic=made), question),
        (study.replace(failures=["dislocated"]), question),
        (study.replace(knee=study.knee.replace({"ACL.stiffness": 4000.0})), question),
    ]  # fmt: skip
    assert all(studies.fingerprint(*other) != own for other in others)
