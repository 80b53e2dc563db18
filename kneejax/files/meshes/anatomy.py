"""Where the joint is in cartilage meshes: the femoral axis, the notch, the compartments.

Everything here is in mm, in the frames of a right knee (X anterior, Y superior, Z lateral): a left
knee's meshes are mirrored before.
"""

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from kneejax.files.meshes.health import Sheet, borders, narrowest
from kneejax.files.reading import InputProblem
from kneejax.geometry import Frame, Placement

#: Femur and tibia meet within this distance at the reference pose, mm.
FARTHEST_MM = 50.0
_WIDEST_MM = (30.0, 200.0)
_STEEPEST_AXIS_DEG = 35.0
_AXIS_STEPS = 50
_OUTLINE_CORNERS = 48
# Part of the condyles that is round enough to find their axis: from distal to posterior.
_ROUND = np.deg2rad([75.0, 230.0])
_BEHIND_TROCHLEA = np.deg2rad(75.0)
# Of extension beyond the reference pose, where condyles may still meet their plateaus.
_MARGIN_DEG = 15.0
# Faces whose normal leaves the joint's direction by more than this are edges of a volume.
_FACING = 0.05
_NARROWEST_NOTCH_MM = 3.0
# Of the area of one sheet on the other side of the notch, for it to be of two compartments.
_LEAST_OF_TWO = 0.2


class Cloud(NamedTuple):
    """Corners of an articular surface, mm, in its bone's frame."""

    points: np.ndarray  # shape `(n, 3)`
    areas: np.ndarray  # mm^2 that each stands for
    normals: np.ndarray  # outward unit normals there

    def kept(self, rows) -> "Cloud":
        """The part with these rows."""
        return Cloud(self.points[rows], self.areas[rows], self.normals[rows])


class Femur(NamedTuple):
    """Articular surface of the femur."""

    cloud: Cloud  # of both condyles and the trochlea
    axis: Frame  # its Z is the transverse axis
    notch_mm: float  # the intercondylar notch along the axis


