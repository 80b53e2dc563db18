"""Forces, tangents and their derivatives by a knee's numbers, against central differences."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.custom_derivatives import SymbolicZero

import kneejax.geometry as geo
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import compiled, instantiate
from kneejax.statics import balance, force, force_derivative

OPTIONS = {"xla_disable_hlo_passes": "fusion"}
FLEXION = jnp.array([0.0, 0.5, 1.3])
HELD = {"flexion": FLEXION}
# The first pose lifts one compartment off, the last presses one of them deep.
Q = jnp.array(
    [[0.0, 0.0, 0.0, -0.3, 0.0], [0.03, 0.05, 1.0, 0.5, 0.3], [-0.02, -0.1, -1.0, 3.2, 0.5]]
).T


@pytest.fixture(scope="module")
def knee(small_knee):
    return add_lane_axis(small_knee)


@pytest.fixture(scope="module")
def compiled_balance():
    return compiled()(balance)


@pytest.fixture(scope="module")
def balanced(knee, compiled_balance):
    return compiled_balance(knee, HELD, Q)


@pytest.fixture(scope="module")
def compiled_force():
    return compiled()(force)


@pytest.fixture(scope="module")
def compiled_derivative():
    return compiled()(force_derivative)


@pytest.fixture(scope="module")
def energy():
    return jax.jit(
        lambda knee, q: knee.energy(geo.State.of(HELD, q)), compiler_options=OPTIONS
    )


def shifted(q, direction):
    """A function of a number that moves all lanes along one coordinate."""
    return lambda e: q + e * jnp.eye(5)[direction][:, None]


@pytest.mark.long
def test_the_poses_press_and_lift_both_compartments(knee, balanced):
    depth = np.asarray(balanced.forces.depth)
    assert depth.shape == (2, 3)
    assert depth.min() < -0.1 and 1.0 < depth.max() < 5.0


def test_energy_at_the_contact_points_is_the_energy(knee, balanced, energy):
    expected = np.asarray(energy(knee, Q))
    np.testing.assert_allclose(np.asarray(balanced.forces.energy), expected, rtol=1e-12)


def test_the_residual_is_the_slope_of_the_energy_less_the_work_of_the_loads(
    knee, balanced, energy, central_difference
):
    slopes = np.stack(
        [
            central_difference(lambda e, d=d: energy(knee, shifted(Q, d)(e)), 0.0, s)
            for d, s in enumerate([2e-5, 2e-5, 4e-4, 4e-4, 4e-4])
        ]
    )
    load = np.asarray(knee.load_work(geo.State.of(HELD, Q), geo.FREE_COORDINATES))
    np.testing.assert_allclose(np.asarray(balanced.forces.load), load, rtol=1e-12)
    assert np.abs(load).max() > 10.0
    residual = np.asarray(balanced.residual)
    size = np.abs(residual).max(axis=1, keepdims=True)
    np.testing.assert_allclose(residual / size, (slopes - load) / size, atol=1e-6)


def test_force_alone_is_the_residual_of_the_balance(knee, balanced, compiled_force):
    residual, forces = compiled_force(knee, HELD, Q)
    np.testing.assert_allclose(np.asarray(residual), np.asarray(balanced.residual), rtol=1e-9)
    ours, theirs = np.asarray(forces.energy), np.asarray(balanced.forces.energy)
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_the_tangent_is_the_slope_of_the_residual(
    knee, balanced, compiled_force, central_difference
):
    def residual(q):
        return compiled_force(knee, HELD, q)[0]

    columns = [
        central_difference(lambda e, d=d: residual(shifted(Q, d)(e)), 0.0, s)
        for d, s in enumerate([2e-5, 2e-5, 4e-4, 4e-4, 4e-4])
    ]
    numeric, tangent = np.stack(columns, axis=1), np.asarray(balanced.tangent)
    assert tangent.shape == (5, 5, 3)
    # Rows and columns in rad and mm: compare after scaling with the diagonal.
    size = np.sqrt(np.abs(np.einsum("iik->ik", tangent)))
    size = size[:, None] * size[None]
    np.testing.assert_allclose(tangent / size, numeric / size, atol=1e-6)


def test_the_tangent_without_following_loads_is_symmetric(knee, compiled_balance):
    free = eqx.tree_at(lambda k: k.loads, knee, jax.tree.map(jnp.zeros_like, knee.loads))
    tangent = np.asarray(compiled_balance(free, HELD, Q).tangent)
    size = np.sqrt(np.abs(np.einsum("iik->ik", tangent)))
    np.testing.assert_allclose(
        (tangent - tangent.transpose(1, 0, 2)) / (size[:, None] * size[None]), 0.0, atol=1e-10
    )


LEAVES = {
    "stiffness": (lambda k: k.ligaments.stiffness, 1000.0),
    "slack length": (lambda k: k.ligaments.slack_length, 1.0),
    "transition strain": (lambda k: k.ligaments.transition_strain, 0.01),
    "transition width": (lambda k: k.ligaments.transition_width, 0.001),
    "femoral attachment": (lambda k: k.ligaments.femoral_attachment, 1.0),
    "tibial attachment": (lambda k: k.ligaments.tibial_attachment, 1.0),
    "condyle coefficients": (lambda k: k.contacts[0].femoral.coefficients, 0.1),
    "condyle origin": (lambda k: k.contacts[1].femoral.frame.origin, 0.5),
    "plateau coefficients": (lambda k: k.contacts[1].tibial.coefficients, 0.1),
    "plateau origin": (lambda k: k.contacts[0].tibial.frame.origin, 0.5),
    "elastic modulus": (lambda k: k.contacts[1].youngs_modulus, 1.0),
    "Poisson's ratio": (lambda k: k.contacts[1].poisson_ratio, 0.01),
    "layer thickness": (lambda k: k.contacts[1].layer_thickness, 0.5),
    "onset width": (lambda k: k.contacts[1].onset_width, 0.005),
    "load": (lambda k: k.loads[0].force, 10.0),
    "line": (lambda k: k.lines[0].origin, 1.0),
}


@pytest.mark.long
@pytest.mark.parametrize("leaf", LEAVES)
def test_the_force_follows_each_number_of_the_knee(
    leaf, knee, balanced, compiled_force, compiled_derivative, central_difference
):
    where, size = LEAVES[leaf]
    zero = jax.tree.map(jnp.zeros_like, knee)
    direction = np.random.default_rng(3).uniform(0.5, 1.0, size=where(knee).shape) * size
    tangent = eqx.tree_at(where, zero, jnp.asarray(direction))
    exact = compiled_derivative(knee, HELD, Q, None, tangent, {"flexion": jnp.zeros(3)})

    def moved(e):
        return jax.tree.map(lambda x, t: x + e * t, knee, tangent)

    step = 1e-3
    numeric = central_difference(lambda e: compiled_force(moved(e), HELD, Q)[0], 0.0, step)
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    assert scale.max() > 0
    scale = np.maximum(scale, 1e-6 * np.abs(np.asarray(balanced.residual)).max())
    np.testing.assert_allclose(np.asarray(exact) / scale, numeric / scale, atol=1e-6)


def test_the_force_follows_flexion(
    knee, balanced, compiled_force, compiled_derivative, central_difference
):
    still = jax.tree.map(jnp.zeros_like, knee)
    exact = compiled_derivative(knee, HELD, Q, None, still, {"flexion": jnp.ones(3)})

    def bent(e):
        return {"flexion": FLEXION + e}

    numeric = central_difference(lambda e: compiled_force(knee, bent(e), Q)[0], 0.0, 2e-5)
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    np.testing.assert_allclose(np.asarray(exact) / scale, numeric / scale, atol=1e-6)


def test_a_derivative_is_made_of_what_moves_alone(knee):
    """By stiffness alone nothing differentiates where a fibre runs."""

    def still(x):
        return SymbolicZero(jax.typeof(x).to_tangent_aval())

    kept, one = jax.tree.map(still, knee), jnp.ones_like(knee.ligaments.stiffness)
    no_turn = jax.tree.map(still, HELD)

    def by_stiffness(rates):
        moved = eqx.tree_at(lambda k: k.ligaments.stiffness, rates, one)
        return jax.make_jaxpr(
            lambda knee: force_derivative(knee, HELD, Q, None, moved, no_turn)
        )(knee)

    zeros = dataclasses.replace(instantiate(kept), contacts=kept.contacts)
    alone, among_zeros = by_stiffness(kept), by_stiffness(zeros)
    assert len(alone.eqns) < 0.6 * len(among_zeros.eqns)
