"""Mass of a bone, and the inertia of a step as a potential."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.geometry import COORDINATES, ZERO, Matrix, Placement, Pose, State, Vector
from kneejax.mechanics import InertiaOfStep, Mass, TimeStep, add_lane_axis
from tests.dynamics.massed import SHANK, bare

NAMES = tuple(COORDINATES)


def points_of(mass):
    """Six equal masses that have a mass, a centre and an inertia together."""
    size, axes = np.linalg.eigh(np.asarray(mass.second_moment_kg_mm2))
    arms = axes * np.sqrt(3.0 * size / float(mass.mass_kg))
    return np.asarray(mass.center_mm) + np.concatenate([arms.T, -arms.T]), float(mass.mass_kg) / 6


def test_a_step_pulls_every_point_of_a_bone_to_where_it_is_expected(rng, central_difference):
    """Energy against a sum over points; generalised forces against differences of the energy."""
    expected = jax.tree.map(
        lambda x: x + 0.05 * rng.normal(), Pose.from_table([20.0, 3, -4, 5, -6, 2]).placement
    )
    step = InertiaOfStep(SHANK, expected, jnp.asarray(300.0))
    q = np.array([0.4, 0.05, -0.1, 4.0, -5.0, 1.0])
    points, each = points_of(SHANK)

    def sum_over_points(x):
        there = State.of({}, jnp.asarray(x)).tibia.placement
        off = [np.array([*(there.apply(p) - expected.apply(p))]) for p in points]
        return 0.5e-3 * 300.0**2 * each * np.sum(np.square(off))

    knee = dataclasses.replace(bare(), step=TimeStep((step,)))
    lanes = add_lane_axis(knee)
    state = State.of({}, jnp.asarray(q)[:, None])
    wrenches, energy, _ = lanes.pull(state)
    work = np.stack(lanes.work_of(wrenches, state, NAMES))[:, 0]
    assert float(energy[0]) == pytest.approx(sum_over_points(q), rel=1e-12)
    slope = central_difference(sum_over_points, q, 1e-3)
    np.testing.assert_allclose(work, -slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


def test_kinetic_energy_is_that_of_points_that_move(rng):
    still = Pose.from_table([0.0] * 6).placement
    velocity = jax.tree.map(lambda _: jnp.asarray(rng.normal()), still)
    points, each = points_of(SHANK)
    speeds = [sum(c**2 for c in velocity.apply(p)) for p in points]
    assert float(SHANK.kinetic_energy(velocity)) == pytest.approx(0.5e-3 * each * sum(speeds))
    # 2 kg at 3 m/s are 9 J.
    one = Placement(Matrix(ZERO, ZERO, ZERO), Vector(3000.0, 0.0, 0.0))
    still = Mass(2.0, [0.0] * 3, np.zeros((3, 3)))
    assert float(still.kinetic_energy(one)) == pytest.approx(9000.0)


def test_a_weight_at_a_point_moves_centre_and_inertia():
    rod = Mass(0.0, [0.0] * 3, np.zeros((3, 3))).with_point(1.0, [0.0, 10.0, 0.0])
    both = rod.with_point(1.0, [0.0, -10.0, 0.0])
    np.testing.assert_allclose(both.center_mm, 0.0)
    np.testing.assert_allclose(both.inertia_kg_mm2, np.diag([200.0, 0.0, 200.0]))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((-1.0, [0.0] * 3, np.eye(3)), "mass_kg is -1; expected 0 or more"),
        ((1.0, [0.0] * 3, np.diag([1.0, 1.0, 2.5])), "principal moments 1, 1, 2.5"),
        ((1.0, [0.0] * 3, np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]])), "not symmetric"),
    ],
)
def test_what_is_no_mass_is_refused(numbers, said):
    with pytest.raises(ValueError, match=said):
        Mass(*numbers)
