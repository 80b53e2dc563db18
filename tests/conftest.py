"""What every test shares: float64, the central difference, and the order of a convergence."""

import jax
import numpy as np
import pytest
from hypothesis import settings

jax.config.update("jax_enable_x64", True)
settings.register_profile("kneejax", deadline=None, max_examples=15, derandomize=True)
settings.load_profile("kneejax")


def pytest_configure(config):
    config.addinivalue_line("markers", "opensim: compares against OpenSim, skipped without it")


def _central_difference(function, x, step=1e-3):
    """Fourth-order central differences of `function`, one column for each entry of `x`."""
    x = np.asarray(x, float)
    columns = []
    for index in np.ndindex(*x.shape):
        unit = np.zeros_like(x)
        unit[index] = step
        near = np.asarray(function(x + unit)) - np.asarray(function(x - unit))
        far = np.asarray(function(x + 2 * unit)) - np.asarray(function(x - 2 * unit))
        columns.append((8.0 * near - far) / (12.0 * step))
    columns = np.stack(columns, axis=-1)
    return columns.reshape(columns.shape[:-1] + x.shape)


def _slope_on_log_axes(x, y):
    return np.polyfit(np.log(np.asarray(x, float)), np.log(np.asarray(y, float)), 1)[0]


@pytest.fixture(scope="session")
def central_difference():
    """Derivative of a function of an array, of shape `(*output, *input)`."""
    return _central_difference


@pytest.fixture(scope="session")
def slope_on_log_axes():
    """Order in which errors `y` shrink with `x`."""
    return _slope_on_log_axes


@pytest.fixture
def rng():
    """Random numbers, the same in every run."""
    return np.random.default_rng(7)
