"""The posterior of a knee's parameters: against Laplace, its density against the solver's poses."""

import dataclasses
import re
import sys
from importlib.util import find_spec

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.inference import Problem, posterior, synthetic_motion
from kneejax.inference.bayesian._priors import MotionDensity, normal_priors
from kneejax.numerics import MissingPackage, compiled
from kneejax.parameters import select

pytest.importorskip("blackjax")
# Not imported to see: two first imports in a day at once, by two workers, stop one of them.
pytestmark = pytest.mark.skipif(find_spec("arviz") is None, reason="needs arviz")

STRAINS = ("*.reference_strain",)
FLEXION = np.arange(0.0, 121.0, 5.0)
#: Between the bounds anything goes.
FLAT = {"reference_strain": (0.0, np.inf)}
NOISE = 0.05


@pytest.fixture(scope="module")
def problem(knee):
    motion = synthetic_motion(knee, {}, FLEXION, noise_mm=NOISE, noise_deg=NOISE, seed=2)
    return Problem.of(knee, select(knee, STRAINS), motion, np.ones(5))


@pytest.fixture(scope="module")
def fitted(problem, knee):
    fit = np.asarray(problem.selection.read(knee))
    return posterior(problem, fit, NOISE, NOISE, priors=FLAT, draws=250, warmup=75, seed=1)


@pytest.fixture(scope="module")
def shifted(problem, knee):
    """The density of four strains and an anterior frame offset, with priors that matter."""
    target, noise = problem.cases.target + 0.3, np.full(5, NOISE)
    cases = dataclasses.replace(problem.cases, target=target, noise=noise)
    shifted = dataclasses.replace(problem, cases=cases, offsets=("anterior",))
    priors = normal_priors(shifted, {"*.reference_strain": (0.01, 0.02)})
    values = np.r_[np.asarray(problem.selection.read(knee)), -0.2]
    found = shifted.begin(values[None])
    deviation = np.array([0.001, 0.002, 0.001, np.nan, 0.1])
    density = MotionDensity.of(shifted, noise, priors, found, deviation)
    return shifted, priors, density, found


@compiled()
def look(density, position):
    return density(position)


@pytest.mark.slow
def test_laplace_and_nuts_agree_where_the_posterior_is_nearly_normal(fitted):
    deviation = np.sqrt(np.diag(fitted.laplace_covariance))
    assert (np.abs(fitted.mean - fitted.laplace_mean) / deviation).max() < 0.1
    assert np.abs(fitted.sd / deviation - 1.0).max() < 0.1
    # What chance alone may do to a mean of so many effective draws is well below that.
    assert (fitted.effective_sample_size > 800).all()
    assert (fitted.r_hat < 1.01).all() and fitted.divergences == 0


@pytest.mark.slow
def test_the_truth_lies_in_the_posterior_and_the_motion_in_its_bands(fitted, problem, knee):
    scores = (np.asarray(problem.selection.read(knee)) - fitted.mean) / fitted.sd
    assert np.abs(scores).max() < 3.5
    low, high = fitted.predictive_quantiles[..., 0], fitted.predictive_quantiles[..., -1]
    inside = (problem.cases.target.T > low) & (problem.cases.target.T < high)
    # 125 measured numbers: 95 % of them, give or take three standard deviations.
    assert 0.89 < inside.mean() < 1.0
    # The motion itself is known better than one measurement of it.
    bands = fitted.motion_quantiles
    assert (bands[..., -1] - bands[..., 0] < 0.7 * (high - low)).all()
    assert np.all(np.diff(bands, axis=-1) >= 0)


@pytest.mark.slow
def test_arviz_takes_it_over(fitted):
    import arviz

    data = fitted.to_arviz()
    groups = {"posterior", "sample_stats", "posterior_predictive", "observed_data"}
    assert groups <= set(data.groups())
    assert data.posterior["ACL.reference_strain"].shape == (4, 250)
    assert data.posterior_predictive["motion"].dims == ("chain", "draw", "pose", "coordinate")
    summary = arviz.summary(data, round_to="none")
    assert np.allclose(summary["mean"].to_numpy(), fitted.mean)
    assert np.allclose(summary["r_hat"].to_numpy(), fitted.r_hat)
    assert np.allclose(summary["ess_bulk"].to_numpy(), fitted.effective_sample_size)


