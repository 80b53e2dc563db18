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
from collections.abc import Mapping
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
        contact_points = moving.knee.contact_points(State.of({}, q, moving.knee.bodies))
        there, rates, pressing = jax.jvp(
            lambda x: _seen(moving, x, contact_points), (q,), (rate,), has_aux=True
        )
        (places, _, lengths, overlaps), (velocities, _, length_rates, overlap_rates) = there, rates
        nothing = jax.tree.map(jnp.zeros_like, velocities)
        moved = q, rate, places, velocities, nothing, lengths, length_rates
        pulls = jnp.broadcast_to(pull, q.shape[1:])
        return cls(*moved, pulls, overlaps, overlap_rates, pressing), contact_points


def _seen(moving: MovingKnee, q: Array, contact_points: Array) -> tuple[tuple, dict[str, Array]]:
    """What has rates: placements of bones with mass, coordinates, lengths of fibres and overlaps of
    contacts; and with what force the contacts press."""
    state = State.of({}, q, moving.knee.bodies)
    places = {bone: state.poses[bone].placement for bone in moving.masses}
    lengths = moving.knee.ligaments.length(state)
    overlaps, pressing = moving.overlaps(state, contact_points)
    return (places, q, lengths, overlaps), pressing


class History(eqx.Module):
    """What is known of a motion so far."""

    last: Moment  # its last moment
    older: Moment  # the one before it
    contact_points: Array  # where contacts met, `(n, 2, lanes)`

    def knee_of(self, moving: MovingKnee, step: Step) -> Knee:
        """The knee whose balance is the end of a step."""
        last, older, knee = self.last, self.older, moving.knee

        def expected(bone: str) -> Placement:
            place = step.before(last.places[bone], older.places[bone])
            speed = step.before(last.velocities[bone], older.velocities[bone])
            return jax.tree.map(lambda x, v: x + v / step.per_s, place, speed)

        pressing = jax.tree.map(
            lambda x, y: jnp.maximum(x + step.ratio * (x - y), 0.0), last.pressing, older.pressing
        )
        # How taut a fibre is at the end of the step is extrapolated, which keeps the order.
        ahead = last.lengths + step.ratio * (last.lengths - older.lengths)
        q, lengths, overlaps = step.before(*((x.q, x.lengths, x.overlaps) for x in (last, older)))
        acting = dataclasses.replace(
            knee, muscles=self._on_cable(knee, step), loads=(*moving.loads, *step.loads)
        )
        places = {bone: expected(bone) for bone in moving.masses}
        damping = damping_of(moving, ahead)
        return in_step(moving, acting, step.per_s, places, q, lengths, overlaps, damping, pressing)

    def _on_cable(self, knee: Knee, step: Step) -> Muscles | None:
        """The cable expects its last pulls to go on along a straight line."""
        if step.cable is None or knee.muscles is None:
            return knee.muscles
        last, older = self.last.pull, self.older.pull
        expected = last + step.ratio * (last - older)
        return dataclasses.replace(knee.muscles, cable=Cable(step.cable, expected))

    def guess(self, step: Step) -> Array:
        """Where all coordinates are expected at the end of a step."""
        last, older, h = self.last, self.older, step.length_s
        bend = 0.5 * step.ratio * (last.rate - older.rate)
        return last.q + h * (last.rate + bend)

    def after(self, moving: MovingKnee, step: Step, q: Array, contact_points: Array) -> Moment:
        """The moment at the end of a step, by where the bones are and their contacts meet."""
        last, older = self.last, self.older
        now, pressing = _seen(moving, q, contact_points)
        places, _, lengths, overlaps = now
        was = [(x.places, x.q, x.lengths, x.overlaps) for x in (last, older)]
        speeds, rate, length_rates, overlap_rates = _rates(step, now, step.before(*was))
        faster = _rates(step, speeds, step.before(last.velocities, older.velocities))
        pull, driven = last.pull, self._on_cable(moving.knee, step)
        if driven is not None and driven.cable is not None:
            state = State.of({}, q, moving.knee.bodies)
            pull = driven.cable.pull(driven.quadriceps_length(state))
        moved = q, rate, places, speeds, faster, lengths, length_rates
        return Moment(*moved, pull, overlaps, overlap_rates, pressing)


def _rates(step: Step, there: Any, before: Any) -> Any:
    return jax.tree.map(lambda x, y: step.per_s * (x - y), there, before)


def in_step(
    moving: MovingKnee, knee: Knee, per_s: Array, expected: Mapping[str, Placement], q: Array,
    lengths: Array, overlaps: Mapping[str, Array], damping: tuple[Array, Array],
    pressing: Mapping[str, Array],
) -> Knee:  # fmt: skip
    """A knee with inertia and dampers: where its bones with mass are expected; coordinates, lengths
    of fibres and overlaps that have no rate; the damping of the fibres (`damping_of`) and the
    elastic force of the contacts."""
    inertia = tuple(
        InertiaOfStep(mass, expected[bone], per_s, bone) for bone, mass in moving.masses.items()
    )
    fibres, damped, coordinates = knee.ligaments, moving.coordinate_damping, None
    if fibres.names:
        dampers = Dampers(*damping, lengths, jnp.broadcast_to(per_s, lengths.shape))
        fibres = dataclasses.replace(fibres, dampers=dampers)
    if damped:
        at = dict(zip(coordinates_of(knee.bodies), q, strict=True))
        coordinates = CoordinateDampers(damped, {name: at[name] for name in damped}, per_s)
    contacts = moving.with_contacts_damped(overlaps, pressing, per_s)
    step = TimeStep(inertia, coordinates)
    return dataclasses.replace(knee, ligaments=fibres, contacts=contacts, step=step)


def damping_of(moving: MovingKnee, length: Array) -> tuple[Array, Array]:
    """Damping of fibres of given lengths, N s/mm: while they lengthen, and both ways."""
    fibres = moving.knee.ligaments
    taut = tautness(length / fibres.slack_length - 1.0)
    return taut * fibres.damping / fibres.slack_length, taut * moving.fibre_damping
