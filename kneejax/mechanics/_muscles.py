"""Muscles as lines of given tension, cables of given length, and what pulls more than at rest."""

__all__ = ["QUADRICEPS", "Cable", "Muscles", "Pull", "pull_of"]

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import FEMUR_AND_TIBIA, PATELLA, Pair, State
from kneejax.mechanics._loads import Wrench, Wrenches
from kneejax.mechanics.ligaments import Course, FibreFaults, Fibres
from kneejax.numerics import positive_part

#: N/mm. A cable is as stiff as poses can be told apart: 1e-9 mm, to which they are found, are
#: 1e-4 N of its pull, and ten times the stiffest cartilage.
CABLE_N_PER_MM = 1e5
#: N: over such pulls it becomes slack, as a cable cannot push.
_ROUNDING_N, _LEAST_N = 1.0, 0.05


class Cable(eqx.Module):
    """A motor that gives the quadriceps its length (paper 3, Eq 20).

    Heads share its pull as they share their tension at rest, and its length is the mean of theirs
    with the same shares: pull times a change of it is the work that it does. It stretches by a
    hundredth of a micrometre for each N by which its pull differs from what was expected. From
    step to step through time that is next to nothing: the pull is the multiplier of a given length.

    Attributes:
        length: that the motor gives, mm, `(...)`.
        expected: pull at which the cable has that length, N, `(...)`.

    Example:
        >>> import jax.numpy as jnp
        >>> float(Cable(jnp.array(400.0), jnp.array(250.0)).length)
        400.0
    """

    length: Array
    expected: Array

    def pull(self, length: Array) -> Array:
        """N, at a length of the quadriceps, mm; 0 where the cable is slack."""
        return CABLE_N_PER_MM * positive_part(self._stretch(length), _ROUNDING_N / CABLE_N_PER_MM)

    def energy(self, length: Array) -> Array:
        """Potential of the pull, N mm."""
        x, w = self._stretch(length), _ROUNDING_N / CABLE_N_PER_MM
        inner = x * (x + jnp.sqrt(x * x + w * w)) + w * w * jnp.arcsinh(x / w)
        return 0.25 * CABLE_N_PER_MM * inner

    def _stretch(self, length: Array) -> Array:
        """Of the cable, mm, counted so that it pulls as expected where it has its length."""
        y = jnp.maximum(self.expected, _LEAST_N) / CABLE_N_PER_MM
        w = _ROUNDING_N / CABLE_N_PER_MM
        return length - self.length + y - w * w / (4.0 * y)


#: All muscles that pull on the patella, as the name of a line that pulls.
QUADRICEPS = "quadriceps"


