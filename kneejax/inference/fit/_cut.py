"""Balances of a knee whose ligaments some tests had cut, and of one in motion."""

__all__ = ["balances_of", "distinct", "passed", "slack_at", "without"]

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics import (
    Given,
    Grid,
    LoadCurve,
    MovingKnee,
    followed,
    given_of,
    move_within,
    searched,
    with_idle_steps,
)
from kneejax.experiments import Frames, slack_poses
from kneejax.geometry import State, coordinates_of
from kneejax.inference.fit._observed import Balance, Observations
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.numerics import compiled, on_all_cores
from kneejax.parameters import Selection, UnsuitableData, fibre_rows, fibres_cut, without_menisci
from kneejax.statics import (
    Equilibrium,
    LoadCases,
    Own,
    Slopes,
    Status,
    Vary,
    balance_with_slopes,
    converged,
    in_lanes,
)


@dataclasses.dataclass(frozen=True)
class CutKnee:
    """Sets parameters, then cuts fibres; hashable, since it steers compiling."""

    selection: Selection  # the free parameters
    fibres: tuple[int, ...]  # rows of those that are cut

    def __call__(self, knee: Knee, values: Any) -> Knee:
        """The knee with these values of the free parameters, and without those fibres."""
        # A group's stiffness is shared out as that of the whole knee.
        knee = self.selection.apply(knee, values)
        torn = np.isin(np.arange(len(knee.ligaments.names)), self.fibres)
        left = jnp.where(torn, 0.0, knee.ligaments.stiffness)
        return eqx.tree_at(lambda k: k.ligaments.stiffness, knee, left)


def balances_of(
    knee: Knee, selection: Selection, cases: Observations, own: Own | None = None
) -> Balance:
    """Balances of a knee's variants at load cases, many at a time.

    Args:
        knee: gives everything that is not free.
        selection: the free parameters.
        cases: each with what is cut there.
        own: of several knees of one structure the numbers in which they differ
            (`balance_with_slopes`).

    Returns:
        A function of values `(variants, p)` and of balances at near ones; without these each
        variant is followed from the knee's reference pose.
    """
    if own and any(cases.cuts):
        raise ValueError("knees side by side have no ligament cut: one whole knee stands for all")
    every, moved = cases.load_cases.of(knee), [x for one in cases.passages for x in one.rows]
    parts: list[tuple[np.ndarray, Balance]] = []
    for number, names in enumerate(cases.cuts):
        base, vary = without(knee, selection, names)
        rows = np.setdiff1d(np.flatnonzero(cases.cut == number), moved)
        if len(rows):
            # A fit asks a hundred times: what is the same each time is made once.
            there = jax.tree.map(np.asarray, every.take(rows).plain())
            parts.append((rows, _balanced(base, vary, there, own)))
        for passage in cases.passages:
            if cases.cut[passage.rows[0]] == number:
                parts.append((passage.rows, functools.partial(passage.slopes, base, vary)))

    def balance(values: np.ndarray, near: Slopes | None = None) -> Slopes:
        if len(parts) == 1:
            return parts[0][1](values, near)
        found = [of_part(values, near and near.at(rows)) for rows, of_part in parts]
        return Slopes.joined(found, [rows for rows, _ in parts])

    return balance


def _balanced(knee: Knee, vary: Vary, there: LoadCases, own: Own | None) -> Balance:
    first, place = distinct(there)
    once = there.take(first)

    def balance(values: np.ndarray, near: Slopes | None) -> Slopes:
        return balance_with_slopes(knee, vary, values, once, near and near.at(first), own).at(place)

    return balance


def distinct(load_cases: LoadCases) -> tuple[np.ndarray, np.ndarray]:
    """Where each load case stands first, and which of these each one is: a load that grows and is
    taken away again, as in most tests, meets each balance twice."""
    columns = [np.reshape(x, (len(load_cases), -1)) for x in jax.tree.leaves(load_cases)]
    _, first, place = np.unique(np.hstack(columns), axis=0, return_index=True, return_inverse=True)
    return first, place.reshape(-1)


def without(knee: Knee, selection: Selection, names: tuple[str, ...]):
    """A knee in which the fibres of ligaments or groups cannot tear, and a function of it and of
    values that sets its free parameters and cuts them."""
    if not names:
        return knee, selection.apply
    fibres = tuple(fibres_cut(knee, names))
    torn = np.isin(np.arange(len(knee.ligaments.names)), fibres)
    strain = jnp.where(torn, jnp.inf, knee.ligaments.failure_strain)
    whole = eqx.tree_at(lambda k: k.ligaments.failure_strain, knee, strain)
    whole = without_menisci(whole, names)
    return whole, CutKnee(selection, fibres)


