"""The sampler against densities that are known in closed form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("blackjax")

from kneejax.inference.bayesian._nuts import ChainState, _log_density, _Scaled, _trajectory, sample


class Line(eqx.Module):
    """A straight line through noisy points, prior and noise normal: the posterior is as well."""

    design: jax.Array
    data: jax.Array
    noise: float
    prior: float

    def __call__(self, position):
        error = self.data - position @ self.design.T
        value = -0.5 * jnp.sum(error**2, axis=1) / self.noise**2
        gradient = error @ self.design / self.noise**2
        value -= 0.5 * jnp.sum(position**2, axis=1) / self.prior**2
        return value, gradient - position / self.prior**2

    def posterior(self):
        precision = self.design.T @ self.design / self.noise**2
        covariance = np.linalg.inv(precision + np.eye(2) / self.prior**2)
        return covariance @ self.design.T @ self.data / self.noise**2, covariance


class Walled(eqx.Module):
    """A normal density that is zero where the first coordinate exceeds a wall."""

    wall: float

    def __call__(self, position):
        inside = position[:, 0] < self.wall
        value = jnp.where(inside, -0.5 * jnp.sum(position**2, axis=1), -jnp.inf)
        return value, jnp.where(inside[:, None], -position, 0.0)


def begun(target, positions):
    positions = jnp.asarray(positions)
    return ChainState(positions, *target(positions))


@pytest.fixture
def line(rng):
    x = np.linspace(0.0, 10.0, 12)
    design = np.column_stack([np.ones(12), x])
    return Line(design, design @ [1.0, -0.4] + 0.5 * rng.standard_normal(12), 0.5, 2.0)


def test_a_linear_model_with_normal_noise_has_the_posterior_of_the_textbook(line, rng):
    """Intercept and slope are correlated by -0.85; the scaling begins 30 times too narrow."""
    mean, covariance = line.posterior()
    start = begun(line, mean + rng.standard_normal((4, 2)))
    found = sample(line, start, mean, 1e-3 * np.eye(2), draws=2000, warmup=300, seed=4)
    draws = found.position.reshape(-1, 2)
    deviation = np.sqrt(np.diag(covariance))
    assert found.position.shape == (4, 2000, 2)
    assert (np.abs(draws.mean(axis=0) - mean) / deviation).max() < 0.05
    assert np.allclose(np.cov(draws.T), covariance, rtol=0.06)
    assert np.allclose(found.value[0], line(jnp.asarray(found.position[0]))[0])
    assert 0.7 < found.acceptance.mean() < 0.95
    assert not found.divergent.any()


def test_the_same_seed_draws_the_same_and_another_does_not(line):
    start = begun(line, np.array([[1.0, -0.4], [1.1, -0.5]]))

    def drawn(seed):
        origin, covariance = line.posterior()
        found = sample(line, start, origin, covariance, draws=30, warmup=75, seed=seed)
        return found.position

    assert np.array_equal(drawn(1), drawn(1))
    assert not np.array_equal(drawn(1), drawn(2))


def test_a_chain_that_runs_out_of_the_density_diverges_alone(rng):
    """Beyond the wall nothing is drawn; that a trajectory ended there is counted, and no number of
    another chain becomes anything but finite."""
    target = Walled(0.5)
    start = begun(target, rng.uniform(-1.0, 0.4, (4, 3)))
    found = sample(target, start, np.zeros(3), np.eye(3), draws=400, warmup=75, seed=0)
    assert np.isfinite(found.position).all() and np.isfinite(found.value).all()
    assert (found.position[..., 0] < 0.5).all()
    assert 0 < found.lost.sum() < found.lost.size
    assert np.array_equal(found.lost, found.divergent)
    # The half normal density up to the wall.
    every = np.linspace(-8.0, 0.5, 20001)
    mean = np.average(every, weights=np.exp(-0.5 * every**2))
    assert found.position[..., 0].mean() == pytest.approx(mean, abs=0.12)


@pytest.mark.long
def test_trajectories_are_those_of_blackjax(line):
    """Its own kernel, with the same random numbers, draws the same."""
    from blackjax.mcmc import hmc, nuts

    mean, covariance = line.posterior()
    target = _Scaled(line, jnp.asarray(mean), jnp.linalg.cholesky(jnp.asarray(covariance)))
    here = begun(target, [[0.3, -0.2]])
    theirs = hmc.HMCState(here.position[0], here.value[0], here.gradient[0])
    kernel = nuts.build_kernel()
    for number in range(5):
        key = jax.random.key(number)
        expected, info = kernel(key, theirs, lambda x: _log_density(target, x), 0.2, jnp.ones(2))
        ours, seen = _trajectory(target, key, jax.tree.map(lambda x: x[0], here), jnp.array(0.2))
        assert jnp.allclose(ours.position, expected.position, rtol=1e-12, atol=0)
        assert seen["evaluations"] == info.num_integration_steps > 4
        assert seen["acceptance"] == pytest.approx(float(info.acceptance_rate))


def test_progress_counts_every_draw(line):
    seen = []
    start = begun(line, np.array([[1.0, -0.4], [1.1, -0.5]]))
    sample(
        line, start, *line.posterior(), draws=30, warmup=75,
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert seen == [(25 * k, 125) for k in range(1, 6)]
