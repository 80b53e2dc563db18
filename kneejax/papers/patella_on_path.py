"""Paper 1's patella: the path on which a patella in balance moves, with one degree of freedom."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.experiments import at_rest, passive_flexion
from kneejax.geometry import FEMUR, PATELLA, TIBIA, ZERO, Pair, Placement, Pose, State, Vector
from kneejax.mechanics import Knee, Wrench, add_lane_axis, ligament_law
from kneejax.statics import converged

#: Part of half the path by which a patella may leave it at either end.
_BEYOND = 0.1
#: Halvings of the path, then steps of Newton's method: 0.1 mm, then 1e-12.
_HALVINGS, _STEPS = 10, 6
#: Degree of the path's polynomials: a knee that rides on them turns by 0.50, 0.39, 0.41 and 0.39
#: degrees at most otherwise than with its patella in balance, with 11, 13, 15 and 17.
_DEGREE = 13
#: Where the path is taken, degrees: polynomials bend at their ends, which stand outside 0 to 120.
_FLEXION_DEG = np.arange(-10.0, 122.6, 2.5)


class Strands(eqx.Module):
    """Straight fibres from the patella on its path to another bone."""

    #: Their ends on the patella, polynomials `(k, n, 3, ...)` in the place along the path, from -1
    #: to 1, lowest power first; femur frame, mm.
    on_path: Array
    on_other: Array  # their other ends, `(n, 3, ...)`, mm, in the other bone's frame
    stiffness: Array  # N per unit strain, `(n, ...)`
    slack_length: Array  # mm, `(n, ...)`
    transition_strain: Array  # as of a ligament, like the next, `(n, ...)`
    transition_width: Array

    def lines(self, other: Placement, place: Array) -> Vector:
        """From the patella to the other bone, femur axes, each `(n, ...)`, mm."""
        return other.apply(_rows(self.on_other)) - _rows(_along(self.on_path, place))

    def tension(self, length: Array) -> Array:
        """Of each, N."""
        return ligament_law.tension(length / self.slack_length - 1.0, *self._law)

    def energy(self, length: Array) -> Array:
        """Of all together, N mm."""
        strain = length / self.slack_length - 1.0
        return jnp.sum(ligament_law.energy(strain, *self._law, self.slack_length), axis=0)

    @property
    def _law(self) -> tuple[Array, Array, Array]:
        return self.stiffness, self.transition_strain, self.transition_width


class PatellaOnPath(eqx.Module):
    """A patella on a prescribed path, hung on the tibia by its tendon, pulled by the quadriceps.

    How far it is along the path is the one thing that is free of it: there the pulls of
    quadriceps, tendon and retinacula along the path are in balance. For every pose of the tibia
    that is one number, so the whole is a potential between femur and tibia, as a spring is. The
    contact, which the path stands for, does no work.
    """

    tension: Array  # of the quadriceps, N
    ends: Array  # least and largest arc length of the path, `(2, ...)`, mm
    quadriceps: Array  # its length, mm, polynomial `(k, ...)` in the place along the path, as above
    tendon: Strands  # to the tibia
    retinacula: Strands  # to the femur
    name: str = eqx.field(static=True, default="patellar_tendon")  # what reports call it

    @property
    def bodies(self) -> Pair:
        """The two bones that it joins."""
        return FEMUR, TIBIA

    def energy(self, state: State) -> Array:
        """Of quadriceps, tendon and retinacula, N mm."""
        tibia = state.between(self.bodies)
        pulled, tendon, held = self._lengths(tibia, self._place(tibia))
        return self.tension * pulled + self.tendon.energy(tendon) + self.retinacula.energy(held)

    def wrench(self, state: State) -> Wrench:
        """Of the tendon on the tibia, about its origin in femur axes."""
        tibia = state.between(self.bodies)
        line = self.tendon.lines(tibia, self._place(tibia))
        length = line.norm()
        pull = -self.tendon.tension(length) / length * line
        moment = tibia.turn(_rows(self.tendon.on_other)).cross(pull)
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), Wrench(pull, moment))

    def work_of_end(self, state: State) -> Array:
        """Generalised force on flexion besides the wrench: none, nothing leads the patella."""
        return jnp.zeros(state.shape)

    def arc_length(self, state: State) -> Array:
        """How far the patella is along its path, mm."""
        first, last = self.ends[0], self.ends[1]
        return first + 0.5 * (1.0 + self._place(state.between(self.bodies))) * (last - first)

    def _lengths(self, tibia: Placement, place: Array) -> tuple[Array, Array, Array]:
        """Of the quadriceps, the tendon's fibres and those of the retinacula, mm."""
        fibres = (self.tendon, tibia), (self.retinacula, _FEMUR)
        tendon, held = (strands.lines(bone, place).norm() for strands, bone in fibres)
        return _along(self.quadriceps, place), tendon, held

    def _slope(self, tibia: Placement, place: Array) -> tuple[Array, Array]:
        """First and second derivative of the energy along the path: at its beginning the tendon
        pulls more than the quadriceps, at its end less."""
        onwards = (jnp.ones_like(place),)

        def slope(at: Array) -> Array:
            (_, tendon, held), longer = jax.jvp(lambda x: self._lengths(tibia, x), (at,), onwards)
            tendon, held = self.tendon.tension(tendon), self.retinacula.tension(held)
            return self.tension * longer[0] + jnp.sum(tendon * longer[1], axis=0) + jnp.sum(
                held * longer[2], axis=0
            )

        return jax.jvp(slope, (place,), onwards)

    def _place(self, tibia: Placement) -> Array:
        """Where the patella balances, from -1 to 1 along the path.

        Found without derivatives. Two last steps by the stiffness there move nothing; the first has
        the derivative of the implicit function theorem, the second its second derivative too.
        """
        still, at_rest = lax.stop_gradient((self, tibia))

        def halved(_, ends):
            low, high = ends
            middle = 0.5 * (low + high)
            beyond = still._slope(at_rest, middle)[0] > 0.0
            return jnp.where(beyond, low, middle), jnp.where(beyond, middle, high)

        def stepped(_, place):
            slope, stiffness = still._slope(at_rest, place)
            return jnp.clip(place - slope / stiffness, -1.0 - _BEYOND, 1.0 + _BEYOND)

        end = jnp.full(still._slope(at_rest, jnp.zeros(()))[0].shape, 1.0 + _BEYOND)
        low, high = lax.fori_loop(0, _HALVINGS, halved, (-end, end))
        found = lax.fori_loop(0, _STEPS, stepped, 0.5 * (low + high))
        place, stiffness = found, still._slope(at_rest, found)[1]
        for _ in range(2):
            place = place - self._slope(tibia, place)[0] / stiffness
        return place


