"""Wrench and stiffness of a contact over points, against differentiation."""

import dataclasses
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import Contact, PointFaults, Wrench, foundations_of
from kneejax.mechanics.contact._points import asked_at, quick_depths
from kneejax.numerics import compiled, compiler_options
from tests.derivatives import wrench_of


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


def of_springs(contact, tibia):
    """The sum of what the springs do, each by itself."""
    foundation = contact.foundation
    each = foundation.wrenches(tibia, foundation.sample(tibia))
    return jax.tree.map(lambda x: x[0], each)


@compiled()
def both(contact, state, flexion):
    """Wrench and its change by five coordinates, written out and differentiated."""

    def wrench(written_out):
        def of(state):
            tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
            if written_out:
                found = contact.wrench(tibia)
            else:
                found = of_springs(contact, tibia)
            return jnp.stack([*found.force, *found.moment])

        return of(state), jax.jacfwd(of)(state)

    tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
    of_energy = wrench_of(contact.energy, tibia)
    return wrench(True), wrench(False), jnp.stack([*of_energy.force, *of_energy.moment])


# The other basis against its energy and differences, where rays graze: test_rays.py.
@pytest.mark.long
@pytest.mark.parametrize("basis", ["cubic_spline", pytest.param("power", marks=pytest.mark.long)])
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


@pytest.mark.long
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
        found = jnp.stack(moved.wrench(tibia).force)
        return found, found

    x = jnp.array([5.0, 23.0, 0.1])
    # One program for both: forces take as long to compile as their derivative.
    derivative_and_force = jax.jit(jax.jacfwd(force, has_aux=True))
    exact, _ = derivative_and_force(x)
    expected = central_difference(lambda x: derivative_and_force(x)[1], np.asarray(x), 1e-3)
    np.testing.assert_allclose(exact, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@compiled()
def apart_and_together(contacts, state, flexion):
    """Energy, wrench, its change by five coordinates, and faults of contacts over points, each by
    itself and as one foundation, with all that is read of it."""

    def of(foundations):
        def wrench(state):
            tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
            energies, wrenches, faults = zip(*(x.press(tibia) for x in foundations), strict=True)
            total = Wrench.total([wrench.alone() for wrench in wrenches])
            worst = reduce(PointFaults.and_of, faults)
            value = jnp.stack([*total.force, *total.moment])
            return value, (value, sum(energies), worst)

        tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
        sampled = [x.sample(tibia) for x in foundations]
        read = [
            (x.wrenches(tibia, own), x.faults(tibia, own), x.border(tibia, own))
            for x, own in zip(foundations, sampled, strict=True)
        ]
        each = jax.tree.map(lambda *x: jnp.concatenate(x), *read)
        # Points are looked for once, beside the derivative.
        slope, (value, energy, worst) = jax.jacfwd(wrench, has_aux=True)(state)
        return energy, value, worst, slope, each

    return of([contact.foundation for contact in contacts]), of(foundations_of(contacts))


@pytest.mark.long
@pytest.mark.parametrize(("tilt", "up"), [(0.02, 1.5), (-0.9, 8.0)])
def test_a_force_is_proportional_to_its_modulus_whatever_moves(tilt, up, rng):
    # Rays stay where they are, the six that graze at the second pose too.
    (together,) = foundations_of(pair_of_splines(rng))

    def pressed(stiffer, state):
        points = dataclasses.replace(together.points, modulus=stiffer * together.points.modulus)
        tibia = geo.State.of({"flexion": jnp.asarray(0.5)}, state).tibia.placement
        energy, wrench, _ = dataclasses.replace(together, points=points).press(tibia)
        return jnp.stack([energy, *wrench.force, *wrench.moment])

    at = jnp.asarray(1.0), jnp.array([tilt, -0.05, 0.7, up, -0.6])
    move = jnp.array([0.01, 0.02, 0.3, -0.1, 0.2])

    @jax.jit
    def rates(stiffer, state):
        along = lambda rate, move: jax.jvp(pressed, (stiffer, state), (rate, move))[1]  # noqa: E731
        none = jnp.zeros(5)
        by_modulus = jax.jvp(lambda e: pressed(e, state), (stiffer,), (jnp.asarray(1.0),))
        return *by_modulus, along(0.0, move), along(1.0, none), along(1.0, move)

    value, by_modulus, by_motion, alone, both = rates(*at)
    assert np.abs(value[1:4]).max() > 10.0
    for found, expected in ((by_modulus, value), (alone, value), (both, value + by_motion)):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(value).max())


@pytest.mark.long
def test_a_force_follows_the_thickness_and_the_onset_of_its_layer(rng, central_difference):
    (together,) = foundations_of(pair_of_splines(rng))
    own, state = together.points, jnp.array([0.02, -0.05, 0.7, 1.5, -0.6])
    tibia = geo.State.of({"flexion": jnp.asarray(0.5)}, state).tibia.placement

    def pressed(parts):
        layer, onset = parts[0] * own.layer, parts[1] * own.onset_width
        points = dataclasses.replace(own, layer=layer, onset_width=onset)
        energy, wrench, _ = dataclasses.replace(together, points=points).press(tibia)
        value = jnp.stack([energy, *wrench.force, *wrench.moment])
        return value, value

    both = jax.jit(jax.jacfwd(pressed, has_aux=True))
    expected = central_difference(lambda x: both(x)[1], np.ones(2), 1e-3)
    size = 1e-6 * np.abs(expected).max(axis=0)
    assert (np.abs(both(np.ones(2))[0] - expected) <= size).all() and (size > 0.0).all()


