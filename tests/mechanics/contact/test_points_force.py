"""Wrench and stiffness of a contact over points, against differentiation."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import Contact
from kneejax.mechanics._wrench import wrench_of
from kneejax.numerics import compiled


def condyle_on_plateau(basis, rng):
    """Tilted surfaces that press about 1 mm into each other over a third of the points."""
    turn = rng.uniform(-0.1, 0.1, size=(2, 3))
    if basis == "power":
        c = [[23.0, 0.4, -1.6], [-1.5, 0.2, 0.0], [0.8, 0.0, 0.0]]
        height = [[0.1, 0.3, 0.9], [0.2, 0.1, 0.0], [0.8, 0.0, 0.0]]
    else:
        c = 23.0 + rng.normal(size=(7, 6))
        height = 0.5 * rng.normal(size=(7, 6))
    femoral = geo.Condyle(c, (0.1, 3.0), (-12, 12), geo.Frame([0, 0, 22], turn[0]), basis)
    tibial = geo.Plateau(height, (-20, 20), (-13, 13), geo.Frame([0, -23, 22], turn[1]), basis)
    return Contact(femoral, tibial, law="log", form="quadrature", points=(9, 8))


@compiled()
def both(contact, state, flexion):
    """Wrench and its change by five coordinates, written out and differentiated."""

    def wrench(written_out):
        def of(state):
            tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
            if written_out:
                found = contact.wrench(tibia)
            else:
                found = contact.sampled_wrench(tibia, contact.sample(tibia))
            return jnp.stack([*found.force, *found.moment])

        return of(state), jax.jacfwd(of)(state)

    tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
    of_energy = wrench_of(contact.energy, tibia)
    return wrench(True), wrench(False), jnp.stack([*of_energy.force, *of_energy.moment])


# The other basis against differences, where rays graze: test_rays.py.
@pytest.mark.parametrize("basis", ["cubic_spline", "power"])
def test_stiffness_over_points_is_the_derivative_of_the_wrench(basis, rng):
    contact = condyle_on_plateau(basis, rng)
    state = jnp.array([0.02, -0.05, 0.7, 1.5, -0.6])
    out, differentiated, of_energy = both(contact, state, jnp.asarray(0.5))
    largest = np.abs(out[0]).max()
    assert largest > 100.0
    np.testing.assert_allclose(out[0], of_energy, rtol=1e-6, atol=1e-6 * largest)
    np.testing.assert_array_equal(out[0], differentiated[0])
    np.testing.assert_allclose(
        out[1], differentiated[1], rtol=1e-8, atol=1e-8 * np.abs(out[1]).max()
    )


def test_a_wrench_has_a_derivative_by_everything_else_too(rng, central_difference):
    contact = condyle_on_plateau("power", rng)
    tibia = geo.Pose(*(jnp.asarray(x) for x in (0.5, 0.02, -0.05, 0.7, 1.5, -0.6))).placement

    def force(numbers):
        modulus, radius, lift = numbers
        moved = dataclasses.replace(
            contact, youngs_modulus=modulus,
            femoral=dataclasses.replace(
                contact.femoral, coefficients=contact.femoral.coefficients.at[0, 0].set(radius)
            ),
            tibial=dataclasses.replace(
                contact.tibial, coefficients=contact.tibial.coefficients.at[0, 0].set(lift)
            ),
        )  # fmt: skip
        return jnp.stack(moved.wrench(tibia).force)

    x = jnp.array([5.0, 23.0, 0.1])
    quick = jax.jit(force)
    exact = jax.jit(jax.jacfwd(force))(x)
    expected = central_difference(quick, np.asarray(x), 1e-3)
    np.testing.assert_allclose(exact, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_points_placed_beforehand_change_nothing(rng):
    contact = condyle_on_plateau("cubic_spline", rng)
    tibia = geo.Pose(*(jnp.asarray(x) for x in (0.5, 0.02, -0.05, 0.7, 1.5, -0.6))).placement
    energy = jax.jit(lambda contact: contact.energy(tibia))
    expected = energy(contact)
    assert expected > 10.0
    np.testing.assert_allclose(energy(contact.with_points_placed()), expected, rtol=1e-13)
