"""Levenberg-Marquardt with bounds in the original variables, as an optimistix solver.

Variables that sit on a bound and are pushed outwards are held; a step that would leave the box
stops the variables that leave it on their bound and is solved again for the others. A sigmoid
that maps the box to a line needs hundreds of steps when a bound is active; this needs none more.

The damping of a variable goes by the steepest slope that any look has shown (by that of the steps
taken in J. J. More, Lect. Notes Math. 630, 105, 1978). A fibre that is slack has next to no slope:
by that alone it would be sent as far as it can go, to where it tears or nothing balances, and each
step of the others would be refused until its own had become short.

At a limit point a pose loses its balance: one reading refuses every step alone, since its pose
jumps or is lost, while all others would take it. Its slope grows without bound there, and each step
along the limit leaves what is balanced. That reading is first led inwards, away from the limit, by
as far as the limit is, and where this promises too little a quarter of the refused way; all others
go as far as they want. Its slope on the way does not count for the damping: it would stop them too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array

#: A reading jumps if it changes by more than so many times what its slope at either end explains.
_JUMP = 2.0
#: Part of a refused move that a reading is led which alone refused a step.
_LED = 0.25
#: How firmly: its weight, in parts of that of all readings together.
_FIRMLY = 100.0
#: Part of what that promises that a step away from the limit must promise.
_INWARDS = 0.1


class _State(eqx.Module):
    x: Array
    residual: Array
    jacobian: Array
    damping: Array
    steepest: Array
    led: Array
    inwards: Array
    jumps: Array
    earlier: Array
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
            led=jnp.full(count, jnp.nan, float),
            inwards=jnp.zeros(count),
            jumps=jnp.zeros(count, bool),
            earlier=jnp.zeros((2, count)),
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
        alone, move = self._refuses_alone(y, residual, jacobian, state)
        alone &= ~accept & state.seen
        led, inwards = self._led(alone, move, state)
        steepness = jnp.linalg.norm(state.jacobian * self._width, axis=1)
        earlier = jnp.stack([state.residual, steepness])
        # What refuses alone for the first time is led, and the others go as far as before.
        raised = jnp.where(jnp.isnan(state.led).all() & alone.any(), 1.0, self.raise_by)
        jumps = state.jumps | alone
        counts = ~(jumps & accept)[:, None]
        steep = jnp.sum(jnp.where(counts, jacobian * self._width, 0.0) ** 2, axis=0)
        change = jnp.where(good, 1.0 / self.lower_by, jnp.where(accept, 1.0, raised))
        return _State(
            x=jnp.where(accept, y, state.x),
            residual=jnp.where(accept, residual, state.residual),
            jacobian=jnp.where(accept, jacobian, state.jacobian),
            damping=jnp.maximum(state.damping * jnp.where(state.seen, change, 1.0), 1e-15),
            steepest=jnp.maximum(state.steepest, jnp.where(jnp.isfinite(steep), steep, 0.0)),
            led=jnp.where(accept, jnp.nan, led),
            inwards=inwards,
            earlier=jnp.where(accept, earlier, state.earlier),
            jumps=jumps,
            reduction=jnp.where(
                state.seen & accept, (before - after) / (before + 1e-300), state.reduction
            ),
            upcoming=state.upcoming,
            promise=state.promise,
            seen=jnp.asarray(True),
            accepted=accept,
            refused=jnp.where(accept, 0, state.refused + 1),
        )

    def _refuses_alone(
        self, y: Array, residual: Array, jacobian: Array, state: _State
    ) -> tuple[Array, Array]:
        """Which reading jumps and refuses a trial that the others would take, and how far each was
        led. A fibre that becomes taut refuses too, but its slope there tells of it."""
        move, back = (slope @ (y - state.x) for slope in (state.jacobian, jacobian))
        lost = ~jnp.isfinite(residual)
        worse = jnp.where(lost, 0.0, residual**2 - state.residual**2)
        size = jnp.where(lost.any(), jnp.where(lost, jnp.abs(move), -1.0), worse)
        worst = jnp.arange(len(size)) == jnp.argmax(size)
        others = jnp.sum(jnp.where(worst, 0.0, worse))
        jumps = jnp.abs(residual - state.residual) > _JUMP * jnp.maximum(
            jnp.abs(move), jnp.abs(back)
        )
        return worst & jumps & (others <= 0.0) & (move != 0.0), move

    def _led(self, alone: Array, move: Array, state: _State) -> tuple[Array, Array]:
        """How far readings that refused alone are led next, and how far away from their limits."""
        residual, slope = state.earlier
        # A slope grows by one over the distance from the limit: two points tell how far that is.
        steeper = jnp.linalg.norm(state.jacobian * self._width, axis=1) / slope - 1.0
        limit = jnp.abs((state.residual - residual) / steeper)
        away = jnp.minimum(jnp.where(jnp.isfinite(limit), limit, 0.0), jnp.abs(state.residual))
        led = _LED * jnp.where(alone, move, state.led)
        return led, jnp.where(alone, -jnp.sign(move) * away, state.inwards)

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
        away = jnp.where(jnp.isnan(state.led), jnp.nan, state.inwards)
        trials = jax.vmap(lambda led: self._trial(state, led))(jnp.stack([away, state.led]))
        promise = jax.vmap(lambda y: self._predicted(state, y))(trials)
        least = self.rtol * jnp.sum(state.residual**2)
        inwards = promise[0] > _INWARDS * jnp.maximum(promise[1], least)
        y, promise = (jnp.where(inwards, *pair) for pair in (trials, promise))
        upcoming = jnp.max(jnp.abs(y - state.x) / self._width)
        return y, eqx.tree_at(lambda s: (s.upcoming, s.promise), state, (upcoming, promise))

    def _trial(self, state: _State, led: Array) -> Array:
        """The damped step from the accepted point, stopped at the bounds it meets."""
        x, jacobian = state.x, state.jacobian * self._width
        gradient, normal = jacobian.T @ state.residual, jacobian.T @ jacobian
        known = ~jnp.isnan(led)
        firm = _FIRMLY**2 * jnp.trace(normal) / jnp.sum(jacobian**2, axis=1)
        firm = jnp.where(known, firm, 0.0)
        gradient -= (jnp.where(known, firm * led + state.residual, 0.0)) @ jacobian
        normal += (jacobian.T * firm) @ jacobian
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
