"""What an implicit step must know of the past, and the parts of a knee that follow from it.

The formula is BDF2 with variable steps. Of a quantity `y` the rate at the end of a step `h` is

    rate = per_s (y - before),   per_s = (1 + 2 r) / (1 + r) / h,
    before = ((1 + r) y_1 - r^2 / (1 + r) y_0) / (h per_s)

with `y_1` and `y_0` its last two values and `r` the ratio of `h` to the step between them; `r = 0`
is the step of order one with which a motion begins. Inertia follows the formula twice, for every
point of a bone (positions make velocities, velocities accelerations), dampers once.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.dynamics._moving import MovingKnee
from kneejax.geometry import Placement, Prescribed, State, coordinates_of
from kneejax.mechanics import (
    Cable,
    CoordinateDampers,
    Dampers,
    InertiaOfStep,
    Knee,
    Load,
    Muscles,
    TimeStep,
    tautness,
)


class Step(eqx.Module):
    """One step through time."""

    length_s: Array  # s, `(lanes,)` or one number
    ratio: Array  # to the step before it; 0 at the beginning
    # At the end of the step, besides those of the knee; arrays `(3, lanes)`.
    loads: tuple[Load, ...]
    held: Prescribed  # coordinate -> its prescribed value at the end, rad or mm
    # Length of the quadriceps at the end, mm; None where no motor gives it.
    cable: Array | None = None

    @property
    def per_s(self) -> Array:
        """Factor between a displacement and its rate, 1/s."""
        return (1.0 + 2.0 * self.ratio) / (1.0 + self.ratio) / self.length_s

    def before(self, last: Any, older: Any) -> Any:
        """Values from which displacements are counted, of the last two."""
        r = self.ratio
        a = (1.0 + r) ** 2 / (1.0 + 2.0 * r)
        b = -r * r / (1.0 + 2.0 * r)
        return jax.tree.map(lambda x, y: a * x + b * y, last, older)


class Moment(eqx.Module):
    """What is known of a knee at a time; arrays end in lanes."""

    q: Array  # all coordinates, rad and mm, `(6 bodies, lanes)`
    rate: Array  # of them, rad/s and mm/s
    places: dict[str, Placement]  # bone with mass -> its placement
    velocities: dict[str, Placement]  # bone with mass -> rate of its placement
    accelerations: dict[str, Placement]  # bone with mass -> rate of its velocity; 0 at the start
    lengths: Array  # of all fibres, mm, `(n, lanes)`
    length_rates: Array  # of these, mm/s
    pull: Array  # of the cable on the quadriceps, N, `(lanes,)`; 0 without one
    # Contact that is damped -> its overlap, mm, `(lanes,)` or `(points, lanes)`.
    overlaps: dict[str, Array]
    overlap_rates: dict[str, Array]  # of these, mm/s
    pressing: dict[str, Array]  # contact that is damped -> its elastic force, N

    @classmethod
    def at_first(
        cls, moving: MovingKnee, q: Array, rate: Array, pull: Array
    ) -> tuple[Moment, Array]:
        """Of a motion's start, coordinates and rates `(6 bodies, lanes)` and the cable's pull, N,
        and where contacts meet there."""
        bones = tuple(moving.masses)

        def places(x: Array) -> dict[str, Placement]:
            state = State.of({}, x, moving.knee.bodies)
            return {bone: state.poses[bone].placement for bone in bones}

        there, velocities = jax.jvp(places, (q,), (rate,))

        def lengths(x: Array) -> Array:
            return moving.knee.ligaments.length(State.of({}, x, moving.knee.bodies))

        nothing = jax.tree.map(jnp.zeros_like, velocities)
        length, length_rate = jax.jvp(lengths, (q,), (rate,))
        pulls = jnp.broadcast_to(pull, q.shape[1:])
        state = State.of({}, q, moving.knee.bodies)
        contact_points = moving.knee.contact_points(state)

        def overlaps(x: Array) -> tuple[dict[str, Array], dict[str, Array]]:
            return moving.overlaps(State.of({}, x, moving.knee.bodies), contact_points)

        overlap, overlap_rate, pressing = jax.jvp(overlaps, (q,), (rate,), has_aux=True)
        pressed = overlap, overlap_rate, pressing
        moved = q, rate, there, velocities, nothing, length, length_rate
        return cls(*moved, pulls, *pressed), contact_points


class History(eqx.Module):
    """What is known of a motion so far."""

    last: Moment  # its last moment
    older: Moment  # the one before it
    contact_points: Array  # where contacts met, `(n, 2, lanes)`

    def knee_of(self, moving: MovingKnee, step: Step) -> Knee:
        """The knee whose balance is the end of a step."""
        last, older, knee = self.last, self.older, moving.knee
        inertia = []
        for bone, mass in moving.masses.items():
            place = step.before(last.places[bone], older.places[bone])
            speed = step.before(last.velocities[bone], older.velocities[bone])
            expected = jax.tree.map(lambda x, v: x + v / step.per_s, place, speed)
            inertia.append(InertiaOfStep(mass, expected, step.per_s, bone))
        fibres, coordinates = knee.ligaments, None
        if fibres.names:
            fibres = dataclasses.replace(fibres, dampers=self._dampers(moving, step))
        if moving.coordinate_damping:
            names = coordinates_of(knee.bodies)
            before = dict(zip(names, step.before(last.q, older.q), strict=True))
            damped = moving.coordinate_damping
            before = {name: before[name] for name in damped}
            coordinates = CoordinateDampers(damped, before, step.per_s)
        before = step.before(last.overlaps, older.overlaps)
        pressing = jax.tree.map(
            lambda x, y: jnp.maximum(x + step.ratio * (x - y), 0.0), last.pressing, older.pressing
        )
        return dataclasses.replace(
            knee,
            ligaments=fibres,
            contacts=moving.with_contacts_damped(before, pressing, step.per_s),
            muscles=self._on_cable(knee, step),
            loads=(*moving.loads, *step.loads),
            step=TimeStep(tuple(inertia), coordinates),
        )

    def _on_cable(self, knee: Knee, step: Step) -> Muscles | None:
        """The cable expects its last pulls to go on along a straight line."""
        if step.cable is None or knee.muscles is None:
            return knee.muscles
        last, older = self.last.pull, self.older.pull
        expected = last + step.ratio * (last - older)
        return dataclasses.replace(knee.muscles, cable=Cable(step.cable, expected))

    def _dampers(self, moving: MovingKnee, step: Step) -> Dampers:
        """How taut a fibre is at the end of the step is extrapolated, which keeps the order."""
        last, older = self.last.lengths, self.older.lengths
        ahead = last + step.ratio * (last - older)
        lengthening, both_ways = damping_of(moving, ahead)
        before = step.before(last, older)
        per_s = jnp.broadcast_to(step.per_s, before.shape)
        return Dampers(lengthening, both_ways, before, per_s)

    def guess(self, step: Step) -> Array:
        """Where all coordinates are expected at the end of a step."""
        last, older, h = self.last, self.older, step.length_s
        bend = 0.5 * step.ratio * (last.rate - older.rate)
        return last.q + h * (last.rate + bend)

    def after(self, moving: MovingKnee, step: Step, q: Array, contact_points: Array) -> Moment:
        """The moment at the end of a step, by where the bones are and their contacts meet."""
        last, older = self.last, self.older
        state = State.of({}, q, moving.knee.bodies)
        places = {bone: state.poses[bone].placement for bone in moving.masses}
        lengths = moving.knee.ligaments.length(state)
        overlaps, pressing = moving.overlaps(state, contact_points)
        was = [(x.places, x.q, x.lengths, x.overlaps) for x in (last, older)]
        now = places, q, lengths, overlaps
        speeds, rate, length_rates, overlap_rates = _rates(step, now, step.before(*was))
        faster = _rates(step, speeds, step.before(last.velocities, older.velocities))
        pull, driven = last.pull, self._on_cable(moving.knee, step)
        if driven is not None and driven.cable is not None:
            pull = driven.cable.pull(driven.quadriceps_length(state))
        moved = q, rate, places, speeds, faster, lengths, length_rates
        return Moment(*moved, pull, overlaps, overlap_rates, pressing)


def _rates(step: Step, there: Any, before: Any) -> Any:
    return jax.tree.map(lambda x, y: step.per_s * (x - y), there, before)


def damping_of(moving: MovingKnee, length: Array) -> tuple[Array, Array]:
    """Damping of fibres of given lengths, N s/mm: while they lengthen, and both ways."""
    fibres = moving.knee.ligaments
    taut = tautness(length / fibres.slack_length - 1.0)
    return taut * fibres.damping / fibres.slack_length, taut * moving.fibre_damping
