"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy, the loads held during the step, so the search runs downhill
to a stable balance. Where the tangent is not positive definite, or a step was refused, a multiple
of the identity is added to it. Lanes decide alone: one bad lane slows the others but never
changes them.

The meeting points of the contacts are searched alongside: with each step they take one of their
own. Energies are compared only where they nearly are such points; a search that did not look twice
there took a lax knee (MCL strain 0.015) for lost at 13 of 25 angles below 12 degrees.

Where contacts have patches, a tangent is kept while steps still shrink by `_GOOD`, and computed
anew when a quarter of the lanes that come further ask for that: a look takes a fourth to an eighth
of its time. What a step has shown of a kept tangent is put into it (Broyden's first update, Math.
Comp. 19, 1965): through time 2.3 looks a step do where there were 3.2. Over points a tangent
costs two forces (0.29 and 0.14 ms a lane, 2 x 432 points): every look takes one along, and 4 looks
do where there were 9.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array, lax

from kneejax.geometry import Prescribed, free_of, scales
from kneejax.mechanics import Knee
from kneejax.statics._balance import Forces, linearised, rows_of_force
from kneejax.statics._scaled import lift, newton_step, scaled, scaled_tangent, size_of
from kneejax.statics._search_state import Guess, Phase, SearchState, Seen, Verdict, begun

_LONGEST_STEP = 3.0
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3
# Steps with a kept tangent shall shrink by this factor, or it is computed anew.
_GOOD = 0.2
# A step by a kept tangent may shrink by more than this, by luck: so much of it is left in any case.
# Without it a search to 1e-10 mm that began with a tangent wrong by a tenth ended 9e-9 mm off.
_LUCKY = 0.05
# How far meeting points may be off, mm, for a pose to be judged, and to be the answer. Where
# surfaces are nearly flat against each other energies change much along them: of 574 knees with a
# lax MCL, in extension, 67, 9, 3 and none were lost with 0.1, 0.01, 0.001 and 0.0003 mm, at the
# same number of looks. A miss of 3e-5 mm moved poses by as much; the last step, from better points,
# takes that out.
_JUDGED, _MET = 3e-4, 3e-5
# N/mm added to the tangent in vain: who is here will not find anything any more.
_HOPELESS = 1e8
# Relative change of the tangent per mm, at worst: surfaces touch within an onset width of 0.02 mm.
_BEND = 50.0


@partial(jax.jit, inline=True)
def look(guess: Guess, args: tuple[Knee, Prescribed]):
    """The function whose root is sought: the unbalanced force at a guess, with what it is made of.

    Jitted so that Python runs through the mechanics once however often the search is traced.

    Returns:
        Residual in rows; forces.
    """
    knee, prescribed = args
    return rows_of_force(knee, prescribed, guess.q, (guess.meeting[:, 0], guess.meeting[:, 1]))


def _tangents_are_dear(knee: Knee) -> bool:
    return knee.patch_count > 0


