"""A scene of a knee (`kneejax.report.Scene`) in viser: made once, then only moved and coloured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kneejax.explore.solving import Answer
from kneejax.mechanics import NAMED_LOADS
from kneejax.report import Scene
from kneejax.report.scene import (
    BONE,
    FEW_FIBRES,
    MUSCLE,
    OBSTACLE,
    SLACK,
    grid_triangles,
    pressure_bands,
    strain_colour,
)

#: Ends of the colours: strain, and pressure, MPa; fixed, so that colours can be compared.
MOST_STRAIN, MOST_MPA, BANDS = 0.08, 8.0, 8
_GHOST, _LOAD, _WORDS = "#4C78A8", "#B03A2E", 0.95
#: Cartilage, darker than in figures: the browser's light is strong.
_CONDYLE, _GROUND = "#CDB98F", "#BFB39B"
#: Thickness of pulled, slack and remembered fibres, mm.
_PULLED, _SLACK, _THIN = 1.8, 0.6, 0.5
#: Part of it where a knee has many fibres; then those that are slack have no words either.
_OF_MANY = 0.6
#: What 100 N, or 10 N m, are drawn as, and the longest arrow, mm.
_PER_100_MM, _LONGEST_MM = 25.0, 60.0
#: Axis of the scene along which each load acts, its sign, and whether it is a moment.
_LOADS = {"anterior_N": (0, 1.0), "compression_N": (1, 1.0), "lateral_N": (2, 1.0),
          "varus_Nm": (0, 1.0), "internal_Nm": (1, 1.0)}  # fmt: skip


def rgb(colour: str) -> tuple[int, int, int]:
    """`#rrggbb` as three numbers."""
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))  # pyright: ignore[reportReturnType]


def tube(line: np.ndarray, thickness: float, sides: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Corners, `(k sides, 3)`, and triangles around a line of `k` points.

    Example:
        >>> corners, faces = tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]]), 2.0, sides=4)
        >>> corners.shape, faces.shape, round(float(np.abs(corners[:, :2]).max()), 6)
        ((8, 3), (8, 3), 1.0)
    """
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    away = np.eye(3)[np.argmin(np.abs(line[-1] - line[0]))]
    first = away - (along @ away)[:, None] * along
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[:, None, None]
    rings = line + 0.5 * thickness * (np.cos(turn) * first + np.sin(turn) * second)
    number = np.arange(len(line) * sides).reshape(len(line), sides)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    corners = rings.swapaxes(0, 1).reshape(-1, 3)
    return corners.astype(np.float32), faces.astype(np.uint32)


