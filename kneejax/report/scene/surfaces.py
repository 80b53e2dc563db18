"""What pictures of a knee are made of, at poses: surfaces, obstacles, and courses of fibres."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax import geometry
from kneejax.geometry import FEMUR, TIBIA, Obstacle, Pose, State, Surface, Vector, WrapCylinder
from kneejax.mechanics import QUADRICEPS, Knee, Muscles, add_lane_axis
from kneejax.mechanics.ligaments import Ligaments

_ROUND = 48
#: Poses that are computed together; points on a piece of a fibre that goes around an obstacle.
_LOT, _AROUND = 8, 14
#: Surfaces whose points are kept: a knee has four to eight, and is drawn again at every pose.
_REMEMBERED = 64
#: A long cylinder is drawn this far beyond the fibres that pass it, in steps of, mm.
_BEYOND, _STEP = 12.0, 5.0


def remembered(find: Callable[..., Any]) -> Callable[..., Any]:
    """A function of surfaces and arrays that does not compute again what it has found of equals."""
    known: dict[tuple, Any] = {}

    @functools.wraps(find)
    def answer(*given: Any) -> Any:
        leaves, structure = jax.tree.flatten(given)
        key = structure, *(np.asarray(x).tobytes() for x in leaves)
        if key not in known:
            if len(known) >= _REMEMBERED:
                known.pop(next(iter(known)))
            known[key] = find(*given)
        return known[key]

    return answer


@remembered
def surface_grid(surface: Surface, points: tuple[int, int]) -> np.ndarray:
    """Points over the whole region of a surface, `(m, n, 3)`, in its bone's frame, mm."""
    (a0, a1), (b0, b1) = surface.bounds()
    a, b = jnp.meshgrid(jnp.linspace(a0, a1, points[0]), jnp.linspace(b0, b1, points[1]),
                        indexing="ij")  # fmt: skip
    point = surface.frame.placement.apply(surface.point(a, b))
    return np.stack([np.broadcast_to(np.asarray(x), a.shape) for x in point], axis=-1)


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles of a grid of points, `(2 (rows - 1)(columns - 1), 3)`."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel()
                  for x in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
    return np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def tube(line: np.ndarray, thickness: float, sides: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Corners, `(k sides, 3)`, and triangles around a line of `k` points."""
    apart = line[1:] - line[:-1]
    along = np.concatenate([apart[:1], apart[1:] + apart[:-1], apart[-1:]])
    along /= np.maximum(np.sqrt((along**2).sum(axis=1, keepdims=True)), 1e-9)
    axis = int(np.argmin(np.abs(line[-1] - line[0])))
    first = -along[:, axis : axis + 1] * along
    first[:, axis] += 1.0
    first *= 0.5 * thickness / np.sqrt((first**2).sum(axis=1, keepdims=True))
    (x, y, z), (u, v, w) = along.T, first.T
    second = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
    cosine, sine = _circle(sides)
    rings = line[:, None] + cosine * first[:, None] + sine * second[:, None]
    return rings.reshape(-1, 3).astype(np.float32), _faces(len(line), sides)


@functools.cache
def _circle(sides: int) -> tuple[np.ndarray, np.ndarray]:
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[:, None]
    return np.cos(turn), np.sin(turn)


@functools.cache
def _faces(count: int, sides: int) -> np.ndarray:
    number = np.arange(count * sides).reshape(count, sides)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    return faces.astype(np.uint32)


def obstacle_grid(obstacle: Obstacle, passing_mm: np.ndarray) -> np.ndarray:
    """Points on a wrap obstacle, `(m, n, 3)`, in its bone's frame, mm."""
    if not isinstance(obstacle, WrapCylinder):
        return _closed(obstacle)
    turn, shift = _placed(obstacle.frame)
    along, half = (passing_mm - shift) @ turn[:, 2], 0.5 * float(obstacle.length)
    # In whole steps: fibres that slide a little leave it as it is.
    low = _STEP * np.floor((along.min() - _BEYOND) / _STEP)
    high = _STEP * np.ceil((along.max() + _BEYOND) / _STEP)
    t = np.linspace(max(low, -half), min(high, half), _ROUND // 2 + 1)
    around, t = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1), t, indexing="ij")
    radius = float(obstacle.radius)
    own = np.stack([radius * np.cos(around), radius * np.sin(around), t], axis=-1)
    return own @ turn.T + shift