class Muscles(Fibres):
    """Lines that pull with a given tension whatever their length, one row each.

    A tension that does not depend on the pose is a potential, tension times length, so the
    stiffness of a knee with muscles stays symmetric.

    Attributes:
        femoral_attachment: origin, shape `(n, 3, ...)`, mm, femur frame.
        tibial_attachment: insertion, `(n, 3, ...)`, mm, in the frame of the second bone.
        tension: shape `(n, ...)`, N; of a head of the quadriceps on a cable, what it has besides.
        cable: on the quadriceps while a motor gives it its length; None without.
        courses: of the muscles that have via points or an obstacle; the others are straight.
        names: one name per muscle.
        bodies: the two bones that each joins; femur and tibia where none are named.

    Example:
        >>> head = Muscles([[10, 180, 20]], [[0, 18, 0]], [200.0], ["vasint"])
        >>> float(head.tension[0])
        200.0
    """

    tension: Array
    cable: Cable | None

    def __init__(
        self,
        femoral_attachment: ArrayLike,
        tibial_attachment: ArrayLike,
        tension: ArrayLike,
        names: tuple[str, ...] | list[str],
        courses: tuple[Course, ...] | list[Course] = (),
        bodies: tuple[Pair, ...] | None = None,
        cable: Cable | None = None,
    ):
        self.femoral_attachment = jnp.asarray(femoral_attachment, float)
        self.tibial_attachment = jnp.asarray(tibial_attachment, float)
        self.tension = jnp.asarray(tension, float)
        self.cable = cable
        self.courses = tuple(courses)
        self.names = tuple(names)
        self.bodies = (FEMUR_AND_TIBIA,) * len(self.names) if bodies is None else tuple(bodies)

    @property
    def quadriceps(self) -> tuple[int, ...]:
        """Rows of the muscles that pull on the patella."""
        return tuple(row for row, (_, bone) in enumerate(self.bodies) if bone == PATELLA)

    @property
    def shares(self) -> Array:
        """Of each muscle in the pull of the quadriceps, `(n, ...)`: as tensions at rest."""
        heads = jnp.array([row in self.quadriceps for row in range(len(self.names))])
        of_heads = jnp.where(heads.reshape(-1, *(1,) * (self.tension.ndim - 1)), self.tension, 0.0)
        return of_heads / jnp.sum(of_heads, axis=0)

    def quadriceps_length(self, state: State) -> Array:
        """Mean length of the heads with their shares, `(...)`, mm."""
        return jnp.sum(self.shares * self.length(state), axis=0)

    def pulling(self, more_N: Mapping[str, ArrayLike]) -> "Muscles":
        """The same with more tension in some of them.

        Args:
            more_N: muscle, or `QUADRICEPS` for all heads in proportion to what each has, -> what
                is added.
        """
        rows = list(self.tension)
        for name, more in more_N.items():
            if name == QUADRICEPS:
                shares = self.shares
                for row in self.quadriceps:
                    rows[row] = rows[row] + more * shares[row]
            elif name in self.names:
                row = self.names.index(name)
                rows[row] = rows[row] + more
        return dataclasses.replace(self, tension=jnp.stack(jnp.broadcast_arrays(*rows)))

    def ending(self, ends: Mapping[str, Array]) -> "Muscles":
        """The same with ends of some elsewhere.

        Args:
            ends: muscle -> where it begins and ends, `(2, 3, ...)`, mm, each in its bone's frame.
        """
        rows = [list(self.femoral_attachment), list(self.tibial_attachment)]
        for name, both in ends.items():
            for own, end in zip(rows, both, strict=True):
                own[self.names.index(name)] = end
        femoral, tibial = (jnp.stack(jnp.broadcast_arrays(*own)) for own in rows)
        return dataclasses.replace(self, femoral_attachment=femoral, tibial_attachment=tibial)

    def only(self, rows: Sequence[int]) -> "Muscles":
        """Some of the muscles, in order."""
        courses = [
            dataclasses.replace(course, rows=kept, via=course.via[:, np.isin(course.rows, rows)])
            for course in self.courses
            if (kept := tuple(rows.index(row) for row in course.rows if row in rows))
        ]
        some = np.array(rows, int)
        ends = self.femoral_attachment[some], self.tibial_attachment[some]
        names, bodies = (tuple(x[row] for row in rows) for x in (self.names, self.bodies))
        return Muscles(*ends, self.tension[some], names, courses, bodies, self.cable)

    def with_more(self, others: "Muscles") -> "Muscles":
        """These and, after them, others.

        Raises:
            ValueError: one of the others has the name of one of these.
        """
        if same := sorted(set(self.names) & set(others.names)):
            raise ValueError(f"two muscles are called {', '.join(same)}: expected another name")
        femoral, tibial, tension = (
            jnp.concatenate([getattr(self, name), getattr(others, name)])
            for name in ("femoral_attachment", "tibial_attachment", "tension")
        )
        first = len(self.names)
        more = [
            dataclasses.replace(course, rows=tuple(first + row for row in course.rows))
            for course in others.courses
        ]
        names, bodies = (*self.names, *others.names), (*self.bodies, *others.bodies)
        courses = (*self.courses, *more)
        return Muscles(femoral, tibial, tension, names, courses, bodies, self.cable)

    def pull(self, state: State) -> tuple[Wrenches, Array, FibreFaults]:
        """What the muscles do to the bones that they join.

        Returns:
            Wrenches, each of several muscles along its first axis; their energy, N mm; and whether
            any lies wrongly on its obstacle. None tears.
        """
        kinds, answer, energy = self.kinds, Wrenches(), jnp.zeros(state.shape)
        past = inside = jnp.zeros_like(energy, bool)
        ways, more = self._ways(kinds, state), None
        if self.cable is not None:
            length = jnp.sum(self.shares * self._joined(kinds, [x.length for x in ways]), axis=0)
            energy = energy + self.cable.energy(length)
            more = self.shares * self.cable.pull(length)
        for course, length, pull, bent in ways:
            tension = self._of(course.rows, self.tension)
            energy = energy + jnp.sum(tension * length, axis=0)
            if more is not None:
                tension = tension + self._of(course.rows, more)
            forces = Wrench((tension * pull.force).full(), (tension * pull.moment).full())
            answer.add(course.bodies, forces)
            for path in bent:
                past = past | jnp.any(path.beyond_ends, axis=0)
                inside = inside | jnp.any(path.inside, axis=0)
        return answer, energy, FibreFaults(jnp.zeros_like(past), past, inside)

    def on_tibia(self, state: State) -> Array:
        """What each that joins femur and tibia does to the tibia about its origin, along the
        tibia's own axes, `(n, 6, ...)`, N and N mm."""
        unit, tibia = self.unit_wrenches(state), state.tibia.placement
        parts = [tibia.turn_back(self.tension * x) for x in (unit.force, unit.moment)]
        return jnp.stack(jnp.broadcast_arrays(*parts[0], *parts[1]), axis=1)

    def energy(self, state: State) -> Array:
        """Tension times length of all together, and of the cable, shape `(...)`, N mm."""
        return self.pull(state)[1]


