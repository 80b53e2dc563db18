"""Bounded least squares against closed forms and SciPy."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from scipy.optimize import lsq_linear

from kneejax.inference import BoundedLevenbergMarquardt


def fit(function, start, lower, upper):
    solver = BoundedLevenbergMarquardt(jnp.asarray(lower), jnp.asarray(upper), rtol=1e-15)
    return optx.least_squares(function, solver, jnp.asarray(start), max_steps=200)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_linear_problems_within_bounds_equal_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((12, 5)), 3 * rng.standard_normal(12)
    answer = fit(lambda x, _: jnp.asarray(a) @ x - b, np.zeros(5), -np.ones(5), np.ones(5))
    reference = lsq_linear(a, b, (-1, 1), tol=1e-14).x
    assert np.allclose(answer.value, reference, atol=1e-6)


def test_an_active_bound_costs_no_extra_steps():
    def rosenbrock(x, _):
        return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    answer = fit(rosenbrock, [-1.0, 1.0], [-2.0, -2.0], [0.5, 2.0])
    assert np.allclose(answer.value, [0.5, 0.25], atol=1e-7)
    assert int(answer.stats["num_steps"]) < 60


def test_a_fibre_that_has_become_slack_does_not_hold_up_the_others():
    def valley_and_fibre(x, _):
        # Taut above 0.6, and next to nothing below: there a linear model promises long steps.
        taut = 0.5 * (x[2] - 0.6 + jnp.hypot(x[2] - 0.6, 0.001))
        return jnp.stack([30 * (x[1] - x[0] ** 2), x[0] - 1 + 1e3 * taut, 1e4 * taut])

    answer = fit(valley_and_fibre, [-1.0, 1.0, 0.61], [-2.0, -2.0, 0.0], [2.0, 2.0, 1.0])
    assert np.allclose(answer.value, [1.0, 1.0, 0.0], atol=1e-3)
    # 60 with a damping that knows nothing but the slopes where the search is.
    assert int(answer.stats["num_steps"]) < 45


def room_to_balance(x, _):
    """Readings that want to be where nothing balances any more, and one whose slope is infinite
    at the limit: least squares of 25 at (0.8, 0.6)."""
    room = 1.0 - x @ x
    jumps = jnp.where(room > 0, 5.0 * jnp.sqrt(jnp.where(room > 0, room, 1.0)), jnp.inf)
    return jnp.append(10.0 * (x - jnp.array([1.2, 0.9])), jumps)


@pytest.mark.parametrize("start", [(0.95, -0.2), (-0.5, 0.8), (0.2, -0.97), (0.9, 0.0)])
def test_a_search_slides_along_a_limit_point_to_the_bottom(start):
    solver = BoundedLevenbergMarquardt(jnp.full(2, -2.0), jnp.full(2, 2.0))
    start = jnp.array(start)
    answer = optx.least_squares(room_to_balance, solver, start, max_steps=200, throw=False)
    # 45 to 413 where a reading that refuses alone shortens the steps of all.
    assert float(jnp.sum(room_to_balance(answer.value, None) ** 2)) < 25.01


def test_a_held_variable_does_not_move():
    answer = fit(lambda x, _: x - jnp.array([2.0, 3.0]), [0.7, 0.0], [0.7, -9.0], [0.7, 9.0])
    assert np.allclose(answer.value, [0.7, 3.0])


def test_already_at_the_answer_ends_at_once():
    answer = fit(lambda x, _: x - 1.0, [1.0, 1.0], [0.0, 0.0], [2.0, 2.0])
    assert int(answer.stats["num_steps"]) <= 2


def test_bounds_in_options_are_refused():
    solver = BoundedLevenbergMarquardt(jnp.zeros(1), jnp.ones(1))
    with pytest.raises(ValueError, match="fields of the solver"):
        optx.least_squares(lambda x, _: x, solver, jnp.ones(1), options={"lower": jnp.zeros(1)})
