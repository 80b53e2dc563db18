"""A knee in space as plain arrays: what the pictures and the page draw."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import TIBIA, Pose, State
from kneejax.mechanics import Knee, Ligaments, add_lane_axis
from kneejax.report.scene._grids import grid_triangles, obstacle_grid, surface_grid
from kneejax.report.scene._pressure_map import (
    PlateauPressure,
    lateral_sign,
    lots,
    plateau_pressures,
)

#: Points on a piece of a fibre that goes around an obstacle.
_AROUND = 14


@dataclasses.dataclass(frozen=True)
class BoneMesh:
    """A bone for the picture, as scanned: a left bone stays a left bone.

    Attributes:
        bone: `femur` or `tibia`, whose frame it is in.
        points_mm: corners, `(n, 3)`.
        faces: rows of three corners, `(m, 3)`.
    """

    bone: str
    points_mm: np.ndarray
    faces: np.ndarray


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A grid of points on a surface: `(m, n, 3)`, mm, in the tibia's frame."""

    name: str
    points_mm: np.ndarray


@dataclasses.dataclass(frozen=True)
class Plateau:
    """A tibial surface with the pressure on it, `(m, n)`, and its centre, `(3,)`.

    `faces` are the triangles of its points (row by row) that are cartilage; points just outside
    its border have been moved there.
    """

    name: str
    points_mm: np.ndarray
    faces: np.ndarray
    pressure_MPa: np.ndarray
    center_mm: np.ndarray


@dataclasses.dataclass(frozen=True)
class Fibre:
    """The course of a fibre, `(k, 3)`, mm, and how it is pulled.

    Attributes:
        name: of the fibre.
        group: first group that has it; its own name if none has.
        points_mm: in the tibia's frame, from femur to tibia.
        strain: length over slack length, minus one.
        tension_N: force.
    """

    name: str
    group: str
    points_mm: np.ndarray
    strain: float
    tension_N: float

    @property
    def slack(self) -> bool:
        """Whether the fibre is not pulled."""
        return not self.strain > 0


@dataclasses.dataclass(frozen=True)
class Scene:
    """A knee at a pose, all in the tibia's frame: X anterior, Y superior, Z to the person's right.

    Attributes:
        title: the knee's name and side.
        flexion_deg: of the pose.
        lateral: sign of the lateral direction along Z: 1 on a right knee, -1 on a left one.
        condyles: the femoral surfaces.
        plateaus: the tibial surfaces with their pressure.
        fibres: all ligament fibres.
        obstacles: what fibres wrap around.
        bones: meshes, placed.
    """

    title: str
    flexion_deg: float
    lateral: float
    condyles: tuple[Sheet, ...]
    plateaus: tuple[Plateau, ...]
    fibres: tuple[Fibre, ...]
    obstacles: tuple[Sheet, ...]
    bones: tuple[BoneMesh, ...]

    @property
    def groups(self) -> dict[str, list[Fibre]]:
        """Group -> its fibres, in the knee's order."""
        answer: dict[str, list[Fibre]] = {}
        for fibre in self.fibres:
            answer.setdefault(fibre.group, []).append(fibre)
        return answer

    @property
    def points_mm(self) -> np.ndarray:
        """All points but those of bones, which may run out of a picture, `(n, 3)`."""
        parts = [*self.condyles, *self.plateaus, *self.fibres, *self.obstacles]
        return np.concatenate([part.points_mm.reshape(-1, 3) for part in parts])

    @property
    def directions(self) -> dict[str, np.ndarray]:
        """Anatomical word -> unit vector."""
        lateral = np.array([0.0, 0.0, self.lateral])
        words = {
            "anterior": np.array([1.0, 0.0, 0.0]),
            "superior": np.array([0.0, 1.0, 0.0]),
            "lateral": lateral,
        }
        opposite = {"anterior": "posterior", "superior": "inferior", "lateral": "medial"}
        return words | {opposite[word]: -axis for word, axis in words.items()}


