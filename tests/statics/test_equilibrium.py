"""Balanced poses of the bundled knee, their derivatives, and lanes that fail."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import compiler_options
from kneejax.numerics._elimination import solve
from kneejax.parameters import select
from kneejax.statics import (
    EnergyNewton,
    Guess,
    LoadCases,
    Status,
    balance_with_slopes,
    solve_equilibrium,
)

FLEXION = np.arange(0.0, 121.0, 5.0)


@pytest.fixture(scope="module")
def motion(knee):
    return kj.passive_flexion(knee, FLEXION)


def test_the_bundled_knee_stands_from_0_to_120_degrees(motion):
    assert (np.asarray(motion.status) == Status.BALANCED).all()
    assert np.asarray(motion.stable).all()
    assert float(motion.residual_force.max()) < 1e-4
    assert float(motion.residual_moment.max()) < 1e-2


def test_no_impossible_penetration(knee, motion):
    depth = np.asarray(motion.equilibrium.depth)
    assert depth.max() < 1.5 < float(knee.contacts[0].layer_thickness)


def test_an_angle_does_not_depend_on_which_others_were_asked_for(knee, motion):
    few = kj.passive_flexion(knee, FLEXION[::-1])
    assert np.allclose(few.to_table()[::-1], motion.to_table(), atol=1e-8)
    # Tables are filled up to a number of lanes, which nobody sees.
    shorter = kj.passive_flexion(knee, FLEXION[:3])
    assert shorter.equilibrium.q.shape == (5, 3) and shorter.flexion_deg.shape == (3,)
    assert np.allclose(shorter.to_table(), motion.to_table()[:3], atol=1e-8)


@jax.jit
def force_on_the_tibia(knee, pose, state, tension, contact_force):
    """Of ligaments, a line and contacts, each along its own way, N."""
    lanes, tibia = add_lane_axis(knee), pose.placement
    femoral, tibial = (
        jnp.moveaxis(x, 1, 0)
        for x in (lanes.ligaments.femoral_attachment, lanes.ligaments.tibial_attachment)
    )
    line = jnp.stack(tibia.apply(tuple(tibial))) - femoral
    pull = -tension.T * line / jnp.sqrt(jnp.sum(line**2, axis=0))
    constant = jnp.stack(lanes.lines[0].wrench(state).force)
    contact = jnp.stack(tibia.turn(tuple(jnp.sum(contact_force, axis=1).T)))
    return pull.sum(axis=1) + constant + contact


def test_forces_on_the_tibia_sum_to_zero(knee, motion):
    mechanics = kj.evaluate(knee, motion.pose, motion.equilibrium.contact_points)
    found = force_on_the_tibia(
        knee, motion.pose, motion.equilibrium.state, mechanics.tension, mechanics.contact_force
    )
    assert np.abs(np.asarray(found)).max() < 1e-4


@pytest.fixture(scope="module")
def poses_of(knee, motion):
    selection = select(knee, ("*.stiffness", "*.reference_strain"))
    values, load_cases = np.asarray(selection.read(knee)), LoadCases.at(FLEXION)
    known = balance_with_slopes(knee, selection.apply, values[None], load_cases)

    def run(x):
        return balance_with_slopes(knee, selection.apply, x[None], load_cases, known)

    return values, run


def test_jacobian_equals_central_differences(poses_of):
    values, run = poses_of
    exact = np.moveaxis(run(values).jacobian[0], 0, 1)
    steps = np.r_[np.full(4, 0.5), np.full(4, 1e-6)]
    for i, step in enumerate(steps):
        change = np.zeros(8)
        change[i] = step
        # Fourth order, so that the difference itself is good to more than 1e-6.
        near = (run(values + change).q - run(values - change).q)[0].T
        far = (run(values + 2 * change).q - run(values - 2 * change).q)[0].T
        difference = (8 * near - far) / (12 * step)
        scale = np.abs(exact[:, :, i]).max()
        assert np.abs(exact[:, :, i] - difference).max() < 1e-6 * scale


@partial(jax.jit, compiler_options=dict(compiler_options()))
def four_lanes(factor, lanes, flexion, guess):
    """Equilibrium poses with stiffnesses times a factor a lane, and their slope by all factors."""

    def poses(factor):
        stiffness = lanes.ligaments.stiffness * factor
        scaled = eqx.tree_at(lambda k: k.ligaments.stiffness, lanes, stiffness)
        found = solve_equilibrium(scaled, {"flexion": flexion}, guess)
        return found.q, found

    q, slope, found = jax.jvp(poses, (factor,), (jnp.ones_like(factor),), has_aux=True)
    return found, slope


@pytest.mark.long
def test_one_bad_lane_is_nan_alone(knee, motion):
    """A lane without a balance is NaN in value and derivative; its neighbours do not notice."""
    here, flexion = motion.equilibrium, jnp.deg2rad(jnp.array([20.0, 25.0, 30.0, 35.0]))
    guess = Guess(here.q[:, 4:8], here.contact_points[:, :, 4:8])
    factor = jnp.array([1.0, jnp.nan, 1.0, 1.0])
    found, slope = four_lanes(factor, add_lane_axis(knee), flexion, guess)
    assert found.status.tolist() == [0, Status.NOT_CONVERGED, 0, 0]
    assert np.isnan(found.q[:, 1]).all() and np.isnan(slope[:, 1]).all()
    assert np.allclose(found.q[:, [0, 2, 3]], here.q[:, [4, 6, 7]], atol=1e-9)
    assert np.isfinite(slope[:, [0, 2, 3]]).all()


@pytest.mark.long
@pytest.mark.parametrize("off_mm", [1e-8, 3e-5, 3e-3, 0.3])
def test_a_balance_is_as_exact_however_near_the_search_began(knee, motion, off_mm):
    """Its last step, and the tangent from which it is taken, which derivatives are made of."""
    there, lanes = motion.equilibrium, np.array([6, 12])
    off = off_mm * jnp.array([1 / 30, 1 / 30, 1.0, 0.0, 1.0])[:, None]
    guess = Guess(there.q[:, lanes] + off, there.contact_points[..., lanes])
    prescribed = {"flexion": there.prescribed["flexion"][lanes]}
    lanes_of = add_lane_axis(knee)
    far = Guess(there.q[:, lanes] + 0.01, there.contact_points[..., lanes])
    found, exact = (solve_equilibrium(lanes_of, prescribed, x) for x in (guess, far))
    assert (found.steps <= 8).all()
    assert jnp.abs(found.q - exact.q).max() < 1e-10
    # A short step alone does not end it, where contacts meet elsewhere.
    coarse = solve_equilibrium(lanes_of, prescribed, guess, EnergyNewton(atol=1e-7))
    assert jnp.abs(coarse.q - exact.q).max() < 1e-10
    np.testing.assert_allclose(found.tangent, exact.tangent, rtol=1e-6, atol=1e-3)


def test_options_are_not_ignored():
    with pytest.raises(ValueError, match="unknown options"):
        EnergyNewton().init(None, None, None, {"lower": 0}, None, None, frozenset())


def test_elimination_solves_and_its_pivots_tell_definiteness():
    rng = np.random.default_rng(0)
    a = rng.standard_normal((5, 5, 7))
    a = np.einsum("ikn,jkn->ijn", a, a) + 0.1 * np.eye(5)[:, :, None]
    b = rng.standard_normal((5, 7))
    x, pivots = solve(jnp.asarray(a), jnp.asarray(b))
    assert np.allclose(np.einsum("ijn,jn->in", a, x), b)
    assert (np.asarray(pivots) > 0).all()
    _, pivots = solve(jnp.asarray(-a), jnp.asarray(b))
    assert (np.asarray(pivots) < 0).any()


@pytest.mark.long
def test_a_lane_whose_contact_points_are_lost_finds_them_again(knee, motion):
    """Guesses off where the surfaces meet, or none at all, of the contact points or of the pose."""
    lanes, here = add_lane_axis(knee), motion.equilibrium
    astray = here.contact_points[..., 3:4] + jnp.array([0.0, 0.5, jnp.nan, jnp.nan])
    q = here.q[:, 3:4] + jnp.array([0.0, 0.0, 0.0, jnp.nan])
    flexion = jnp.deg2rad(jnp.full(4, 20.0))
    found, _ = four_lanes(jnp.ones(4), lanes, flexion, Guess(q, astray))
    assert found.status.tolist() == [0, 0, 0, 0]
    assert np.allclose(found.q, here.q[:, 4:5], atol=1e-9)


@pytest.mark.long
def test_a_compartment_that_is_apart_is_apart_as_far_as_it_is(knee):
    """It pulls at nothing: a pose balances however wrong its contact point is."""
    lower = eqx.tree_at(
        lambda k: k.contacts[1].tibial.frame.origin, knee, replace_fn=lambda x: x.at[1].add(-1.8)
    )
    here = kj.passive_flexion(lower, [20.0]).equilibrium
    apart = np.asarray(here.depth)[1, 0]
    assert -0.6 < apart < -0.2
    contact_points = here.contact_points + jnp.zeros((2, 2, 4)).at[1].set(
        jnp.array([0.0, 0.05, 0.1, 0.2])
    )
    guess = Guess(jnp.tile(here.q, 4), contact_points)
    flexion = jnp.tile(here.prescribed["flexion"], 4)
    found, _ = four_lanes(jnp.ones(4), add_lane_axis(lower), flexion, guess)
    assert found.status.tolist() == [0, 0, 0, 0]
    assert np.allclose(found.depth[1], apart, atol=1e-7)


def test_a_lax_knee_is_found_in_extension(knee):
    """Its surfaces are flat against each other there, and contact points are far to seek."""
    for strain in (0.02, 0.015, 0.0):
        lax = knee.replace({"MCL.reference_strain": strain})
        motion = kj.passive_flexion(lax, FLEXION / 10)
        assert np.asarray(motion.stable).all()


@pytest.mark.parametrize(
    ("strain", "most_deg"),
    [(0.01, 120.0), (0.0125, 120.0), (0.015, 120.0), (0.0175, 120.0), (0.015, 12.0), (0.02, 12.0)],
)
def test_a_motion_does_not_jump_to_another_balance(knee, strain, most_deg):
    """With a lax MCL the extended knee also balances 20 degrees of internal rotation away, and
    searches on the way there end so: by 4 to 9 mm where strides are not held short."""
    lax, flexion = knee.replace({"MCL.reference_strain": strain}), FLEXION / 120 * most_deg
    motion = kj.passive_flexion(lax, flexion)
    balanced = np.asarray(motion.equilibrium.converged)
    assert balanced.sum() > 8
    q = (
        np.asarray(motion.equilibrium.q)[:, balanced]
        * np.array([30.0, 30.0, 1.0, 1.0, 1.0])[:, None]
    )
    bend = np.diff(flexion[balanced])
    assert (np.abs(np.diff(q, axis=1)).max(axis=0) <= np.maximum(1.0, bend)).all()


def test_a_search_that_ends_on_another_branch_is_not_believed(knee):
    """One of 600 random knees; if strides are not held short it jumps by 8.2 mm at 110 degrees."""
    selection = select(knee, ("*.stiffness", "*.reference_strain"))
    values = np.array([7714.09, 4438.9077, 1379.1424, 8284.0577, -0.143, -0.2727, -0.0281, 0.0463])
    motion = kj.passive_flexion(selection.apply(knee, values), FLEXION)
    balanced = np.asarray(motion.equilibrium.converged)
    assert 8 < balanced.sum() < len(FLEXION)
    q = (
        np.asarray(motion.equilibrium.q)[:, balanced]
        * np.array([30.0, 30.0, 1.0, 1.0, 1.0])[:, None]
    )
    assert (np.abs(np.diff(q, axis=1)).max(axis=0) <= np.diff(FLEXION[balanced])).all()


@pytest.mark.long
def test_a_motion_works_inside_another_jit(knee, motion):
    """A person's own jit around a motion gives the same numbers."""

    @jax.jit
    def rotation_at_30(factor):
        stiffer = eqx.tree_at(lambda k: k.ligaments.stiffness, knee, factor * stiffness)
        return kj.passive_flexion(stiffer, jnp.array([30.0])).pose.internal_rotation[0]

    stiffness = knee.ligaments.stiffness
    lowered = rotation_at_30.lower(1.0).compile(compiler_options())
    assert float(lowered(1.0)) == pytest.approx(float(motion.pose.internal_rotation[6]), abs=1e-9)
