"""Mass of the bones, and what an implicit step through time adds to a knee."""

__all__ = ["CoordinateDampers", "InertiaOfStep", "Mass", "TimeStep"]

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import FEMUR, TIBIA, ZERO, Matrix, Placement, State, Vector, numbers
from kneejax.mechanics._loads import Wrench, Wrenches
from kneejax.numerics import traced

#: N s^2/mm in a kg.
N_S2_PER_MM = 1e-3
# Relative to the largest moment: what rounding of published tables may break of the triangle rule.
_TRIANGLE = 1e-9


class Mass(eqx.Module):
    """A rigid mass that moves with a bone.

    Attributes:
        mass_kg: shape `(...)`.
        center_mm: of mass, in the bone's frame, shape `(3, ...)`.
        inertia_kg_mm2: about the centre, along the bone's axes, shape `(3, 3, ...)`.

    Raises:
        ValueError: a negative mass, an inertia that is not symmetric, or one that no distribution
            of mass has: each principal moment is at most the sum of the two others.

    Example:
        >>> ball = Mass(2.0, [0.0, -50.0, 0.0], np.eye(3) * 800.0)
        >>> Mass(2.0, [0.0, 0.0, 0.0], np.diag([1.0, 1.0, 3.0]))
        Traceback (most recent call last):
        ValueError: Mass.inertia_kg_mm2 has principal moments 1, 1, 3; expected none above the sum \
of the two others
    """

    mass_kg: Array = numbers()
    center_mm: Array = numbers()
    inertia_kg_mm2: Array = numbers()

    def __check_init__(self):
        if traced(self) or not all(isinstance(x, Array) for x in (self.mass_kg, self.center_mm)):
            return
        mass = np.asarray(self.mass_kg)
        if not (mass >= 0.0).all():
            raise ValueError(f"Mass.mass_kg is {mass.min():g}; expected 0 or more")
        inertia = np.moveaxis(np.asarray(self.inertia_kg_mm2), (0, 1), (-2, -1))
        if not np.allclose(inertia, np.swapaxes(inertia, -2, -1), rtol=1e-9, atol=0.0):
            raise ValueError("Mass.inertia_kg_mm2 is not symmetric")
        moments = np.linalg.eigvalsh(inertia).reshape(-1, 3)
        for one in moments:
            if one[2] > one[0] + one[1] + _TRIANGLE * abs(one[2]) or one[0] < 0.0:
                told = ", ".join(f"{x:g}" for x in one)
                raise ValueError(
                    f"Mass.inertia_kg_mm2 has principal moments {told}; expected none above the "
                    "sum of the two others"
                )

    def with_point(self, mass_kg: ArrayLike, at_mm: ArrayLike) -> "Mass":
        """With a further mass at a point of the bone, of one knee.

        Args:
            mass_kg: of the point.
            at_mm: in the bone's frame, shape `(3,)`.
        """
        at = jnp.asarray(at_mm, float)
        whole = self.mass_kg + mass_kg
        center = (self.mass_kg * self.center_mm + mass_kg * at) / jnp.where(whole > 0, whole, 1.0)
        inertia = self.inertia_kg_mm2
        for part, place in ((self.mass_kg, self.center_mm), (mass_kg, at)):
            arm = place - center
            inertia = inertia + part * (jnp.dot(arm, arm) * jnp.eye(3) - jnp.outer(arm, arm))
        return Mass(whole, center, inertia)

    @property
    def second_moment_kg_mm2(self) -> Array:
        """Of the mass about its centre: half the trace of the inertia, minus the inertia."""
        inertia = self.inertia_kg_mm2
        half = 0.5 * (inertia[0, 0] + inertia[1, 1] + inertia[2, 2])
        unit = jnp.eye(3).reshape(3, 3, *(1,) * (inertia.ndim - 2))
        return half * unit - inertia

    def kinetic_energy(self, velocity: Placement) -> Array:
        """Of the bone, N mm.

        Args:
            velocity: rate at which the bone's placement changes: of a point `p` of the bone it is
                `velocity.apply(p)`, mm/s.
        """
        return 0.5 * N_S2_PER_MM * self._square(velocity)

    def _square(self, moved: Placement) -> Array:
        """Sum over the mass of the squares of `moved.apply(p)`, kg times mm^2."""
        center = moved.apply(Vector.of(self.center_mm))
        turned = _columns(moved)
        second = self.second_moment_kg_mm2
        spread = sum(
            turned[i] @ (second[i, j] * turned[j]) for i in range(3) for j in range(3)
        )
        return self.mass_kg * (center @ center) + spread


class InertiaOfStep(eqx.Module):
    """What the inertia of a bone does in one implicit step through time.

    Where the accelerations of the bone's points are `per_s^2` times how far they are from where
    they are expected, inertia is a spring that pulls every point there: a quadratic potential of
    the bone's placement. Where they are expected is an affine map of the bone, whatever linear
    formula the steps follow.

    Attributes:
        mass: of the bone.
        expected: where its points are expected, as a map whose matrix need be no rotation.
        per_s: factor between a displacement and the velocity that it makes, 1/s, `(...)`.
        bone: that it moves with.
    """

    mass: Mass
    expected: Placement
    per_s: Array
    bone: str = eqx.field(static=True, default=TIBIA)

    def energy(self, there: Placement) -> Array:
        """N mm, of where the bone is in the femur."""
        return 0.5 * N_S2_PER_MM * self.per_s**2 * self.mass._square(_minus(there, self.expected))

    def wrench(self, there: Placement) -> Wrench:
        """On the bone, about its origin in femur axes."""
        factor = -N_S2_PER_MM * self.per_s**2
        off = _minus(there, self.expected)
        center = Vector.of(self.mass.center_mm)
        force = factor * self.mass.mass_kg * off.apply(center)
        second = self.mass.second_moment_kg_mm2
        here, turned = _columns(there), _columns(off)
        couple = ZERO
        for i in range(3):
            pulled = ZERO
            for j in range(3):
                pulled = pulled + second[i, j] * turned[j]
            couple = couple + here[i].cross(pulled)
        return Wrench.at(there.turn(center), force, factor * couple)


def _minus(one: Placement, other: Placement) -> Placement:
    """The difference of two affine maps."""
    a, b = one.rotation, other.rotation
    assert a is not None and b is not None
    return Placement(a - b, one.translation - other.translation)


def _columns(of: Placement) -> Matrix:
    assert of.rotation is not None
    return of.rotation.T


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
