"""Motions as exact as they are wanted: steps are halved, and shortened where that tells.

And the same motion by an integrator of others, Lagrange's equations in diffrax, to compare with.
Nothing of the steps is shared: forces are derivatives of the knee's energy, inertia is that of
kinetic energy in the free coordinates, and time is left to Dormand and Prince's explicit method of
eighth order with steps of its own choice. A stiff knee takes it many steps, while an implicit
method takes six times as long to compile.
"""

__all__ = ["integrated", "move_within"]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from kneejax.dynamics._account import CLOSES_WITHIN
from kneejax.dynamics._moving import MovingKnee, damping_of
from kneejax.dynamics._trajectory import LoadCurve, Trajectory, move
from kneejax.geometry import Matrix, Placement, State, Vector, coordinates_of, scales
from kneejax.mechanics import add_lane_axis, contact_damping_force, damping_force
from kneejax.numerics import WrongValue, imported
from kneejax.statics import converged, needs_float64

#: Steps between two times at most: what still cannot be taken then ends the motion.
MOST_WITHIN = 256


def move_within(
    most_mm: float, moving: MovingKnee, start: ArrayLike, time_s: ArrayLike, **options
) -> Trajectory:
    """Let a knee move, with steps so short that its poses are right within an error.

    A motion is compared with the one before it, whose steps were twice as long at least
    (`_error_of`). Where its error is too large all steps are halved, and become shorter still where
    they surprised most, and where one could not be taken, and so where the account of energy does
    not close; no more than 256 are made between two times.

    Args:
        most_mm: that is left of the error at any of the times, mm (rotations at 30 mm).
        moving: as `move`; likewise the others.
        start: likewise.
        time_s: likewise.
        options: likewise.

    Returns:
        The motion; `error_mm` says what its error is, which exceeds `most_mm` where not even the
        shortest steps were enough.
    """

    def moved(within: NDArray[np.int64]) -> Trajectory:
        return move(moving, start, time_s, **options, within=within)

    wanted = np.ones(len(np.asarray(time_s)) - 1, int)
    # Steps that cannot be taken become as short as they may.
    while True:
        coarse = moved(wanted)
        wanted = _shorter(coarse, float("inf"))
        if np.array_equal(wanted, coarse.grid.within()):
            break
    while True:
        fine = moved(np.maximum(2 * coarse.grid.within(), wanted))
        error = _error_of(coarse, fine)
        fine = dataclasses.replace(fine, error_mm=error)
        going_on = bool(converged(np.asarray(fine.status)).all())
        # Energy that steps lose tells of what is over before the next time that was asked for.
        missing = float(fine.account().part_missing) if going_on else 0.0
        factor = max(error / most_mm, missing / CLOSES_WITHIN)
        wanted = _shorter(fine, factor)
        if (factor <= 1.0 and going_on) or np.array_equal(wanted, fine.grid.within()):
            return fine
        coarse = fine


def _error_of(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest error of a motion, `coarse`, by another with shorter steps, mm (rotations at 30 mm),
    over the times that both reach; infinite where none is.

    Errors fall with the square of the steps, so that steps half as long leave a third of the
    difference. Where some became shorter than others, the error is taken to stem from where the
    longer steps surprised.
    """
    off = (np.asarray(fine.q) - np.asarray(coarse.q)) / np.array(scales(fine.names))
    known = np.asarray(np.isfinite(off).all(axis=1))
    if not known[1:].any():
        return float("inf")
    shorter = fine.grid.within() / coarse.grid.within()
    surprise = _surprises(coarse, np.add) + np.finfo(float).tiny
    left = float(np.sum(surprise / shorter**2) / np.sum(surprise))
    return float(np.abs(off[known]).max()) * left / (1.0 - left)


def _surprises(motion: Trajectory, how: np.ufunc) -> NDArray[np.float64]:
    """How far its steps ended from where they were expected, for each two of the times, mm."""
    each = np.nan_to_num(np.asarray(motion.moments.surprise)[1:, 0])
    begin = np.concatenate([[0], motion.grid.asked[:-1] + 1])
    return how.reduceat(each, begin)


def _shorter(fine: Trajectory, factor: float) -> NDArray[np.int64]:
    """Steps between two times that promise an error so much less: each should surprise alike.

    With an error that is not known, infinite, only steps that could not be taken become shorter.
    """
    within, each = fine.grid.within(), _surprises(fine, np.maximum)
    # What is left of an error falls with the square of the steps, a surprise with the cube.
    less = max(1.2 * factor, 1.0) if np.isfinite(factor) else 1.0
    allowed = max(each.max(), 1e-12) / less**1.5
    times = np.ceil(np.cbrt(np.maximum(each / allowed, 1.0)) - 1e-9).astype(int)
    lost = ~np.asarray(converged(np.asarray(fine.status)))
    if lost.any():
        first = int(np.flatnonzero(lost)[0]) - 1
        times[max(first - 1, 0) : first + 1] *= 4
    return np.maximum(within, np.minimum(within * times, MOST_WITHIN))


def integrated(
    moving: MovingKnee, start: ArrayLike, time_s: ArrayLike, *, rate: ArrayLike = 0.0,
    loads: LoadCurve | None = None, held: tuple[str, ...] = (), tolerance: float = 1e-9,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Let a knee of which every bone has mass move.

    Args:
        moving: as `kneejax.dynamics.move`, and so are `start`, `time_s`, `rate` and `loads`.
        held: names of coordinates that stay where they are.
        tolerance: of a step, relative, and absolute in rad, mm, rad/s and mm/s.

    Returns:
        Coordinates and their rates, `(times, 6 bodies)` each.

    Raises:
        MissingPackage: diffrax is not installed.
        ValueError: a bone without mass.
    """
    needs_float64()
    diffrax = imported("diffrax", "diffrax", "dynamics")
    if set(moving.masses) != set(moving.knee.bodies):
        expected = f"one of each of {', '.join(moving.knee.bodies)}; move() does without"
        raise WrongValue("masses", f"of {', '.join(moving.masses) or 'nothing'}", expected)
    names = coordinates_of(moving.knee.bodies)
    free = np.array([k for k, name in enumerate(names) if name not in held])
    begin = jnp.asarray(start, float)
    speed = jnp.broadcast_to(jnp.asarray(rate, float), begin.shape)
    times = jnp.asarray(time_s, float)
    accelerated = _Equations(add_lane_axis(moving), begin, free, loads).accelerated

    def equation(t, y, _):
        return y[1], accelerated(t, *y)

    def solved(y):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(equation), diffrax.Dopri8(), times[0], times[-1], None, y,
            saveat=diffrax.SaveAt(ts=times), max_steps=200_000,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        ).ys  # fmt: skip

    # With its newer emitters XLA 0.10 aborts the process over this program.
    program = jax.jit(solved, compiler_options={"xla_cpu_use_fusion_emitters": False})
    q, v = program((begin[free], speed[free]))
    every = np.tile(np.asarray(begin), (len(times), 1))
    rates = np.zeros_like(every)
    every[:, free], rates[:, free] = q, v
    return every, rates


