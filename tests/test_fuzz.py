"""Damaged inputs and wrong command lines: a part of `python benchmarks/fuzz.py --count 5000`."""

import pytest


@pytest.fixture(scope="module")
def fuzz(benchmark_script):
    return benchmark_script("fuzz")


def test_damaged_inputs_are_taken_or_refused_in_one_line(fuzz):
    found = fuzz.answers(138, seed=1)
    assert [one for one in found if one.outcome in fuzz.FAULTS] == []
    # Not every input is refused for the same reason before it is looked at.
    assert len({one.sentence.rpartition(": ")[2] for one in found}) > 50
    assert {one.outcome for one in found} == {fuzz.ACCEPTED, fuzz.REFUSED}


def test_wrong_command_lines_are_refused_in_one_line(fuzz):
    assert [said for words in fuzz.command_lines(100) if (said := fuzz.refused(words))] == []
