"""A knee in space as plain arrays: what the pictures and the page draw."""

__all__ = ["BoneMesh", "Scene", "scenes"]

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.geometry import FEMUR, TIBIA, Pose, State
from kneejax.mechanics import Knee
from kneejax.report.look.tables import grouped
from kneejax.report.scene import surfaces
from kneejax.report.scene.pressure import PlateauPressure, lateral_sign, plateau_pressures

#: A muscle is shown as far as this beyond what else is, mm: its origin may be at the hip.
_MUSCLE_MM = 15.0
#: Likewise a ligament that is longer than any of the knee itself, mm: a band from the pelvis.
_LONGEST_MM = 200.0
#: Points along them.
_ALONG = 80


@dataclasses.dataclass(frozen=True)
class BoneMesh:
    """A bone for the picture, as scanned: a left bone stays a left bone.

    Attributes:
        bone: `femur`, `tibia` or `patella`, whose frame it is in.
        points_mm: corners, `(n, 3)`.
        faces: rows of three corners, `(m, 3)`.
    """

    bone: str
    points_mm: np.ndarray
    faces: np.ndarray


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A grid of points on a bone's surface: `(m, n, 3)`, mm, in the tibia's frame."""

    name: str
    bone: str
    points_mm: np.ndarray

    @property
    def faces(self) -> np.ndarray:
        """Triangles of its points, row by row, `(k, 3)`."""
        return surfaces.grid_triangles(*self.points_mm.shape[:2])


@dataclasses.dataclass(frozen=True)
class Plateau:
    """A tibial or patellar surface, `(m, n, 3)`, its cartilage's triangles, pressure `(m, n)`."""

    name: str
    bone: str
    points_mm: np.ndarray
    faces: np.ndarray
    pressure_MPa: np.ndarray
    center_mm: np.ndarray


@dataclasses.dataclass(frozen=True)
class Fibre:
    """Course in the tibia's frame, `(k, 3)`, its group, strain (NaN of a muscle), tension."""

    name: str
    group: str
    points_mm: np.ndarray
    strain: float
    tension_N: float

    @property
    def way_mm(self) -> np.ndarray:
        """Way along it to each of its points, `(k,)`."""
        return np.append(0.0, np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1).cumsum())

    def at(self, share: float | np.ndarray) -> np.ndarray:
        """Point at a share of its way, `(..., 3)`."""
        way = self.way_mm
        return np.stack([np.interp(share * way[-1], way, x) for x in self.points_mm.T], axis=-1)

    @property
    def slack(self) -> bool:
        """Whether the fibre is not pulled."""
        return self.strain <= 0

    @property
    def is_muscle(self) -> bool:
        """Whether it is a muscle, which has no strain of its own."""
        return bool(np.isnan(self.strain))


@dataclasses.dataclass(frozen=True)
class Scene:
    """A knee at a pose, all in the tibia's frame: X anterior, Y superior, Z to the person's right.

    Attributes:
        title: the knee's name and side.
        flexion_deg: of the pose.
        lateral: sign of the lateral direction along Z: 1 on a right knee, -1 on a left one.
        condyles: the femoral surfaces.
        plateaus: the tibial surfaces, and the patella's, with their pressure.
        fibres: all ligament fibres, then bands and heads of the quadriceps near the knee.
        obstacles: what ligaments wrap around.
        bones: meshes, placed.
        places: bone -> rotation from its axes to the tibia's, `(3, 3)`, and translation, `(3,)`,
            of the knee's own side.
    """

    title: str
    flexion_deg: float
    lateral: float
    condyles: tuple[Sheet, ...]
    plateaus: tuple[Plateau, ...]
    fibres: tuple[Fibre, ...]
    obstacles: tuple[Sheet, ...]
    bones: tuple[BoneMesh, ...]
    places: dict[str, tuple[np.ndarray, np.ndarray]]

    @property
    def groups(self) -> dict[str, list[Fibre]]:
        """Group -> its fibres, in the knee's order."""
        return grouped((fibre.group, fibre) for fibre in self.fibres)

    @property
    def points_mm(self) -> np.ndarray:
        """All points but those of bones, which may run out of a picture, `(n, 3)`."""
        parts = [*self.condyles, *self.plateaus, *self.fibres, *self.obstacles]
        return np.concatenate([part.points_mm.reshape(-1, 3) for part in parts])

    @property
    def directions(self) -> dict[str, np.ndarray]:
        """`anterior`, `superior`, `lateral` -> unit vector."""
        axes = np.diag([1.0, 1.0, self.lateral])
        return dict(zip(("anterior", "superior", "lateral"), axes, strict=True))