class EnergyNewton(optx.AbstractRootFinder):
    """Newton's method on the forces that never climbs in energy.

    Attributes:
        rtol: unused; the search ends by what is left of the error.
        atol: mm (rotations count at 30 mm). A lane is at rest when its next step, which is still
            taken, is expected to leave less than this.
        most_steps: looks before a lane that still searches is given up.
        waiting: part of the lanes that have not ended which must wait for the tangent at their
            solution before it is computed for them. Less than all where others can begin.
        seldom: whether tangents are to be as few as can be, as in steps through time, where the
            last one serves: a lane that rests by it ends without another, and a tangent computes
            the forces once more, so that looks without one keep nothing for it (64 lanes: 0.22 ms
            a step of 2.5 looks instead of 0.30; where every third look takes one, 5 % slower).
    """

    rtol: float = 0.0
    atol: float = 1e-9
    most_steps: int | Array = 80
    waiting: float = 1.0
    seldom: bool = False
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> SearchState:
        if options:
            raise ValueError(f"EnergyNewton: unknown options {sorted(options)}; it takes none")
        forces = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), aux_struct)
        knee, prescribed = args
        return begun(y, forces, scales(free_of(prescribed, knee.bodies)))

    def step(self, fn, y, args, options, state, tags):
        dear = _tangents_are_dear(args[0])

        def force_at(q: Array, meeting: Array):
            return fn(Guess(q, meeting, y.tangent), args)

        if self.seldom and dear:
            residual, forces = force_at(y.q, y.meeting)
            tangent_there = partial(_tangent_of, force_at, y)
        else:
            residual, forces, tangent_there = linearised(force_at, y.q, y.meeting)
        here = Seen(y, residual, forces)
        verdict = self._judged(here, state, dear)
        best = state.at(verdict.accept, here)
        best = _with_secant(state, best, verdict) if dear else best
        best = _with_tangent(best, verdict, tangent_there, dear)
        best = _steadied(best, verdict, _miss(forces))
        ahead = self._ahead(best, state, verdict)
        there = Guess(y.q, jnp.stack(forces.meeting, axis=1))
        return self._next(ahead, verdict.again, there), ahead, ahead.forces

    def _judged(self, here: Seen, state: SearchState, dear: bool) -> Verdict:
        """Whether each lane takes the pose it looked at, and whether it looks there again."""
        first, miss = state.count == 0, _miss(here.forces)
        lower = state.still | self._is_lower(here, state)
        # Off its meeting points a pose's energy says little: look again, as long as they come near.
        # Better ones only raise it: what is too high already needs no other look.
        again = lower & (miss > _JUDGED) & (miss < 0.5 * state.miss)
        astray = miss > jnp.maximum(_JUDGED, _miss(state.forces))
        accept = state.searches & (first | (lower & (state.still | ~astray) & ~again))
        again = state.searches & again & ~accept
        anew = self._wanted(state, accept) if dear else jnp.asarray(True)
        # With the tangent at the solution comes one step more for nothing.
        ends = state.rests & anew
        refused = state.searches & ~(accept | again)
        accept = accept | ends
        return Verdict(accept, again, refused, ends, anew, accept & state.still & ~anew)

    def _ahead(self, best: SearchState, before: SearchState, verdict: Verdict) -> SearchState:
        """The next step of each lane, and whether it is at rest or lost."""
        step = newton_step(
            best.guess.tangent, best.residual, jnp.maximum(best.shift, best.lift), best.scales
        )
        size, last = size_of(step), size_of(before.step)
        shrinks = jnp.where(last > 0, size / jnp.where(last > 0, last, 1.0), 1.0)
        short = jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0, size, 1.0))
        short = jnp.where(best.still, 0.0, short)
        moves = verdict.ends | (before.searches & ~verdict.again)
        step = tuple(
            jnp.where(moves, short * new, old) for new, old in zip(step, before.step, strict=True)
        )
        left = jnp.where(best.kept, jnp.maximum(shrinks, _LUCKY), _BEND * size) * size
        # A shift that is small against the stiffness does not hide how far the solution is.
        at_rest = verdict.accept & (best.lift == 0.0) & (best.shift < 1.0)
        at_rest &= (left < self.atol) & (size < _CLOSE) & (_miss(best.forces) < _MET)
        at_rest &= before.searches
        count = before.count + before.searches
        hopeless = (best.shift > _HOPELESS) | (count >= self.most_steps)
        phase = jnp.where(before.searches & hopeless, int(Phase.LOST), before.phase)
        # By a kept tangent the error was seen to shrink; by a new one it is only expected to be
        # small, which a damper that stops between here and the balance makes wrong.
        ends = best.kept & self.seldom
        rest = jnp.where(ends, int(Phase.FOUND), int(Phase.AT_REST))
        phase = jnp.where(at_rest, rest, phase)
        phase = jnp.where(verdict.ends, int(Phase.FOUND), phase)
        slow = verdict.accept & (last > 0) & (shrinks > _GOOD)
        asks = best.kept & ~verdict.in_vain & (before.asks | best.still | slow)
        return dataclasses.replace(best, step=step, phase=phase, count=count, asks=asks)

    def _wanted(self, state: SearchState, accept: Array) -> Array:
        """Whether enough lanes need a tangent. Those that were refused have no use for it and do
        not count: a lane that is stuck once starved the others."""
        asks = jnp.sum(state.asks & accept)
        many = (asks > 0) & (4 * asks >= jnp.sum(accept))
        waiting = jnp.sum(state.rests)
        return many | ((waiting > 0) & (waiting >= self.waiting * jnp.sum(~state.ended)))

    def _next(self, state: SearchState, again: Array, there: Guess) -> Guess:
        """Where to look next: a step ahead, or at the same pose from better meeting points."""
        guess, shift = state.guess, scaled(state.step, state.scales)
        a, b = (
            sum(rate * by for rate, by in zip(rates, shift, strict=True))
            for rates in zip(*state.forces.drift, strict=True)
        )
        (met_a, met_b), tangent = state.forces.meeting, guess.tangent
        moved = (
            jnp.where(again, there.q, guess.q + jnp.stack(shift)),
            jnp.where(again, there.meeting, jnp.stack([met_a + a, met_b + b], axis=1)),
            tangent,
        )
        # A lane whose numbers are not finite stands still: the solver would end the search of all.
        finite = [jnp.all(jnp.isfinite(x), axis=tuple(range(x.ndim - 1))) for x in moved]
        astray = ~functools.reduce(jnp.logical_and, finite)
        still = guess.q, guess.meeting, jnp.zeros_like(guess.tangent)
        q, meeting, tangent = (
            jnp.where(astray, old, new) for old, new in zip(still, moved, strict=True)
        )
        return Guess(q, meeting, tangent)

    def _is_lower(self, here: Seen, state: SearchState) -> Array:
        before, energy = state.forces, here.forces.energy
        work = jnp.sum(before.load * (here.guess.q - state.guess.q), axis=0)
        climb = energy - before.energy - work
        scale = jnp.abs(before.energy) + jnp.abs(energy) + 1.0
        residuals = here.residual, state.residual
        force, old_force = (size_of(scaled(x, state.scales)) for x in residuals)
        finite = jnp.isfinite(energy) & jnp.isfinite(force)
        # Close to the solution energy differences drown in rounding; the forces do not.
        calmer = force < 0.5 * old_force
        close = size_of(state.step) < _CLOSE
        return finite & ((climb <= _ROUNDING * scale) | (close & calmer))

    def terminate(self, fn, y, args, options, state, tags):
        return jnp.all(state.ended), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        nowhere = jnp.zeros_like(state.kept)
        return self._next(state, nowhere, state.guess), state, {}


