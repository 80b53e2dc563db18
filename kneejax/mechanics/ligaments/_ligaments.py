"""Ligaments as nonlinear springs between femur and tibia, straight or around obstacles."""

from __future__ import annotations

import functools
import operator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import Placement, TautPath, Vector, add, full, norm, scale, subtract
from kneejax.mechanics._wrench import Wrench
from kneejax.mechanics.ligaments import _law as law
from kneejax.mechanics.ligaments._courses import Course, Piece, by_kind
from kneejax.mechanics.ligaments._failure_strain import FibreFaults, usual_failure_strain


class WrapState(eqx.Module):
    """How fibres pass their obstacles; fibres without one are free.

    Attributes:
        angle: rad over which a fibre lies on its obstacle, `(n, ...)`; not positive where free,
            minus infinity without an obstacle.
        inside: whether an end lies inside the obstacle: its length means nothing then.
        side: unit direction from the obstacle's centre to the fibre, in the obstacle's frame,
            each component `(n, ...)`; zero without an obstacle. A jump between poses is a flip.
        other_side: how much longer the way around the other side is, mm, `(n, ...)`; infinite
            where free. Near zero two ways compete.
        beyond_ends: whether the fibre touches a cylinder beyond its length, `(n, ...)`.
    """

    angle: Array
    inside: Array
    side: Vector
    other_side: Array
    beyond_ends: Array