def scenes(
    knee: Knee, poses: Pose | State, bones: Sequence[BoneMesh] = (),
    points: tuple[int, int] = (48, 48),
) -> tuple[Scene, ...]:
    """Place everything that a picture of a knee shows, in the tibia's frame.

    A left knee, which is stored as its mirrored right twin, is mirrored back.

    Args:
        knee: any knee.
        poses: of the tibia, fields of shape `(poses,)`, or one pose; a `State` where other bones
            move too.
        bones: meshes to show with it, in the frames of the knee's own side.
        points: on each articular surface, along its two parameters.

    Returns:
        One scene a pose.

    Raises:
        ValueError: a mesh belongs to a bone that the knee does not have.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> (scene,) = scenes(knee, kj.Pose.from_table([[30.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
        >>> [fibre.name for fibre in scene.fibres], [plateau.name for plateau in scene.plateaus]
        (['ACL', 'PCL', 'MCL', 'LCL'], ['medial', 'lateral'])
    """
    for mesh in bones:
        if mesh.bone not in (FEMUR, *knee.bodies):
            known = f"expected one of {FEMUR!r}, {', '.join(map(repr, knee.bodies))}"
            raise ValueError(f"a mesh belongs to {mesh.bone!r}; {known}")
    state = surfaces.state_of(poses)
    places, sign = surfaces.Places.of(state), lateral_sign(knee)
    mirror = np.array([1.0, 1.0, sign])
    condyles = {name: surfaces.surface_grid(contact.femoral, points)
                for name, contact in zip(knee.contact_names, knee.contacts, strict=True)}
    pressures = plateau_pressures(knee, state, points)
    drawn = [_to_the_rim(x.covered, x.points_mm, x.rim_mm) for x in pressures]
    courses, muscles = surfaces.fibre_lines(knee, state)
    grids = surfaces.obstacles(knee, courses, places)

    def at(i: int) -> Scene:
        def seen(points_mm: np.ndarray, bone: str) -> np.ndarray:
            """From a bone of the stored twin to the tibia as it is drawn."""
            return places.moved(points_mm, bone, TIBIA, i) * mirror

        def placed(bone: str) -> tuple[np.ndarray, np.ndarray]:
            """Rotation and translation of a bone's axes, both of the knee's own side."""
            origin, *ends = (seen(x, bone) for x in np.vstack([np.zeros(3), np.diag(mirror)]))
            return np.stack(ends, axis=-1) - origin[:, None], origin

        def pressed(field: PlateauPressure, shown) -> Plateau:
            points, faces, own = shown
            pressure = field.pressure_MPa[i].ravel()[own].reshape(field.covered.shape)
            places = points, field.center_mm[i]
            if field.bone != TIBIA:  # its points are mirrored already
                places = (seen(x * mirror, field.bone) for x in places)
            points, center = places
            return Plateau(field.name, field.bone, points, faces, pressure, center)

        def line(course: surfaces.Line) -> Fibre:
            points_mm = seen(course.points_mm[:, :, i], course.bone)
            numbers = float(course.strain[i]), float(course.tension_N[i])
            return Fibre(course.name, course.group, points_mm, *numbers)

        fibres = [line(course) for course in courses]
        far = [x for x in fibres if x.way_mm[-1] > _LONGEST_MM]
        scene = Scene(
            title=f"{knee.name}, {knee.side} knee",
            flexion_deg=float(np.rad2deg(state.tibia.flexion[i])),
            lateral=sign,
            condyles=tuple(Sheet(name, FEMUR, seen(x, FEMUR)) for name, x in condyles.items()),
            plateaus=tuple(map(pressed, pressures, drawn)),
            fibres=tuple(x for x in fibres if all(x is not y for y in far)),
            obstacles=tuple(Sheet("", bone, seen(grid, bone)) for grid, bone in grids),
            bones=tuple(BoneMesh(x.bone, seen(np.asarray(x.points_mm, float) * mirror, x.bone),
                                 x.faces) for x in bones),
            places={bone: placed(bone) for bone in (FEMUR, *state.poses)},
        )
        near = _near([*far, *map(line, muscles)], scene.points_mm) if far or muscles else ()
        return dataclasses.replace(scene, fibres=(*scene.fibres, *near))

    return tuple(at(i) for i in range(state.shape[0]))


def _near(muscles: Sequence[Fibre], points_mm: np.ndarray) -> tuple[Fibre, ...]:
    """The parts of muscles and bands that are near everything else."""
    middle = points_mm.mean(axis=0)
    most = np.linalg.norm(points_mm - middle, axis=1).max() + _MUSCLE_MM
    fine = [(muscle, muscle.at(np.linspace(0.0, 1.0, _ALONG))) for muscle in muscles]
    kept = [(muscle, x[np.linalg.norm(x - middle, axis=1) < most]) for muscle, x in fine]
    return tuple(dataclasses.replace(one, points_mm=x) for one, x in kept if len(x) > 1)


@surfaces.remembered
def _to_the_rim(
    covered: np.ndarray, points_mm: np.ndarray, rim_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and triangles up to the cartilage's border, and each point's pressed neighbour."""
    shape, covered = points_mm.shape, covered.ravel()
    faces = surfaces.grid_triangles(*shape[:2])
    faces = faces[covered[faces].any(axis=1)]
    points, own = points_mm.reshape(-1, 3).copy(), np.arange(len(covered))
    outside = np.unique(faces[~covered[faces]])
    if len(outside):
        along = np.roll(rim_mm, -1, axis=0) - rim_mm
        away = points[outside, None] - rim_mm
        square = np.maximum(np.sum(along**2, axis=1), 1e-12)
        share = np.clip(np.sum(away * along, axis=2) / square, 0.0, 1.0)
        nearest = rim_mm + share[..., None] * along
        best = np.argmin(np.sum((points[outside, None] - nearest) ** 2, axis=2), axis=1)
        points[outside] = nearest[np.arange(len(outside)), best]
        inside = np.flatnonzero(covered)
        apart = points[outside, None] - points[inside]
        own[outside] = inside[np.argmin(np.sum(apart**2, axis=2), axis=1)]
    return points.reshape(shape), faces, own
