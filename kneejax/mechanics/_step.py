"""What one implicit step through time adds to a knee: inertia, and dampers of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import FEMUR, State
from kneejax.mechanics._mass import InertiaOfStep
from kneejax.mechanics._wrench import Wrenches


class CoordinateDampers(eqx.Module):
    """Dampers along coordinates, as OpenSim JAM damps a joint until it has settled.

    Attributes:
        damping: coordinate -> N mm s per rad of a rotation, N s per mm of a translation, `(...)`.
        before: coordinate -> where its rate would be none, rad or mm.
        per_s: 1/s; rates are it times how far coordinates are from there.
    """

    damping: Mapping[str, Array]
    before: Mapping[str, Array]
    per_s: Array

    def forces(self, state: State) -> dict[str, Array]:
        """Coordinate -> the force along it, N mm or N."""
        there = dict(zip(self.damping, state.at(self.damping), strict=True))
        return {
            name: -c * self.per_s * (there[name] - self.before[name])
            for name, c in self.damping.items()
        }

    def energy(self, state: State) -> Array:
        """Potential of the forces, N mm."""
        there = zip(self.damping, state.at(self.damping), strict=True)
        squares = (self.damping[name] * (x - self.before[name]) ** 2 for name, x in there)
        return 0.5 * self.per_s * sum(squares)


class TimeStep(eqx.Module):
    """The parts of a knee that there are during a step only.

    Each has a potential, so that the balance of a knee with them is the implicit step.

    Attributes:
        inertia: of the bones that have mass.
        coordinates: dampers along coordinates; None without any.
    """

    inertia: tuple[InertiaOfStep, ...]
    coordinates: CoordinateDampers | None = None

    def pull(self, state: State, wrenches: Wrenches) -> Array:
        """Add what inertia does to the bones.

        Returns:
            Energy of all parts, N mm.
        """
        total = jnp.zeros(state.shape)
        for part in self.inertia:
            there = state.poses[part.bone].placement
            total = total + part.energy(there)
            wrenches.add((FEMUR, part.bone), part.wrench(there).alone())
        return total if self.coordinates is None else total + self.coordinates.energy(state)

    def work(self, state: State, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force of the dampers along coordinates; 0 for those without."""
        nothing = jnp.zeros(state.shape)
        forces = {} if self.coordinates is None else self.coordinates.forces(state)
        return tuple(nothing + forces.get(name, 0.0) for name in names)
