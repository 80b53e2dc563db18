"""Words of options as numbers; what the numbers may be is for the study to say."""

import pytest

from kneejax.cli.options import studies as options
from kneejax.files import InputProblem
from kneejax.studies import Identify


def read(*words):
    return options.Identify.read({"prior": list(words)}).prior


def test_names_and_numbers_are_read_in_order():
    assert read("*.stiffness=4000:1200", "PCL.reference_strain=-0.1:inf") == {
        "*.stiffness": (4000.0, 1200.0),
        "PCL.reference_strain": (-0.1, float("inf")),
    }
    assert read() == {}
    words = ["ACL.stiffness", "*.reference_strain=0:1", "PCL.stiffness=1:2:3"]
    assert options.Sensitivity.read({"sweep": words}).sweep == {
        "ACL.stiffness": None,
        "*.reference_strain": (0.0, 1.0),
        "PCL.stiffness": (1.0, 2.0, 3.0),
    }


@pytest.mark.parametrize(
    "word", ["ACL.stiffness=4500", "ACL.stiffness", "=4500:wide", "ACL.stiffness=1:2:3"]
)
def test_a_word_of_another_form_is_refused_in_one_line(word):
    with pytest.raises(InputProblem, match="^--prior: .*expected NAME=MEAN:SD, e.g. ") as caught:
        read(word)
    assert "\n" not in str(caught.value)


def test_a_name_given_twice_is_refused():
    with pytest.raises(InputProblem, match=r"--prior: \*\.stiffness: .*expected every name once"):
        read("*.stiffness=1:1", "*.stiffness=2:1")


@pytest.mark.parametrize(
    ("asked", "field", "option"),
    [
        (options.Identify, "next_tests", "--next-tests"),
        (options.Sensitivity, "indices", "--global"),
        (options.Sensitivity, "study.yaml", "study.yaml"),
    ],
)
def test_a_problem_of_a_question_names_the_option(asked, field, option):
    said = asked.read({}).said(InputProblem(field, "place", 3, "more", "4"))
    assert str(said) == f"{option}: place: 3: expected more; did you mean 4?"


def test_options_that_nobody_gives_are_the_questions_defaults():
    assert options.Identify.read({}).question() == Identify()