class Drawing:
    """The 3-D view: one for all pages that are open.

    Attributes:
        clicked: called with the ligament whose fibres are clicked.
        words: whether ligaments are labelled.
    """

    def __init__(self, viser_scene: Any, clicked: Callable[[str], None]):
        """An empty view with lights."""
        self.clicked, self.words = clicked, True
        self._scene, self._made, self._clickable = viser_scene, {}, set()
        self._many = False
        viser_scene.set_up_direction("+y")
        viser_scene.configure_default_lights(cast_shadow=False)

    def show(
        self,
        scene: Scene,
        answer: Answer,
        loads: dict[str, float],
        ghost: Scene | None,
        stale: bool,
    ) -> None:
        """Draw a pose.

        Args:
            scene: of the pose.
            answer: its numbers.
            loads: what acts, by name.
            ghost: the setting that was kept, in thin blue lines.
            stale: whether this is a pose that another setting had: everything is grey.
        """
        shown: set[str] = set()
        self._many = len(scene.fibres) > FEW_FIBRES

        def keep(name: str, make: Callable, **props: Any) -> Any:
            """Make a node, or change those of its properties that are others."""
            shown.add(name)
            if name not in self._made:
                self._made[name] = (make(name, **props), props)
                return self._made[name][0]
            handle, before = self._made[name]
            for key, value in props.items():
                if not np.array_equal(before.get(key), value):
                    setattr(handle, key, value)
            if not handle.visible:
                handle.visible = True
            self._made[name] = handle, before | props
            return handle

        def mesh(name: str, points: np.ndarray, faces: np.ndarray, colour: str, opacity=None):
            if len(faces):
                keep(name, self._mesh, vertices=points.reshape(-1, 3).astype(np.float32),
                     faces=faces.astype(np.uint32), color=rgb(SLACK if stale else colour),
                     opacity=opacity)  # fmt: skip

        for i, bone in enumerate(scene.bones):
            mesh(f"/bones/{i}", bone.points_mm, bone.faces, BONE, 0.25)
        for kind, sheets, colour, opacity in (
            ("condyles", scene.condyles, _CONDYLE, 0.6), ("wraps", scene.obstacles, OBSTACLE, 0.13),
        ):  # fmt: skip
            for i, sheet in enumerate(sheets):
                faces = grid_triangles(*sheet.points_mm.shape[:2])
                mesh(f"/{kind}/{i}", sheet.points_mm, faces, colour, opacity)
        for i, plateau in enumerate(scene.plateaus):
            bands = pressure_bands(plateau, MOST_MPA, BANDS)
            for band, (colour, faces) in enumerate(bands):
                mesh(f"/plateaus/{i}/{band}", plateau.points_mm, faces, colour if band else _GROUND)
        for name, fibres in scene.groups.items():
            self._fibres(keep, name, fibres, answer, stale)
        if ghost is not None:
            for fibre in ghost.fibres:
                points, faces = tube(fibre.points_mm, _THIN)
                keep(f"/ghost/{fibre.name}", self._mesh, vertices=points, faces=faces,
                     color=rgb(_GHOST))  # fmt: skip
        self._axes(keep, scene)
        self._arrows(keep, scene, loads)
        for name, (handle, _) in self._made.items():
            if name not in shown and handle.visible:
                handle.visible = False

    def _mesh(self, name: str, **props: Any) -> Any:
        return self._scene.add_mesh_simple(name, side="double", cast_shadow=False, **props)

    def _fibres(self, keep, name: str, fibres: Sequence[Any], answer: Answer, stale: bool) -> None:
        is_muscle, gone = fibres[0].is_muscle, f"{name}.cut" in answer.setting.given
        for fibre in fibres:
            colour = MUSCLE if is_muscle else strain_colour(fibre.strain, MOST_STRAIN)
            thick = _THIN if gone else _SLACK if fibre.slack else _PULLED
            thick *= _OF_MANY if self._many else 1.0
            points, faces = tube(fibre.points_mm, thick)
            handle = keep(f"/ligaments/{name}/{fibre.name}", self._mesh, vertices=points,
                          faces=faces, opacity=0.35 if gone else None,
                          color=rgb(SLACK if stale or gone else colour))  # fmt: skip
            if not is_muscle and handle.name not in self._clickable:
                self._clickable.add(handle.name)
                handle.on_click(lambda _, own=name: self.clicked(own))
        force, strain = sum(x.tension_N for x in fibres), max(x.strain for x in fibres)
        words = f"{name} {force:.0f} N" + ("" if is_muscle else f", {100 * strain:.1f} %")
        if gone or (not is_muscle and strain <= 0):
            words = f"{name} {'cut' if gone else 'slack'}"
        if self.words and (gone or not self._many or is_muscle or strain > 0):
            line = fibres[len(fibres) // 2].points_mm
            way = np.r_[0.0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()]
            where = tuple(float(np.interp(0.5 * way[-1], way, x)) for x in line.T)
            keep(f"/words/{name}", self._label, text=words, position=where)

    def _label(self, name: str, **props: Any) -> Any:
        more = {"font_screen_scale": _WORDS, "anchor": "center-center"}
        return self._scene.add_label(name, **more, **props)

    def _axes(self, keep, scene: Scene) -> None:
        points = scene.points_mm
        start = points.min(axis=0)
        edge = scene.lateral * points[:, 2]
        start[2] = scene.lateral * (edge.min() - 22.0)
        ends = {w: start + 16.0 * scene.directions[w] for w in ("anterior", "superior", "lateral")}
        arrows = np.array([[start, end] for end in ends.values()], np.float32)
        if "/axes" not in self._made:
            self._axes_at = arrows
        keep("/axes", self._arrow, points=self._axes_at, colors=rgb("#555555"))
        for (word, _), (_, end) in zip(ends.items(), self._axes_at, strict=True):
            keep(f"/axes_words/{word}", self._label, text=word, position=tuple(map(float, end)))

    def _arrow(self, name: str, **props: Any) -> Any:
        return self._scene.add_arrows(name, shaft_radius=0.7, head_radius=1.8, head_length=4.0,
                                      **props)  # fmt: skip

    def _arrows(self, keep, scene: Scene, loads: dict[str, float]) -> None:
        """Forces and moments on the tibia, from below its plateaux; a moment along its axis."""
        places = [x.points_mm.reshape(-1, 3) for x in scene.plateaus] or [scene.points_mm]
        points = np.concatenate(places)
        middle = points.mean(axis=0)
        middle[1] = points[:, 1].min() - 6.0
        for name, size in loads.items():
            if not size:
                continue
            axis, sign = _LOADS[name]
            unit = 10.0 if name.endswith("Nm") else 100.0
            way = np.zeros(3)
            way[axis] = sign * (scene.lateral if axis == 2 or unit == 10.0 else 1.0)
            long = np.clip(_PER_100_MM * size / unit, -_LONGEST_MM, _LONGEST_MM)
            start = middle - (way * long if axis == 1 and unit == 100.0 else 0.0)
            arrow = np.array([[start, start + way * long]], np.float32)
            colour = MUSCLE if unit == 10.0 else _LOAD
            keep(f"/loads/{name}", self._arrow, points=arrow, colors=rgb(colour))
            keep(f"/loads_words/{name}", self._label, text=NAMED_LOADS[name].words(size),
                 position=tuple(map(float, arrow[0, 1])))  # fmt: skip
