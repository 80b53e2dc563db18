"""Derivatives of a function in both modes, against each other and against differences."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import AXES, Matrix, Placement, Vector
from kneejax.mechanics import Wrench

#: By hand: the compiler's own choice copies shared values and takes minutes.
OPTIONS = {"xla_disable_hlo_passes": "fusion"}
_WEIGHTS = np.random.default_rng(0).uniform(0.5, 1.0, size=200)


class Errors(NamedTuple):
    """Largest relative errors; NaN where a derivative is not finite.

    Attributes:
        forward: of the derivative against differences, relative to the largest of its row.
        reverse: of one direction of the reverse derivative against the forward one, relative to
            itself and to the largest derivative, if that is below 1.
    """

    forward: float
    reverse: float


def both_ways(function, step=1e-3):
    """Check the derivatives of a function of one array.

    Args:
        function: from `(n,)` to `(m,)`; differentiable.
        step: of the fourth-order central differences, as a part of each entry's size.

    Returns:
        A function `(x, size, smallest=1e-9, of_value=0.0) -> Errors`. `size` is what counts as a
        change of 1 of each entry. `smallest`, a number in units of the answers, and `of_value`, a
        part of each answer, are added to what errors are relative to.
    """

    @jax.jit(compiler_options=OPTIONS)
    def derivatives(x, size):
        # One batch holds the place, once for each direction, and its neighbours: the function is
        # compiled once for all of them, not once for values and once for derivatives.
        directions = jnp.eye(x.size)
        steps = jnp.array([0.0, 2.0, 1.0, -1.0, -2.0])[:, None, None] * step * directions
        here = jnp.zeros_like(steps)

        def scaled(u):
            return jax.vmap(jax.vmap(lambda v: function(x + size * v)))(u)

        value, push = jax.linearize(scaled, steps)
        exact = push(here.at[0].set(directions))[0]
        pull = jax.linear_transpose(push, here)
        weights = jnp.asarray(_WEIGHTS[: value.shape[-1]])
        (reverse,) = pull(jnp.zeros_like(value).at[0, 0].set(weights))
        difference = jnp.tensordot(jnp.array([-1.0, 8.0, -8.0, 1.0]) / (12.0 * step), value[1:], 1)
        return value[0, 0], exact.T, reverse[0, 0], difference.T

    def errors(x, size, smallest=1e-9, of_value=0.0):
        value, exact, reverse, numeric = (np.asarray(y) for y in derivatives(x, size))
        scale = np.abs(exact).max(axis=1) + of_value * np.abs(value) + smallest
        forward = np.abs(exact - numeric) / scale[:, None]
        expected = _WEIGHTS[: value.size] @ exact
        unit = np.abs(expected) + np.minimum(np.abs(exact).max() + smallest, 1.0)
        return Errors(forward.max(), (np.abs(reverse - expected) / unit).max())

    return errors


def wrench_of(energy, there):
    """Wrench on a body that an energy exerts, about the body's origin, in the other's axes.

    Args:
        energy: of where the body is against another, N mm, one number a pose.
        there: where it is.
    """
    shape = jax.eval_shape(energy, there).shape
    columns = (AXES if there.rotation is None else there.rotation).T

    def displaced(twist):
        shift, turn = Vector.of(twist[:3]), Vector.of(twist[3:])
        turned = Matrix(*(column + turn.cross(column) for column in columns)).T
        return jnp.sum(energy(Placement(turned, there.translation + shift)))

    slope = -jax.grad(displaced)(jnp.zeros((6, *shape)))
    return Wrench(Vector.of(slope[:3]), Vector.of(slope[3:]))