def state_of(knee: Knee, cases: Observations, found: Slopes) -> State:
    """Where the bones are in the balances of one variant, `(load_cases,)`."""
    return State.of(cases.load_cases.prescribed, jnp.asarray(found.q[0].T, float), knee.bodies)


def slack_at(
    knee: Knee, selection: Selection, cases: Observations, found: Slopes
) -> dict[str, np.ndarray]:
    """Ligament or group -> where it is slack or cut in the balances of one variant,
    `(load_cases,)`."""
    contact_points = jnp.asarray(np.moveaxis(found.contact_points[0], 0, -1), float)
    own = selection.apply(knee, found.values[0])
    slack = slack_poses(own, state_of(knee, cases, found), contact_points)
    for number, names in enumerate(cases.cuts):
        gone = {*fibres_cut(knee, names)}
        for name, where in slack.items():
            if gone.issuperset(fibre_rows(knee, name)):
                where[cases.cut == number] = True
    return slack


@dataclasses.dataclass(frozen=True, eq=False)
class Passage:
    """Load cases that a knee in motion passes."""

    frames: Frames  # when, and what moves
    rows: np.ndarray  # of the load cases, `(n,)`
    load_cases: LoadCases  # these
    grid: Grid  # steps of the motion
    # How far a motion that repeats itself is from where it was a period before, mm or degrees, at
    # worst in the last half of the rows; 0 of one that does not.
    restless: float

    @classmethod
    def of(cls, knee: Knee, vary: Vary, values, frames: Frames, rows, load_cases) -> "Passage":
        """With steps short enough at `values`, `(p,)`; raises where no motion begins, or it ends
        early."""
        at = np.asarray(values, float)[None]
        begin, (start,), _ = _started(knee, vary, at, frames, load_cases)
        if not begin.converged.all():
            status = Status(int(begin.status[0, 0]))
            raise UnsuitableData(f"no balance from which a motion could begin: {status.sentence}")
        moving = frames.moving(vary(knee, jnp.asarray(values))).critically_damped(frames.critical)
        moving = moving.damped_everywhere(frames.damping_N_s_per_mm)
        led = _led(knee, frames, load_cases)
        found = move_within(frames.most_mm, moving, start, frames.since_start_s, **led)
        if not converged(np.asarray(found.status)).all():
            raise UnsuitableData(
                f"with the parameters that choose its steps the motion ends after "
                f"{found.ended_s:.3g} of {frames.since_start_s[-1]:.3g} s: {found.ended.sentence}"
            )
        table, count = np.asarray(found.to_table())[:, 1:], len(rows)
        now, before = table[-count:], table[-2 * count : -count]
        periodic = frames.period_s is not None and frames.cycles_before
        restless = float(np.abs(now - before)[count // 2 :].max()) if periodic else 0.0
        return cls(frames, np.asarray(rows), load_cases, found.grid, restless)

    def slopes(
        self, knee: Knee, vary: Vary, values: np.ndarray, _: Slopes | None = None
    ) -> Slopes:
        """Poses of variants `(variants, p)` at the frames, with derivatives; each begins anew."""
        frames = self.frames
        begin, q, slope = _started(knee, vary, values, frames, self.load_cases)
        moving, varied = frames.moving(knee), _Varied(vary)
        dampers = jnp.array([frames.critical]), jnp.array([frames.damping_N_s_per_mm])
        asked = jnp.asarray(self.grid.asked[-len(self.rows) :])
        led = _led(knee, frames, self.load_cases)
        at_rest = given_of(moving, np.zeros(q.shape[1]), self.grid, **led)
        held = at_rest.steps.held
        free = [k for k, name in enumerate(coordinates_of(knee.bodies)) if name not in held]

        # One by one: a program of more lanes compiles for as long as a hundred motions take.
        def one(row: int) -> Slopes:
            own = slice(row, row + 1)
            given = dataclasses.replace(at_rest, q=jnp.asarray(q[own].T))
            equilibrium = searched(varied(moving, dampers, values[own]), given)
            given, equilibrium = with_idle_steps(given, equilibrium)
            return passed(
                varied, moving, dampers, given, equilibrium, asked, values[own], slope[own], free
            )

        parts = on_all_cores(one, range(len(values)))
        found = jax.tree.map(lambda *each: np.concatenate(each), *parts)
        status = np.where(converged(begin.status), found.status, begin.status)
        q = np.where(converged(status)[..., None], found.q, np.nan)
        return dataclasses.replace(found, q=q, status=status)


@dataclasses.dataclass(frozen=True)
class _Varied:
    """Makes damped variants of a knee; leaves end in lanes."""

    vary: Vary

    def __call__(self, moving: MovingKnee, dampers: tuple[Array, Array], values) -> MovingKnee:
        knee = in_lanes(moving.knee, self.vary, values)
        lanes = dataclasses.replace(add_lane_axis(moving), knee=knee)
        return lanes.critically_damped(dampers[0]).damped_everywhere(dampers[1])


def passed(
    lanes_of: Callable[..., MovingKnee], moving: MovingKnee, fixed: Any, given: Given,
    equilibrium: Equilibrium, asked: Array, values: np.ndarray, slope: ArrayLike,
    rows: Sequence[int],
) -> Slopes:  # fmt: skip
    """What variants of a moving knee pass, and its derivatives by the values; no stiffness.

    Args:
        lanes_of: `(moving, fixed, values) -> variants` whose leaves end in lanes; hashable.
        moving: gives all numbers that do not vary.
        fixed: arrays that `lanes_of` takes besides.
        given: start and steps of the motions.
        equilibrium: these motions, as they were searched.
        asked: steps that are asked for.
        values: `(variants, p)`.
        slope: of the starts by the values, `(variants, coordinates, p)`.
        rows: of the coordinates that are wanted.
    """
    found = _passed(lanes_of, moving, fixed, given, equilibrium, asked, values, slope)
    q, jacobian, contact_points, status = map(np.asarray, found)
    unknown = np.zeros((*status.shape, len(rows), len(rows)))
    return Slopes(values, q[..., rows], jacobian[..., rows, :], contact_points, unknown, status)


@compiled(static_argnums=(0,))
def _passed(lanes_of, moving, fixed, given: Given, equilibrium, asked, values, slope):
    def motion(x: Array):
        begin = given.q + jnp.einsum("vcp,vp->cv", slope, x - values)
        lanes = lanes_of(moving, fixed, x)
        found = followed(lanes, dataclasses.replace(given, q=begin), equilibrium)
        return found.known.q[asked], (found.contact_points[asked], found.status[asked])

    q, push, (contact_points, status) = jax.linearize(motion, values, has_aux=True)
    size = values.shape[1]
    units = jnp.broadcast_to(jnp.eye(size)[:, None], (size, *values.shape))
    turned = jax.vmap(push, out_axes=-1)(units)
    q, turned, contact_points = map(jnp.nan_to_num, (q, turned, contact_points))
    return (
        jnp.moveaxis(q, -1, 0), jnp.moveaxis(turned, -2, 0), jnp.moveaxis(contact_points, -1, 0),
        jnp.moveaxis(status, -1, 0),
    )  # fmt: skip


def _started(knee: Knee, vary: Vary, values: np.ndarray, frames: Frames, load_cases):
    """Balances from which variants begin to move, at one load case; all coordinates there,
    `(variants, 6 bodies)`, and by the values."""
    flexion, names = frames.led(np.zeros(1)), coordinates_of(knee.bodies)
    heavy = dataclasses.replace(knee, loads=frames.moving(knee).loads)
    first = LoadCases.at(np.rad2deg(flexion), jax.tree.map(lambda x: x[:1], load_cases.loads))
    begin = balance_with_slopes(heavy, vary, values, first)
    rows = [k for k, name in enumerate(names) if name != "flexion"]
    size = len(values), len(names)
    q, slope = np.zeros(size), np.zeros((*size, values.shape[1]))
    q[:, names.index("flexion")] = flexion[0]
    q[:, rows] = np.nan_to_num(begin.q[:, 0])
    slope[:, rows] = np.nan_to_num(begin.jacobian[:, 0])
    return begin, q, slope


def _led(knee: Knee, frames: Frames, load_cases: LoadCases) -> dict[str, Any]:
    """Loads besides the knee's own, and the flexion that is led, over the time since the start."""
    along = jax.tree.map(lambda x: jnp.asarray(frames.over_time(np.asarray(x))), load_cases.loads)
    flexes = [name == "flexion" for name in coordinates_of(knee.bodies)]
    return {
        "loads": LoadCurve(jnp.asarray(frames.since_start_s), along),
        "held": {"flexion": frames.led},
        "rate": np.where(flexes, frames.starts_with_rad_s, 0.0),
    }
