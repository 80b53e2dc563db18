"""Ligaments as nonlinear springs between two bones, straight or around obstacles."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import FEMUR_AND_TIBIA, Pair, State, Vector, full, scale
from kneejax.mechanics._wrench import Wrench, Wrenches
from kneejax.mechanics.ligaments import _law as law
from kneejax.mechanics.ligaments._courses import Course
from kneejax.mechanics.ligaments._dampers import Dampers
from kneejax.mechanics.ligaments._failure_strain import FibreFaults, usual_failure_strain
from kneejax.mechanics.ligaments._fibres import Fibres, WrapState


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
        nothing = jnp.zeros_like(self.stiffness)
        self.damping = nothing if damping is None else jnp.asarray(damping, float)
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
        return length, wrap, full(scale(self.tension_at(length), pulls))

    def tension_at(self, length: Array) -> Array:
        """Tension of each fibre at given lengths, N."""
        strain = length / self.slack_length - 1.0
        return law.tension(strain, self.stiffness, self.transition_strain, self.transition_width)

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
            stiffness, slack_length, transition_strain, transition_width, failure_strain = (
                self._of(course.rows, x)
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
            each = law.energy(strain, stiffness, transition_strain, transition_width, slack_length)
            if self.dampers is not None:
                rows = course.rows
                dampers = jax.tree.map(lambda x, rows=rows: self._of(rows, x), self.dampers)
                tension = tension + dampers.tension(length)
                each = each + dampers.energy(length)
            forces = Wrench(full(scale(tension, pull.force)), full(scale(tension, pull.moment)))
            answer.add(course.bodies, forces)
            energy = energy + jnp.sum(each, axis=0)
            over = over | jnp.any(strain > failure_strain, axis=0)
            for path in bent:
                past = past | jnp.any(path.beyond_ends, axis=0)
                inside = inside | jnp.any(path.inside, axis=0)
        return answer, energy, FibreFaults(over, past, inside)

    def energy(self, state: State) -> Array:
        """Energy of all fibres together, shape `(...)`, N mm."""
        return self.pull(state)[1]
