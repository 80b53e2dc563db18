"""Equilibria along paths of load cases: natural-parameter continuation, many paths side by side.

From its last equilibrium a path steps towards its next load case. Where the step leads is predicted
by a parabola through the last three equilibria; where nothing is found, or something farther away
than one branch leads, the step is halved, and after an easy one it is doubled. What is not found
then has no equilibrium that is connected with the last: it lies beyond a limit point.

Every turn of the one compiled loop is a look of all lanes, each at its own step of its own path.
"""

import dataclasses
import itertools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.geometry import TIBIA, Prescribed, coordinate, scales
from kneejax.mechanics import Knee
from kneejax.statics._equilibria import shapes_of_record
from kneejax.statics._equilibrium import fault_of, forces_of
from kneejax.statics._load_cases import Case
from kneejax.statics._newton import (
    EnergyNewton,
    Guess,
    SearchState,
    look,
    size_of,
    softness_of,
)
from kneejax.statics._status import Status, converged

#: Last step of a search, mm (rotations at 30 mm).
_ACCURACY_MM = 1e-9
#: Looks of a search that is predicted, of one for a part of the way, and of one that failed or is
#: not predicted.
_QUICK, _PART, _PATIENT = 15, 25, 80
#: A step that took more looks than this is not followed by a longer one.
_EASY = 8
#: Least part of the way to a load case that is tried: where the knee bends, where its numbers
#: change, and where loads do.
_FINEST_BENT, _FINEST_CHANGED, _FINEST = 2.0**-3, 2.0**-6, 2.0**-14
#: How far an equilibrium may lie from where it was expected, mm (rotations at 30 mm): a branch is
#: smooth, and shorter steps come as near as one likes; another branch stays away.
_MISSED_MM = 1.0
#: How far a tibia may move in one step, mm (rotations at 30 mm): for each degree of flexion, but as
#: far at least; under changing loads, where longer steps pass over limit points. A patella: twice.
_PER_DEGREE_MM, _BENT_MM, _LOADED_MM, _PATELLA = 0.75, 0.75, 1.0, 2.0
#: Unit vectors that differ by less have one direction.
_STRAIGHT = 1e-6
#: Turns of the loop in which load cases may end, for each that lies ahead.
_ENDS = 2


class Behind(eqx.Module):
    """What lies behind paths, and how they go on: a call that stops on the way to a load case, as
    one does where other paths fill it, changes nothing. Arrays end in lanes."""

    cases: Any  # in rows, of the last three equilibria, the latest first, `(3, numbers, lanes)`
    q: Any  # free coordinates there, `(3, free, lanes)`, rad and mm
    contact_points: Any  # their parameters, `(3, n, 2, lanes)`; NaN where they are not known
    known: Any  # how many of them are equilibria; without any, the latest is a guess
    failed: Any  # load cases without an equilibrium in a row, or as many as end a path
    progress: Any  # part of the way to the next load case at which the latest is
    softness: Any  # see `softness_of`, there
    step: Any  # part of the way that is left to the next load case which is tried
    cautious: Any  # whether nothing is extrapolated, since a search failed
    again: Any  # whether the next search is the last one once more, with patience
    looks: Any  # that the next load case took so far

    @classmethod
    def at(cls, cases, q, points, known) -> "Behind":
        """One equilibrium each, or a guess: the attributes without their first axis."""
        numpy = np if isinstance(q, np.ndarray) else jnp
        cases, q, points = (numpy.repeat(x[None], 3, axis=0) for x in (cases, q, points))
        nothing = numpy.zeros(numpy.shape(known))
        none, no = nothing.astype(int), nothing.astype(bool)
        soft = nothing + numpy.inf
        return cls(cases, q, points, known, none, nothing, soft, nothing + 1.0, no, no, none)


def follow(
    knee: Knee, like: Case, cases: Array, length: Array, behind: Behind, give_up: Array,
    fewest: Array,
) -> tuple[Array, Behind]:  # fmt: skip
    """Follow paths some load cases further; arguments as in `Continuation`.

    Args:
        behind: what lies behind.
        fewest: paths that must go on, or all stop.

    Returns:
        Records, `(turns, numbers, lanes)`, see `shapes_of_record`; and what lies behind then.
    """
    turns = _ENDS * cases.shape[0]
    end = Continuation(knee, like, cases, length, give_up).run(behind, turns, fewest)
    return end.record, end.behind