@pytest.mark.long
def test_the_density_is_that_of_the_poses(shifted, central_difference):
    """Its value by the poses of `Problem`, its gradient by central differences."""
    problem, priors, density, near = shifted
    away = [[0.004, -0.006, 0.005, 0.003, 0.1], [0.0, 0.02, 0.0, -0.01, 9.7]]
    values = near.values + np.array(away)
    position = np.asarray(density.position(jnp.asarray(values)))
    assert np.allclose(density.values(jnp.asarray(position)), values, rtol=1e-9)
    value, gradient = look(density, jnp.asarray(position[[0, 1, 0, 1]]))
    expected = []
    for x, place in zip(values, position, strict=True):
        residual, _ = problem.residual(problem.balance(x[None], near))
        bells = sum(((v - p.mean) / p.sd) ** 2 for v, p in zip(x, priors, strict=True))
        # How much room a step takes up where the bounds are taken away.
        rates = np.diag(central_difference(lambda u: density.values(jnp.asarray(u)), place, 1e-5))
        expected.append(-0.5 * (residual @ residual + bells) + np.log(rates).sum())
    assert value[0] - value[1] == pytest.approx(expected[0] - expected[1], rel=1e-9)
    assert value[2] == pytest.approx(value[0]) and value[3] == pytest.approx(value[1])

    def alone(x):
        return look(density, jnp.tile(jnp.asarray(x), (4, 1)))[0][0]

    for row, place in enumerate(position):
        slopes = central_difference(alone, place, 1e-4)
        assert np.allclose(gradient[row], slopes, rtol=1e-6, atol=1e-6 * np.abs(slopes).max())


def test_positions_bend_at_bounds_and_priors_follow(knee, shifted, central_difference):
    """Stiffness in its logarithm, strain as it is; the priors' mass is the same in both worlds."""
    named = select(knee, ("ACL.stiffness", "PCL.reference_strain"))
    problem = dataclasses.replace(shifted[0], selection=named, offsets=())
    priors = normal_priors(problem)
    near = problem.begin(np.array([[4500.0, -0.1]]))
    density = MotionDensity.of(problem, np.full(5, NOISE), priors, near, np.array([450.0, 0.002]))
    values = np.array([[4000.0, -0.09], [301.0, -0.1999], [9990.0, 0.1999], [6000.0, 0.0]])
    position = np.asarray(density.position(jnp.asarray(values)))
    assert np.allclose(density.values(jnp.asarray(position)), values, rtol=1e-9)
    # Far from the bounds nothing is bent.
    assert position[3] == pytest.approx([np.log(6000.0), 0.0], abs=1e-3)
    logs = [
        sum(np.log(p.density(v)) for p, v in zip(priors, row, strict=True))
        + np.log(np.diag(central_difference(density.values, place, 1e-5))).sum()
        for row, place in zip(values, position, strict=True)
    ]
    found = np.asarray(density.prior(jnp.asarray(position)))
    assert np.allclose(found - found[0], np.array(logs) - logs[0], rtol=1e-7)
    beyond = np.asarray(density.values(jnp.array([[-50.0, -9.0], [50.0, 9.0]])))
    assert np.allclose(beyond, [[300.0, -0.2], [10000.0, 0.2]])


@pytest.mark.long
def test_parameters_without_balance_have_no_density_and_leave_others_alone(shifted):
    """Without an MCL nothing balances in extension; the others' poses are found as exactly as
    before."""
    *_, density, near = shifted
    good = np.tile(near.values, (4, 1)) + 2e-4 * np.arange(4)[:, None]
    bad = good.copy()
    bad[2, shifted[0].selection.names.index("MCL.reference_strain")] = -0.199
    (value, gradient), (mixed, mixed_gradient) = (
        look(density, density.position(jnp.asarray(x))) for x in (good, bad)
    )
    assert np.isfinite(value).all()
    assert mixed[2] == -np.inf and not mixed_gradient[2].any()
    others = np.array([0, 1, 3])
    assert np.allclose(mixed[others], value[others], rtol=0, atol=1e-4)
    assert np.allclose(mixed_gradient[others], gradient[others], rtol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"noise_mm": 0.0}, "noise_mm: 0: expected a standard deviation above 0"),
        ({"noise_deg": np.nan}, "noise_deg: nan"),
        ({"chains": 1}, "chains: 1: expected 2 or more"),
        ({"draws": 3}, "draws: 3: expected 20 or more"),
        ({"warmup": 0}, "warmup: 0: expected 1 or more"),
        ({"priors": {"*.reference_strain": (0.0, 0.0)}}, "prior of width 0"),
        ({"priors": {"PCL.reference_strain": (0.5, 0.1)}}, "bounds -0.2 to 0.2 exclude"),
        ({"priors": {"PCL.reference_strian": (0.0, 0.1)}}, "did you mean 'PCL.reference_strain'"),
        ({"bounds": {"reference_strain": (0.1, -0.1)}}, "expected lower below upper"),
    ],
)
def test_what_makes_no_sense_is_refused(problem, knee, wrong, says):
    fit = np.asarray(problem.selection.read(knee))
    with pytest.raises(ValueError, match=re.escape(says)):
        posterior(problem, fit, **{"noise_mm": NOISE, "noise_deg": NOISE, **wrong})


@pytest.mark.parametrize("package", ["blackjax", "arviz"])
def test_a_missing_package_is_named(problem, knee, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    fit = np.asarray(problem.selection.read(knee))
    with pytest.raises(MissingPackage, match=f"needs {package}.*pip install 'kneejax.posterior.'"):
        posterior(problem, fit, NOISE, NOISE)