class Pull(eqx.Module):
    """Tension that is added to lines or muscles of a knee, as a load that grows like any other.

    Its lines grow together. Only where a knee is balanced (`kneejax.statics.LoadCases`).

    Attributes:
        tension: that is added to each, shape `(..., lines)`, N.
        ends: where each begins, in the femur's frame, and ends, in that of the bone it pulls, shape
            `(..., lines, 2, 3)`, mm: a muscle that comes from the pelvis begins elsewhere in the
            femur at each angle of the hip. Of muscles only; None where they stay where they are.
        lines: names of the knee's lines and muscles; `QUADRICEPS` stands for all its heads.

    Example:
        >>> pull = Pull([80.0], ("patellar_tendon",))
        >>> pull.lines, pull.tension.tolist()
        (('patellar_tendon',), [80.0])
    """

    tension: Array
    ends: Array | None
    lines: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, tension: ArrayLike, lines: tuple[str, ...], ends: ArrayLike | None = None):
        self.tension = jnp.asarray(tension, float)
        self.ends = None if ends is None else jnp.asarray(ends, float)
        self.lines = tuple(lines)

    @property
    def sizes(self) -> Array:
        """How much pulls, `(..., lines)`, N."""
        return self.tension

    @property
    def places(self) -> tuple[Array, ...]:
        """Where it pulls: what stays while it grows."""
        return () if self.ends is None else (self.ends,)

    def times(self, part: ArrayLike) -> "Pull":
        """A part of it, `(...)` or one."""
        return dataclasses.replace(self, tension=jnp.asarray(part)[..., None] * self.tension)

    def at_each(self, shape: tuple[int, ...]) -> "Pull":
        """Once for each of `shape` load cases."""
        ends = self.ends
        if ends is not None:
            ends = jnp.broadcast_to(ends, (*shape, *ends.shape[-3:]))
        tension = jnp.broadcast_to(self.tension, (*shape, len(self.lines)))
        return dataclasses.replace(self, tension=tension, ends=ends)


def pull_of(line: str, tension_N: ArrayLike) -> Pull:
    """Tension that is added to one of a knee's lines.

    Args:
        line: its name, e.g. `patellar_tendon`; a muscle's, or `QUADRICEPS`.
        tension_N: one, or `(n,)` for `kneejax.statics.LoadCases`.

    Example:
        >>> pull_of("patellar_tendon", [0.0, 50.0]).tension.tolist()
        [[0.0], [50.0]]
    """
    return Pull(jnp.asarray(tension_N, float)[..., None], (line,))