# At the second pose rays graze at six points: two rows of three are searched thoroughly.
@pytest.mark.long
@pytest.mark.parametrize(("tilt", "up", "unusual"), [(0.02, 1.5, 0), (-0.9, 8.0, 6)])
def test_contacts_in_one_foundation_do_what_they_do_apart(tilt, up, unusual, rng):
    contacts = pair_of_splines(rng)
    (together,) = foundations_of(contacts)
    assert together.counts == (72, 30) and together.rows == (0, 1)
    state = jnp.array([tilt, -0.05, 0.7, up, -0.6])
    tibia = geo.State.of({"flexion": jnp.asarray(0.5)}, state).tibia.placement
    surface = asked_at(together.femoral, together.points)
    _, sound = jax.jit(quick_depths)(surface, together.points, tibia.inverse())
    assert np.sum(~np.asarray(sound)) == unusual
    apart, joined = apart_and_together(contacts, state, jnp.asarray(0.5))
    assert float(apart[0]) > 10.0
    for one, other in zip(jax.tree.leaves(apart), jax.tree.leaves(joined), strict=True):
        largest = np.abs(np.asarray(one, float)).max(initial=1.0)
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-11 * largest)


@pytest.mark.long
def test_all_numbers_of_joined_contacts_have_their_derivatives(rng):
    contacts, state = pair_of_splines(rng), jnp.array([0.02, -0.05, 0.7, 1.5, -0.6])
    tibia = geo.State.of({"flexion": jnp.asarray(0.5)}, state).tibia.placement
    leaves, tree = jax.tree.flatten(contacts)
    ways = tree.unflatten([jnp.asarray(rng.normal(size=x.shape)) for x in leaves])

    @compiled()
    def change(contacts, ways):
        def total(contacts, apart):
            foundations = [x.foundation for x in contacts] if apart else foundations_of(contacts)
            return Wrench.total([x.press(tibia)[1].alone() for x in foundations])

        by = [partial(total, apart=apart) for apart in (True, False)]
        return [jax.tree.leaves(jax.jvp(one, (contacts,), (ways,))[1]) for one in by]

    apart, together = np.array(change(contacts, ways))
    assert np.abs(apart).max() > 100.0
    np.testing.assert_allclose(together, apart, rtol=1e-8, atol=1e-10 * np.abs(apart).max())


@pytest.mark.long  # where operations are fused as in a command: gathers once ended the process
def test_their_energy_is_differentiated_backwards_as_forwards(rng):
    contacts, state = pair_of_splines(rng), jnp.array([0.02, -0.05, 0.7, 1.5, -0.6])
    tibia = geo.State.of({"flexion": jnp.asarray(0.5)}, state).tibia.placement
    leaves, tree = jax.tree.flatten(contacts)
    ways = tree.unflatten([jnp.asarray(rng.normal(size=x.shape)) for x in leaves])

    def energy(contacts):
        (together,) = foundations_of(contacts)
        return together.energy(tibia)

    options = dict(compiler_options())
    found = jax.jit(jax.grad(energy), compiler_options=options)(contacts)
    pairs = zip(jax.tree.leaves(found), jax.tree.leaves(ways), strict=True)
    backwards = sum(jnp.vdot(x, y) for x, y in pairs)
    forwards = jax.jit(lambda x, way: jax.jvp(energy, (x,), (way,))[1], compiler_options=options)
    np.testing.assert_allclose(backwards, forwards(contacts, ways), rtol=1e-10)


def test_what_cannot_be_asked_at_once_stays_apart(rng):
    one, other = pair_of_splines(rng)
    powers = condyle_on_plateau("power", rng)
    by_another_law = dataclasses.replace(other, law="log")
    elsewhere = dataclasses.replace(other, bodies=("femur", "patella"))
    found = foundations_of((one, powers, by_another_law, other, elsewhere, powers))
    assert [x.rows for x in found] == [(0, 3), (1,), (2,), (4,), (5,)]


def pair_of_splines(rng):
    """Two contacts between the same bones, of tables and points of different sizes."""
    one = dataclasses.replace(condyle_on_plateau("cubic_spline", rng), law="linear")
    femoral = geo.Condyle(
        24.0 + rng.normal(size=(6, 8)), (0.2, 2.8), (-10, 11),
        geo.Frame([1, -1, -20], [0.05, -0.02, 0.04]), "cubic_spline",
    )  # fmt: skip
    tibial = geo.Plateau(
        0.4 * rng.normal(size=(5, 7)), (-17, 18), (-11, 10),
        geo.Frame([0.5, -23.5, -20.5], [0.03, 0.02, -0.06]), "cubic_spline",
    )  # fmt: skip
    other = Contact(
        femoral, tibial, 7.0, 0.4, 5.0, 0.03, "linear", "quadrature", (6, 5),
        layer_variation=[[0.3, 0.1], [-0.2, 0.05]],
    )  # fmt: skip
    return one, other