def cylindrical(axis: Frame, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle from anterior through distal, rad; distance from an axis and place along it, mm."""
    x, y, z = in_frame(axis, points).T
    return 0.5 * np.pi - np.arctan2(x, -y), np.hypot(x, y), z


def in_frame(frame: Frame, points: np.ndarray) -> np.ndarray:
    """Points of a bone in a frame placed in it, shape `(n, 3)`."""
    return _rows(_of_numpy(frame.placement).apply_inverse(tuple(points.T)), len(points))


def find_femur(
    sheets: list[Sheet], findings: list[str], axis: Frame | None, notch_mm: float | None
) -> Femur:
    """Find the transverse axis and the notch in the femoral cartilage, unless given."""
    name = sheets[0].name
    points = np.concatenate([sheet.corners()[0] for sheet in sheets])
    width = float(np.ptp(points[:, 2]))
    if not _WIDEST_MM[0] < width < _WIDEST_MM[1]:
        expected = f"a femoral cartilage {_WIDEST_MM[0]:g} to {_WIDEST_MM[1]:g} mm wide (along Z)"
        raise InputProblem(name, "width", f"{width:.3g} mm", expected + "; is the unit right?")
    center = axis
    if center is None:  # of the circle nearest to the points seen from the side
        columns = np.c_[2.0 * points[:, :2], np.ones(len(points))]
        solution, *_ = np.linalg.lstsq(columns, (points[:, :2] ** 2).sum(axis=1), rcond=None)
        center = Frame([solution[0], solution[1], 0.0])

    def by_angle(places: np.ndarray):
        angle, radius, along = cylindrical(center, places)
        return angle * 10.0, along / 3.0, radius

    def radial(sheet: Sheet) -> np.ndarray:
        away = in_frame(center, sheet.centers) * [1.0, 1.0, 0.0]
        away = _rows(center.placement.turn(tuple(away.T)), len(away))
        return away / np.linalg.norm(away, axis=1, keepdims=True)

    cloud = joined(articular(sheets, radial, "outer", findings, by_angle))
    axis = _found_axis(cloud, center, name, findings) if axis is None else axis
    if notch_mm is None:
        angle, _, along = cylindrical(axis, cloud.points)
        behind = np.sort(along[(angle > np.deg2rad(110)) & (angle < np.deg2rad(230))])
        gaps = np.diff(behind)
        if len(gaps) == 0 or gaps.max() < _NARROWEST_NOTCH_MM:
            expected = ("a gap between the condyles behind the joint, or the notch's place given; "
                        "have femur and tibia changed places?")
            raise InputProblem(name, "notch", "none found", expected)
        notch_mm = float(np.mean(behind[np.argmax(gaps) :][:2]))
        findings.append(f"{Path(name).name}: the notch lies at {notch_mm:.1f} mm along the axis.")
    return Femur(cloud, axis, notch_mm)


def find_plateaus(
    sheets: list[Sheet], femur: Femur, tibia: Placement, findings: list[str],
    split_mm: float | None = None,
) -> dict[str, Sheet]:  # fmt: skip
    """Sheets of the tibial cartilage, `medial` and `lateral`, parted at Z = `split_mm`."""
    name = sheets[0].name
    facing = articular(sheets, np.array([0.0, 1.0, 0.0]), "upper", findings)
    cloud = joined(facing)
    tibial = moved(tibia, cloud.points)
    few, others = (points[:: max(1, len(points) // most)]
                   for points, most in ((tibial, 500), (femur.cloud.points, 2000)))
    distance = np.sqrt(((few[:, None] - others) ** 2).sum(axis=2).min())
    if distance > FARTHEST_MM:
        expected = f"within {FARTHEST_MM:g} mm of the femoral cartilage at the reference pose"
        raise InputProblem(name, "place", f"{distance:.0f} mm apart", expected + "; frames differ?")
    angle, radius, _ = cylindrical(femur.axis, tibial)
    below = np.average(np.sin(angle) * radius, weights=cloud.areas)
    if below < 0:
        expected = "tibial cartilage below the femoral axis; is Y superior?"
        raise InputProblem(name, "place", f"{-below:.0f} mm above the axis", expected)
    found: dict[str, Sheet] = {}
    for part in _parted(facing, split_mm, femur, tibia, findings):
        middle = np.average(part.centers, axis=0, weights=part.face_areas)
        along = in_frame(femur.axis, moved(tibia, middle[None]))[0, 2]
        side = "lateral" if along > femur.notch_mm else "medial"
        if side in found:
            value = f"two parts on the {side} side of the notch"
            expected = "one on either side; is the frame right, and is the side?"
            raise InputProblem(name, "compartments", value, expected)
        found[side] = part
    if len(found) == 1:
        findings.append(f"{Path(name).name}: only a {next(iter(found))} compartment was found.")
    return {side: found[side] for side in ("medial", "lateral") if side in found}


def outline(sheet: Sheet, frame: Frame) -> np.ndarray:
    """Border of a sheet in its frame, corners `(x, z)` at equal distances, shape `(k, 2)`, mm."""
    line = in_frame(frame, sheet.points[borders(sheet)[0]])[:, [0, 2]]
    # The same line for the same sheet, however its corners are numbered.
    if np.sum(line[:, 0] * np.roll(line[:, 1], -1) - np.roll(line[:, 0], -1) * line[:, 1]) < 0:
        line = line[::-1]
    line = np.roll(line, -int(np.argmax(line @ [1.0, 0.3])), axis=0)
    closed = np.r_[line, line[:1]]
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    at = along[-1] * np.arange(_OUTLINE_CORNERS) / _OUTLINE_CORNERS
    return np.stack([np.interp(at, along, c) for c in closed.T], axis=1)


def condyle_region(
    femur: Femur, cloud: Cloud, tibial: np.ndarray
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Angles, degrees, and widths, mm, over which a condyle can meet the points `tibial`."""
    angle, _, along = cylindrical(femur.axis, cloud.points)
    foremost = cylindrical(femur.axis, tibial)[0].min() - np.deg2rad(_MARGIN_DEG)
    lower, upper = max(foremost, angle.min()), angle.max()
    behind = (angle > max(lower, min(_BEHIND_TROCHLEA, 0.5 * (lower + upper)))) & (angle < upper)
    width = along[behind].min(), along[behind].max()
    return (float(np.rad2deg(lower)), float(np.rad2deg(upper))), (float(width[0]), float(width[1]))


def moved(placement: Placement, points: np.ndarray) -> np.ndarray:
    """Points after a motion, shape `(n, 3)`."""
    return _rows(_of_numpy(placement).apply(tuple(points.T)), len(points))


def joined(sheets: list[Sheet]) -> Cloud:
    """Corners of several sheets."""
    parts = zip(*(sheet.corners() for sheet in sheets), strict=True)
    return Cloud(*(np.concatenate(part) for part in parts))


def _of_numpy(placement: Placement) -> Placement:
    """Without JAX, which compiles every product for each number of points."""
    return jax.tree.map(np.asarray, placement)


def _rows(vector, count: int) -> np.ndarray:
    return np.stack([np.broadcast_to(np.asarray(c), count) for c in vector], axis=1)


def articular(
    sheets: list[Sheet], direction, word: str, findings: list[str], place=None
) -> list[Sheet]:
    """Articular sides of one bone's sheets, turned outwards, without sheets behind another one.
    `direction` is a unit vector towards the joint, or gives them of a sheet, and `place` then two
    parameters of points, in cells, and the height over them; `word` says which sheet is kept."""
    def above(points: np.ndarray):
        across = np.delete(points, np.argmax(np.abs(direction)), axis=1)
        return *across.T / 3.0, points @ direction

    facing: list[Sheet] = []
    for sheet in sheets:
        named = Path(sheet.name).name
        towards = direction[None] if isinstance(direction, np.ndarray) else direction(sheet)
        along = np.einsum("ij,ij->i", sheet.normals, np.broadcast_to(towards, sheet.normals.shape))
        if sheet.closed:
            findings.append(f"{named}: a closed volume; its articular side was taken.")
            sheet = sheet.kept(along > _FACING)
        elif np.average(along, weights=sheet.face_areas) < 0:
            findings.append(f"{named}: the normals faced the bone and were turned.")
            sheet = sheet.turned()
        facing.append(sheet)
    kept: list[Sheet] = []
    grids = [_heights(*(place or above)(sheet.corners()[0])) for sheet in facing]
    for sheet, own in zip(facing, grids, strict=True):
        shared = ((grid, own.keys() & grid.keys()) for grid in grids if grid is not own)
        if any(2 * len(cells) >= len(own) and np.mean([grid[c] - own[c] for c in cells]) > 0
               for grid, cells in shared):
            text = "a second sheet behind the first was left out"
            findings.append(f"{Path(sheet.name).name}: {text}: the {word} one carries contact.")
        else:
            kept.append(sheet)
    return kept


def _heights(a: np.ndarray, b: np.ndarray, height: np.ndarray) -> dict[tuple[int, int], float]:
    cells = np.floor(np.c_[a, b]).astype(int)
    unique, place = np.unique(cells, axis=0, return_inverse=True)
    mean = np.bincount(place.ravel(), height) / np.bincount(place.ravel())
    return {(int(i), int(j)): float(h) for (i, j), h in zip(unique, mean, strict=True)}


def _found_axis(cloud: Cloud, axis: Frame, name: str, findings: list[str]) -> Frame:
    for _ in range(3):
        angle, _, _ = cylindrical(axis, cloud.points)
        rows = np.flatnonzero((angle > _ROUND[0]) & (angle < _ROUND[1]))
        if len(rows) < 20:
            expected = "condyles below and behind the axis; is the frame X anterior, Y superior?"
            raise InputProblem(name, "frame", f"{len(rows)} corners there", expected)
        axis = _nearest_cylinder(cloud.kept(rows), axis)
        turn = np.rad2deg(np.abs(np.asarray(axis.rotation)))
        if turn.max() > _STEEPEST_AXIS_DEG:
            expected = (f"a transverse axis within {_STEEPEST_AXIS_DEG:g} degrees of Z; are these "
                        "femoral condyles, with X anterior, Y superior, Z to the right?")
            raise InputProblem(name, "frame", f"an axis {turn.max():.1f} degrees off", expected)
    x, y, _ = np.asarray(axis.origin)
    rx, ry, _ = np.rad2deg(np.asarray(axis.rotation))
    findings.append(f"{Path(name).name}: the transverse axis passes through ({x:.1f}, {y:.1f}) mm, "
                    f"turned {rx:.1f} and {ry:.1f} degrees about X and Y.")
    return axis


def _nearest_cylinder(cloud: Cloud, axis: Frame) -> Frame:
    """Axis of the cylinder nearest to corners, by Gauss and Newton from a frame near it."""
    points, areas, _ = cloud
    u = np.array([float(c) for c in axis.placement.turn((0.0, 0.0, 1.0)).full()])
    line = np.r_[np.asarray(axis.origin)[:2], u[:2] / u[2]]
    root = np.sqrt(areas / areas.sum())
    for _ in range(_AXIS_STEPS):
        along = np.r_[line[2:], 1.0]
        size = np.linalg.norm(along)
        from_line = points - np.r_[line[:2], 0.0]
        place = from_line @ along / size
        away = from_line - place[:, None] * along / size
        radius = np.linalg.norm(away, axis=1)
        toward = -away[:, :2] / radius[:, None]
        columns = np.c_[toward, toward * (place / size)[:, None], -np.ones(len(points))]
        step, *_ = np.linalg.lstsq(columns * root[:, None], -radius * root, rcond=None)
        line = line + step[:4]
        if np.abs(step[:2]).max() < 1e-9 and np.abs(step[2:4]).max() < 1e-11:
            break
    along = np.r_[line[2:], 1.0]
    x, y, z = along / np.linalg.norm(along)
    return Frame([line[0], line[1], 0.0], [-np.arctan2(y, z), np.arcsin(x), 0.0])


def _parted(
    sheets: list[Sheet], split_mm: float | None, femur: Femur, tibia: Placement, findings: list[str]
) -> list[Sheet]:
    name = Path(sheets[0].name).name
    if split_mm is None and len(sheets) > 1:
        if len(sheets) > 2:
            expected = "one sheet, or one for each compartment; or give where they part"
            raise InputProblem(sheets[0].name, "sheets", f"{len(sheets)} of them", expected)
        return sheets
    if split_mm is None:
        split_mm, where = narrowest(sheets[0]), "where it is narrow"
        if split_mm is None:  # the insert of a prosthesis is one plate
            centers, areas = sheets[0].centers, sheets[0].face_areas
            along = in_frame(femur.axis, moved(tibia, centers))[:, 2] - femur.notch_mm
            lateral = float(areas[along > 0].sum() / areas.sum())
            if min(lateral, 1.0 - lateral) < _LEAST_OF_TWO:  # it is under one of them
                return sheets
            split_mm = float(np.average(centers[:, 2] - along, weights=areas))
            where = "below the notch: it lies under both condyles"
        findings.append(f"{name}: one sheet, parted at z = {split_mm:.1f} mm, {where}.")
    parts = []
    offset = np.cumsum([0, *(len(s.points) for s in sheets[:-1])])
    points = np.concatenate([s.points for s in sheets])
    for lower in (True, False):
        own = [s.faces[(s.centers[:, 2] < split_mm) == lower] for s in sheets]
        faces = np.concatenate([face + o for face, o in zip(own, offset, strict=True)])
        parts += [Sheet(points, faces, False, sheets[0].name)] * bool(len(faces))
    return parts
