"""What arms learn of curvature: quadratic sums whole, of kinks nothing, of valleys enough."""

import numpy as np
import pytest
from scipy.optimize import minimize

from kneejax.inference import Observations
from kneejax.inference.intervals import _profile_arms
from kneejax.inference.intervals._profile_arms import is_convex, learned
from kneejax.inference.intervals._profiles import Pace, follow
from kneejax.statics import LoadCases, Slopes, Status


def test_a_quadratic_is_known_after_as_many_steps_as_it_has_directions():
    random = np.random.default_rng(0)
    linear, hessian = (m @ m.T + np.eye(5) for m in random.standard_normal((2, 5, 5)))
    curvature = np.zeros((5, 5))
    # Directions that are conjugate: what is learned of one does not disturb what was.
    for direction in np.linalg.eigh(hessian)[1].T:
        curvature = learned(curvature, linear, direction, hessian @ direction)
    np.testing.assert_allclose(linear + curvature, hessian, atol=1e-12)


def test_the_last_step_is_explained_whatever_was_believed():
    random = np.random.default_rng(1)
    linear = np.eye(4)
    curvature, step = np.diag([3.0, 0.0, 2.0, 1.0]), random.standard_normal(4)
    change = 2.0 * step + 0.1 * random.standard_normal(4)
    found = learned(curvature, linear, step, change)
    np.testing.assert_allclose((linear + found) @ step, change, atol=1e-12)
    np.testing.assert_allclose(found, found.T, atol=1e-12)


def test_nothing_is_learned_where_the_gradient_falls():
    curvature = np.diag([1.0, 2.0])
    step = np.array([1.0, 0.0])
    assert learned(curvature, np.eye(2), step, -step) is curvature


def test_a_model_that_is_flat_somewhere_is_not_convex():
    assert is_convex(np.diag([1.0, 1e-6]), np.diag([1.0, 1e-6]))
    assert not is_convex(np.array([[1.0, 1.0], [1.0, 1.0]]), np.eye(2))


def test_a_kink_is_not_taken_for_curvature():
    """A spring that is ten times as stiff beyond a point that the step has passed."""
    curvature = np.diag([1.0, 2.0])
    assert learned(curvature, np.eye(2), np.array([1.0, 0.0]), np.array([10.0, 0.0])) is curvature


def bent_valley(values, near=None):
    """Residuals of a valley in x, y and z along z = 3 (x^2 + x y), with a weak spring in z."""
    x, y, z = np.asarray(values, float).T
    q, slope = np.zeros((len(x), 2, 5)), np.zeros((len(x), 2, 5, 3))
    q[:, 0, 2:] = np.stack([x, y, 10.0 * (z - 3.0 * (x * x + x * y))], 1)
    q[:, 1, 2] = 0.3 * z
    slope[:, 0, 2, 0] = slope[:, 0, 3, 1] = 1.0
    slope[:, 0, 4] = np.stack([-30.0 * (2.0 * x + y), -30.0 * x, np.full(len(x), 10.0)], 1)
    slope[:, 1, 2, 2] = 0.3
    shape = (len(x), 2)
    return Slopes(
        np.array(values, float), q, slope, np.zeros((*shape, 0, 2)), np.zeros((*shape, 0, 2, 3)),
        np.zeros((*shape, 5, 5)), np.full(shape, Status.BALANCED),
    )  # fmt: skip


def limits_and_looks(threshold=3.84):
    looks = []

    def balance(values, near=None):
        looks.append(len(values))
        return bent_valley(values)

    data = Observations(LoadCases.at([0.0, 1.0]), np.zeros((1, 2, 5)), np.ones(5))
    box, names = np.full(3, 20.0), [(name, "") for name in "xyz"]
    found, _ = follow(
        balance, data, bent_valley(np.zeros((1, 3))), -box, box, threshold, names, Pace.LIMITS
    )
    return np.array([[one.low, one.high] for one in found[0]]), sum(looks)


def test_limits_in_a_bent_valley_are_where_another_search_finds_them_in_fewer_looks(monkeypatch):
    def chi2(x):
        return float(np.sum(bent_valley(x[None]).q ** 2))

    limits, looks = limits_and_looks()
    # Downwards z has another valley, which begins away from the fit.
    for i, (low, high) in enumerate(limits[:2]):
        for way, end in ((-1.0, low), (1.0, high)):
            starts = np.random.default_rng(i).normal(size=(10, 3))
            inside = {"type": "ineq", "fun": lambda x: 3.84 - chi2(x)}
            ends = [
                minimize(lambda x, i=i, way=way: -way * x[i], x, constraints=inside)
                for x in starts
            ]
            farthest = max(way * one.x[i] for one in ends if one.success)
            assert way * end == pytest.approx(farthest, rel=0.03)
    monkeypatch.setattr(_profile_arms, "learned", lambda curvature, *_: np.zeros_like(curvature))
    straight, more = limits_and_looks()
    np.testing.assert_allclose(limits, straight, rtol=0.03)
    assert looks < 0.8 * more