class _Paths(eqx.Module):
    """Paths on their way."""

    behind: Behind
    place: Array  # of the next load case
    active: Array  # whether there is one
    ended: Array  # whether what was sought is to be judged
    patient: Array  # whether a search may take long
    at_first: Array  # whether there was an equilibrium at the very first load case
    here: Array  # case that is tried, in rows
    # Free coordinates there by the last one, two, three equilibria that lie on a straight path,
    # `(3, free, lanes)`, rad and mm; and how many of them do.
    expected: Array
    straight: Array
    y: Array  # where its search looks next
    state: SearchState
    turns: Array  # in which load cases ended
    record: Array  # see `shapes_of_record`: of every turn, or of each path's last load case


class _Judged(NamedTuple):
    """What searches that ended have found."""

    good: Array  # an equilibrium on the path's branch
    again: Array  # it is searched once more with patience
    shorter: Array  # the step is halved
    failed: Array  # the load case is given up
    status: Array
    fault: Array
    softness: Array


class Continuation(NamedTuple):
    """The rules of continuation, for one knee and what lies ahead."""

    knee: Knee  # gives all numbers that do not vary
    like: Case  # any case; so rows are read
    cases: Array  # that lie ahead, in rows, `(places, lanes, numbers)`
    length: Array  # how many of them count, `(lanes,)`
    give_up: Array  # load cases without an equilibrium in a row after which a path ends

    def run(self, behind: Behind, turns: int | None, fewest: Any = 0) -> _Paths:
        """Follow all paths, to their ends or until as many turns are recorded; without turns, each
        path's last load case is."""
        begun = self._begun(behind)
        nothing = begun.record
        if turns is not None:
            every = jnp.broadcast_to(nothing, (turns, *nothing.shape))
            begun = dataclasses.replace(begun, record=every)

        def unfinished(paths: _Paths) -> Array:
            going = jnp.sum(paths.active)
            on = (going > 0) & (going >= fewest)
            return on if turns is None else on & (paths.turns < turns)

        def a_turn(paths: _Paths) -> _Paths:
            every = paths.record
            paths = dataclasses.replace(paths, record=nothing if turns is not None else every)
            looked = self._looked(paths)
            after = lax.cond(jnp.any(looked.ended), self._advanced, lambda x: x, looked)
            if turns is not None:
                # Written outside of the branch, which would copy every turn.
                log = lax.dynamic_update_index_in_dim(every, after.record, paths.turns, 0)
                after = dataclasses.replace(after, record=log)
            return after

        return lax.while_loop(unfinished, a_turn, begun)

    @property
    def _flexion(self) -> np.ndarray:
        """Which row is flexion, where that is prescribed."""
        return self.like.rows_of(self.like.load_cases.prescribed.get("flexion"))

    @property
    def _points(self) -> np.ndarray:
        """Which rows say where a load acts."""
        return self.like.rows_of([load.places for load in self.like.load_cases.loads])

    def _args(self, here: Array) -> tuple[Knee, Prescribed]:
        case = self.like.of(here)
        return case.knees(self.knee), case.load_cases.prescribed

    def _begun(self, behind: Behind) -> _Paths:
        """On the way to the first load case."""
        lanes = behind.known.shape
        yes, no, none = jnp.ones(lanes, bool), jnp.zeros(lanes, bool), jnp.zeros(lanes, int)
        y, here = behind.q[0], behind.cases[0]
        args = *self._args(here), behind.contact_points[0]
        _, shapes = jax.eval_shape(look, y, args)
        state = EnergyNewton().init(look, y, args, {}, None, shapes, frozenset())
        record = shapes_of_record(self.like.load_cases, self.knee.patch_count)
        size = sum(int(np.prod(shape)) for shape in record.values())
        nothing = jnp.full((size, *lanes), -1.0)
        begun = _Paths(
            behind=behind, place=none, active=(self.length > 0) & (behind.failed < self.give_up),
            ended=yes, patient=no, at_first=no, here=here, expected=behind.q, straight=none,
            y=y, state=state, turns=jnp.asarray(0), record=nothing,
        )  # fmt: skip
        return self._sent(begun, self._goal(none))

    def _goal(self, place: Array) -> Array:
        """The load cases that lie ahead, in rows."""
        places, lanes, _ = self.cases.shape
        return self.cases[jnp.minimum(place, places - 1), jnp.arange(lanes)].T

    def _looked(self, paths: _Paths) -> _Paths:
        """A look of all lanes, each where its search goes on."""
        part = paths.behind.step * (1.0 - paths.behind.progress) < 1.0
        few = jnp.where(part, _PART, _QUICK)
        search = EnergyNewton(atol=_ACCURACY_MM, most_steps=jnp.where(paths.patient, _PATIENT, few))
        before = paths.state
        args = *self._args(paths.here), before.best.contact_points
        y, state, _ = search.step(look, paths.y, args, {}, before, frozenset())
        ended = paths.active & ~state.searches
        return dataclasses.replace(paths, y=y, state=state, ended=ended)

    def _advanced(self, paths: _Paths) -> _Paths:
        """Judge what was found, write it down, and send the paths on."""
        judged, points = self._judged(paths), paths.state.best.contact_points
        behind, good = paths.behind, judged.good
        arrived = good & (behind.step >= 1.0)
        over = arrived | judged.failed
        looks = behind.looks + jnp.where(paths.ended, paths.state.count, 0)
        entry = dict(
            place=paths.place, status=judged.status, fault=judged.fault, steps=looks,
            way=jnp.where(arrived, 1.0, behind.progress), softness=judged.softness,
            q=paths.y, contact_points=points, **forces_of(paths.state.there),
        )  # fmt: skip
        rows = [jnp.reshape(x, (-1, x.shape[-1])).astype(float) for x in entry.values()]
        record = jnp.where(over, jnp.concatenate(rows), paths.record)
        done = behind.step * (1.0 - behind.progress)
        progress = behind.progress + jnp.where(good, done, 0.0)
        easy = jnp.where(paths.state.count <= _EASY, 2.0, 1.0)
        left = jnp.where(over, 1.0, 1.0 - progress)
        step = jnp.where(good, jnp.minimum(1.0, easy * done / left), behind.step)
        step = jnp.where(judged.shorter, 0.5 * step, jnp.where(judged.failed, 1.0, step))
        place = paths.place + over
        behind = Behind(
            cases=_pushed(behind.cases, paths.here, good),
            q=_pushed(behind.q, paths.y, good),
            contact_points=_pushed(behind.contact_points, points, good),
            known=jnp.minimum(behind.known + good, 3),
            failed=jnp.where(arrived, 0, behind.failed + judged.failed),
            progress=jnp.where(over, 0.0, progress),
            softness=jnp.where(good, judged.softness, behind.softness),
            step=step,
            cautious=~good & (behind.cautious | paths.ended),
            again=jnp.where(paths.ended, judged.again, behind.again),
            looks=jnp.where(over, 0, looks),
        )
        goal = self._goal(place)
        # Loads are not laid on a knee that is not balanced without them.
        in_vain = judged.failed & self._loading(goal, behind.cases[0])
        failed = jnp.where(in_vain, self.give_up, behind.failed)
        paths = dataclasses.replace(
            paths,
            behind=dataclasses.replace(behind, failed=failed),
            place=place,
            active=paths.active & (place < self.length) & (failed < self.give_up),
            at_first=paths.at_first | (arrived & (paths.place == 0)),
            turns=paths.turns + jnp.any(over),
            record=record,
        )  # fmt: skip
        return self._sent(paths, goal)

    def _sent(self, paths: _Paths, goal: Array) -> _Paths:
        """Begin the next search of the lanes whose last one has ended."""
        behind = paths.behind
        last, begins = behind.cases[0], paths.ended & paths.active
        # A load that grows acts where it will act.
        whole = (behind.step >= 1.0) | self._points
        new = jnp.where(whole, goal, last + behind.step * _apart(goal, last))
        orders, distances = self._past(behind, new)
        expected = jnp.stack([_extrapolated(behind.q, distances, k) for k in orders])
        order = jnp.where(behind.cautious, jnp.minimum(orders[-1], 1), orders[-1])
        known = behind.q, behind.contact_points
        guess = Guess(*(_extrapolated(x, distances, order) for x in known))
        patient = (order < 2) | behind.again
        return dataclasses.replace(
            paths,
            here=jnp.where(begins, new, paths.here),
            expected=jnp.where(begins, expected, paths.expected),
            straight=jnp.where(begins, orders[-1], paths.straight),
            y=jnp.where(begins, guess.q, paths.y),
            state=paths.state.restarted(begins, guess),
            patient=jnp.where(begins, patient, paths.patient),
        )

    def _loading(self, here: Array, last: Array) -> Array:
        """Whether anything changes but flexion and the numbers of a knee."""
        others = ~(self._flexion | self.like.rows_of(self.like.numbers) | self._points)
        return jnp.any((here != last) & others, axis=0)

    def _past(self, behind: Behind, here: Array) -> tuple[list[Array], list[Array]]:
        """How many of the last one, two, three equilibria lie on a straight path to a case, and how
        far behind it each of them is."""
        cases = here, *behind.cases
        steps = [jnp.where(self._points, 0.0, _apart(a, b)) for a, b in itertools.pairwise(cases)]
        sizes = [jnp.linalg.norm(step, axis=0) for step in steps]
        ahead, last, before = (
            step / jnp.where(size > 0.0, size, 1.0) for step, size in zip(steps, sizes, strict=True)
        )
        one = jnp.minimum(behind.known, 1)
        turns, turned = (jnp.max(jnp.abs(x), axis=0) for x in (ahead - last, last - before))
        two = one + ((behind.known > 1) & (turns < _STRAIGHT))
        three = two + ((two > 1) & (behind.known > 2) & (turned < _STRAIGHT))
        return [one, two, three], list(itertools.accumulate(sizes))

    def _judged(self, paths: _Paths) -> _Judged:
        """Whether what was found is on its branch, and what to do where it is not."""
        behind, state, free = paths.behind, paths.state, self.like.load_cases.free
        units = scales(free)
        here, last = paths.here, behind.cases[0]
        softness, pivots = softness_of(state.there.tangent, units)
        fault = fault_of(*self._args(here), state, pivots)
        status = jnp.where(state.done, fault, int(Status.NOT_CONVERGED))
        loading, begun = self._loading(here, last), behind.known > 0
        turned = jnp.where(self._flexion, jnp.abs(_apart(here, last)), 0.0)
        bend = jnp.rad2deg(jnp.max(turned, axis=0))
        reach = jnp.where(bend > 0.0, jnp.maximum(_BENT_MM, _PER_DEGREE_MM * bend), jnp.inf)
        reach = jnp.where(loading, _LOADED_MM, reach)
        scale = jnp.asarray(units)[:, None]
        reaches = [1.0 if coordinate(name).body == TIBIA else _PATELLA for name in free]
        moved = (paths.y - behind.q[0]) / scale / jnp.asarray(reaches)[:, None]
        far = begun & (size_of(moved) > reach)
        # Round a corner a parabola leads astray, which a line, or the last equilibrium, does not.
        missed = jnp.min(jnp.max(jnp.abs(paths.y - paths.expected) / scale, axis=1), axis=0)
        far |= (paths.straight > 1) & (missed > _MISSED_MM)
        off_branch = converged(status) & (far | (loading & ~(softness > 0.0)))
        status = jnp.where(off_branch, int(Status.NOT_CONVERGED), status)
        ended = paths.ended & paths.active
        good = ended & converged(status)
        finest = jnp.where(bend > 0.0, _FINEST_BENT, _FINEST_CHANGED)
        finest = jnp.where(loading, _FINEST, finest)
        divides = begun & (0.5 * behind.step * (1.0 - behind.progress) >= finest)
        # An equilibrium far away is mostly the right one, which another search finds once more:
        # half of the way tells.
        again = ended & ~good & ~paths.patient & ~(loading & begun) & ~(off_branch & divides)
        shorter = ended & ~good & ~again & divides
        # What ends beside a limit point may be so soft that no equilibrium is told from it; where
        # the least part of a load leads elsewhere, nothing held this one.
        softer = jnp.where(~far & (softness < behind.softness), softness, behind.softness)
        softer = jnp.where(off_branch & loading, 0.0, softer)
        return _Judged(
            good, again, shorter, ended & ~(good | again | shorter), status, fault,
            jnp.where(good, softness, softer),
        )  # fmt: skip


def _apart(here: Array, last: Array) -> Array:
    """The difference of cases; infinite numbers that stay are no difference."""
    return jnp.where(here == last, 0.0, here - last)


def _pushed(rows: Array, latest: Array, good: Array) -> Array:
    """Rows with the latest one in front, in lanes that are good."""
    return jnp.where(good, jnp.concatenate([latest[None], rows[:-1]]), rows)


def _extrapolated(values: Array, distances: list[Array], order: Array) -> Array:
    """What lies ahead of the last three values: by a parabola (order 3), a line, or the last."""
    (last, before, first), (ahead, to_before, to_first) = values, distances

    def slope(later: Array, earlier: Array, gap: Array) -> Array:
        return (later - earlier) / jnp.where(gap != 0.0, gap, 1.0)

    line = slope(last, before, to_before - ahead)
    bend = slope(line, slope(before, first, to_first - to_before), to_first - ahead)
    bend = jnp.where(order > 2, bend * to_before, 0.0)
    return last + jnp.where(order > 1, (line + bend) * ahead, 0.0)
