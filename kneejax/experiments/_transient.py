"""A knee through time: loaded, led or let go until it is at rest, and a leg that is raised."""

__all__ = ["MOST_ERROR_MM", "RaisedLeg", "Transient", "beginning", "raised_leg", "transient"]

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from kneejax.dynamics import Account, LoadCurve, MovingKnee, Trajectory, move_within, rising
from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._extensor import Extensor, at_rest, leg_raise
from kneejax.experiments._motion import Motion, apart_mm, passive_flexion
from kneejax.geometry import TIBIA, State, coordinate, coordinates_of, prescribed_of, table_units
from kneejax.mechanics import QUADRICEPS, load_of
from kneejax.numerics import Named, WrongValue
from kneejax.statics import Status, converged

#: mm, at any time: what is left of the error of a motion's steps.
MOST_ERROR_MM = 0.01


@dataclasses.dataclass(frozen=True)
class Transient(Named):
    """A motion through time with what holds it.

    Attributes:
        trajectory: poses and rates.
        mechanics: of ligaments and contacts at each time.
        damping_N: force of the dampers of each fibre, `(times, n)`.
        account: of energies, at each time.
        sizes: load -> its size at each time, in the unit of its name.
        rest: the balance under the loads of the end; None where flexion is free.
        from_rest_mm: how far the last pose is from that, mm (rotations at 30 mm); NaN without.
    """

    trajectory: Trajectory
    mechanics: Mechanics
    damping_N: np.ndarray
    account: Account
    sizes: Mapping[str, np.ndarray]
    rest: Motion | None
    from_rest_mm: float

    @property
    def time_s(self) -> np.ndarray:
        """At which all is told."""
        return np.asarray(self.trajectory.time_s)

    @property
    def quadriceps(self) -> Mapping[str, np.ndarray]:
        """Pull and length, by column, of a quadriceps that a motor gives its length."""
        motion = self.trajectory
        if QUADRICEPS not in motion.held:
            return {}
        pull = motion.pull_N + float(at_rest(motion.moving.knee))
        length = np.asarray(motion.held[QUADRICEPS])[motion.rows, 0]
        return {"quadriceps_N": pull, "quadriceps_mm": length}

    @property
    def overshoot(self) -> Mapping[str, float]:
        """Coordinate -> by how much it went beyond where it comes to rest, degrees or mm."""
        if self.rest is None:
            return {}
        names, last = coordinates_of((TIBIA,)), np.asarray(self.rest.to_table())[0]
        table = self.trajectory.to_table()[:, :6]
        sense = np.sign(last - table[0])
        return dict(zip(names, np.fmax.reduce((table - last) * sense), strict=True))

    def _named(self) -> dict[str, tuple]:
        motion, knee, per = self.trajectory, self.trajectory.moving.knee, "time_s ligament"
        pressed = np.linalg.norm(np.asarray(self.mechanics.contact_force), axis=-1)
        loads = {f"load_{name}": ("time_s", size) for name, size in self.sizes.items()}
        kinds = {"quadriceps_N": "quadriceps_force", "quadriceps_mm": "quadriceps_length"}
        for column, size in self.quadriceps.items():
            loads[kinds[column]] = "time_s", size, column.split("_")[1]
        for name in ("work", "kinetic", "potential", "dissipated", "missing"):
            energy = np.asarray(getattr(self.account, name))[motion.rows]
            loads[f"energy_{name}"] = "time_s", energy, "N mm"
        return motion._named() | loads | {
            "tension": (per, self.mechanics.tension, "N"), "damping": (per, self.damping_N, "N"),
            "contact_force": ("time_s contact", pressed, "N"),
            "ligament": ("ligament", knee.ligaments.names),
            "contact": ("contact", knee.contact_names),
        }  # fmt: skip

    def _about(self) -> dict[str, Any]:
        return {"knee": self.trajectory.moving.knee.name}


