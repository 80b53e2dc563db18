"""Ligaments as straight nonlinear springs between femur and tibia."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import Placement, Vector, add, norm, scale, subtract
from kneejax.mechanics import _ligament_law as law
from kneejax.mechanics._wrench import Wrench


class Ligaments(eqx.Module):
    """A set of straight fibres, one row each.

    Attributes:
        femoral_attachment: shape `(n, 3, ...)`, mm, femur frame.
        tibial_attachment: shape `(n, 3, ...)`, mm, tibia frame.
        stiffness: shape `(n, ...)`, N per unit strain.
        slack_length: shape `(n, ...)`, mm.
        transition_strain: shape `(n, ...)`; the parabola ends there (`2 eps_l` of paper 1).
        transition_width: shape `(n, ...)`; rounding of the law's corners, in strain.
        names: one name a fibre.

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
    ):
        self.femoral_attachment = jnp.asarray(femoral_attachment, float)
        self.tibial_attachment = jnp.asarray(tibial_attachment, float)
        self.stiffness = jnp.asarray(stiffness, float)
        self.slack_length = jnp.asarray(slack_length, float)
        self.transition_strain = jnp.asarray(transition_strain, float)
        self.transition_width = jnp.asarray(transition_width, float)
        self.names = tuple(names)

    def line(self, tibia: Placement) -> Vector:
        """Vector from femoral to tibial attachment in femur axes, components `(n, ...)`, mm."""
        return self._arm_and_line(tibia)[1]

    def _arm_and_line(self, tibia: Placement) -> tuple[Vector, Vector]:
        """Tibial attachment from the tibia's origin and from the femoral one, femur axes."""
        a, b = self.femoral_attachment, self.tibial_attachment
        # One broadcast here instead of one in every product: its transpose is a sum.
        tibia = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(self.names), *x.shape)), tibia)
        arm = tibia.turn((b[:, 0], b[:, 1], b[:, 2]))
        return arm, subtract(add(arm, tibia.translation), (a[:, 0], a[:, 1], a[:, 2]))

    def length(self, tibia: Placement) -> Array:
        """Length of each fibre, shape `(n, ...)`, mm."""
        return norm(self.line(tibia))

    def strain(self, tibia: Placement) -> Array:
        """Strain of each fibre: length over slack length, minus one."""
        return self.length(tibia) / self.slack_length - 1.0

    def tension(self, tibia: Placement) -> Array:
        """Tension of each fibre, shape `(n, ...)`, N."""
        return law.tension(
            self.strain(tibia), self.stiffness, self.transition_strain, self.transition_width
        )

    def wrench(self, tibia: Placement) -> Wrench:
        """Of each fibre on the tibia, about the tibia's origin in femur axes; `(n, ...)`."""
        arm, line = self._arm_and_line(tibia)
        length = norm(line)
        tension = law.tension(
            length / self.slack_length - 1.0,
            self.stiffness,
            self.transition_strain,
            self.transition_width,
        )
        pull = -tension / jnp.where(length > 0, length, 1.0)
        return Wrench.at(arm, scale(pull, line))

    def energy(self, tibia: Placement) -> Array:
        """Energy of all fibres together, shape `(...)`, N mm."""
        each = law.energy(
            self.strain(tibia),
            self.stiffness,
            self.transition_strain,
            self.transition_width,
            self.slack_length,
        )
        return jnp.sum(each, axis=0)
