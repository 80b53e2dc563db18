"""What is prescribed is a number, and there is some of it."""

import jax
import numpy as np
import pytest

from kneejax.mechanics import load_of
from kneejax.statics import LoadCases


@pytest.mark.parametrize(
    ("flexion", "held", "words"),
    [
        ([], None, "flexion_deg is empty"),
        ([np.nan], None, "flexion_deg is nan: expected a number"),
        ([0.0, np.inf, np.nan], None, "flexion_deg is inf, value 2 of 3"),
        (30.0, {"anterior_mm": [1.0, np.nan]}, "anterior_mm is nan, value 2 of 2"),
        ([[0.0, 30.0]], None, "flexion_deg has the shape .1, 2.: expected one value, or a list"),
        ([0.0, "x"], None, "flexion_deg is .*'x'.: expected numbers"),
    ],
)
def test_what_is_no_number_is_refused_in_one_line(flexion, held, words):
    with pytest.raises(ValueError, match=words):
        LoadCases.at(flexion, held=held)


@pytest.mark.parametrize("loads", [load_of(anterior_N=100.0), [5.0], 100.0])
def test_loads_stand_in_a_list(loads):
    with pytest.raises(ValueError, match="loads: .*: expected a list of loads"):
        LoadCases.at(30.0, loads)


def test_what_is_traced_is_not_looked_at():
    assert jax.eval_shape(lambda x: LoadCases.at(x).flexion, np.zeros(3)).shape == (3,)


def test_some_of_the_load_cases_can_be_taken_in_trace_too():
    cases = LoadCases.at([0.0, 30.0, 60.0])
    rows = np.array([2, 0])
    traced = jax.jit(lambda rows: cases.take(rows).flexion)(rows)
    np.testing.assert_array_equal(traced, cases.take(rows).flexion)
    np.testing.assert_allclose(traced, np.deg2rad([60.0, 0.0]))
    assert len(cases.take([])) == 0
    masked = cases.take(np.array([False, True, True]))
    np.testing.assert_allclose(masked.flexion, np.deg2rad([30.0, 60.0]))
