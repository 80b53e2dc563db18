"""Priors as they are written on a command line."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.cli._priors import read_priors
from kneejax.files import InputProblem

PARAMETERS = ("ACL.stiffness", "PCL.stiffness", "ACL.reference_strain", "PCL.reference_strain")


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("four_ligament")


def test_a_wildcard_stands_for_all_and_a_name_counts_before_it(knee):
    words = ["ACL.stiffness=5000:900", "*.stiffness=4000:1200", "PCL.reference_strain=-0.1:inf"]
    assert read_priors(words, knee, PARAMETERS) == {
        "ACL.stiffness": (5000.0, 900.0),
        "PCL.stiffness": (4000.0, 1200.0),
        "PCL.reference_strain": (-0.1, np.inf),
    }
    assert read_priors([], knee, PARAMETERS) == {}


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("ACL.stifness=4500:900", "--prior: name: ACL.stifness.*did you mean ACL.stiffness"),
        ("*.slack_length=40:2", "name: .*slack_length.*a free parameter"),
        ("ACL.stiffness=4500", "expected NAME=MEAN:SD"),
        ("ACL.stiffness", "expected NAME=MEAN:SD"),
        ("=4500:900", "expected NAME=MEAN:SD"),
        ("ACL.stiffness=4500:0", "ACL.stiffness: 0: expected a standard deviation above zero"),
        ("ACL.stiffness=4500:-3", "ACL.stiffness: -3: expected a standard deviation above zero"),
        ("ACL.stiffness=4500:nan", "expected a standard deviation above zero"),
        ("ACL.stiffness=4500:wide", "wide: expected a standard deviation above zero"),
        ("ACL.stiffness=inf:9", "ACL.stiffness: inf: expected a mean that is a finite number"),
        ("ACL.stiffness=stiff:9", "stiff: expected a mean"),
    ],
)
def test_a_prior_that_is_none_is_refused_in_one_line(knee, word, says):
    with pytest.raises(InputProblem, match=says) as caught:
        read_priors([word], knee, PARAMETERS)
    assert "\n" not in str(caught.value)


def test_a_prior_given_twice_is_refused(knee):
    with pytest.raises(InputProblem, match=r"\*\.stiffness.*expected one prior of a name"):
        read_priors(["*.stiffness=1:1", "*.stiffness=2:1"], knee, PARAMETERS)
