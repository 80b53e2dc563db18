"""What was recorded of a leg that moved: where its bones were, and what acted on its tibia."""

from __future__ import annotations

import dataclasses
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import FEMUR_AND_TIBIA, TIBIA, Pose, State, scale
from kneejax.mechanics._knee import add_lane_axis
from kneejax.mechanics._muscles import Muscles
from kneejax.mechanics.ligaments import Course
from kneejax.numerics import compiled

#: Names of the quadriceps' heads.
_HEAD = re.compile(r"rec|vas", re.IGNORECASE)
#: Instants of a call: one program serves records of any length.
_LANES = 64


class Lines(eqx.Module):
    """Muscles over a knee, each as the piece that leaves the thigh for the leg below the knee.

    What runs along the thigh or below the knee does no work on the knee.

    Attributes:
        first: last point above the knee, in the femur's frame, `(lines, 3, n)`, mm: points on the
            pelvis move in it.
        second: first point below the knee, in the tibia's frame, `(lines, 3, n)`, mm.
        tension: `(lines, n)`, N.
        courses: around obstacles; one with an end inside its obstacle runs straight, as OpenSim
            has it.
        names: one a line.
    """

    first: Array
    second: Array
    tension: Array
    courses: tuple[Course, ...]
    names: tuple[str, ...] = eqx.field(static=True)

    def only(self, rows: tuple[int, ...]) -> Lines:
        """Some of the lines, in order."""
        courses = [
            dataclasses.replace(course, rows=kept, via=course.via[:, : len(kept)])
            for course in self.courses
            if (kept := tuple(rows.index(row) for row in course.rows if row in rows))
        ]
        some = np.array(rows, int)
        names = tuple(self.names[row] for row in rows)
        first, second = self.first[some], self.second[some]
        return Lines(first, second, self.tension[some], tuple(courses), names)

    def on_tibia(self, rows: np.ndarray, tibia: np.ndarray) -> np.ndarray:
        """What each does to the tibia about its origin, along the tibia's own axes.

        Args:
            rows: instants, `(m,)`.
            tibia: where it is there, degrees and mm, `(m, 6)`.

        Returns:
            `(lines, m, 6)`, N and N mm.
        """
        numbers = [np.asarray(x) for x in (self.first, self.second, self.tension)]
        found = np.zeros((len(self.names), len(rows), 6))
        for begin in range(0, len(rows) if self.names else 0, _LANES):
            own = np.minimum(np.arange(begin, begin + _LANES), len(rows) - 1)
            first, second, tension = (x[..., rows[own]] for x in numbers)
            here = Lines(first, second, tension, self.courses, self.names)  # pyright: ignore[reportArgumentType]
            part = np.asarray(_on_tibia(here, tibia[own]))[..., : len(rows) - begin]
            found[:, begin : begin + _LANES] = part.transpose(1, 2, 0)
        return found


@compiled()
def _on_tibia(lines: Lines, table: Array) -> Array:
    state, courses = State({TIBIA: Pose.from_table(table)}), add_lane_axis(lines.courses)
    ends = lines.first, lines.second, lines.tension, lines.names
    pairs = (FEMUR_AND_TIBIA,) * len(lines.names)
    bent, straight = (Muscles(*ends, own, pairs) for own in (courses, ()))
    inside = bent.length_and_wrap(state)[1].inside
    found = [x.unit_wrenches(state) for x in (bent, straight)]
    unit = jax.tree.map(lambda a, b: jnp.where(inside, b, a), *found)
    tibia = state.tibia.placement
    parts = [tibia.turn_back(scale(lines.tension, x)) for x in (unit.force, unit.moment)]
    return jnp.stack(jnp.broadcast_arrays(*parts[0], *parts[1]))


@dataclasses.dataclass(frozen=True)
class LegRecord:
    """A recorded movement, as a knee needs it.

    Attributes:
        time_s: of the instants, `(n,)`.
        pose: of the tibia in the femur in the record, `(n, 6)`, degrees and mm, in the order of
            `kneejax.geometry.COLUMNS`.
        acting: what acts on the leg below the knee besides muscles, by name, about the tibia's
            origin along its axes, `(n, 6)` each, N and N mm.
        lines: muscles from the thigh to the leg below the knee.
        quadriceps_N: together, of those that end on the patella, `(n,)`.
        ground_N: force of the ground on this foot, `(n, 3)`, in the ground's axes; zero without a
            record of it.
        same_frames: whether the knee was made of this model, so that frames are the same.
        mass_kg: of the leg below the knee.
        notes: what was taken as what, a sentence each.
        doubts: what a person should look at.
    """

    time_s: np.ndarray
    pose: np.ndarray
    acting: dict[str, np.ndarray]
    lines: Lines
    quadriceps_N: np.ndarray
    ground_N: np.ndarray
    same_frames: bool
    mass_kg: float
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def with_heads_on_patella(self) -> LegRecord:
        """The same where heads of the quadriceps that end on the tibia pull on the patella.

        Models without a patella have them end there; they are known by their names (`rec...`,
        `vas...`).
        """
        heads = [_HEAD.match(name) is not None for name in self.lines.names]
        if not any(heads):
            return self
        on, off = (np.flatnonzero(np.array(heads) == own) for own in (True, False))
        lines = self.lines.only(tuple(int(row) for row in off))
        pull = self.quadriceps_N + np.asarray(self.lines.tension)[on].sum(axis=0)
        return dataclasses.replace(self, lines=lines, quadriceps_N=pull)
