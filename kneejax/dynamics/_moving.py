"""A knee with mass and dampers; what an implicit step must know of its past, and what follows.

The formula is BDF2 with variable steps. Of a quantity `y` the rate at the end of a step `h` is

    rate = per_s (y - before),   per_s = (1 + 2 r) / (1 + r) / h,
    before = ((1 + r) y_1 - r^2 / (1 + r) y_0) / (h per_s)

with `y_1` and `y_0` its last two values and `r` the ratio of `h` to the step between them; `r = 0`
is the step of order one with which a motion begins. Inertia follows the formula twice, for every
point of a bone (positions make velocities, velocities accelerations), dampers once.
"""

__all__ = ["MovingKnee", "Step", "gravity_of"]

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import (
    PATELLA,
    TIBIA,
    Placement,
    Prescribed,
    State,
    coordinate,
    coordinates_of,
)
from kneejax.mechanics import (
    Cable,
    ContactDamper,
    CoordinateDampers,
    Dampers,
    InertiaOfStep,
    Knee,
    Load,
    Mass,
    Muscles,
    TimeStep,
    critical_damping,
    tautness,
)
from kneejax.numerics import WrongValue

#: m/s^2, of a thigh that stands still in any attitude.
GRAVITY = 9.80665
#: What the weight of a bone is called among loads.
WEIGHT = "weight"


