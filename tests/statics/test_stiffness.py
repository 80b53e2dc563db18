"""Steps by a stiffness: what is added where it is not positive definite, and what it tells."""

import jax.numpy as jnp
import numpy as np

from kneejax.statics._newton import damped_step, softness_of

SCALES = (1 / 30, 1 / 30, 1 / 30, 1.0, 1.0, 1.0)
UNITS = np.array([1 / 30, 1 / 30, 1.0, 1.0, 1.0])


def stiffness_of(eigenvalues, rng):
    """Stiffnesses in rad and mm that have given eigenvalues in N/mm, a lane each."""
    axes, _ = np.linalg.qr(rng.normal(size=(len(eigenvalues), 6, 6)))
    each = np.einsum("lij,lj,lkj->lik", axes, np.asarray(eigenvalues), axes)
    return jnp.asarray(np.moveaxis(each / np.outer(SCALES, SCALES), 0, -1))


def lift(tangent, damping=0.0):
    """What is added to a stiffness, N/mm."""
    lanes = tangent.shape[2:]
    nothing = jnp.zeros((6, *lanes))
    return np.asarray(damped_step(tangent, nothing, jnp.full(lanes, damping), SCALES)[1])


def test_a_step_is_newtons_with_so_much_of_the_identity_added():
    rng = np.random.default_rng(3)
    tangent = stiffness_of(rng.uniform(1.0, 1e3, (4, 6)), rng)
    force, damping = rng.normal(size=(6, 4)), np.array([0.0, 0.0, 2.0, 50.0])
    step, added = damped_step(tangent, jnp.asarray(force), jnp.asarray(damping), SCALES)
    np.testing.assert_array_equal(added, damping)
    units = np.asarray(SCALES)
    for k in range(4):
        matrix = np.asarray(tangent)[..., k] * np.outer(units, units) + damping[k] * np.eye(6)
        expected = -np.linalg.solve(matrix, units * force[:, k])
        np.testing.assert_allclose(step[:, k], expected, rtol=1e-9)


def test_a_stiffness_that_holds_is_left_alone_in_any_lane():
    rng = np.random.default_rng(0)
    holds, gives = [0.01, 3.0, 40.0, 500.0, 2e3, 2e4], [-1.0, 3.0, 40.0, 500.0, 2e3, 2e4]
    added = lift(stiffness_of([holds, gives, holds], rng))
    assert added[0] == added[2] == 0.0 < added[1]


def test_one_to_four_times_what_is_missing_is_added_however_stiff_the_rest_is():
    rng = np.random.default_rng(1)
    missing = np.geomspace(0.3, 2e3, 40)
    rest = rng.uniform(1.0, 2e4, (40, 5))
    added = lift(stiffness_of(np.c_[-missing, rest], rng))
    assert (added > missing * (1.0 - 1e-9)).all()
    assert (added < np.maximum(4.0 * missing, 0.6)).all()


def test_a_stiffness_that_is_not_a_number_ends_the_search_for_more():
    rng = np.random.default_rng(2)
    lanes = stiffness_of([[-1.0, 1.0, 2.0, 3.0, 4.0, 5.0]] * 2, rng).at[..., 0].set(jnp.nan)
    assert 1.0 <= lift(lanes)[1] < 4.0


def test_softness_is_near_the_least_eigenvalue_and_not_positive_beyond_it():
    rng = np.random.default_rng(0)
    axes, _ = np.linalg.qr(rng.normal(size=(100, 5, 5)))
    for least in (1e-3, -1e-3):
        values = np.array([least, 10.0, 50.0, 200.0, 1000.0])
        scaled = axes @ (values[:, None] * np.swapaxes(axes, 1, 2))
        tangent = np.moveaxis(scaled / UNITS[:, None] / UNITS, 0, -1)
        softness = np.asarray(softness_of(jnp.asarray(tangent), UNITS)[0])
        if least < 0:
            assert (softness < 0).all()
        else:
            assert (softness > least * 0.99).all() and np.median(softness) < 10 * least
