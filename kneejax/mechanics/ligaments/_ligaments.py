"""Ligaments as nonlinear springs between two bones, straight or around obstacles."""

__all__ = ["BLANKEVOORT", "LIGAMENT_LAWS", "NEO_HOOKEAN", "Fibres", "Ligaments", "WrapState"]

import functools
import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import FEMUR, FEMUR_AND_TIBIA, Pair, State, TautPath, Vector
from kneejax.mechanics._loads import Wrench, Wrenches
from kneejax.mechanics.ligaments import _law as law
from kneejax.mechanics.ligaments import _neo_hookean as neo_hookean
from kneejax.mechanics.ligaments._courses import Course, by_kind
from kneejax.mechanics.ligaments._law import Dampers, FibreFaults, usual_failure_strain

#: Laws of a fibre: a parabola and a line, and that of an incompressible neo-Hookean band.
BLANKEVOORT, NEO_HOOKEAN = LIGAMENT_LAWS = "blankevoort", "neo_hookean"


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


class Fibres(eqx.Module):
    """Lines between two attachments each, one row each.

    Attributes:
        femoral_attachment: shape `(n, 3, ...)`, mm, femur frame; of a fibre between other bones,
            the attachment to the first of them, in its frame.
        tibial_attachment: shape `(n, 3, ...)`, mm, tibia frame; to the second bone.
        courses: of the fibres that have via points or an obstacle; the others are straight.
        names: one name per fibre.
        bodies: the two bones that each fibre joins.
    """

    femoral_attachment: Array
    tibial_attachment: Array
    courses: tuple[Course, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    bodies: tuple[Pair, ...] = eqx.field(static=True)

    def __check_init__(self):
        rows = [row for course in self.courses for row in course.rows]
        if len(set(rows)) < len(rows) or not set(rows) <= set(range(len(self.names))):
            kind = type(self).__name__
            raise ValueError(f"{kind}.courses name rows {rows}; expected each once, existing")
        for course in self.courses:
            if {self.bodies[row] for row in course.rows} - {course.bodies}:
                kind = type(self).__name__
                raise ValueError(
                    f"{kind}.bodies: rows of a course between {course.bodies} join others"
                )

    @property
    def kinds(self) -> tuple[Course, ...]:
        """All fibres in courses, each of what can be computed together; straight ones first."""
        bent = {row for course in self.courses for row in course.rows}
        straight: dict[Pair, list[int]] = {} if self.names else {FEMUR_AND_TIBIA: []}
        for row, pair in enumerate(self.bodies):
            if row not in bent:
                straight.setdefault(pair, []).append(row)
        without = (Course(rows, bodies=pair) for pair, rows in straight.items())
        return *without, *by_kind(self.courses, self.femoral_attachment.ndim > 2)

    def length(self, state: State) -> Array:
        """Length of each fibre along its course, shape `(n, ...)`, mm."""
        kinds = self.kinds
        return self._joined(kinds, [way.length for way in self._ways(kinds, state)])

    def length_wrap_and_pulls(self, state: State) -> tuple[Array, WrapState, Vector]:
        """Lengths, `(n, ...)`, mm, how the fibres pass their obstacles, and `unit_pulls`.

        Of a fibre's several pieces the most bent one counts.
        """
        kinds = self.kinds
        ways = self._ways(kinds, state)
        wraps = [functools.reduce(_more_bent, way.bent, _free(way.length)) for way in ways]
        wrap = jax.tree.map(lambda *x: self._joined(kinds, list(x)), *wraps)
        length = self._joined(kinds, [way.length for way in ways])
        return length, wrap, self._unit_pulls(kinds, ways, state)

    def unit_pulls(self, state: State) -> Vector:
        """Force of a unit tension on the second bone of each, in femur axes, each `(n, ...)`."""
        kinds = self.kinds
        return self._unit_pulls(kinds, self._ways(kinds, state), state)

    def _unit_pulls(self, kinds: tuple[Course, ...], ways: "list[_Way]", state: State) -> Vector:
        found = []
        for way in ways:
            first, force = way.course.bodies[0], way.pull.force.full()
            found.append(force if first == FEMUR else state.poses[first].placement.turn(force))
        return Vector(*(self._joined(kinds, list(parts)) for parts in zip(*found, strict=True)))

    def unit_wrenches(self, state: State) -> Wrench:
        """What a unit tension of each does to its second bone, about that bone's origin in the
        axes of the first, each component `(n, ...)`."""
        kinds = self.kinds
        pulls = [way.pull for way in self._ways(kinds, state)]
        rows = ([pull.force.full() for pull in pulls], [pull.moment.full() for pull in pulls])
        return Wrench(*(
            Vector(*(self._joined(kinds, list(parts)) for parts in zip(*row, strict=True)))
            for row in rows
        ))  # fmt: skip

    def ends_inside(self, state: State) -> Array:
        """Whether an end of each fibre lies inside the fibre's obstacle, `(n, ...)`."""
        inside = jnp.zeros(len(self.names), bool)
        for course in self.courses:
            found = course.ends_inside(*self._ends(course.rows), state.between(course.bodies))
            inside = inside.at[np.array(course.rows)].set(found)
        return inside

    def _of(self, rows: tuple[int, ...], array: Array) -> Array:
        """Rows of an array; all of them as they are."""
        return array if rows == tuple(range(len(self.names))) else _rows_of(array, rows)

    def _ends(self, rows: tuple[int, ...]) -> tuple[Array, Array]:
        return self._of(rows, self.femoral_attachment), self._of(rows, self.tibial_attachment)

    def _joined(self, kinds: tuple[Course, ...], parts: list[Array]) -> Array:
        """What was computed kind by kind, in the order of the fibres."""
        order = np.argsort([row for course in kinds for row in course.rows])
        if len(parts) == 1 and list(order) == list(range(len(order))):  # spares a gather
            return parts[0]
        shape = jnp.broadcast_shapes(*(part.shape[1:] for part in parts))
        return jnp.concatenate([jnp.broadcast_to(x, (len(x), *shape)) for x in parts])[order]

    def _ways(self, kinds: tuple[Course, ...], state: State) -> "list[_Way]":
        """How the fibres of each kind run."""
        ways = []
        for course in kinds:
            pieces = course.pieces(*self._ends(course.rows), state.between(course.bodies))
            length = functools.reduce(operator.add, (piece.length for piece in pieces))
            pull = functools.reduce(operator.add, (piece.pull for piece in pieces))
            bent = [piece.taut for piece in pieces if piece.taut is not None]
            ways.append(_Way(course, length, pull, bent))
        return ways


class _Way(NamedTuple):
    """Fibres of one kind: lengths, the wrench of unit tensions, ways around obstacles."""

    course: Course
    length: Array
    pull: Wrench
    bent: list[TautPath]


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _rows_of(array: Array, rows: tuple[int, ...]) -> Array:
    """Some rows of an array; neighbours without a gather."""
    first, last = (rows[0], rows[-1] + 1) if rows else (0, 0)
    return array[first:last] if rows == tuple(range(first, last)) else array[np.array(rows)]


@_rows_of.defjvp
def _rows_of_jvp(rows: tuple[int, ...], primals, tangents):
    # By a matrix of zeros and ones: backwards a slice becomes a pad and a gather a scatter, and
    # kernels that XLA (jaxlib 0.10.2) makes of several abort the process.
    (array,), (change,) = primals, tangents
    chosen = np.equal.outer(rows, np.arange(len(array))).astype(float)
    return _rows_of(array, rows), jnp.tensordot(chosen, change, 1)


def _free(length: Array) -> WrapState:
    """Of fibres without an obstacle."""
    zero = jnp.zeros_like(length)
    return WrapState(zero - jnp.inf, zero > 0, Vector(zero, zero, zero), zero + jnp.inf, zero > 0)


def _more_bent(before: WrapState, path: TautPath) -> WrapState:
    more = path.angle > before.angle
    return WrapState(
        jnp.where(more, path.angle, before.angle),
        before.inside | path.inside,
        Vector(*(jnp.where(more, a, b) for a, b in zip(path.side, before.side, strict=True))),
        jnp.where(more, path.detour_other_side, before.other_side),
        before.beyond_ends | path.beyond_ends,
    )


class Ligaments(Fibres):
    """A set of elastic fibres, one row each.

    Attributes:
        femoral_attachment: shape `(n, 3, ...)`, mm, femur frame; of a fibre between other bones,
            the attachment to the first of them, in its frame.
        tibial_attachment: shape `(n, 3, ...)`, mm, tibia frame; to the second bone.
        stiffness: shape `(n, ...)`, N per unit strain.
        slack_length: shape `(n, ...)`, mm.
        transition_strain: shape `(n, ...)`; the parabola ends there (`2 eps_l` of paper 1).
        transition_width: shape `(n, ...)`; rounding of the law's corners, in strain.
        failure_strain: shape `(n, ...)`; beyond it a fibre would tear. No force depends on it. The
            published value of each fibre's kind by default (`usual_failure_strain`).
        damping: shape `(n, ...)`, N s: times the rate of strain it is the force that resists
            stretching. Nothing at rest depends on it. 0 by default.
        area: shape `(n, ...)`, mm^2, cross-section of the band of which a fibre is a part; 0 where
            it is not known. Its stiffness is Young's modulus times this.
        laws: of each fibre, one of `LIGAMENT_LAWS`; that of Blankevoort by default. The transition
            strain is no part of the neo-Hookean one.
        dampers: during a step through time; None at rest.
        courses: of the fibres that have via points or an obstacle; the others are straight.
        names: one name per fibre.
        bodies: the two bones that each fibre joins; femur and tibia where none are named.

    Example:
        >>> acl = Ligaments([[0, 0, 0]], [[10, -28, 0]], [4500.0], [29.0], [0.03], [0.001], ["ACL"])
        >>> acl.names
        ('ACL',)
    """

    stiffness: Array
    slack_length: Array
    transition_strain: Array
    transition_width: Array
    failure_strain: Array
    damping: Array
    area: Array
    laws: tuple[str, ...] = eqx.field(static=True)
    dampers: Dampers | None

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
        bodies: tuple[Pair, ...] | None = None,
        damping: ArrayLike | None = None,
        dampers: Dampers | None = None,
        area: ArrayLike | None = None,
        laws: tuple[str, ...] | list[str] | None = None,
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
            usual = usual_failure_strain(names)
            failure_strain = usual.reshape(-1, *(1,) * (self.stiffness.ndim - 1))
        self.failure_strain = jnp.asarray(failure_strain, float)
        damping, area = (
            jnp.zeros_like(self.stiffness) if x is None else jnp.asarray(x, float)
            for x in (damping, area)
        )
        self.damping, self.area = damping, area
        self.laws = (BLANKEVOORT,) * len(names) if laws is None else tuple(laws)
        self.dampers = dampers
        self.courses = tuple(courses)
        self.names = tuple(names)
        self.bodies = (FEMUR_AND_TIBIA,) * len(self.names) if bodies is None else tuple(bodies)

    def strain(self, state: State) -> Array:
        """Strain of each fibre: length over slack length, minus one."""
        return self.length(state) / self.slack_length - 1.0

    def tension(self, state: State) -> Array:
        """Tension of each fibre, shape `(n, ...)`, N."""
        return self.tension_at(self.length(state))

    def length_wrap_and_forces(self, state: State) -> tuple[Array, WrapState, Vector]:
        """As `length_wrap_and_pulls`, with forces of the fibres' tensions, N."""
        length, wrap, pulls = self.length_wrap_and_pulls(state)
        return length, wrap, (self.tension_at(length) * pulls).full()

    def tension_at(self, length: Array) -> Array:
        """Tension of each fibre at given lengths, N."""
        every = tuple(range(len(self.names)))
        return self._tension_and_energy(every, length / self.slack_length - 1.0)[0]

    def _tension_and_energy(self, rows: tuple[int, ...], strain: Array) -> tuple[Array, Array]:
        """Tensions, N, and energies, N mm, of some fibres at given strains."""
        stiffness, slack_length, toe, width = (
            self._of(rows, x)
            for x in (
                self.stiffness,
                self.slack_length,
                self.transition_strain,
                self.transition_width,
            )
        )
        found = {
            BLANKEVOORT: lambda: (
                law.tension(strain, stiffness, toe, width),
                law.energy(strain, stiffness, toe, width, slack_length),
            ),
            NEO_HOOKEAN: lambda: (
                neo_hookean.tension(strain, stiffness, width),
                neo_hookean.energy(strain, stiffness, width, slack_length),
            ),
        }
        laws = [self.laws[row] for row in rows]
        if len(set(laws)) < 2:
            return found[laws[0] if laws else BLANKEVOORT]()
        # Both laws are finite at every strain, so no derivative meets what is not a number.
        which = np.array([name == NEO_HOOKEAN for name in laws])
        which = which.reshape(-1, *(1,) * (strain.ndim - 1))
        a, b = found[NEO_HOOKEAN](), found[BLANKEVOORT]()
        return jnp.where(which, a[0], b[0]), jnp.where(which, a[1], b[1])

    def pull(self, state: State) -> tuple[Wrenches, Array, FibreFaults]:
        """What the fibres do to the bones that they join.

        Returns:
            Wrenches, the energy of all fibres, N mm, and what is wrong with any of them. Each
            wrench holds several fibres along its first axis: kinds of courses are kept apart,
            since only their sum is wanted where speed matters.
        """
        answer, energy = Wrenches(), jnp.zeros(state.shape)
        over = past = inside = jnp.zeros_like(energy, bool)
        for course, length, pull, bent in self._ways(self.kinds, state):
            rows = course.rows
            strain = length / self._of(rows, self.slack_length) - 1.0
            tension, each = self._tension_and_energy(rows, strain)
            if self.dampers is not None:
                dampers = jax.tree.map(lambda x, rows=rows: self._of(rows, x), self.dampers)
                tension = tension + dampers.tension(length)
                each = each + dampers.energy(length)
            forces = Wrench((tension * pull.force).full(), (tension * pull.moment).full())
            answer.add(course.bodies, forces)
            energy = energy + jnp.sum(each, axis=0)
            over = over | jnp.any(strain > self._of(rows, self.failure_strain), axis=0)
            for path in bent:
                past = past | jnp.any(path.beyond_ends, axis=0)
                inside = inside | jnp.any(path.inside, axis=0)
        return answer, energy, FibreFaults(over, past, inside)

    def energy(self, state: State) -> Array:
        """Energy of all fibres together, shape `(...)`, N mm."""
        return self.pull(state)[1]
