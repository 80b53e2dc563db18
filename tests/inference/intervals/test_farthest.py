"""How far a value goes while a linear misfit stays within a limit: ellipsoids; boxes by SLSQP."""

import numpy as np
import pytest
from scipy.optimize import minimize

from kneejax.inference.intervals._profile_arms import farthest, products, squares


def linear(seed, size=4):
    rng = np.random.default_rng(seed)
    # Values that make up for each other, as stiffnesses and strains do.
    mixed = np.eye(size) + 0.8 * rng.normal(size=(size, size))
    slope = rng.normal(size=(1, 12, size)) @ mixed
    return products(rng.normal(size=(1, 12)), slope)[0]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_bounds_it_is_the_end_of_the_ellipsoid(way):
    model, far = linear(0), np.full(4, 1e6)
    best = -np.linalg.solve(model[:4, :4], model[:4, 4])
    most = squares(model, best) + 3.84
    found = farthest(model, 2, way, most, -far, far, 0.0)
    end = best[2] + way * np.sqrt(3.84 * np.linalg.inv(model[:4, :4])[2, 2])
    assert found.step[2] == pytest.approx(end, rel=1e-9)
    assert squares(model, found.step) == pytest.approx(most, rel=1e-9)


@pytest.mark.parametrize("seed", [*range(6), 8, 10, 39, 45, 50])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_in_a_box_no_general_optimiser_goes_farther(seed, way):
    model, rng = linear(seed), np.random.default_rng(100 + seed)
    low, high = -rng.uniform(0.02, 0.4, 4), rng.uniform(0.02, 0.4, 4)
    low[1], high[1] = -5.0, 5.0
    most = squares(model, np.zeros(4)) + 1.0
    found = farthest(model, 1, way, most, low, high, 0.0)
    assert squares(model, found.step) <= most * (1 + 1e-9)
    assert ((found.step >= low) & (found.step <= high)).all()
    room = {"type": "ineq", "fun": lambda x: most - squares(model, x)}
    other = minimize(
        lambda x: -way * x[1], np.zeros(4), bounds=list(zip(low, high, strict=True)),
        constraints=room, method="SLSQP", options={"maxiter": 300, "ftol": 1e-11},
    )  # fmt: skip
    assert squares(model, other.x) == pytest.approx(most, rel=1e-6)
    assert way * found.step[1] >= way * other.x[1] - 1e-5