def _with_secant(before: SearchState, best: SearchState, verdict: Verdict) -> SearchState:
    """With what the last step has shown of the tangent along it."""
    units = jnp.asarray(best.scales)[:, None]
    step = (best.guess.q - before.guess.q) / units
    length = jnp.sum(step * step, axis=0)
    tells = verdict.accept & (before.count > 0) & (length > 0.0)
    tangent = scaled_tangent(best.guess.tangent, best.scales)
    change = (jnp.stack(best.residual) - jnp.stack(before.residual)) * units
    missing = change - jnp.sum(tangent * step, axis=1)
    along = jnp.where(tells, step / jnp.where(tells, length, 1.0), 0.0) / units
    tangent = best.guess.tangent + (missing / units)[:, None] * along
    return dataclasses.replace(best, guess=dataclasses.replace(best.guess, tangent=tangent))


def _tangent_of(force_at, y: Guess) -> Array:
    return linearised(force_at, y.q, y.meeting)[2]()


def _with_tangent(
    best: SearchState, verdict: Verdict, tangent_there: Callable[[], Array], dear: bool
) -> SearchState:
    """With the tangent at the best point, where this look computes tangents."""

    def renewed() -> tuple[Array, Array]:
        tangent = jnp.where(verdict.accept, tangent_there(), best.guess.tangent)
        return tangent, lift(tangent, best.scales)

    tangent, raised = lax.cond(verdict.anew, renewed, lambda: (best.guess.tangent, best.lift))
    kept = jnp.where(verdict.accept, ~verdict.anew, best.kept & dear)
    guess = dataclasses.replace(best.guess, tangent=tangent)
    return dataclasses.replace(best, guess=guess, lift=raised, kept=kept)


def _steadied(best: SearchState, verdict: Verdict, miss: Array) -> SearchState:
    """What follows a step that was refused: another tangent, or a shorter step."""
    # A step by a kept tangent was refused: look once more at the best point, for a new one. Who
    # asks in vain goes on with what there is, in shorter steps.
    still = (verdict.refused & best.kept & ~best.still) | (best.still & verdict.again)
    # A first look far off the meeting points cannot be judged. Whoever comes with a tangent goes on
    # from there all the same, and is judged from the next pose on.
    off = (best.count == 0) & (miss > _JUDGED)
    led = jnp.any(best.guess.tangent != 0.0, axis=(0, 1))
    still = still | (off & ~led)
    energy = jnp.where(off & led, jnp.inf, best.forces.energy)
    best = dataclasses.replace(best, forces=dataclasses.replace(best.forces, energy=energy))
    shift = jnp.where(still | best.still | verdict.again, best.shift, 0.1 * best.shift)
    longer = verdict.in_vain | (verdict.refused & ~best.kept)
    shift = jnp.where(longer, jnp.maximum(8.0 * best.shift, 1.0), shift)
    shift = jnp.where(shift < 1e-3, 0.0, shift)
    miss = jnp.where(verdict.again, miss, jnp.inf)
    return dataclasses.replace(best, still=still, shift=shift, miss=miss)


def _miss(forces: Forces) -> Array:
    """How far off the meeting points of a lane are at most, mm, where contact is near."""
    return jnp.max(jnp.where(forces.depth < -1.0, 0.0, forces.miss), axis=0, initial=0.0)