def transient(
    moving: MovingKnee, flexion_deg: float, time_s: ArrayLike, *, load_s: ArrayLike = (0.0,),
    sizes: Mapping[str, ArrayLike] | None = None,
    led: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    offset: Mapping[str, float] | None = None, flexion_is_free: bool = False,
    most_mm: float = MOST_ERROR_MM, progress: Callable[[int], None] | None = None,
) -> Transient:  # fmt: skip
    """Load, lead or let go a knee that is in balance.

    It begins at rest where it balances at a flexion under its own loads, its weight and the loads
    of the first moment.

    Args:
        moving: the knee, with mass and damping.
        flexion_deg: at which it begins.
        time_s: at which the motion is told; the first is the start.
        load_s: times at which the loads are known; straight lines between.
        sizes: load -> its size at these, in the unit of its name (`kneejax.mechanics.NAMED_LOADS`).
        led: column -> times and values, degrees or mm, of a coordinate that is led: smoothly, from
            where it is.
        offset: column -> by how much, degrees or mm, the knee is moved before it is let go.
        flexion_is_free: whether it may bend; it stays bent as it is otherwise.
        most_mm: that is left of the error of the steps.
        progress: is told how many steps are done, of each of several passes.

    Returns:
        The motion; where it could not go on, NaN with a status.

    Raises:
        ValueError: times that do not rise; a column that is no coordinate; a start without balance.

    Example:
        >>> from kneejax.experiments import leg_of_person
        >>> leg_of_person(75.0, 1.75).mass_kg.round(3).item()
        4.575
    """
    times, load_s, sizes = np.asarray(time_s, float), np.asarray(load_s, float), sizes or {}
    start, loads, held = beginning(
        moving, flexion_deg, times[0], load_s=load_s, sizes=sizes, led=led, offset=offset,
        flexion_is_free=flexion_is_free,
    )  # fmt: skip
    found = move_within(most_mm, moving, start, times, loads=loads, held=held, progress=progress)
    rest, far = None, float("nan")
    if not flexion_is_free and set(held) == {"flexion"}:
        names = coordinates_of(moving.knee.bodies)
        rest = _balance(moving, flexion_deg, sizes, load_s, times[-1])
        there = np.asarray(rest.equilibrium.state.at(names))[:, 0]
        far = float(apart_mm(names, np.asarray(found.q)[-1], there))
    return described(found, _at(times, load_s, sizes), rest, far)


def beginning(
    moving: MovingKnee, flexion_deg: float, start_s: float, *, load_s: ArrayLike = (0.0,),
    sizes: Mapping[str, ArrayLike] | None = None,
    led: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    offset: Mapping[str, float] | None = None, flexion_is_free: bool = False,
) -> tuple[np.ndarray, LoadCurve, dict[str, Callable]]:  # fmt: skip
    """Where a motion begins: in balance, or moved from there by an offset.

    Arguments as those of `transient`, with `start_s`, the time of the start.

    Returns:
        All coordinates, rad and mm; what acts from there on; and coordinate -> its way over time,
        of what is held. As `kj.move` takes them.

    Raises:
        ValueError: as `transient`.
    """
    times = np.asarray(load_s, float)
    sized = {name: np.asarray(size, float) for name, size in (sizes or {}).items()}
    curve = LoadCurve.of(times, load_of(**{k: jnp.asarray(v) for k, v in sized.items()}))
    balance = _balance(moving, flexion_deg, sized, times, start_s)
    if not bool(balance.equilibrium.converged[0]):
        found = f"{flexion_deg:g}: {Status(int(balance.status[0])).sentence}"
        raise WrongValue("flexion_deg", found, "a balance that the motion can begin from")
    names = coordinates_of(moving.knee.bodies)
    start = np.array(balance.equilibrium.state.at(names))[:, 0]
    for name, more in prescribed_of(offset or {}).items():
        start[names.index(name)] += float(more)
    held = {} if flexion_is_free else {"flexion": lambda t, x=start[0]: np.full_like(t, x)}
    for column, (at_s, values) in (led or {}).items():
        ((name, way),) = prescribed_of({column: values}).items()
        held[name] = smooth_way(at_s, np.asarray(way), start[names.index(name)])
    return start, curve, held


