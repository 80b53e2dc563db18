"""The same motion by an integrator of others: Lagrange's equations in diffrax.

Nothing of the steps is shared: forces are derivatives of the knee's energy, inertia is that of
kinetic energy in the free coordinates, and time is left to Kvaerno's method of fifth order with
steps of its own choice. It is slow to compile, and there to be compared with.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics._history import damping_of
from kneejax.dynamics._moving import MovingKnee
from kneejax.dynamics._trajectory import LoadCurve
from kneejax.geometry import Placement, State, coordinates_of
from kneejax.mechanics import Knee, add_lane_axis, damping_force
from kneejax.numerics import imported
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
        moving: as `kneejax.dynamics.move`; likewise the others.
        start: likewise.
        time_s: likewise.
        rate: likewise.
        loads: likewise.
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
        raise ValueError(
            f"a bone of {', '.join(moving.knee.bodies)} has no mass; move() takes such"
        )
    names = coordinates_of(moving.knee.bodies)
    free = np.array([k for k, name in enumerate(names) if name not in held])
    begin = jnp.asarray(start, float)
    speed = jnp.broadcast_to(jnp.asarray(rate, float), begin.shape)
    times = jnp.asarray(time_s, float)
    accelerated = _accelerations(moving, begin, free, loads)

    def equation(t, y, _):
        return y[1], accelerated(t, *y)

    def solved(y):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(equation), diffrax.Kvaerno5(), times[0], times[-1], None, y,
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


def _accelerations(
    moving: MovingKnee, begin: Array, free: np.ndarray, loads: LoadCurve | None
) -> Callable[[Array, Array, Array], Array]:
    """Of the free coordinates, as a function of time, of these and of their rates."""
    lanes, names = add_lane_axis(moving), coordinates_of(moving.knee.bodies)
    knee: Knee = lanes.knee

    def state_of(x: Array) -> State:
        return State.of({}, begin.at[free].set(x)[:, None], knee.bodies)

    def energy(x: Array) -> Array:
        return knee.energy(state_of(x))[0]

    def places(x: Array) -> Array:
        """Of the bones with mass, 12 numbers each."""
        state = state_of(x)
        return jnp.concatenate([
            _flat(state.poses[bone].placement) for bone in lanes.masses
        ])[:, 0]  # fmt: skip

    def kinetic(speed: Array) -> Array:
        parts = zip(lanes.masses.values(), speed.reshape(-1, 12, 1), strict=True)
        return sum((mass.kinetic_energy(_placement(x)) for mass, x in parts), jnp.zeros(1))[0]

    of_points = jax.hessian(kinetic)(jnp.zeros(12 * len(lanes.masses)))

    def lengths(x: Array) -> Array:
        return knee.ligaments.length(state_of(x)).reshape(len(knee.ligaments.names))

    def damped(x: Array, v: Array) -> Array:
        there, by_length = jax.vjp(lengths, x)
        _, faster = jax.jvp(lengths, (x,), (v,))
        coefficients = (c[:, 0] for c in damping_of(lanes, there[:, None]))
        force = -by_length(damping_force(faster, *coefficients))[0]
        c = jnp.array([
            moving.coordinate_damping.get(names[k], jnp.asarray(0.0)) for k in free
        ])  # fmt: skip
        return force - c * v

    def acting(t: Array, x: Array) -> Array:
        state = state_of(x)
        more = () if loads is None else jax.tree.map(lambda y: y[0], loads.at(t[None]))
        total = jnp.zeros(len(free))
        for load in (*lanes.loads, *more):
            total = total + jnp.stack(load.work(state, [names[k] for k in free]))[:, 0]
        return total

    def accelerated(t: Array, x: Array, v: Array) -> Array:
        def speed(z: Array) -> Array:
            return jax.jvp(places, (z,), (v,))[1]

        by_coordinate = jax.jacfwd(places)(x)
        turned = jax.jvp(speed, (x,), (v,))[1]
        pushed = by_coordinate.T @ of_points
        force = acting(t, x) - jax.grad(energy)(x)
        if len(knee.ligaments.names):
            force = force + damped(x, v)
        return jnp.linalg.solve(pushed @ by_coordinate, force - pushed @ turned)

    return accelerated


def _flat(place: Placement) -> Array:
    assert place.rotation is not None
    rows = (*(x for row in place.rotation for x in row), *place.translation)
    return jnp.stack(jnp.broadcast_arrays(*rows))


def _placement(x: Array) -> Placement:
    return Placement(
        ((x[0], x[1], x[2]), (x[3], x[4], x[5]), (x[6], x[7], x[8])), (x[9], x[10], x[11])
    )
