"""The same motion by an integrator of others: Lagrange's equations in diffrax.

Nothing of the steps is shared: forces are derivatives of the knee's energy, inertia is that of
kinetic energy in the free coordinates, and time is left to Dormand and Prince's explicit method of
eighth order with steps of its own choice. It is there to be compared with: a stiff knee takes it
many steps, while an implicit method takes six times as long to compile.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics._history import damping_of
from kneejax.dynamics._moving import MovingKnee
from kneejax.dynamics._trajectory import LoadCurve
from kneejax.geometry import Matrix, Placement, State, Vector, coordinates_of
from kneejax.mechanics import add_lane_axis, contact_damping_force, damping_force
from kneejax.numerics import WrongValue, imported
from kneejax.statics import needs_float64


def integrated(
    moving: MovingKnee,
    start: ArrayLike,
    time_s: ArrayLike,
    *,
    rate: ArrayLike = 0.0,
    loads: LoadCurve | None = None,
    held: tuple[str, ...] = (),
    tolerance: float = 1e-9,
) -> tuple[np.ndarray, np.ndarray]:
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
