"""Levenberg-Marquardt with bounds in the original variables, as an optimistix solver.

Variables that sit on a bound and are pushed outwards are held; a step that would leave the box
stops the variables that leave it on their bound and is solved again for the others. A sigmoid
that maps the box to a line needs hundreds of steps when a bound is active; this needs none more.

The damping of a variable goes by the steepest slope that any look has shown (by that of the steps
taken in J. J. More, Lect. Notes Math. 630, 105, 1978). A fibre that is slack has next to no slope:
by that alone it would be sent as far as it can go, to where it tears or nothing balances, and each
step of the others would be refused until its own had become short.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array


class _State(eqx.Module):
    x: Array
    residual: Array
    jacobian: Array
    damping: Array
    steepest: Array
    reduction: Array
    upcoming: Array
    promise: Array
    seen: Array
    accepted: Array
    refused: Array


class BoundedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Nonlinear least squares within bounds.

    Attributes:
        lower: shape `(p,)`; equal to `upper` holds a variable.
        upper: shape `(p,)`.
        rtol: relative decrease of the objective below which the search ends.
        atol: step relative to the width of the bounds below which the search ends.
        first_damping: added to the normal matrix, relative to its diagonal.
        raise_by: factor on the damping after a refused step.
        lower_by: divisor of the damping after a step that kept half its promise.

    Example:
        >>> import jax.numpy as jnp, optimistix as optx
        >>> solver = BoundedLevenbergMarquardt(jnp.array([0.0, 0.0]), jnp.array([1.0, 5.0]))
        >>> fit = optx.least_squares(lambda x, _: x - jnp.array([2.0, 3.0]), solver, jnp.ones(2))
        >>> [round(float(x), 4) for x in fit.value]
        [1.0, 3.0]
    """

    lower: Array
    upper: Array
    rtol: float = 1e-10
    atol: float = 1e-9
    first_damping: float = 1.0
    raise_by: float = 4.0
    lower_by: float = 10.0
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> _State:
        if options:
            raise ValueError(f"unknown options {sorted(options)}: bounds are fields of the solver")
        count = f_struct.shape[0]
        return _State(
            x=y,
            residual=jnp.full(count, jnp.inf, float),
            jacobian=jnp.zeros((count, y.shape[0])),
            damping=jnp.asarray(self.first_damping, float),
            steepest=jnp.zeros(y.shape[0]),
            reduction=jnp.asarray(jnp.inf, float),
            upcoming=jnp.asarray(jnp.inf, float),
            promise=jnp.asarray(jnp.inf, float),
            seen=jnp.asarray(False),
            accepted=jnp.asarray(False),
            refused=jnp.asarray(0, int),
        )

    def step(self, fn, y, args, options, state, tags):
        residual, push, aux = jax.linearize(lambda x: fn(x, args), y, has_aux=True)
        jacobian = jax.vmap(push, out_axes=1)(jnp.eye(y.shape[0]))
        following, state = _update(self, y, jnp.asarray(residual), jnp.asarray(jacobian), state)
        return following, state, aux

    def judged(self, y: Array, residual: Array, jacobian: Array, state: _State) -> _State:
        """Accept or refuse a trial point and set the damping."""
        before, after = jnp.sum(state.residual**2), jnp.sum(residual**2)
        predicted = self._predicted(state, y)
        accept = jnp.isfinite(after) & ((after <= before) | ~state.seen)
        good = accept & (before - after > 0.5 * predicted)
        steep = jnp.sum((jacobian * self._width) ** 2, axis=0)
        change = jnp.where(good, 1.0 / self.lower_by, jnp.where(accept, 1.0, self.raise_by))
        return _State(
            x=jnp.where(accept, y, state.x),
            residual=jnp.where(accept, residual, state.residual),
            jacobian=jnp.where(accept, jacobian, state.jacobian),
            damping=jnp.maximum(state.damping * jnp.where(state.seen, change, 1.0), 1e-15),
            steepest=jnp.maximum(state.steepest, jnp.where(jnp.isfinite(steep), steep, 0.0)),
            reduction=jnp.where(
                state.seen & accept, (before - after) / (before + 1e-300), state.reduction
            ),
            upcoming=state.upcoming,
            promise=state.promise,
            seen=jnp.asarray(True),
            accepted=accept,
            refused=jnp.where(accept, 0, state.refused + 1),
        )

    def terminate(self, fn, y, args, options, state, tags):
        flat = state.accepted & (state.reduction < self.rtol)
        small = state.upcoming < self.atol
        negligible = state.promise <= self.rtol * jnp.sum(state.residual**2)
        # Rounding of the residual: every longer step has been refused.
        stuck = state.refused > 12
        return state.seen & (flat | small | negligible | stuck), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return state.x, aux, {"damping": state.damping}

    @property
    def _width(self) -> Array:
        return jnp.where(self.upper > self.lower, self.upper - self.lower, 1.0)

    def following(self, state: _State) -> tuple[Array, _State]:
        """The next trial point, and the state that knows how far it is and what it promises."""
        y = self._trial(state)
        upcoming = jnp.max(jnp.abs(y - state.x) / self._width)
        promise = self._predicted(state, y)
        return y, eqx.tree_at(lambda s: (s.upcoming, s.promise), state, (upcoming, promise))

    def _trial(self, state: _State) -> Array:
        """The damped step from the accepted point, stopped at the bounds it meets."""
        x, jacobian = state.x, state.jacobian * self._width
        gradient, normal = jacobian.T @ state.residual, jacobian.T @ jacobian
        diagonal = jnp.maximum(state.steepest, 1e-12 * jnp.max(state.steepest) + 1e-300)
        damped = normal + state.damping * jnp.diag(diagonal)
        low, high = (self.lower - x) / self._width, (self.upper - x) / self._width
        held = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0)) | (low >= high)
        step = jnp.zeros_like(x)

        def resolve(_, carry):
            held, step = carry
            free = ~held
            right = -(gradient + damped @ jnp.where(held, step, 0.0))
            matrix = jnp.where(free[:, None] & free[None], damped, jnp.eye(x.shape[0]))
            trial = jnp.where(free, jnp.linalg.solve(matrix, jnp.where(free, right, 0.0)), step)
            clipped = jnp.clip(trial, low, high)
            return held | (clipped != trial), clipped

        _, step = jax.lax.fori_loop(0, x.shape[0] + 1, resolve, (held, step))
        return jnp.clip(x + step * self._width, self.lower, self.upper)

    def _predicted(self, state: _State, y: Array) -> Array:
        model = state.residual + state.jacobian @ (y - state.x)
        return jnp.sum(state.residual**2) - jnp.sum(model**2)


@eqx.filter_jit
def _update(solver, y, residual, jacobian, state):
    return solver.following(solver.judged(y, residual, jacobian, state))
