"""A motion through time, as people ask for it and read it."""

__all__ = ["LoadCurve", "Trajectory", "given_of", "move"]

import dataclasses
from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics._account import Account, Flow, account_of, flow
from kneejax.dynamics._march import BLOCK, Given, Grid, Moments, first_moment, march, rising
from kneejax.dynamics._moving import MovingKnee, Step
from kneejax.geometry import Pose, State, coordinate, coordinates_of, table_units
from kneejax.mechanics import QUADRICEPS, Knee, Load, add_lane_axis
from kneejax.numerics import Named, WrongValue, traced
from kneejax.statics import Status, converged


class LoadCurve(eqx.Module):
    """Loads over time, straight between the times at which they are known.

    Attributes:
        time_s: rising, `(k,)`; before and after the loads are what they are at the ends.
        loads: with arrays `(k, 3)`, N, N mm and mm.

    Example:
        >>> import kneejax as kj
        >>> pull = kj.load_of(anterior_N=jnp.array([0.0, 100.0]))
        >>> curve = LoadCurve.of([0.0, 0.1], pull)
        >>> curve.at(jnp.array([0.05])).__class__.__name__
        'tuple'
    """

    time_s: Array
    loads: tuple[Load, ...]

    @classmethod
    def of(cls, time_s: ArrayLike, *loads: Load) -> "LoadCurve":
        """Make one; arrays of the loads may be of one time, `(3,)`.

        Raises:
            ValueError: times that do not rise.
        """
        times = rising(time_s)
        shape = (len(times), 3)
        every = (jax.tree.map(lambda x: jnp.broadcast_to(x, shape), load) for load in loads)
        return cls(jnp.asarray(times), tuple(every))

    def at(self, time_s: Array) -> tuple[Load, ...]:
        """At other times, with arrays `(times, 3, 1)`."""
        columns = jax.vmap(lambda row: jnp.interp(time_s, self.time_s, row), 1, 1)
        return jax.tree.map(lambda x: columns(x)[..., None], self.loads)


#: What does not move freely: names of coordinates, or name -> where it is over time;
#: `kneejax.mechanics.QUADRICEPS` stands for the length of the quadriceps, mm.
Held = Mapping[str, Callable[[np.ndarray], ArrayLike]] | tuple[str, ...]