@remembered
def _closed(obstacle: Obstacle) -> np.ndarray:
    """Points on a ball or an ellipsoid."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1),
                             np.linspace(0, np.pi, _ROUND // 2 + 1), indexing="ij")  # fmt: skip
    axes = (float(x) for x in obstacle.semi_axes_along_frame)
    unit = [np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)]
    own = np.stack([r * x for r, x in zip(axes, unit, strict=True)], axis=-1)
    turn, shift = _placed(obstacle.frame)
    return own @ turn.T + shift


@remembered
def _placed(frame: geometry.Frame) -> tuple[np.ndarray, np.ndarray]:
    origin, *ends = (np.stack([np.asarray(x, float) for x in frame.placement.apply(Vector(*point))])
                     for point in np.vstack([np.zeros(3), np.eye(3)]))  # fmt: skip
    return np.stack(ends, axis=-1) - origin[:, None], origin


def state_of(poses: Pose | State) -> State:
    """Where all bones are at poses of the tibia, or of all bones; fields of shape `(poses,)`."""
    state = poses if isinstance(poses, State) else State({TIBIA: poses})
    return jax.tree.map(jnp.atleast_1d, state)


def lots(state: State) -> list[State]:
    """Poses in lots of one size, so that one program computes them; one alone has its own."""
    count, state = state.shape[0], jax.tree.map(np.asarray, state)
    if count == 1:
        return [state]
    rows = np.minimum(np.arange(-(-count // _LOT) * _LOT), count - 1)
    return [jax.tree.map(lambda x, own=rows[i : i + _LOT]: x[own], state)
            for i in range(0, len(rows), _LOT)]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Places:
    """Bone -> rotations into the femur's axes, `(poses, 3, 3)`, and translations."""

    rigid: dict[str, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, state: State) -> Self:
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


def fibre_lines(knee: Knee, state: State) -> tuple[list[Line], list[Line]]:
    """All fibres of the ligaments, and the heads of the quadriceps."""
    ligaments, muscles, heads = [], knee.muscles, []
    if names := knee.ligaments.names:
        groups = {fibre: name for name, members in reversed(knee.groups) for fibre in members}
        ligaments = _lines(knee.ligaments, state, [groups.get(name, name) for name in names])
    if muscles is not None and muscles.quadriceps:
        lines = _lines(muscles, state, [QUADRICEPS] * len(muscles.names))
        heads = [lines[row] for row in muscles.quadriceps]
    return ligaments, heads


def _lines(fibres: Ligaments | Muscles, state: State, groups: Sequence[str]) -> list[Line]:
    """Courses in their first bones' axes; muscles have no strain, and a tension of their own."""
    (kinds, *_), found = zip(*(_drawn(fibres, some) for some in lots(state)), strict=True)
    *drawn, length, tension = (
        np.concatenate([np.asarray(x) for x in parts], axis=-1)[..., : state.shape[0]]
        for parts in zip(*found, strict=True)
    )
    strain = np.full_like(length, np.nan)
    if isinstance(fibres, Ligaments):
        strain = length / np.asarray(fibres.slack_length)[:, None] - 1.0
    points = {row: of_kind[:, :, i] for rows, of_kind in zip(kinds, drawn, strict=True)
              for i, row in enumerate(rows)}  # fmt: skip
    return [Line(name, groups[i], fibres.bodies[i][0], points[i], strain[i], tension[i])
            for i, name in enumerate(fibres.names)]  # fmt: skip


@eqx.filter_jit
def _drawn(fibres: Ligaments | Muscles, state: State):
    """Rows, courses `(k, 3, fibres, poses)` of each kind (one array), lengths, tensions."""
    fibres, drawn = add_lane_axis(fibres), []
    for course in fibres.kinds:
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
    own = fibres.tension_at(length) if isinstance(fibres, Ligaments) else fibres.tension
    rows = [course.rows for course in fibres.kinds]
    return rows, [*drawn, length, jnp.broadcast_to(own, length.shape)]


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
