"""What is added to a stiffness that is not positive definite: enough, and not much more."""

import jax.numpy as jnp
import numpy as np

from kneejax.statics._scaled import lift

SCALES = (1 / 30, 1 / 30, 1 / 30, 1.0, 1.0, 1.0)


def stiffness_of(eigenvalues, rng):
    """Stiffnesses in rad and mm that have given eigenvalues in N/mm, a lane each."""
    axes, _ = np.linalg.qr(rng.normal(size=(len(eigenvalues), 6, 6)))
    each = np.einsum("lij,lj,lkj->lik", axes, np.asarray(eigenvalues), axes)
    return jnp.asarray(np.moveaxis(each / np.outer(SCALES, SCALES), 0, -1))


def test_a_stiffness_that_holds_is_left_alone_in_any_lane():
    rng = np.random.default_rng(0)
    holds, gives = [0.01, 3.0, 40.0, 500.0, 2e3, 2e4], [-1.0, 3.0, 40.0, 500.0, 2e3, 2e4]
    added = lift(stiffness_of([holds, gives, holds], rng), SCALES)
    assert added[0] == added[2] == 0.0 < added[1]


def test_two_to_eight_times_what_is_missing_is_added_however_stiff_the_rest_is():
    rng = np.random.default_rng(1)
    missing = np.geomspace(0.3, 2e3, 40)
    rest = rng.uniform(1.0, 2e4, (40, 5))
    added = np.asarray(lift(stiffness_of(np.c_[-missing, rest], rng), SCALES))
    assert (added > 2.0 * missing * (1.0 - 1e-9)).all()
    assert (added < 8.0 * missing).all()


def test_a_stiffness_that_is_not_a_number_ends_the_search_for_more():
    rng = np.random.default_rng(2)
    lanes = stiffness_of([[-1.0, 1.0, 2.0, 3.0, 4.0, 5.0]] * 2, rng).at[..., 0].set(jnp.nan)
    assert 2.0 <= lift(lanes, SCALES)[1] < 8.0
