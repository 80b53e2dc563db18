"""Courses of fibres and the obstacles that they pass, at poses, in the frames of bones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import FEMUR, State
from kneejax.mechanics import QUADRICEPS, Knee, add_lane_axis
from kneejax.mechanics.ligaments import Fibres, Ligaments
from kneejax.report.scene.pressure import lots
from kneejax.report.scene.surfaces import obstacle_grid

#: Points on a piece of a fibre that goes around an obstacle.
_AROUND = 14


@dataclasses.dataclass(frozen=True)
class Places:
    """Where bones are at poses: bone -> rotations into the femur's axes, `(poses, 3, 3)`, and
    translations, `(poses, 3)`; the femur, which stands still, is not among them."""

    rigid: dict[str, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, state: State) -> Places:
        """Where each bone is in a state."""
        found = {}
        for bone, pose in state.poses.items():
            place = pose.placement
            turn = [np.stack([np.asarray(x) for x in row], axis=-1) for row in place.rotation or ()]
            shift = np.stack([np.asarray(x) for x in place.translation], axis=-1)
            found[bone] = np.stack(turn, axis=-2), shift
        return cls(found)

    def moved(self, points_mm: np.ndarray, bone: str, to: str, i: int) -> np.ndarray:
        """Points of a bone, `(..., 3)`, in the frame of another at a pose."""
        if bone == to:
            return points_mm
        if bone != FEMUR:
            turn, shift = (x[i] for x in self.rigid[bone])
            points_mm = points_mm @ turn.T + shift
        if to != FEMUR:
            turn, shift = (x[i] for x in self.rigid[to])
            points_mm = (points_mm - shift) @ turn
        return points_mm


@dataclasses.dataclass(frozen=True)
class Line:
    """The course of a fibre at all poses: points in a bone's frame, `(k, 3, poses)`."""

    name: str
    group: str
    bone: str
    points_mm: np.ndarray
    strain: np.ndarray
    tension_N: np.ndarray


def ligament_lines(knee: Knee, state: State) -> list[Line]:
    """All fibres of the ligaments."""
    fibres = knee.ligaments
    if not fibres.names:
        return []
    lines, length, tension = _courses(fibres, state)
    strain = length / np.asarray(fibres.slack_length)[:, None] - 1.0
    groups = {fibre: name for name, members in reversed(knee.groups) for fibre in members}
    return [Line(name, groups.get(name, name), pair[0], lines[i], strain[i], tension[i])
            for i, (name, pair) in enumerate(zip(fibres.names, fibres.bodies, strict=True))]


def quadriceps_lines(knee: Knee, state: State) -> list[Line]:
    """The heads of the quadriceps."""
    muscles = knee.muscles
    if muscles is None or not muscles.quadriceps:
        return []
    lines, *_ = _courses(muscles, state)
    nothing = np.zeros(state.shape)
    return [
        Line(muscles.names[row], QUADRICEPS, muscles.bodies[row][0], lines[row], nothing + np.nan,
             nothing + float(muscles.tension[row]))
        for row in muscles.quadriceps
    ]  # fmt: skip


def _courses(fibres: Fibres, state: State) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Courses in their first bones' axes, each `(k, 3, poses)`; lengths, and tensions of ligaments,
    `(fibres, poses)`."""
    parts = [_drawn(fibres, some) for some in lots(state)]
    count = state.shape[0]

    def joined(arrays) -> np.ndarray:
        return np.concatenate([np.asarray(x) for x in arrays], axis=-1)[..., :count]

    lines = {}
    for rows, *drawn in zip(parts[0][3], *(part[0] for part in parts), strict=True):
        points = joined(drawn)
        lines |= {row: points[:, :, i] for i, row in enumerate(rows)}
    of_all = (joined(part[i] for part in parts) for i in (1, 2))
    return [lines[row] for row in range(len(lines))], *of_all


@eqx.filter_jit
def _drawn(fibres: Fibres, state: State):
    """Fibres of one kind of course together, `(k, 3, fibres, poses)`; all lengths and tensions; the
    rows of each kind.

    One array a kind: each point as a result of its own would take minutes to compile.
    """
    fibres = add_lane_axis(fibres)
    drawn, kinds = [], fibres.kinds
    for course in kinds:
        rows = np.array(course.rows)
        ends = fibres.femoral_attachment[rows], fibres.tibial_attachment[rows]
        shape = (len(rows), *state.shape)
        points = []
        for piece in course.polylines(*ends, state.between(course.bodies), _AROUND):
            points += piece[1:] if points else piece
        stacked = [jnp.stack([jnp.broadcast_to(jnp.asarray(c), shape) for c in point])
                   for point in points]  # fmt: skip
        drawn.append(jnp.stack(stacked))
    length = fibres.length(state)
    tension = fibres.tension_at(length) if isinstance(fibres, Ligaments) else length
    return drawn, length, tension, [course.rows for course in kinds]


def obstacles(knee: Knee, every: Sequence[Line], places: Places) -> list[tuple[np.ndarray, str]]:
    """Grids of what ligaments go around, in their bones' frames, each once, with their bones."""
    found: dict[tuple, tuple[np.ndarray, str]] = {}
    passing: dict[tuple, list[np.ndarray]] = {}
    for course in knee.ligaments.courses:
        if course.obstacle is None:
            continue
        bone, leaves = course.obstacle_bone, jax.tree.leaves(course.obstacle)
        key = type(course.obstacle), bone, *(np.asarray(x).tobytes() for x in leaves)
        passing.setdefault(key, []).extend(places.moved(line.points_mm[:, :, i], line.bone, bone, i)
                                           for line in (every[row] for row in course.rows)
                                           for i in range(line.points_mm.shape[-1]))  # fmt: skip
        found[key] = obstacle_grid(course.obstacle, np.concatenate(passing[key])), bone
    return list(found.values())