@dataclasses.dataclass(frozen=True)
class _Equations:
    """Lagrange's equations in the free coordinates `x` and their rates `v`."""

    moving: MovingKnee  # leaves end in a lane axis
    begin: Array
    free: np.ndarray
    loads: LoadCurve | None

    @property
    def names(self) -> list[str]:
        """Of the free coordinates."""
        every = coordinates_of(self.moving.knee.bodies)
        return [every[k] for k in self.free]

    def accelerated(self, t: Array, x: Array, v: Array) -> Array:
        """Acceleration of the free coordinates."""
        masses = self.moving.masses

        def kinetic(speed: Array) -> Array:
            parts = zip(masses.values(), speed.reshape(-1, 12, 1), strict=True)
            return sum((mass.kinetic_energy(_placement(y)) for mass, y in parts), jnp.zeros(1))[0]

        def speed(y: Array) -> Array:
            return jax.jvp(self._places, (y,), (v,))[1]

        of_points = jax.hessian(kinetic)(jnp.zeros(12 * len(masses)))
        by_coordinate = jax.jacfwd(self._places)(x)
        turned = jax.jvp(speed, (x,), (v,))[1]
        pushed = by_coordinate.T @ of_points
        force = self._acting(t, x) + self._damped(x, v)
        force = force - jax.grad(lambda y: self.moving.knee.energy(self._state(y))[0])(x)
        return jnp.linalg.solve(pushed @ by_coordinate, force - pushed @ turned)

    def _state(self, x: Array) -> State:
        q = self.begin.at[self.free].set(x)
        return State.of({}, q[:, None], self.moving.knee.bodies)

    def _places(self, x: Array) -> Array:
        """Of the bones with mass, 12 numbers each."""
        poses = self._state(x).poses
        return jnp.concatenate([_flat(poses[bone].placement) for bone in self.moving.masses])[:, 0]

    def _acting(self, t: Array, x: Array) -> Array:
        more = () if self.loads is None else jax.tree.map(lambda y: y[0], self.loads.at(t[None]))
        total = jnp.zeros(len(self.free))
        for load in (*self.moving.loads, *more):
            total = total + jnp.stack(load.work(self._state(x), self.names))[:, 0]
        return total

    def _damped(self, x: Array, v: Array) -> Array:
        along = [self.moving.coordinate_damping.get(name, jnp.zeros(1)) for name in self.names]
        force = -jnp.concatenate(along) * v
        if self.moving.knee.ligaments.names:
            force = force + self._damped_in_fibres(x, v)
        if self.moving.contact_dissipation:
            force = force + self._damped_in_contacts(x, v)
        return force

    def _damped_in_fibres(self, x: Array, v: Array) -> Array:
        fibres = self.moving.knee.ligaments

        def lengths(y: Array) -> Array:
            return fibres.length(self._state(y)).reshape(len(fibres.names))

        there, by_length = jax.vjp(lengths, x)
        _, faster = jax.jvp(lengths, (x,), (v,))
        coefficients = (c[:, 0] for c in damping_of(self.moving, there[:, None]))
        return -by_length(damping_force(faster, *coefficients))[0]

    def _damped_in_contacts(self, x: Array, v: Array) -> Array:
        contact_points = self.moving.knee.contact_points(self._state(x))

        def overlaps(y: Array) -> tuple[dict[str, Array], dict[str, Array]]:
            return self.moving.overlaps(self._state(y), contact_points)

        _, by_overlap, pressing = jax.vjp(overlaps, x, has_aux=True)
        _, faster, _ = jax.jvp(overlaps, (x,), (v,), has_aux=True)
        return -by_overlap({
            name: contact_damping_force(faster[name], c, pressing[name])
            for name, c in self.moving.contact_dissipation.items()
        })[0]  # fmt: skip


def _flat(place: Placement) -> Array:
    assert place.rotation is not None
    rows = (*(x for row in place.rotation for x in row), *place.translation)
    return jnp.stack(jnp.broadcast_arrays(*rows))


def _placement(x: Array) -> Placement:
    rotation = Matrix(*(Vector.of(x[k : k + 3]) for k in (0, 3, 6)))
    return Placement(rotation, Vector.of(x[9:]))