def described(
    found: Trajectory, sizes: Mapping[str, np.ndarray], rest: Motion | None = None,
    from_rest_mm: float = float("nan"),
) -> Transient:  # fmt: skip
    """A motion with its forces and energies, by what `Transient` says of them."""
    knee = found.moving.knee
    contact_points = jnp.nan_to_num(found.contact_points) if knee.patch_count else None
    mechanics = evaluate(knee, State.of({}, found.q.T, knee.bodies), contact_points)
    damping = np.asarray(found.flow().damping).T[found.rows]
    return Transient(found, mechanics, damping, found.account(), sizes, rest, from_rest_mm)


def smooth_way(time_s: ArrayLike, values: np.ndarray, start: float) -> Callable:
    """A function of rising times through given values, rad or mm, without overshoot, moved to where
    a coordinate is at the start."""
    from scipy.interpolate import PchipInterpolator

    times = rising(time_s)
    through = PchipInterpolator(times, values - values[0] + start)
    return lambda t: through(np.clip(t, times[0], times[-1]))


def _balance(moving: MovingKnee, flexion_deg: float, sizes, load_s, at_s) -> Motion:
    """Where the knee balances under what acts at a time."""
    acting = {name: float(size) for name, size in _at(at_s, load_s, sizes).items()}
    loads = [*moving.weights, *([load_of(**acting)] if acting else [])]
    return passive_flexion(moving.knee, [flexion_deg], loads)