class Trajectory(eqx.Module, Named):
    """A motion through time.

    Attributes:
        time_s: `(times,)`, the first of them the start.
        q: all coordinates, rad and mm, `(times, 6 bodies)`; NaN from where no step could be taken.
        rate: of them, rad/s and mm/s.
        status: `Status` values; that of the step that could not be taken is kept to the end.
        looks: evaluations of the knee in each step's search, `(steps,)`.
        moments: of all steps, the start first.
        grid: the steps.
        moving: the knee.
        loads: at all moments, arrays `(moments, 3, 1)`.
        held: coordinate, or `QUADRICEPS`, -> its value at all moments.
        error_mm: how far poses are from those of ever shorter steps, by doubling them, at worst
            (rotations at 30 mm); NaN where nobody asked (`move_within`).

    Example:
        `kj.move` makes one; it compiles for long. What it holds:

        >>> import kneejax as kj
        >>> list(kj.Trajectory.__dataclass_fields__)[:4]
        ['time_s', 'q', 'rate', 'status']
    """

    time_s: Array
    q: Array
    rate: Array
    status: Array
    looks: Array
    moments: Moments
    moving: MovingKnee
    loads: tuple[Load, ...]
    held: dict[str, Array]
    grid: Grid = eqx.field(static=True)
    error_mm: Array | float = np.nan

    OVER = {"time_s": {"time_s": "", "status": Status}}

    def _named(self) -> dict[str, tuple]:
        rates = zip(self.names, self.to_table().T, self.rates_to_table().T, strict=True)
        content = super()._named()
        for name, values, rate in rates:
            unit = coordinate(name).unit
            content[name] = "time_s", values, unit
            content[f"{name}_rate"] = "time_s", rate, f"{unit} s-1"
        return content

    @property
    def pose(self) -> Pose:
        """Of the tibia, `(times,)`."""
        return State.of({}, self.q.T, self.moving.knee.bodies).tibia

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates, in the order of `q`."""
        return coordinates_of(self.moving.knee.bodies)

    @property
    def columns(self) -> tuple[str, ...]:
        """Of `to_table`."""
        return tuple(coordinate(name).column for name in self.names)

    def to_table(self) -> np.ndarray:
        """All coordinates in degrees and mm, `(times, 6 bodies)`."""
        return np.asarray(self.q) * table_units(self.names)

    def rates_to_table(self) -> np.ndarray:
        """Their rates in degrees/s and mm/s, `(times, 6 bodies)`."""
        return np.asarray(self.rate) * table_units(self.names)

    @property
    def rows(self) -> np.ndarray:
        """Of the moments, those at `time_s`."""
        return np.concatenate([[0], 1 + self.grid.asked])

    @property
    def pull_N(self) -> np.ndarray:
        """Of the cable on the quadriceps, `(times,)`; 0 without one."""
        return np.asarray(self.moments.known.pull)[self.rows, 0]

    @property
    def ended(self) -> Status:
        """How the motion ended: balanced in every step, or the status of the last that was not."""
        bad = np.asarray(self.status)[~converged(np.asarray(self.status))]
        return Status(int(bad[0])) if len(bad) else Status.BALANCED

    @property
    def ended_s(self) -> float:
        """The last time at which there is a pose."""
        known = np.flatnonzero(converged(np.asarray(self.moments.status)[:, 0]))
        return float(self.grid.moments_s[known[-1] if len(known) else 0])

    @property
    def contact_points(self) -> Array:
        """Where contacts meet, `(contacts, 2, times)`."""
        return jnp.moveaxis(self.moments.contact_points[self.rows, ..., 0], 0, -1)

    def flow(self) -> Flow:
        """Energies and powers at every moment."""
        # Moments as lanes.
        rows = jax.tree.map(
            lambda x: (jnp if traced(x) else np).moveaxis(x[..., 0], 0, -1),
            (self.loads, self.moments.known, self.moments.contact_points),
        )
        moving, held = add_lane_axis(self.moving), tuple(self.held)
        if traced((moving, rows)):
            return flow(moving, *rows, held)
        count = len(self.moments.status)
        blocks = [
            flow(moving, *jax.tree.map(lambda x, k=k: _filled(x, k), rows), held)
            for k in range(0, count, BLOCK)
        ]
        return jax.tree.map(lambda *x: np.concatenate(x, axis=-1)[..., :count], *blocks)

    def account(self) -> Account:
        """Energies, what was dissipated, and work, at every moment."""
        return account_of(jnp.concatenate([jnp.zeros(1), self.grid.time_s]), self.flow())


def move(
    moving: MovingKnee, start: ArrayLike, time_s: ArrayLike | Grid, *, rate: ArrayLike = 0.0,
    pull_N: ArrayLike = 0.0, loads: LoadCurve | None = None, held: Held = (), within: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:  # fmt: skip
    """Let a knee move.

    Args:
        moving: the knee, with mass and damping.
        start: all coordinates at the start, rad and mm, `(6 bodies,)`.
        time_s: at which the motion is asked for, rising, the start first; or the steps themselves.
        rate: of the coordinates at the start, rad/s and mm/s.
        pull_N: of the quadriceps at the start in addition to its tension at rest, where a motor
            gives it its length.
        loads: over time, in addition to those of the knee.
        held: names of coordinates that stay where they are, or name -> a function of time, s, on
            which it is led, rad or mm (the start is taken from `start`). With `QUADRICEPS` a
            motor gives that muscle its length (`kneejax.mechanics.Cable`); its pull is a result.
        within: steps between two of the times.
        progress: called with how many steps are done.

    Returns:
        The motion, differentiable by every number of the knee, by start, rates and loads, forward
        and backward. Where a step has no balance it ends: NaN from there on, with a status.

    Raises:
        ValueError: times that do not rise; a quadriceps that the knee does not have.

    Example:
        >>> from kneejax.mechanics import Knee, Ligaments, Mass
        >>> alone = Knee(Ligaments([], [], [], [], [], [], []), (), (), (), State.of(
        ...     {}, jnp.zeros(6)).tibia, ())
        >>> rod = Mass(3.0, [0.0, -200.0, 0.0], np.diag([4e4, 0.0, 4e4]))
        >>> swinging = MovingKnee.of(alone, rod, gravity_m_s2=(0.0, -9.8, 0.0))
        >>> pivot = ("adduction", "internal_rotation", "anterior", "superior", "lateral")
        >>> let_go = move(swinging, [0.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.01, 0.02], held=pivot)
        >>> let_go.q.shape, bool(let_go.pose.flexion[-1] < 0.5)
        ((3, 6), True)
    """
    grid = time_s if isinstance(time_s, Grid) else Grid.of(time_s, within)
    times = grid.moments_s
    acting = () if loads is None else loads.at(jnp.asarray(times))
    ways = _ways(moving.knee, held, jnp.asarray(start, float), times)
    given = given_of(moving, start, grid, rate=rate, pull_N=pull_N, loads=loads, held=held)
    found = march(add_lane_axis(moving), given, progress)
    moments, asked = _with_start(moving, given, found), np.concatenate([[0], 1 + grid.asked])
    return Trajectory(
        jnp.asarray(times[asked]), moments.known.q[asked, :, 0], moments.known.rate[asked, :, 0],
        moments.status[asked, 0], moments.looks[1:, 0], moments, moving, acting, ways, grid,
    )  # fmt: skip


def given_of(
    moving: MovingKnee, start: ArrayLike, grid: Grid, *, rate: ArrayLike = 0.0,
    pull_N: ArrayLike = 0.0, loads: LoadCurve | None = None, held: Held = (),
) -> Given:  # fmt: skip
    """What `move` gives to `march`: for programs of one's own over many motions on the same steps.

    Arguments as those of `move`, with `grid`, the steps.

    Returns:
        The start, and what acts and is held at the end of each step, in one lane.

    Raises:
        ValueError: a quadriceps that the knee does not have.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.mechanics import Mass
        >>> shank = Mass(3.0, [0.0, -200.0, 0.0], np.diag([4e4, 0.0, 4e4]))
        >>> moving = MovingKnee.of(kj.load_knee("four_ligament"), shank)
        >>> given_of(moving, np.zeros(6), Grid.of([0.0, 0.1, 0.2])).steps.length_s.shape
        (6,)
    """
    q, times = jnp.asarray(start, float), grid.moments_s
    acting = () if loads is None else loads.at(jnp.asarray(times))
    later, led = jax.tree.map(lambda x: x[1:], (acting, _ways(moving.knee, held, q, times)))
    cable = led.pop(QUADRICEPS, None)
    rates = jnp.broadcast_to(jnp.asarray(rate, float), q.shape)[:, None]
    steps = Step(jnp.asarray(grid.length_s), jnp.asarray(grid.ratio), later, led, cable)
    return Given(q[:, None], rates, steps, jnp.asarray(pull_N, float))


def _ways(knee: Knee, held: Held, q: Array, times: np.ndarray) -> dict[str, Array]:
    """What does not move freely -> its value at all moments, `(moments, 1)`."""
    ways = {}
    for name, lead in (held if isinstance(held, Mapping) else dict.fromkeys(held)).items():
        if name != QUADRICEPS:
            there = q[coordinates_of(knee.bodies).index(name)]
        elif knee.muscles is None or not knee.muscles.quadriceps:
            raise WrongValue("path", QUADRICEPS, f"a knee with a quadriceps; {knee.name} has none")
        else:
            there = knee.muscles.quadriceps_length(State.of({}, q, knee.bodies))
        after = there if lead is None else jnp.asarray(lead(times[1:]), float)
        every = [there[None], jnp.broadcast_to(after, times[1:].shape)]
        ways[name] = jnp.concatenate(every)[:, None]
    return ways


def _filled(x, first: int) -> np.ndarray:
    """A block of lanes, filled up with the last: one program serves motions of any length."""
    lanes = np.asarray(x)[..., first : first + BLOCK]
    more = BLOCK - lanes.shape[-1]
    return np.pad(lanes, [(0, 0)] * (lanes.ndim - 1) + [(0, more)], "edge")


def _with_start(moving: MovingKnee, given: Given, found: Moments) -> Moments:
    """The moments with the start before them; its accelerations are those of the first step."""
    lanes = add_lane_axis(moving)
    first, contact_points = first_moment(lanes, given.q, given.rate, jnp.asarray(given.pull))
    first = dataclasses.replace(
        first, accelerations=jax.tree.map(lambda x: x[0], found.known.accelerations)
    )
    start = Moments(
        first, contact_points, jnp.zeros_like(found.status[0]),
        jnp.zeros_like(found.looks[0]), jnp.zeros_like(found.surprise[0]),
    )  # fmt: skip
    both = jnp if traced((start, found)) else np
    return jax.tree.map(lambda x, y: both.concatenate([both.asarray(x)[None], y]), start, found)
