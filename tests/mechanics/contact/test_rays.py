"""How deep a point lies: every ray ends, or its depth comes to rest, and nothing jumps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import Contact, add_lane_axis
from kneejax.mechanics.contact import _rays as rays
from kneejax.numerics import compiled
from tests.derivatives import wrench_of

UP = geo.AXES.y


@jax.jit
def depth_of(femoral, start, along):
    """Depth and its two slopes, of the thorough search."""
    start, along = start.full(), along.full()
    none = jnp.zeros(jnp.shape(start[0]), bool)
    found = rays.thorough_exit(femoral, start, along, jnp.zeros(none.shape), none)
    return *rays.any_depth(femoral, start, along, found), found


def points(*columns):
    return geo.Vector(*(jnp.asarray(x, float) for x in np.broadcast_arrays(*columns)))


def test_a_point_in_a_ball_is_as_deep_as_its_chord(rng):
    radius = 20.0
    start = rng.uniform(-1, 1, (3, 400))
    start = 0.999 * radius * start / np.maximum(1.0, np.linalg.norm(start, axis=0))
    along = rng.normal(size=(3, 400))
    along /= np.linalg.norm(along, axis=0)
    depth, _, _, found = depth_of(geo.Sphere(radius), points(*start), points(*along))
    across = (start * along).sum(axis=0)
    chord = across + np.sqrt(across**2 + radius**2 - (start**2).sum(axis=0))
    assert not found.lost.any()
    # Close under the surface a line that first goes deeper has an exit far away: its depth rests.
    nearby = np.abs(found.depth) < rays.STRAIGHT * np.abs(found.first)
    assert nearby.mean() > 0.5
    np.testing.assert_allclose(np.asarray(depth)[nearby], chord[nearby], atol=1e-9)
    assert (np.asarray(depth) > 0).all() and (np.asarray(depth) <= chord + 1e-9).all()


def test_a_ray_beside_a_ball_comes_to_rest_instead_of_missing_it():
    across = np.linspace(19.0, 22.0, 30_001)
    depth, *_, found = depth_of(geo.Sphere(20.0), points(across, -3.0, 0.0), UP)
    depth, meets = np.asarray(depth), across < 19.9
    exact = np.sqrt(np.clip(400.0 - across**2, 0, None)) - 3.0
    usual = np.asarray(found.depth / found.first) < rays.STRAIGHT
    assert usual[meets & (across > 19.8)].any() and np.asarray(found.held)[across > 20.1].all()
    np.testing.assert_allclose(depth[usual], exact[usual], atol=1e-9)
    assert (np.diff(depth) < 0).all()
    # No kink: a bend of the depth that is some per mm, at steps of 1e-4 mm.
    assert np.abs(np.diff(depth, 2)).max() < 1e-5


def waves():
    """A solid with valleys, through which lines leave it, graze it and miss it."""
    c = np.zeros((5, 3))
    c[0], c[1], c[2, 0], c[4, 0] = [18.0, 0.5, -0.6], [0.5, 0.3, 0.0], 6.0, -9.0
    return geo.Condyle(c, np.deg2rad([20.0, 160.0]), (-12.0, 12.0))


def test_depth_and_slopes_are_continuous_over_valleys():
    """Along random lines through the solid in steps of 1e-3 mm."""
    rng, most = np.random.default_rng(3), 45_000
    for _ in range(20):
        first, last = rng.uniform([-18, -22, -10], [18, -6, 10], (2, 3))
        tilt = rng.uniform(-0.4, 0.4, 2)
        along = np.array([tilt[0], 1.0, tilt[1]]) / np.hypot(1.0, np.hypot(*tilt))
        count = int(np.linalg.norm(last - first) / 1e-3)
        # All lines in one program: where one ends, its last point stands again.
        part = np.minimum(np.arange(most) / (count - 1), 1.0)
        x = first[:, None] + (last - first)[:, None] * part
        found = depth_of(waves(), points(*x), points(*along))[:3]
        depth, slope, swing = jax.tree.map(lambda y: np.asarray(y)[:count], found)
        # Farther apart nothing depends on it.
        matters = depth[1:] > -rays.APART
        for y in (depth, *slope, *swing):
            change = np.abs(np.diff(y))
            usual = np.maximum(np.roll(change, 50), np.roll(change, -50))
            assert (change[matters] < 10 * usual[matters] + 1e-2).all()


@pytest.mark.parametrize("seed", range(3))
def test_slopes_of_any_depth_are_central_differences(seed, central_difference):
    rng = np.random.default_rng(seed)
    start = rng.uniform([-18, -22, -10], [18, -4, 10], (60, 3)).T
    along = rng.normal(size=(3, 60)) * [[0.3], [0.0], [0.3]] + [[0.0], [1.0], [0.0]]

    def depth(shift):
        moved = points(*(start + shift[:3, None])), points(*(along + shift[3:, None]))
        return np.asarray(depth_of(waves(), *moved)[0])

    _, by_start, by_along, found = depth_of(waves(), points(*start), points(*along))
    exact = np.concatenate([np.stack(by_start), np.stack(by_along)]).T
    numeric = central_difference(depth, np.zeros(6), 1e-4)
    ratio = np.asarray(found.depth / found.first)
    assert (ratio > rays.STRAIGHT).any() and (ratio < rays.STRAIGHT).any()
    scale = 1e-6 * (1.0 + np.abs(exact).max(axis=1, keepdims=True))
    assert (np.abs(exact - numeric) < scale).all()


def pressed_waves():
    tibial = geo.Plateau(
        [[0.0, 0.3, 0.4], [0.2, 0.0, 0.0], [1.5, 0.0, 0.0]], (-16, 16), (-11, 11),
        geo.Frame([0.0, -20.0, 0.0], [0.05, 0.02, -0.04]),
    )  # fmt: skip
    return Contact(waves(), tibial, law="linear", form="quadrature", points=(12, 10))


@compiled()
def wrench_and_stiffness(contact, state, flexion):
    """Wrench, its change by five coordinates, the slope of the energy, and whose rays rest."""

    def wrench(state):
        found = contact.wrench(geo.State.of({"flexion": flexion}, state).tibia.placement)
        return jnp.stack([*found.force, *found.moment])

    tibia = geo.State.of({"flexion": flexion}, state).tibia.placement
    sampled = contact.foundation.sample(tibia)
    of_energy = wrench_of(contact.energy, tibia)
    return (
        wrench(state), jax.jacfwd(wrench)(state),
        jnp.stack([*of_energy.force, *of_energy.moment]), sampled,
    )  # fmt: skip


@pytest.mark.long
def test_wrench_and_stiffness_hold_where_rays_graze(central_difference):
    contact, flexion = pressed_waves(), -0.162
    state = np.array([0.196, -0.263, -4.884, 8.669, 2.027])
    wrench, stiffness, of_energy, sampled = wrench_and_stiffness(contact, state, flexion)
    twisted = np.abs(np.stack(sampled.twist)).max(axis=0) > 1e-6
    assert (twisted & (np.asarray(sampled.depth) > 0.1)).any(), "no ray rests in this pose"
    largest = np.abs(wrench).max()
    np.testing.assert_allclose(wrench, of_energy, atol=1e-6 * largest)
    numeric = central_difference(
        lambda x: wrench_and_stiffness(contact, x, flexion)[0], state, 1e-4
    )
    np.testing.assert_allclose(stiffness, numeric, atol=1e-6 * np.abs(numeric).max())


@pytest.mark.long
def test_a_force_does_not_tell_which_poses_are_asked_for_beside_it():
    """Rays of a pose that are hard to find once let those of all others be found more closely: the
    slope of a depth was off by as much as the last step left, and poses by 1e-8 mm."""
    contact, usual = add_lane_axis(pressed_waves()), [0.0, 0.02, 0.3, 4.5, 0.1]

    @compiled()
    def linearised(states):
        def wrench(states):
            state = {"flexion": jnp.zeros(states.shape[1])}
            found = contact.wrench(geo.State.of(state, states).tibia.placement)
            return jnp.stack([*found.force, *found.moment])

        return jax.jvp(wrench, (states,), (jnp.ones_like(states),))

    hard = [0.196, -0.263, -4.884, 8.669, 2.027]
    alone, beside = (linearised(jnp.array(x).T) for x in ([usual, usual], [usual, hard]))
    for one, other in zip(alone, beside, strict=True):
        assert np.abs(one[:, 0]).max() > 10.0
        np.testing.assert_allclose(one[:, 0], other[:, 0], atol=1e-11 * np.abs(one[:, 0]).max())