class Ligaments(eqx.Module):
    """A set of fibres, one row each.

    Attributes:
        femoral_attachment: shape `(n, 3, ...)`, mm, femur frame.
        tibial_attachment: shape `(n, 3, ...)`, mm, tibia frame.
        stiffness: shape `(n, ...)`, N per unit strain.
        slack_length: shape `(n, ...)`, mm.
        transition_strain: shape `(n, ...)`; the parabola ends there (`2 eps_l` of paper 1).
        transition_width: shape `(n, ...)`; rounding of the law's corners, in strain.
        failure_strain: shape `(n, ...)`; beyond it a fibre would tear. No force depends on it. The
            published value of each fibre's kind by default (`usual_failure_strain`).
        courses: of the fibres that have via points or an obstacle; the others are straight.
        names: one name per fibre.

    Example:
        >>> acl = Ligaments([[0, 0, 0]], [[10, -28, 0]], [4500.0], [29.0], [0.03], [0.001], ["ACL"])
        >>> acl.names
        ('ACL',)
    """

    femoral_attachment: Array
    tibial_attachment: Array
    stiffness: Array
    slack_length: Array
    transition_strain: Array
    transition_width: Array
    failure_strain: Array
    courses: tuple[Course, ...]
    names: tuple[str, ...] = eqx.field(static=True)

    def __init__(
        self,
        femoral_attachment: ArrayLike,
        tibial_attachment: ArrayLike,
        stiffness: ArrayLike,
        slack_length: ArrayLike,
        transition_strain: ArrayLike,
        transition_width: ArrayLike,
        names: tuple[str, ...] | list[str],
        courses: tuple[Course, ...] | list[Course] = (),
        failure_strain: ArrayLike | None = None,
    ):
        # No fibres at all come as empty lists.
        ends = [jnp.asarray(x, float) for x in (femoral_attachment, tibial_attachment)]
        ends = [end if end.size else jnp.zeros((0, 3)) for end in ends]
        self.femoral_attachment, self.tibial_attachment = ends
        self.stiffness = jnp.asarray(stiffness, float)
        self.slack_length = jnp.asarray(slack_length, float)
        self.transition_strain = jnp.asarray(transition_strain, float)
        self.transition_width = jnp.asarray(transition_width, float)
        if failure_strain is None:
            lanes = (1,) * (self.stiffness.ndim - 1)
            failure_strain = usual_failure_strain(names).reshape(-1, *lanes)
        self.failure_strain = jnp.asarray(failure_strain, float)
        self.courses = tuple(courses)
        self.names = tuple(names)

    def __check_init__(self):
        rows = [row for course in self.courses for row in course.rows]
        if len(set(rows)) < len(rows) or not set(rows) <= set(range(len(self.names))):
            raise ValueError(f"Ligaments.courses name rows {rows}; expected each once, existing")

    @property
    def straight(self) -> tuple[int, ...]:
        """Rows of the fibres without via points and obstacles."""
        bent = {row for course in self.courses for row in course.rows}
        return tuple(row for row in range(len(self.names)) if row not in bent)

    @property
    def kinds(self) -> tuple[Course, ...]:
        """The courses, with those in one that can be computed together."""
        return by_kind(self.courses, self.stiffness.ndim > 1)

    def line(self, tibia: Placement) -> Vector:
        """Vector from femoral to tibial attachment in femur axes, components `(n, ...)`, mm."""
        return _arm_and_line(self.femoral_attachment, self.tibial_attachment, tibia)[1]

    def length(self, tibia: Placement) -> Array:
        """Length of each fibre along its course, shape `(n, ...)`, mm."""
        if not self.courses:
            return norm(self.line(tibia))
        kinds = self.kinds
        return self._joined(kinds, [length for length, *_ in self._ways(kinds, tibia)])

    def strain(self, tibia: Placement) -> Array:
        """Strain of each fibre: length over slack length, minus one."""
        return self.length(tibia) / self.slack_length - 1.0

    def tension(self, tibia: Placement) -> Array:
        """Tension of each fibre, shape `(n, ...)`, N."""
        return self.tension_at(self.length(tibia))

    def tension_at(self, length: Array) -> Array:
        """Tension of each fibre at given lengths, N."""
        strain = length / self.slack_length - 1.0
        return law.tension(
            strain, self.stiffness, self.transition_strain, self.transition_width
        )

    def wrenches(self, tibia: Placement) -> list[Wrench]:
        """The wrenches of `pull`."""
        return self.pull(tibia)[0]

    def pull(self, tibia: Placement) -> tuple[list[Wrench], Array, FibreFaults]:
        """What the fibres do to the tibia.

        Returns:
            Wrenches about the tibia's origin in femur axes, the energy of all fibres, N mm, and
            what is wrong with any of them. Each wrench holds several fibres along its first axis:
            kinds of courses are kept apart, since only their sum is wanted where speed matters.
        """
        answer, energy = [], jnp.zeros(jnp.shape(tibia.translation[0]))
        over = past = inside = jnp.zeros_like(energy, bool)
        kinds = self.kinds
        for rows, (length, pulls, bent) in zip(
            self._rows(kinds), self._ways(kinds, tibia), strict=True
        ):
            stiffness, slack_length, transition_strain, transition_width, failure_strain = (
                self._of(rows, x)
                for x in (
                    self.stiffness,
                    self.slack_length,
                    self.transition_strain,
                    self.transition_width,
                    self.failure_strain,
                )
            )
            strain = length / slack_length - 1.0
            tension = law.tension(strain, stiffness, transition_strain, transition_width)
            pull = functools.reduce(operator.add, pulls)
            answer.append(
                Wrench(full(scale(tension, pull.force)), full(scale(tension, pull.moment)))
            )
            each = law.energy(strain, stiffness, transition_strain, transition_width, slack_length)
            energy = energy + jnp.sum(each, axis=0)
            over = over | jnp.any(strain > failure_strain, axis=0)
            for path in bent:
                past = past | jnp.any(path.beyond_ends, axis=0)
                inside = inside | jnp.any(path.inside, axis=0)
        return answer, energy, FibreFaults(over, past, inside)

    def energy(self, tibia: Placement) -> Array:
        """Energy of all fibres together, shape `(...)`, N mm."""
        return self.pull(tibia)[1]

    def length_and_wrap(self, tibia: Placement) -> tuple[Array, WrapState]:
        """Lengths, `(n, ...)`, mm, and how the fibres pass their obstacles.

        Of a fibre's several pieces the most bent one counts.
        """
        if not self.courses:
            length = norm(self.line(tibia))
            return length, _free(length)
        kinds, lengths, states = self.kinds, [], []
        if self.straight:
            lengths = [norm(_arm_and_line(*self._ends(self.straight), tibia)[1])]
            states = [_free(lengths[0])]
        for course in kinds:
            pieces = self._pieces(course, tibia)
            lengths.append(functools.reduce(operator.add, (piece.length for piece in pieces)))
            bent = [piece.taut for piece in pieces if piece.taut is not None]
            states.append(functools.reduce(_more_bent, bent, _free(lengths[-1])))
        wrap = jax.tree.map(lambda *x: self._joined(kinds, list(x)), *states)
        return self._joined(kinds, lengths), wrap

    def ends_inside(self, tibia: Placement) -> Array:
        """Whether an end of each fibre lies inside the fibre's obstacle, `(n, ...)`."""
        inside = jnp.zeros(len(self.names), bool)
        for course in self.courses:
            found = course.ends_inside(*self._ends(course.rows), tibia)
            inside = inside.at[np.array(course.rows)].set(found)
        return inside

    def _rows(self, kinds: tuple[Course, ...]) -> list[tuple[int, ...]]:
        straight = [self.straight] if self.straight else []
        return [*straight, *(course.rows for course in kinds)]

    def _of(self, rows: tuple[int, ...], array: Array) -> Array:
        """Rows of an array; all of them, or neighbours, without a gather."""
        first, last = rows[0], rows[-1] + 1
        if rows == tuple(range(first, last)):
            return array if last - first == len(self.names) else array[first:last]
        return array[np.array(rows)]

    def _ends(self, rows: tuple[int, ...]) -> tuple[Array, Array]:
        return self._of(rows, self.femoral_attachment), self._of(rows, self.tibial_attachment)

    def _joined(self, kinds: tuple[Course, ...], parts: list[Array]) -> Array:
        """What was computed kind by kind, straight fibres first, in the order of the fibres."""
        order = np.argsort([row for rows in self._rows(kinds) for row in rows])
        shape = jnp.broadcast_shapes(*(part.shape[1:] for part in parts))
        return jnp.concatenate([jnp.broadcast_to(x, (len(x), *shape)) for x in parts])[order]

    def _pieces(self, course: Course, tibia: Placement) -> list[Piece]:
        return course.pieces(*self._ends(course.rows), tibia)

    def _ways(
        self, kinds: tuple[Course, ...], tibia: Placement
    ) -> list[tuple[Array, list[Wrench], list[TautPath]]]:
        """Of straight fibres and each kind of course: lengths, wrenches of unit tensions, and ways
        around obstacles."""
        ways = []
        if self.straight:
            arm, line = _arm_and_line(*self._ends(self.straight), tibia)
            length = norm(line)
            unit = scale(-1.0 / jnp.where(length > 0, length, 1.0), line)
            ways.append((length, [Wrench.at(arm, unit)], []))
        for course in kinds:
            pieces = self._pieces(course, tibia)
            length = functools.reduce(operator.add, (piece.length for piece in pieces))
            bent = [piece.taut for piece in pieces if piece.taut is not None]
            ways.append((length, [piece.pull for piece in pieces], bent))
        return ways


def _arm_and_line(femoral: Array, tibial: Array, tibia: Placement) -> tuple[Vector, Vector]:
    """Tibial attachments from the tibia's origin and from the femoral ones, femur axes."""
    # One broadcast here instead of one in every product: its transpose is a sum.
    tibia = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(femoral), *jnp.shape(x))), tibia)
    arm = tibia.turn((tibial[:, 0], tibial[:, 1], tibial[:, 2]))
    away = (femoral[:, 0], femoral[:, 1], femoral[:, 2])
    return arm, subtract(add(arm, tibia.translation), away)


def _free(length: Array) -> WrapState:
    """Of fibres without an obstacle."""
    zero = jnp.zeros_like(length)
    return WrapState(zero - jnp.inf, zero > 0, (zero, zero, zero), zero + jnp.inf, zero > 0)


def _more_bent(before: WrapState, path: TautPath) -> WrapState:
    more = path.angle > before.angle
    return WrapState(
        jnp.where(more, path.angle, before.angle),
        before.inside | path.inside,
        tuple(jnp.where(more, a, b) for a, b in zip(path.side, before.side, strict=True)),
        jnp.where(more, path.detour_other_side, before.other_side),
        before.beyond_ends | path.beyond_ends,
    )
