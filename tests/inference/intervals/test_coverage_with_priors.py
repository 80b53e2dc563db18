"""Limits with priors hold the truth as often as they say: a part of `benchmarks/coverage.py`."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def script():
    """The script, with what lies beside it."""
    sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
    try:
        yield importlib.import_module("coverage")
    finally:
        sys.path.pop(0)


@pytest.mark.slow
def test_limits_with_priors_on_half_of_the_parameters_hold(script):
    """40 draws of 8 parameters from their priors; 200 draws are the script's."""
    design = script.designs()["priors on half"]
    prior = np.r_[np.full(4, design.prior["*.stiffness"]), np.full(4, np.inf)]
    found = script.coverage(*script.intervals(design.begin(), design, 40, 0), prior=prior)
    assert 0.90 <= found["holds"] <= 0.98
    assert found["wider than the prior"] == 0.0
    assert found["answer_outside_its_limits"] == 0.0
    # The prior alone tells one of the four stiffnesses, and all of them are printed.
    assert found["printed"] == 1.0 and 0.1 < found["share prior"] < 0.4