class MovingKnee(eqx.Module):
    """A knee with mass and damping; every number of it is a leaf.

    Fibres are damped by `knee.ligaments.damping` (N s, while they lengthen) and by what stands
    here. A bone without mass is in balance at every moment.

    Attributes:
        knee: its loads act throughout.
        masses: bone -> its mass.
        fibre_damping: of each fibre, N s/mm, `(n, ...)`, lengthening or shortening.
        coordinate_damping: coordinate -> N mm s per rad of a rotation, N s/mm of a translation.
        gravity_m_s2: along the femur's axes, `(3, ...)`; zeros without.
        contact_dissipation: contact -> s/mm by which its force grows with the rate of its overlap.

    Raises:
        ValueError: a mass of a bone that the knee has not, a coordinate or a contact that is none
            of its, or as many coefficients as it has no fibres.

    Example:
        >>> import numpy as np
        >>> import kneejax as kj
        >>> ball = Mass(3.5, [0.0, -250.0, 0.0], np.diag([5e4, 5e3, 5e4]))
        >>> moving = MovingKnee.of(kj.load_knee("four_ligament"), ball)
        >>> moving.critically_damped().fibre_damping.round(2).tolist()
        [1.56, 1.24, 1.22, 1.25]
    """

    knee: Knee
    masses: Mapping[str, Mass]
    fibre_damping: Array
    coordinate_damping: Mapping[str, Array]
    gravity_m_s2: Array
    contact_dissipation: Mapping[str, Array] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls, knee: Knee, shank: Mass, *, patella: Mass | None = None,
        fibre_damping: ArrayLike = 0.0, coordinate_damping: Mapping[str, ArrayLike] | None = None,
        gravity_m_s2: ArrayLike = (0.0, 0.0, 0.0),
        contact_dissipation: Mapping[str, ArrayLike] | None = None,
    ) -> "MovingKnee":  # fmt: skip
        """Make one from the mass of the shank.

        Args:
            knee: any knee.
            shank: what moves with the tibia: shank and foot.
            patella: its mass; None leaves it in balance at every moment.
            fibre_damping: N s/mm, one for all fibres or `(n,)`.
            coordinate_damping: as the attribute.
            gravity_m_s2: as the attribute; see `gravity_of`.
            contact_dissipation: as the attribute.
        """
        masses = {TIBIA: shank} if patella is None else {TIBIA: shank, PATELLA: patella}
        every = jnp.broadcast_to(jnp.asarray(fibre_damping, float), (len(knee.ligaments.names),))
        damped = {k: jnp.asarray(c, float) for k, c in (coordinate_damping or {}).items()}
        pressed = {k: jnp.asarray(c, float) for k, c in (contact_dissipation or {}).items()}
        return cls(knee, masses, every, damped, jnp.asarray(gravity_m_s2, float), pressed)

    def __check_init__(self):
        known = {"masses": self.knee.bodies, "coordinate_damping": coordinates_of(self.knee.bodies),
                 "contact_dissipation": self.knee.contact_names}  # fmt: skip
        for field, names in known.items():
            for name in getattr(self, field):
                if name not in names:
                    which = ", which move" if field == "masses" else ""
                    raise WrongValue(field, repr(name), f"of {', '.join(names)}{which}")
        count, given = len(self.knee.ligaments.names), len(self.fibre_damping)
        if given != count:
            raise WrongValue("fibre_damping", f"{given} rows", f"{count}, one a fibre")

    def critically_damped(self, part: ArrayLike = 1.0) -> "MovingKnee":
        """With the damping of paper 2 in every fibre: `sqrt(4 k m)` of the tibia's mass.

        Args:
            part: of that damping.
        """
        fibres = self.knee.ligaments
        critical = critical_damping(
            fibres.stiffness, fibres.slack_length, self.masses[TIBIA].mass_kg
        )
        return dataclasses.replace(self, fibre_damping=jnp.asarray(part, float) * critical)

    def damped_everywhere(self, per_mm: ArrayLike) -> "MovingKnee":
        """With every coordinate damped alike, to settle.

        Args:
            per_mm: N s/mm of translations; of rotations as at an arm of 30 mm.
        """
        c = jnp.asarray(per_mm, float)
        every = coordinates_of(self.knee.bodies)
        damping = {name: c / coordinate(name).scale ** 2 for name in every}
        return dataclasses.replace(self, coordinate_damping=damping)

    def overlaps(
        self, state: State, contact_points: Array
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """What dampers of contacts must know: contact -> its overlap, mm, and elastic force, N.

        Args:
            state: where the bones are.
            contact_points: points near those where surfaces meet, `(n, 2, lanes)`.
        """
        overlap, pressing, row = {}, {}, 0
        for name, contact in zip(self.knee.contact_names, self.knee.contacts, strict=True):
            near = contact_points[row] if contact.has_patch else None
            row += contact.has_patch
            if name in self.contact_dissipation:
                there = contact.overlap(state.between(contact.bodies), near)
                overlap[name], pressing[name] = there
        return overlap, pressing

    @property
    def weights(self) -> tuple[Load, ...]:
        """Of its bones."""
        g, nothing = self.gravity_m_s2, jnp.zeros_like(self.gravity_m_s2)
        return tuple(
            Load(mass.mass_kg * g, nothing, mass.center_mm, point_in=bone, name=WEIGHT, bone=bone)
            for bone, mass in self.masses.items()
        )

    @property
    def loads(self) -> tuple[Load, ...]:
        """What acts throughout: the knee's own loads and the weights of its bones."""
        return *self.knee.loads, *self.weights


def gravity_of(femur_deg: float) -> tuple[float, float, float]:
    """Gravity along the femur's axes, m/s^2.

    Args:
        femur_deg: of the femur from the horizontal, knee above hip positive: 0 for a person who
            sits, -90 for one who stands.

    Example:
        >>> [round(x, 3) for x in gravity_of(-90.0)], [round(x, 3) for x in gravity_of(0.0)]
        ([-0.0, -9.807, 0.0], [-9.807, 0.0, 0.0])
    """
    turn = math.radians(femur_deg)
    return -GRAVITY * math.cos(turn), GRAVITY * math.sin(turn), 0.0


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
    ) -> "tuple[Moment, Array]":
        """At the start, of rates `(6 bodies, lanes)` and pull, N; and where contacts meet."""
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
    """What has rates: places, coordinates, lengths, overlaps; and how hard the contacts press."""
    state = State.of({}, q, moving.knee.bodies)
    places = {bone: state.poses[bone].placement for bone in moving.masses}
    lengths = moving.knee.ligaments.length(state)
    overlaps, pressing = moving.overlaps(state, contact_points)
    return (places, q, lengths, overlaps), pressing


class History(eqx.Module):
    """What is known of a motion so far, which goes from step to step."""

    last: Moment  # its last moment
    older: Moment  # the one before it
    contact_points: Array  # where contacts met, `(n, 2, lanes)`
    ended: Array  # whether it has, `(lanes,)`
    status: Array  # of its last step, `(lanes,)`

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
    contacts = list(moving.knee.contacts)
    for k, name in enumerate(knee.contact_names):
        if name in moving.contact_dissipation:
            each = moving.contact_dissipation[name], pressing[name], overlaps[name], per_s
            damper = ContactDamper(*(jnp.broadcast_to(x, overlaps[name].shape) for x in each))
            contacts[k] = eqx.tree_at(
                lambda c: c.damper, contacts[k], damper, is_leaf=lambda x: x is None
            )
    step = TimeStep(inertia, coordinates)
    return dataclasses.replace(knee, ligaments=fibres, contacts=tuple(contacts), step=step)


def damping_of(moving: MovingKnee, length: Array) -> tuple[Array, Array]:
    """Damping of fibres of given lengths, N s/mm: while they lengthen, and both ways."""
    fibres = moving.knee.ligaments
    taut = tautness(length / fibres.slack_length - 1.0)
    return taut * fibres.damping / fibres.slack_length, taut * moving.fibre_damping
