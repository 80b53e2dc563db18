"""Questions to a study are checked whole before a knee moves."""

import dataclasses
import inspect
import math

import numpy as np
import pytest

import kneejax as kj
from kneejax import inference, studies
from kneejax.numerics import MissingPackage
from kneejax.parameters import UnknownParameter, UnsuitableData


@pytest.fixture(scope="module")
def study():
    return kj.read_study("paper1")


@pytest.fixture(autouse=True)
def unmoved(monkeypatch):
    def never(*_, **__):
        raise AssertionError("the knee has moved before the mistake was said")

    monkeypatch.setattr("kneejax.studies._poses.synthetic_motion", never)


PAIR = [("PCL.stiffness", "PCL.reference_strain")]


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (kj.Sensitivity(indices="sobol", samples=4), "4 points .*: expected at least 32"),
        (kj.Sensitivity(indices="sobol", samples=100), "such as 128"),
        (kj.Sensitivity(indices="sobol", samples=10**7), "from 0 to 1000000"),
        (kj.Sensitivity(indices="morris", samples=2), "at least 4"),
        (kj.Sensitivity(indices="moris"), "expected one of sobol, morris"),
        (kj.Sensitivity(indices="sobol", range={"ACL.stifness": (1, 2)}), "ACL.stiffness"),
        (kj.Sensitivity(indices="sobol", range={"ACL.stiffness": (2, 1)}), "larger upper limit"),
        (kj.Sensitivity(range={"ACL.stiffness": (1, 2)}), "global indices"),
        (kj.Sensitivity(samples=64), "global indices"),
        (kj.Sensitivity(scale="percent", prior={"ACL.stiffness": 5.0}), "--scale prior"),
        (kj.Sensitivity(scale="per cent"), "unknown scale"),
        (kj.Sensitivity(prior={"ACL.stifness": 5.0}), "did you mean 'ACL.stiffness'"),
        (kj.Sensitivity(prior={"ACL.stiffness": 1e-300}), "between 0.01 and"),
        (kj.Sensitivity(sweep={"ACL.stifness": None}), "did you mean 'ACL.stiffness'"),
        (kj.Sensitivity(sweep={"*.stiffness": None, "ACL.stiffness": None}), "is swept twice"),
        (kj.Sensitivity(sweep={"ACL.stiffness": (300.0, 9000.0, 1)}), "from 2 to 1000"),
        (kj.Sensitivity(sweep={"ACL.stiffness": (300.0, 9000.0, 2.5)}), "a whole number"),
        (kj.Sensitivity(sweep={"ACL.reference_strain": (-5.0, 5.0)}), "a strain, not percent"),
        (kj.Map(), "expected two, e.g. ACL.stiffness PCL.stiffness"),
        (kj.Map(PAIR, grid=(1, 5)), "from 2 to 2000"),
        (kj.Map([*PAIR, PAIR[0][::-1]]), "every pair once"),
        (kj.Map([("PCL.stiffness",) * 2]), "two different parameters"),
        (kj.Map([("*.stiffness", "ACL.stiffness")]), "a map takes one per side"),
        (kj.Map(PAIR, range={"PCL.stifness": (300.0, 900.0)}), "did you mean PCL.stiffness"),
        (kj.Map(PAIR, range={"PCL.stiffness": (300.0, math.nan)}), "finite"),
        (kj.Identify(next_tests=0), "next_tests: tests: 0: expected a whole number from 1"),
        (kj.Identify(next_tests=73), "73 tests wanted, of 72 candidates"),
        (kj.Identify(criterion="E"), "expected D or A"),
        (kj.Identify(candidates=[]), "no candidates"),
        (kj.Identify(noise_mm=0.0), "noise_mm: 0.0: expected"),
        (kj.Identify(posterior=True, chains=1), "chains: 1: expected 2 or more"),
        (kj.Identify(posterior=True, draws=5), "draws: 5: expected 20 or more"),
        (kj.Identify(prior={"ACL.stifness": (4500.0, 900.0)}), "did you mean 'ACL.stiffness'"),
        (kj.Identify(prior={"*.slack_length": (40.0, 2.0)}), "which is not free"),
        (kj.Identify(prior={"ACL.stiffness": (4500.0, 0.0)}), "prior: ACL.stiffness: 0.0"),
        (kj.Identify(prior={"ACL.stiffness": (math.inf, 9.0)}), "prior: ACL.stiffness: inf"),
        (kj.Identify(prior={"ACL.stiffness": (20000.0, 9.0)}), "exclude the prior's mean 20000"),
    ],
)
def test_what_cannot_be_answered_is_refused_before_the_knee_moves(study, question, words):
    """Most of it once came after sweeps, maps or a whole identification."""
    errors = (kj.InputProblem, UnknownParameter, UnsuitableData)
    with pytest.raises(errors, match=words) as caught:
        kj.run(study, question)
    assert "\n" not in str(caught.value)


def test_too_few_data_to_estimate_their_noise_are_known_at_once(study):
    poses = np.array([[30.0, 0.0, 2.0, 1.0, 0.0, 0.5]])
    few = dataclasses.replace(study, synthetic=None, measured=poses)
    with pytest.raises(UnsuitableData, match="5 measured numbers for 8 unknowns"):
        kj.run(few, kj.Identify())
    studies.check(few, kj.Identify(noise_mm=0.1, noise_deg=0.1))


def test_a_prior_may_be_flat_and_a_study_may_bound_what_is_not_free(study):
    """Usual bounds of strains were once handed to a posterior of stiffnesses, which refused."""
    alone = dataclasses.replace(study, parameters=["ACL.stiffness"])
    studies.check(alone, kj.Identify(posterior=True, prior={"*.stiffness": (4500.0, math.inf)}))


def test_a_package_that_is_missing_is_known_at_once(study, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(MissingPackage, match="the posterior needs blackjax"):
        kj.run(study, kj.Identify(posterior=True))
    with pytest.raises(MissingPackage, match="global indices need SALib"):
        kj.run(study, kj.Sensitivity(indices="sobol"))


def test_something_else_is_no_question(study):
    with pytest.raises(TypeError, match="expected Identify, Map or Sensitivity"):
        kj.run(study, "identify")  # pyright: ignore


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


def test_a_study_and_calibrate_have_the_same_defaults():
    usual, own = defaults(kj.calibrate), defaults(kj.Study)
    for name in ("procedures", "starts", "seed", "method", "noise_mm", "noise_deg"):
        assert own[name] == usual[name], name
    assert own["frame_offset"] == usual["offsets"]


def test_the_fingerprint_of_a_map_knows_study_and_question(study):
    question = kj.Map(PAIR)
    own = studies.fingerprint(study, question)
    assert own == studies.fingerprint(kj.read_study("paper1"), kj.Map(PAIR))
    made = dataclasses.replace(study.synthetic, seed=study.synthetic.seed + 1)
    others = [
        (study, kj.Map(PAIR, grid=(5, 5))),
        (dataclasses.replace(study, synthetic=made), question),
        (dataclasses.replace(study, failures=["dislocated"]), question),
        (dataclasses.replace(study, knee=kj.with_values(study.knee, {"ACL.stiffness": 4000.0})),
         question),
    ]  # fmt: skip
    assert all(studies.fingerprint(*other) != own for other in others)
