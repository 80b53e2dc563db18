"""Limits with priors hold the truth as often as they say: a part of `benchmarks/coverage.py`."""

import numpy as np
import pytest


@pytest.mark.slow
def test_limits_with_priors_on_half_of_the_parameters_hold(benchmark_script):
    """40 draws of 8 parameters from their priors; 200 draws are the script's."""
    script = benchmark_script("coverage")
    design = script.designs()["priors on half"]
    prior = np.r_[np.full(4, design.prior["*.stiffness"]), np.full(4, np.inf)]
    found = script.coverage(*script.intervals(design.begin(), design, 40, 0), prior=prior)
    assert 0.90 <= found["holds"] <= 0.98
    assert found["wider than the prior"] == 0.0
    assert found["answer_outside_its_limits"] == 0.0
    # The prior alone tells one of the four stiffnesses, and all of them are printed.
    assert found["printed"] == 1.0 and 0.1 < found["share prior"] < 0.4
