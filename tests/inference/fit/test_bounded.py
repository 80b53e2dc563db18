"""Bounded least squares against closed forms and SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from kneejax.inference import BoundedLevenbergMarquardt


def fit(function, start, lower, upper, rtol=1e-15):
    """The best point of a fit, and how many trials it took."""
    search = BoundedLevenbergMarquardt([start], lower, upper, rtol=rtol)
    both = jax.jit(lambda x: (function(x), jax.jacfwd(function)(x)))
    trials = 0
    while trials < 200 and not search.ended.all():
        trials += 1
        residual, slope = map(np.array, both(search.trial[0]))
        slope[~np.isfinite(residual)] = 0.0
        search.tell(np.arange(1), residual[None], slope[None])
    return search.x[0], trials


@pytest.mark.parametrize("seed", range(6))
def test_linear_problems_within_bounds_equal_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((12, 5)), 3 * rng.standard_normal(12)
    found, _ = fit(lambda x: jnp.asarray(a) @ x - b, np.zeros(5), -np.ones(5), np.ones(5))
    reference = lsq_linear(a, b, (-1, 1), tol=1e-14).x
    assert np.allclose(found, reference, atol=1e-6)


def test_fits_side_by_side_end_as_each_alone():
    """Whatever the others do: they share arrays, not decisions."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((7, 12, 5)), 3 * rng.standard_normal((7, 12))
    together = BoundedLevenbergMarquardt(np.zeros((7, 5)), -np.ones(5), np.ones(5))
    while not together.ended.all():
        rows = np.flatnonzero(~together.ended)
        residual = np.einsum("fij,fj->fi", a[rows], together.trial[rows]) - b[rows]
        together.tell(rows, residual, a[rows])
    for row in range(7):
        start, end = np.zeros(5), np.ones(5)
        alone, _ = fit(lambda x, r=row: a[r] @ x - b[r], start, -end, end, 1e-10)
        np.testing.assert_allclose(together.x[row], alone, atol=1e-12)


def test_an_active_bound_costs_no_extra_steps():
    def rosenbrock(x):
        return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    found, trials = fit(rosenbrock, [-1.0, 1.0], [-2.0, -2.0], [0.5, 2.0])
    assert np.allclose(found, [0.5, 0.25], atol=1e-7)
    assert trials < 60


def test_a_fibre_that_has_become_slack_does_not_hold_up_the_others():
    def valley_and_fibre(x):
        # Taut above 0.6, and next to nothing below: there a linear model promises long steps.
        taut = 0.5 * (x[2] - 0.6 + jnp.hypot(x[2] - 0.6, 0.001))
        return jnp.stack([30 * (x[1] - x[0] ** 2), x[0] - 1 + 1e3 * taut, 1e4 * taut])

    found, trials = fit(valley_and_fibre, [-1.0, 1.0, 0.61], [-2.0, -2.0, 0.0], [2.0, 2.0, 1.0])
    assert np.allclose(found, [1.0, 1.0, 0.0], atol=1e-3)
    # 60 with a damping that knows nothing but the slopes where the search is.
    assert trials < 45


def room_to_balance(x):
    """Readings that want to be where nothing balances any more, and one whose slope is infinite
    at the limit: least squares of 25 at (0.8, 0.6)."""
    room = 1.0 - x @ x
    jumps = jnp.where(room > 0, 5.0 * jnp.sqrt(jnp.where(room > 0, room, 1.0)), jnp.inf)
    return jnp.append(10.0 * (x - jnp.array([1.2, 0.9])), jumps)


@pytest.mark.parametrize("start", [(0.95, -0.2), (-0.5, 0.8), (0.2, -0.97), (0.9, 0.0)])
def test_a_search_slides_along_a_limit_point_to_the_bottom(start):
    found, _ = fit(room_to_balance, start, [-2.0, -2.0], [2.0, 2.0], rtol=1e-10)
    # 45 to 413 where a reading that refuses alone shortens the steps of all.
    assert float(jnp.sum(room_to_balance(found) ** 2)) < 25.01


def test_a_held_variable_does_not_move():
    found, _ = fit(lambda x: x - jnp.array([2.0, 3.0]), [0.7, 0.0], [0.7, -9.0], [0.7, 9.0])
    assert np.allclose(found, [0.7, 3.0])


def test_already_at_the_answer_ends_at_once():
    _, trials = fit(lambda x: x - 1.0, [1.0, 1.0], [0.0, 0.0], [2.0, 2.0])
    assert trials <= 2


def test_a_fit_without_a_start_does_not_end_by_itself():
    search = BoundedLevenbergMarquardt([[0.5]], [0.0], [1.0])
    search.tell(np.arange(1), np.array([[np.inf, 1.0]]), np.zeros((1, 2, 1)))
    assert not search.ended[0] and np.isinf(search.chi2[0])