def scenes(
    knee: Knee, poses: Pose, bones: Sequence[BoneMesh] = (), points: tuple[int, int] = (48, 48)
) -> tuple[Scene, ...]:
    """Place everything that a picture of a knee shows, in the tibia's frame.

    A left knee, which is stored as its mirrored right twin, is mirrored back.

    Args:
        knee: any knee.
        poses: fields of shape `(poses,)`, or one pose.
        bones: meshes to show with it, in the frames of the knee's own side.
        points: on each articular surface, along its two parameters.

    Returns:
        One scene a pose.

    Raises:
        ValueError: a mesh belongs to a bone that is neither femur nor tibia.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> (scene,) = scenes(knee, kj.Pose.from_table([[30.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
        >>> [fibre.name for fibre in scene.fibres], [plateau.name for plateau in scene.plateaus]
        (['ACL', 'PCL', 'MCL', 'LCL'], ['medial', 'lateral'])
    """
    table = np.reshape(np.asarray(poses.to_table()), (-1, 6))
    batch = Pose.from_table(table)
    turn, shift = _rigid(batch)
    sign = lateral_sign(knee)
    mirror = np.array([1.0, 1.0, sign])
    condyles = [
        Sheet(name, surface_grid(contact.femoral, points))
        for name, contact in zip(knee.contact_names, knee.contacts, strict=True)
    ]
    pressures = plateau_pressures(knee, batch, points) if knee.contacts else ()
    drawn = [_to_the_rim(field) for field in pressures]
    lines, strain, tension = _fibres(knee, batch)
    groups = {fibre: name for name, members in reversed(knee.groups) for fibre in members}
    answer = []
    for i, row in enumerate(table):

        def seen(points_mm: np.ndarray, bone: str, i: int = i) -> np.ndarray:
            """From a bone of the stored twin to the tibia as it is drawn."""
            if bone == "femur":
                points_mm = (points_mm - shift[i]) @ turn[i]
            return points_mm * mirror

        fibres = tuple(
            Fibre(
                name,
                groups.get(name, name),
                seen(lines[j][:, :, i], "femur"),
                float(strain[j, i]),
                float(tension[j, i]),
            )
            for j, name in enumerate(knee.ligaments.names)
        )
        answer.append(
            Scene(
                title=f"{knee.name}, {knee.side} knee",
                flexion_deg=float(row[0]),
                lateral=sign,
                condyles=tuple(
                    Sheet(sheet.name, seen(sheet.points_mm, "femur")) for sheet in condyles
                ),
                plateaus=tuple(map(_at_pose, pressures, [i] * len(pressures), drawn)),
                fibres=fibres,
                obstacles=tuple(
                    Sheet("", seen(grid, bone))
                    for grid, bone in _obstacles(knee, lines, turn, shift)
                ),
                bones=tuple(_placed(mesh, seen, mirror) for mesh in bones),
            )
        )
    return tuple(answer)


