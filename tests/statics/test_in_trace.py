"""A motion inside somebody's `jax.jit` is the motion outside of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.mechanics import load_of
from kneejax.numerics import compiler_options
from kneejax.parameters import select

FLEXION = np.arange(-5.0, 121.0, 12.5)


@pytest.fixture(scope="module")
def traced(knee):
    """Poses and statuses of a knee by its stiffnesses and strains, under a drawer."""
    selection = select(knee, ("*.stiffness", "*.reference_strain"))

    def motion(values, force):
        found = kj.passive_flexion(
            selection.apply(knee, values), FLEXION, [load_of(anterior_N=force)]
        )
        return found.to_table(), found.status

    return selection, jax.jit(motion, compiler_options=dict(compiler_options()))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_random_knees_move_alike(knee, traced, seed):
    """Lost poses included: those of knees too lax or too tight to balance everywhere."""
    selection, motion = traced
    rng = np.random.default_rng(seed)
    values = np.asarray(selection.read(knee))
    values = values * np.r_[rng.uniform(0.3, 1.5, 4), np.ones(4)]
    values += np.r_[np.zeros(4), rng.uniform(-0.06, 0.04, 4)]
    force = float(rng.uniform(-60.0, 60.0))
    table, status = map(np.asarray, motion(jnp.asarray(values), force))
    walked = kj.passive_flexion(
        selection.apply(knee, jnp.asarray(values)), FLEXION, [load_of(anterior_N=force)]
    )
    lost = np.isnan(np.asarray(walked.to_table())).any(axis=1)
    np.testing.assert_array_equal(np.isnan(table).any(axis=1), lost)
    np.testing.assert_allclose(table[~lost], np.asarray(walked.to_table())[~lost], atol=1e-6)
    np.testing.assert_array_equal(status[~lost], np.asarray(walked.status)[~lost])


@pytest.mark.long
def test_derivatives_inside_and_outside_are_one(knee, traced):
    selection, motion = traced
    values = selection.read(knee)

    def poses(x):
        return kj.passive_flexion(
            selection.apply(knee, x), FLEXION, [load_of(anterior_N=20.0)]
        ).to_table()

    inside = jax.jit(
        jax.jacfwd(lambda x: motion(x, 20.0)[0]), compiler_options=dict(compiler_options())
    )(values)
    outside = jax.jacfwd(poses)(values)
    scale = np.abs(outside).max(axis=(0, 1))
    # Balances of either are within 1e-7 mm; so are their derivatives, which are taken there.
    np.testing.assert_allclose(inside / scale, outside / scale, atol=1e-6)


@pytest.mark.long
def test_flexion_may_be_traced_too(knee):
    @jax.jit
    def rotation(flexion):
        return kj.passive_flexion(knee, flexion[None]).pose.internal_rotation[0]

    both = jax.jit(jax.value_and_grad(rotation))
    _, slope = both(33.0)
    step = 1e-2
    ends = [
        float(kj.passive_flexion(knee, [33.0 + k * step]).pose.internal_rotation[0])
        for k in (-2, -1, 1, 2)
    ]
    numeric = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
    assert float(slope) == pytest.approx(numeric, rel=1e-6)
    # No path has so many strides: that is no pose, rather than the one at its end.
    assert np.isnan(both(400.0)[0])
