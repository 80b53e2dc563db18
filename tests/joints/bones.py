"""Meshes of made-up bones in OBJ files, and their landmarks."""

from __future__ import annotations

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.joints.condyles import PARTS, condyles

#: Where the plateau of `write_bones` touches the condyles, extended and bent: poses of the tibia.
TOUCHING = [[-10.0, -2.4, 0.0, 3.87, -21.96, 0.0], [60.0, 0.0, 0.0, -19.2, -11.1, 0.0]]
_STEP = 2.0
_X, _Z = np.meshgrid(np.arange(-25, 26.0, _STEP), np.arange(-40, 41.0, _STEP))
#: Corners of the plateau, in the tibia, mm.
PLATEAU = np.c_[_X.ravel(), np.zeros(_X.size), _Z.ravel()]
_LANDMARKS = {
    "epicondyles": {"medial_mm": [0, 0, -40], "lateral_mm": [0, 0, 40]},
    "femoral_head": {"near_mm": [3, 398, 2], "within_mm": 40},
    "tibia": {
        "plateau": {"medial_mm": [0, 0, -36], "lateral_mm": [0, 0, 36]},
        "malleoli": {
            "medial_ball": {"near_mm": [1, -368, -29], "within_mm": 20},
            "lateral_mm": [0, -370, 30],
        },
    },
}


def write_femur(path, mirror=1.0, scale=1.0):
    """The made-up condyles, facing outwards; with `mirror` -1 those of a left knee."""
    points, faces = _condyles()
    return _write(path, points * [1, 1, mirror] * scale, faces[:, :: int(mirror)])


def write_bones(folder):
    """Condyles and a plateau, in the frames of the poses: `femur.obj`, `tibia.obj`."""
    _write(folder / "femur.obj", *_condyles())
    _write(folder / "tibia.obj", *_plateau())


def write_scanned_bones(folder, side):
    """The same with femoral head and medial malleolus, as a scanner sees them, and landmarks."""
    turn, shift = Rotation.from_euler("xyz", [20, -35, 50], degrees=True), np.array([60, 5, -400])
    mirror = -1 if side == "left" else 1

    def seen(points):
        return (turn.apply(points) + shift) * [1, 1, mirror]

    for name, bone, ball in (
        ("femur", _condyles(), _ball([0, 400, 0], 24.0)),
        ("tibia", _plateau(), _ball([0, -370, -30], 9.0)),
    ):
        points = seen(np.concatenate([bone[0], ball[0]]))
        faces = np.concatenate([bone[1], len(bone[0]) + ball[1]])
        _write(folder / f"{name}.obj", points, faces[:, ::mirror])
    (folder / "landmarks.yaml").write_text(yaml.safe_dump(_moved(_LANDMARKS, seen)))


def _condyles():
    points, normals = condyles(step_deg=_STEP, step_mm=_STEP)
    faces, first = [], 0
    for low, high in np.repeat(PARTS, 2, axis=0):
        rows, wide = len(np.arange(-10.0, 10.1, _STEP)), len(np.arange(low, high, _STEP))
        faces.append(first + _triangles(rows, wide))
        first += rows * wide
    faces = np.concatenate(faces)
    corner = points[faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inwards = np.einsum("ij,ij->i", across, normals[faces[:, 0]]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return points, faces


def _plateau():
    return PLATEAU, _triangles(*_X.shape)


def _ball(center, radius):
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 16), np.linspace(0.1, np.pi - 0.1, 9))
    flat = np.sin(down)
    out = np.stack([flat * np.cos(around), np.cos(down), flat * np.sin(around)], axis=-1)
    return center + radius * out.reshape(-1, 3), _triangles(*around.shape)


def _triangles(rows, wide):
    """Corners of the triangles of a grid of points, row by row."""
    a = (np.arange(rows - 1)[:, None] * wide + np.arange(wide - 1)).ravel()
    one, other = [a, a + wide, a + 1], [a + 1, a + wide, a + wide + 1]
    return np.concatenate([np.stack(one, axis=1), np.stack(other, axis=1)])


def _moved(known, seen):
    if isinstance(known, dict):
        return {name: _moved(value, seen) for name, value in known.items()}
    return seen(np.array([known], float))[0].tolist() if isinstance(known, list) else known


def _write(path, points, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return str(path)
