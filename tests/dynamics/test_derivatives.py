"""Derivatives of a motion by every kind of number, forward and backward, against differences."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.dynamics import LoadCurve, MovingKnee, move
from kneejax.geometry import Frame, Plane, Sphere
from kneejax.mechanics import Contact, Load, Mass
from tests.dynamics.massed import ALL_BUT_SUPERIOR, SHANK, STEPS, bare, in_a_vice

pytestmark = pytest.mark.usefixtures("optimised_code")

TIMES = np.linspace(0.0, 0.012, STEPS + 1)
WHICH = ("fibre damping", "damping while lengthening", "coordinate damping", "mass", "centre",
         "stiffness", "start", "rate at start", "load", "gravity")  # fmt: skip


def end_of(x):
    """Coordinates and rates at the end of a short motion, by changes of ten numbers."""
    vice = in_a_vice(4000.0)
    fibres = vice.knee.ligaments
    fibres = dataclasses.replace(fibres, stiffness=fibres.stiffness * (1.0 + 0.1 * x[5]),
                                 damping=fibres.damping + 2.0 * (1.0 + x[1]))  # fmt: skip
    mass = dataclasses.replace(SHANK, mass_kg=SHANK.mass_kg * (1.0 + x[3]),
                               center_mm=SHANK.center_mm + 10.0 * x[4])  # fmt: skip
    moving = MovingKnee(
        eqx.tree_at(lambda k: k.ligaments, vice.knee, fibres), {"tibia": mass},
        jnp.full(12, 0.05) * (1.0 + x[0]),
        {"flexion": 20.0 * (1.0 + x[2]), "lateral": 0.02 * (1.0 + x[2])},
        jnp.array([0.0, -9.8, 0.0]) * (1.0 + 5.0 * x[9]),
    )  # fmt: skip
    start = jnp.array([0.03, -0.01, 0.02, 0.2, -0.1, 0.15]) * (1.0 + x[6])
    rate = jnp.array([1.0, 0.5, -1.0, 20.0, 0.0, -10.0]) * (1.0 + x[7])
    pull = Load(jnp.array([[0.0, 0, 0], [40.0, -20.0, 10.0]]) * (1.0 + x[8]))
    found = move(moving, start, TIMES, rate=rate, loads=LoadCurve.of([0.0, 0.006], pull))
    return jnp.concatenate([found.q[-1], 1e-3 * found.rate[-1]])


def end_of_bounce(x):
    """Height and rate in the middle of a damped bounce, by changes of three numbers."""
    contact = Contact(Sphere(20.0), Plane(Frame([0.0, -20.5, 0.0])), 5.0 * (1.0 + x[0]))
    ball = MovingKnee.of(
        bare(contacts=(contact,)), Mass(2.0, [0.0] * 3, np.zeros((3, 3))),
        contact_dissipation={"0": 0.003 * (1.0 + x[1])},
    )  # fmt: skip
    found = move(ball, jnp.zeros(6), np.linspace(0.0, 0.004, STEPS + 1), held=ALL_BUT_SUPERIOR,
                 rate=jnp.array([0.0, 0.0, 0.0, 0.0, 300.0, 0.0]) * (1.0 + x[2]))  # fmt: skip
    return jnp.stack([found.q[-1, 4], 1e-3 * found.rate[-1, 4]])


@pytest.mark.long
def test_derivatives_of_a_damped_bounce_are_those_of_differences():
    """By the modulus, the dissipation, and the speed."""
    step, columns = 1e-3, []
    for unit in step * np.eye(3):
        near, far = (
            np.asarray(end_of_bounce(k * unit) - end_of_bounce(-k * unit)) for k in (1, 2)
        )
        columns.append((8.0 * near - far) / (12.0 * step))
    expected = np.stack(columns, axis=-1)
    found = jax.jacrev(end_of_bounce)(jnp.zeros(3))
    assert np.abs(expected).min() > 1e-3
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.long
def test_second_derivatives_of_a_damped_bounce_are_those_of_differences():
    """Backwards through the loop over steps, then forwards."""
    along, step = jnp.array([0.4, -0.3, 0.5]), 2e-3

    def height(size):
        return end_of_bounce(size * along)[0]

    told = jax.jit(lambda size: jax.jvp(jax.grad(height), (size,), (1.0,)))
    far, near = (float(told(k * step)[0] - told(-k * step)[0]) for k in (1.0, 0.5))
    expected = (8.0 * near - far) / (6.0 * step)
    assert float(told(0.0)[1]) == pytest.approx(expected, rel=1e-6)


@pytest.fixture(scope="module")
def by_differences():
    # Poses are rounded at 4e-12 mm. Little depends on the damping of coordinates: its step is wide;
    # for others, fibres would become slack within such a step.
    columns, steps = [], np.full(len(WHICH), 2e-3)
    steps[WHICH.index("coordinate damping")] = 8e-3
    for unit, step in zip(np.diag(steps), steps, strict=True):
        near, far = (np.asarray(end_of(k * unit) - end_of(-k * unit)) for k in (1, 2))
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.long
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev], ids=["forward", "backward"])
def test_derivatives_of_a_motion_are_those_of_differences(mode, by_differences):
    exact = mode(end_of)(jnp.zeros(len(WHICH)))
    largest = np.abs(by_differences).max(axis=0)
    assert largest.min() > 1e-6, dict(zip(WHICH, largest, strict=True))
    np.testing.assert_allclose(exact / largest, by_differences / largest, atol=1e-6)