def _at(at_s, load_s: np.ndarray, sizes: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Load -> its size at some times."""
    return {name: np.interp(at_s, load_s, np.broadcast_to(size, load_s.shape))
            for name, size in sizes.items()}  # fmt: skip


#: N m; a leg that would turn with more is not held by its quadriceps: it would not sink.
_HELD_NM = 1e-3


@dataclasses.dataclass(frozen=True)
class RaisedLeg(Named):
    """A leg that is raised in some time, and the same leg held where it comes by.

    Attributes:
        transient: the motion.
        rows: of its times, those at which the leg is held too, `(poses,)`.
        held: the leg that its quadriceps holds at the flexions of these times.
        from_held: how far the motion is from that, degrees and mm, `(poses, coordinates)`, columns
            as of the motion; of flexion, how far it is from where the leg would be held with the
            quadriceps as long as it is.
    """

    transient: Transient
    rows: np.ndarray
    held: Extensor
    from_held: np.ndarray

    def _named(self) -> dict[str, tuple]:
        motion, over = self.transient.trajectory, "pose"
        away = {f"{x}_from_held": (over, y, coordinate(x).unit)
                for x, y in zip(motion.names, self.from_held.T, strict=True)}  # fmt: skip
        pull = np.asarray(self.held.quadriceps_N)
        held = {"held_time_s": (over, motion.time_s[self.rows]), "held_quadriceps_N": (over, pull)}
        return self.transient._named() | held | away

    @property
    def farthest(self) -> float:
        """Of `from_held`, degrees or mm."""
        return float(np.nanmax(np.abs(self.from_held)))


def raised_leg(
    moving: MovingKnee, flexion_deg: ArrayLike, time_s: ArrayLike, *,
    lengths: tuple[ArrayLike, ArrayLike] | None = None, most_mm: float = MOST_ERROR_MM,
    progress: Callable[[int], None] | None = None,
) -> RaisedLeg:  # fmt: skip
    """Raise a leg by a motor on its quadriceps.

    By itself the motor shortens the quadriceps from its length where the leg is held at the first
    flexion to that at the last, along a polynomial of degree 5 that begins and ends at rest. Its
    pull is a result.

    Args:
        moving: a knee of three bones with mass, damping and gravity.
        flexion_deg: from most to least, `(poses,)`; at as many the motion is compared with a leg
            that is held. Where a leg would not sink the quadriceps has nothing to do: the motion
            begins at the first flexion at which it has.
        time_s: at which the motion is told; it begins with the first and ends with the last.
        lengths: times, and lengths of the quadriceps at these, mm, smoothly joined; only their
            changes count, since the leg begins where it is held.
        most_mm: that is left of the error of the steps.
        progress: is told how many steps are done, of each of several passes.

    Raises:
        ValueError: the knee has no patella, flexions that do not fall, fewer than two at which the
            quadriceps holds the leg, or lengths beyond those with which it does.

    Source: paper 3, Eqs 19 and 20.
    """
    flexions, times = np.asarray(flexion_deg, float), np.asarray(time_s, float)
    if (np.diff(flexions) >= 0.0).any():
        found = ", ".join(f"{x:g}" for x in flexions)
        raise WrongValue("flexion_deg", found, "flexions that fall, from the hanging leg on")
    others = tuple(load for load in moving.weights if load.bone != TIBIA)
    (weight,) = (load for load in moving.weights if load.bone == TIBIA)
    knee = dataclasses.replace(moving.knee, loads=(*moving.knee.loads, *others))
    ahead = leg_raise(knee, flexions, weight)
    first, last = _ends(ahead)
    way = _way(times, np.asarray(ahead.quadriceps_mm)[[first, last]], lengths)
    names = coordinates_of(knee.bodies)
    start = np.asarray(ahead.motion.equilibrium.state.at(names))[:, first]
    found = move_within(
        most_mm, moving, start, times, held={QUADRICEPS: way},
        pull_N=float(ahead.quadriceps_N[first] - at_rest(knee)), progress=progress,
    )  # fmt: skip
    table = found.to_table()
    passed = np.where(np.isfinite(table[:, 0]), table[:, 0], np.inf)
    wanted = np.linspace(flexions[first], flexions[last], len(flexions))
    rows = np.argmin(np.abs(passed - wanted[:, None]), axis=1)
    held = leg_raise(knee, passed[rows], weight)
    there = np.asarray(held.motion.equilibrium.state.at(names)).T * table_units(names)
    away = table[rows] - there
    longer = np.asarray(way(times))[rows] - np.asarray(held.quadriceps_mm)
    away[:, 0] = np.rad2deg(longer / np.asarray(held.arm_mm))
    away[~_holds(held)] = np.nan
    return RaisedLeg(described(found, {}), rows, held, away)


def _holds(leg: Extensor) -> np.ndarray:
    """Where the quadriceps holds the leg."""
    rest = float(at_rest(leg.motion.knee))
    good = np.asarray(converged(leg.motion.status)) & (np.asarray(leg.quadriceps_N) > rest)
    return good & (np.abs(np.asarray(leg.extension_Nm)) < _HELD_NM)


def _ends(leg: Extensor) -> tuple[int, int]:
    """First and last row of the longest stretch of flexions at which the leg is held."""
    rows = np.flatnonzero(_holds(leg))
    stretch = max(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1), key=len)
    if len(stretch) < 2:
        found = f"{leg.flexion_deg[0]:g} to {leg.flexion_deg[-1]:g}"
        raise WrongValue("flexion_deg", found, "two at least at which the quadriceps holds the leg")
    return int(stretch[0]), int(stretch[-1])


def _way(times: np.ndarray, ends: np.ndarray, lengths) -> Callable:
    """Length over time: as given, or along a polynomial that is at rest at both ends."""
    first, last = ends
    if lengths is not None:
        given = np.asarray(lengths[1], float)
        changes = given - given[0]
        for change in (changes.max(), changes.min()):
            if not last <= first + change <= first:
                raise WrongValue(
                    "quadriceps_mm",
                    f"{change:+.4g} longer than at the start, where it has {first:.4g}",
                    f"between {last - first:.4g} and 0, with which it holds the leg",
                )
        return smooth_way(lengths[0], given, first)

    def way(t):
        part = np.clip((t - times[0]) / (times[-1] - times[0]), 0.0, 1.0)
        return first + (last - first) * part**3 * (10.0 + part * (6.0 * part - 15.0))

    return way