def _rigid(poses: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Rotations from tibia to femur, `(poses, 3, 3)`, and translations, `(poses, 3)`."""
    place = poses.placement
    rotation = place.rotation or ()  # a pose always has one
    turn = [np.stack([np.asarray(x) for x in row], axis=-1) for row in rotation]
    shift = np.stack([np.asarray(x) for x in place.translation], axis=-1)
    return np.stack(turn, axis=-2), shift


def _to_the_rim(field: PlateauPressure) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and triangles up to the cartilage's border, and each point's pressed neighbour.

    Points of the grid just outside are moved to the border, which would else have teeth.
    """
    covered = field.covered.ravel()
    faces = grid_triangles(*field.covered.shape)
    faces = faces[covered[faces].any(axis=1)]
    points, own = field.points_mm.reshape(-1, 3).copy(), np.arange(len(covered))
    outside = np.unique(faces[~covered[faces]])
    if len(outside):
        start = field.rim_mm
        along = np.roll(start, -1, axis=0) - start
        away = points[outside, None] - start
        square = np.maximum(np.sum(along**2, axis=1), 1e-12)
        share = np.clip(np.sum(away * along, axis=2) / square, 0.0, 1.0)
        nearest = start + share[..., None] * along
        best = np.argmin(np.sum((points[outside, None] - nearest) ** 2, axis=2), axis=1)
        points[outside] = nearest[np.arange(len(outside)), best]
        inside = np.flatnonzero(covered)
        apart = points[outside, None] - points[inside]
        own[outside] = inside[np.argmin(np.sum(apart**2, axis=2), axis=1)]
    return points.reshape(field.points_mm.shape), faces, own


def _at_pose(field: PlateauPressure, row: int, drawn) -> Plateau:
    points, faces, own = drawn
    pressure = field.pressure_MPa[row]
    pressure = pressure.ravel()[own].reshape(pressure.shape)
    return Plateau(field.name, points, faces, pressure, field.center_mm[row])


def _placed(mesh: BoneMesh, seen, mirror: np.ndarray) -> BoneMesh:
    if mesh.bone not in ("femur", "tibia"):
        raise ValueError(f"a mesh belongs to {mesh.bone!r}; expected 'femur' or 'tibia'")
    twin = np.asarray(mesh.points_mm, float) * mirror
    return dataclasses.replace(mesh, points_mm=seen(twin, mesh.bone))


def _fibres(knee: Knee, poses: Pose):
    """Courses in femur axes, each `(k, 3, poses)`; strains and tensions, `(fibres, poses)`."""
    if not knee.ligaments.names:
        return [], np.zeros((0, 1)), np.zeros((0, 1))
    ligaments = add_lane_axis(knee.ligaments)
    kinds = [course.rows for course in ligaments.kinds]
    parts = [_drawn(ligaments, some) for some in lots(poses)]
    count = np.shape(poses.flexion)[0]

    def joined(arrays) -> np.ndarray:
        return np.concatenate([np.asarray(x) for x in arrays], axis=-1)[..., :count]

    lines = {}
    for rows, *drawn in zip(kinds, *(part[0] for part in parts), strict=True):
        points = joined(drawn)
        lines |= {row: points[:, :, i] for i, row in enumerate(rows)}
    strain, tension = (joined(part[k] for part in parts) for k in (1, 2))
    return [lines[row] for row in range(len(lines))], strain, tension


@eqx.filter_jit
def _drawn(ligaments: Ligaments, poses: Pose):
    """Fibres of one kind of course together, `(k, 3, fibres, poses)`; strain and tension.

    One array a kind: each point as a result of its own would take minutes to compile.
    """
    state, drawn = State({TIBIA: poses}), []
    for course in ligaments.kinds:
        rows = np.array(course.rows)
        ends = ligaments.femoral_attachment[rows], ligaments.tibial_attachment[rows]
        shape = (len(rows), *jnp.shape(poses.flexion))
        points = []
        for piece in course.polylines(*ends, state.between(course.bodies), _AROUND):
            points += piece[1:] if points else piece
        stacked = [
            jnp.stack([jnp.broadcast_to(jnp.asarray(c), shape) for c in point]) for point in points
        ]
        drawn.append(jnp.stack(stacked))
    length = ligaments.length(state)
    return drawn, length / ligaments.slack_length - 1.0, ligaments.tension_at(length)


def _obstacles(knee: Knee, lines: list[np.ndarray], turn: np.ndarray, shift: np.ndarray):
    """Grids of the obstacles in their bones' frames, each drawn once, with their bones."""
    found: dict[tuple, tuple[np.ndarray, str]] = {}
    passing: dict[tuple, list[np.ndarray]] = {}
    for course in knee.ligaments.courses:
        if course.obstacle is None:
            continue
        leaves = jax.tree.leaves(course.obstacle)
        key = (
            type(course.obstacle),
            course.obstacle_bone,
            *(np.asarray(x).tobytes() for x in leaves),
        )
        for row in course.rows:
            for i in range(len(shift)):
                line = lines[row][:, :, i]
                on_tibia = course.obstacle_bone == "tibia"
                passing.setdefault(key, []).append(
                    (line - shift[i]) @ turn[i] if on_tibia else line
                )
        grid = obstacle_grid(course.obstacle, np.concatenate(passing[key]))
        found[key] = grid, course.obstacle_bone
    return list(found.values())
