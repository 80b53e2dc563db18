"""Where the energy of a motion is, where it came from and where it went."""

__all__ = ["Account"]

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.dynamics._moving import Moment, MovingKnee, damping_of, in_step
from kneejax.geometry import State, coordinates_of
from kneejax.mechanics import QUADRICEPS, Load, contact_damping_force, damping_force
from kneejax.numerics import compiled
from kneejax.statics import force, force_along

#: Part of all energy that changed hands which an account may miss before it is said.
CLOSES_WITHIN = 0.01


class Flow(eqx.Module):
    """Energies and powers at each of some moments, `(moments,)`, N mm and N mm/s."""

    kinetic: Array  # of all bones
    potential: Array  # of ligaments, contacts, lines and muscles
    dissipation: Array  # by all dampers
    by_loads: Array  # what loads and weights do
    by_drives: Array  # what those who move held coordinates, or the quadriceps, do
    damping: Array  # force of the dampers of each fibre, `(n, moments)`, N
    # Coordinate -> what holds it, N mm or N; `QUADRICEPS` -> the pull of its cable.
    holding: dict[str, Array]


class Account(eqx.Module):
    """The energy of a motion, `(times,)` each, N mm.

    Attributes:
        kinetic: of all bones.
        potential: of ligaments, contacts, lines and muscles, from the start on.
        dissipated: by dampers.
        work: of loads, weights and drives.
        missing: what is there and was dissipated, less what was there and what work brought.
        turnover: all that has changed hands so far, by which `missing` is judged.
    """

    kinetic: Array
    potential: Array
    dissipated: Array
    work: Array
    missing: Array
    turnover: Array

    @property
    def part_missing(self) -> Array:
        """Largest part of the turnover that is missing at any time that the motion reached."""
        turnover = jnp.maximum(jnp.nanmax(self.turnover), 1e-9)
        return jnp.nanmax(jnp.abs(self.missing)) / turnover

    @property
    def closes(self) -> bool:
        """Whether no more than a hundredth is missing."""
        return bool(self.part_missing <= CLOSES_WITHIN)


@compiled(static_argnums=(4,))
def flow(
    moving: MovingKnee, loads: tuple[Load, ...], known: Moment, contact_points: Array,
    held: tuple[str, ...],
) -> Flow:  # fmt: skip
    """Energies and powers at moments, under their loads `(3, moments)`.

    Leaves of `moving` end in a lane axis of length one; `held` are names of the coordinates that
    are, `QUADRICEPS` where a motor gives it its length.
    """
    names = coordinates_of(moving.knee.bodies)
    q, rate = known.q, known.rate
    state = State.of({}, q, moving.knee.bodies)
    rates = dict(zip(names, rate, strict=True))
    coefficients = damping_of(moving, known.lengths)
    damping = damping_force(known.length_rates, *coefficients)
    lost = jnp.sum(damping * known.length_rates, axis=0)
    in_contacts = jnp.zeros(q.shape[1:])
    for name, dissipation in moving.contact_dissipation.items():
        faster = known.overlap_rates[name]
        power = faster * contact_damping_force(faster, dissipation, known.pressing[name])
        power = power if power.ndim == in_contacts.ndim else jnp.sum(power, axis=0)
        in_contacts = in_contacts + power
    lost = lost + in_contacts
    lost = lost + sum(c * rates[name] ** 2 for name, c in moving.coordinate_damping.items())
    kinetic = sum(m.kinetic_energy(known.velocities[bone]) for bone, m in moving.masses.items())
    whole = dataclasses.replace(moving.knee, loads=(*moving.loads, *loads))
    _, forces = force(whole, {}, q, contact_points)
    # As in a step of one second: what holds coordinates acts against inertia and dampers, too.
    expected = {
        bone: jax.tree.map(lambda x, a: x - a, state.poses[bone].placement, faster)
        for bone, faster in known.accelerations.items()
    }
    before = known.q, known.lengths, known.overlaps
    ahead = known.rate, known.length_rates, known.overlap_rates
    x, lengths, overlaps = jax.tree.map(jnp.subtract, before, ahead)
    in_motion = in_step(
        moving, whole, jnp.ones(state.shape), expected, x, lengths, overlaps, coefficients,
        known.pressing,
    )  # fmt: skip
    still = tuple(name for name in held if name != QUADRICEPS)
    holding, driven = {}, jnp.zeros(state.shape)
    if QUADRICEPS in held:
        muscles = whole.muscles
        assert muscles is not None
        pull = holding[QUADRICEPS] = known.pull

        def length(x: Array) -> Array:
            return muscles.quadriceps_length(State.of({}, x, moving.knee.bodies))

        driven = -pull * jax.jvp(length, (q,), (rate,))[1]
        in_motion = dataclasses.replace(in_motion, muscles=muscles.pulling({QUADRICEPS: pull}))
    if still:
        holding |= zip(still, force_along(in_motion, state, contact_points, still), strict=True)
    driven = driven + sum((holding[name] * rates[name] for name in still), jnp.zeros(state.shape))
    by_loads = jnp.sum(forces.load * rate, axis=0)
    return Flow(kinetic, forces.energy, lost, by_loads, driven, damping, holding)


def account_of(time_s: Array, flow: Flow) -> Account:
    """Add up what flows, by the trapezoidal rule between neighbouring moments."""
    lost, by_loads, by_drives = (
        _from_start(0.5 * jnp.diff(time_s) * (power[1:] + power[:-1]))
        for power in (flow.dissipation, flow.by_loads, flow.by_drives)
    )
    work, potential = by_loads + by_drives, flow.potential - flow.potential[0]
    missing = flow.kinetic - flow.kinetic[0] + potential + lost - work
    parts = flow.kinetic, flow.potential, lost, by_loads, by_drives
    turned = sum(_from_start(jnp.abs(jnp.diff(x))) for x in parts)
    return Account(flow.kinetic, potential, lost, work, missing, 0.5 * turned + flow.kinetic[0])


def _from_start(parts: Array) -> Array:
    return jnp.concatenate([jnp.zeros(1), jnp.cumsum(parts)])
