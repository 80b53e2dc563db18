"""L-BFGS-B through jaxopt: converged, within bounds, honest when it is not."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("jaxopt")

import kneejax as kj
from kneejax.inference import Ending, synthetic_motion
from kneejax.inference.calibration import _search
from kneejax.inference.calibration._search import minimise_bounded
from kneejax.numerics import MissingPackage


@pytest.mark.long
def test_a_bound_is_respected_and_convergence_checked():
    both = jax.value_and_grad(lambda x: jnp.sum((x - jnp.array([2.0, -1.0])) ** 2))
    low, high = np.array([-1.0, -3.0]), np.array([1.0, 3.0])
    answer = minimise_bounded(both, np.zeros(2), low, high)
    assert answer.converged and not answer.reason
    assert np.allclose(answer.x, [1.0, -1.0], atol=1e-5)


def test_too_few_steps_are_reported():
    def valley(x):
        return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2

    both = jax.value_and_grad(valley)
    low, high = np.full(2, -3.0), np.full(2, 3.0)
    answer = minimise_bounded(both, np.array([-1.2, 1.0]), low, high, max_steps=2)
    assert not answer.converged
    assert "after 2 iterations" in answer.reason and "projected gradient" in answer.reason


def test_a_function_that_lies_about_its_gradient_is_reported():
    def uphill(x):
        return float(np.sum(x**2)), -2.0 * x

    answer = minimise_bounded(uphill, np.ones(2), np.full(2, -3.0), np.full(2, 3.0))
    assert not answer.converged
    assert "line search" in answer.reason


def test_steps_are_cut_back_where_the_function_is_not_finite():
    def fenced(x):
        if x[0] > 1.2:
            return np.nan, np.full(1, np.nan)
        return float(np.cosh(x[0] - 1.0)), np.sinh(x - 1.0)

    answer = minimise_bounded(
        fenced, np.zeros(1), np.full(1, -9.0), np.full(1, 9.0), np.full(1, 9.0)
    )
    assert answer.converged
    assert np.allclose(answer.x, 1.0, atol=1e-6)


def test_a_start_where_the_function_is_not_finite_is_reported():
    one = np.ones(1)
    answer = minimise_bounded(lambda x: (np.nan, x), 0 * one, -one, one)
    assert not answer.converged and "at the start" in answer.reason


def test_a_missing_jaxopt_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "jaxopt", None)
    with pytest.raises(MissingPackage, match="lbfgsb needs jaxopt.*pip install"):
        minimise_bounded(lambda x: (0.0, x), np.zeros(1), -np.ones(1), np.ones(1))


@pytest.fixture(scope="module")
def twin():
    """Paper 1's twin with noise."""
    study = kj.read_study("paper1")
    made = study.synthetic
    assert made is not None
    measured = synthetic_motion(
        study.knee,
        dict(made.parameters),
        np.asarray(made.flexion_deg),
        noise_mm=made.noise_mm,
        noise_deg=made.noise_deg,
        seed=made.seed,
    )
    asked = study.replace(synthetic=None, measured=measured, procedures=["III"])
    return lambda **changes: kj.calibrate(asked.replace(**changes))


@pytest.mark.slow
def test_the_twin_ends_where_least_squares_ends(twin):
    """Two roads, one minimum: within 1/500 of every parameter's error."""
    reference, answer = twin().fit, twin(method="lbfgsb").fit
    assert answer.success and answer.ending is Ending.CONVERGED and not answer.reason
    assert answer.objective == pytest.approx(reference.objective, rel=1e-8)
    for one, other in zip(answer.estimates, reference.estimates, strict=True):
        low, high = (
            end if np.isfinite(end) else bound
            for end, bound in ((other.low, other.lower), (other.high, other.upper))
        )
        error = (high - low) / (2.0 * 1.96)
        assert abs(one.value - other.value) < 2e-3 * error
    assert answer.evaluations["jacobian"] < 400


def test_a_calibration_that_does_not_converge_says_so(twin, monkeypatch):
    monkeypatch.setattr(_search, "_MAX_STEPS", 2)
    fit = twin(method="lbfgsb").fit
    assert not fit.success
    assert "L-BFGS-B ended after 2 iterations (the limit" in fit.reason