_FEMUR = Placement(None, ZERO)


def _along(coefficients: Array, place: Array) -> Array:
    """A polynomial, lowest power first, by Horner's rule."""
    return functools.reduce(lambda value, row: value * place + row, coefficients[::-1])


def _rows(points: Array) -> Vector:
    """Points `(n, 3, ...)` as a vector of `(n, ...)`."""
    return Vector.of(jnp.moveaxis(points, 1, 0))


def on_path(knee: Knee, with_patella: Knee) -> Knee:
    """A knee of two bones whose patella rides on the path on which a patella in balance moves.

    The path is that of `with_patella`, the same knee of three bones, whose quadriceps pulls as much
    on it (paper 1, section 2.2, where the path comes from a simulation of the contact too). Lines
    of constant tension, which stand for the patella, go; the tendon's fibres and the retinacula are
    straight. Raises `ValueError` where a knee is not of these, or does not balance on the path.
    """
    if PATELLA in knee.bodies:
        raise ValueError(f"{knee.name} has its patella already: expected the knee of two bones")
    if PATELLA not in with_patella.bodies or with_patella.muscles is None:
        raise ValueError(f"{with_patella.name} has no patella: expected one read with its patella")
    motion = passive_flexion(with_patella, _FLEXION_DEG)
    lost = np.flatnonzero(~converged(np.asarray(motion.status)))
    if len(lost):
        place = f"{_FLEXION_DEG[lost[0]]:g} degrees"
        raise ValueError(f"{knee.name}: the patella has no balance at {place}; expected one there")
    state = motion.equilibrium.state
    poses = state.poses[PATELLA]
    length = np.asarray(add_lane_axis(with_patella.muscles).quadriceps_length(state))
    steps = np.linalg.norm(np.diff(np.asarray(poses.to_table())[:, 3:], axis=0), axis=1)
    arc_length = np.r_[0.0, np.cumsum(steps)]
    place = 2.0 * arc_length / arc_length[-1] - 1.0
    path = PatellaOnPath(
        tension=jnp.asarray(at_rest(with_patella)),
        ends=jnp.array([0.0, arc_length[-1]]),
        quadriceps=_polynomials(place, length),
        tendon=_strands(with_patella, (PATELLA, TIBIA), place, poses),
        retinacula=_strands(with_patella, (FEMUR, PATELLA), place, poses),
    )
    return dataclasses.replace(knee, lines=(path,))


def _strands(knee: Knee, bones: Pair, place: np.ndarray, poses: Pose) -> Strands:
    """Fibres of the patella to another bone, straight."""
    fibres = knee.ligaments
    rows = np.array([k for k, pair in enumerate(fibres.bodies) if pair == bones], int)
    ends = fibres.femoral_attachment[rows], fibres.tibial_attachment[rows]
    on_patella, on_other = ends if bones[0] == PATELLA else ends[::-1]
    moved = poses.placement.apply(Vector.of(on_patella.T[..., None]))
    law = fibres.stiffness, fibres.slack_length, fibres.transition_strain, fibres.transition_width
    paths = _polynomials(place, np.moveaxis(np.stack([*moved]), -1, 0))
    return Strands(jnp.swapaxes(paths, 1, 2), on_other, *(x[rows] for x in law))


def _polynomials(place: np.ndarray, values: np.ndarray) -> Array:
    """Coefficients `(k, ...)` of what `(poses, ...)` is along the path."""
    rows = np.polynomial.polynomial.polyfit(place, values.reshape(len(place), -1), _DEGREE)
    return jnp.asarray(rows.reshape(-1, *values.shape[1:]))
