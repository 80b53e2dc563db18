"""Where all bodies of a knee are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry._coordinates import (
    BODIES,
    FEMUR,
    TIBIA,
    Pair,
    Prescribed,
    coordinate,
    free_of,
)
from kneejax.geometry._pose import Placement, Pose, from_drawer


class State(eqx.Module):
    """The pose of every body that moves against the femur.

    Attributes:
        poses: body -> its pose, all of one shape.

    Example:
        >>> state = State.of({"flexion": 0.5, "anterior": 2.0}, jnp.zeros((4, 1)))
        >>> float(state.tibia.anterior[0]), float(state.tibia.superior[0])
        (2.0, 0.0)
    """

    poses: dict[str, Pose]

    @classmethod
    def of(cls, prescribed: Prescribed, q: Array, bodies: Sequence[str] = (TIBIA,)) -> State:
        """Make a state from its prescribed and its free coordinates.

        Args:
            prescribed: coordinate -> its value, rad or mm.
            q: the others, `(free, ...)`, rad and mm, in the order of `kneejax.geometry.free_of`.
            bodies: that move.
        """
        values = {**prescribed, **dict(zip(free_of(prescribed, bodies), q, strict=True))}
        if "drawer" in values:
            turned = from_drawer(values["flexion"], values["drawer"], values["lift"])
            values["anterior"], values["superior"] = turned
        names = [name for body in bodies for name in BODIES[body]]
        every = jnp.broadcast_arrays(*(jnp.asarray(values[name], float) for name in names))
        rows = dict(zip(names, every, strict=True))
        return cls({body: Pose(*(rows[name] for name in BODIES[body])) for body in bodies})

    @property
    def tibia(self) -> Pose:
        """The tibia's pose."""
        return self.poses[TIBIA]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the batch."""
        return jnp.shape(self.tibia.adduction)

    def at(self, names: Iterable[str]) -> Array:
        """Some of the coordinates, `(len(names), ...)`, rad and mm."""
        places = [coordinate(name) for name in names]
        values = [getattr(self.poses[one.body], one.way) for one in places]
        return jnp.stack(jnp.broadcast_arrays(*values))

    def between(self, pair: Pair) -> Placement:
        """The motion from the second body's coordinates to the first's."""
        first, second = pair
        if first == FEMUR:
            return self.poses[second].placement
        back = self.poses[first].placement.inverse()
        return back if second == FEMUR else back.after(self.poses[second].placement)
