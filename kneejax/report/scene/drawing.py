"""A scene in viser (three.js), whose nodes are made once, then only moved, bent and coloured; and
as one HTML page that turns and bends, and needs no network."""

__all__ = ["scene_page"]

import html
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from scipy.spatial.transform import Rotation

from kneejax.geometry import TIBIA
from kneejax.mechanics import NAMED_LOADS
from kneejax.numerics import imported
from kneejax.report.scene import rendering
from kneejax.report.scene.pressure import PRESSURE_COLOURS, degrees
from kneejax.report.scene.scene import Scene
from kneejax.report.scene.surfaces import tube

BANDS = 8
_GHOST, _LOAD, _WORDS = "#4C78A8", "#B03A2E", 0.95
#: Cartilage, darker than in figures: the browser's light is strong.
_CONDYLE, _GROUND = "#CDB98F", "#BFB39B"
#: Points of a bone's node that are as near as this to where they were are not sent again, mm.
_SAME_MM = 1e-3
#: Thickness of pulled, slack and remembered fibres, mm.
_PULLED, _SLACK, _THIN = 1.8, 0.6, 0.5
#: Part of it where a knee has many fibres; then those that are slack have no words either.
_OF_MANY = 0.6
#: Share of its way at which a ligament has its words, in turn: some cross in their middles.
_SHARES = (0.62, 0.38)
#: What 100 N, or 10 N m, are drawn as, and the longest arrow, mm.
_PER_100_MM, _LONGEST_MM = 25.0, 60.0
#: Axis of the scene along which each load acts.
_LOADS = {"anterior_N": 0, "compression_N": 1, "lateral_N": 2, "varus_Nm": 0, "internal_Nm": 1}


def rgb(colour: str) -> tuple[int, int, int]:
    """`#rrggbb` as three numbers."""
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))  # pyright: ignore[reportReturnType]


class SceneView:
    """A scene on the screen; `words`: labels; `strain` and `pressure`: ends of the colours."""

    def __init__(self, viser_scene: Any, clicked: Callable[[str], None] | None = None,
                 strain: float = 0.08, pressure: float = 8.0):  # fmt: skip
        """An empty view with lights; `clicked` is called with a fibre's name."""
        self.words, self.strain, self.pressure = True, strain, pressure
        self._clicked = clicked
        self._frame = partial(viser_scene.add_frame, show_axes=False)
        self._mesh = partial(viser_scene.add_mesh_simple, side="double", cast_shadow=False)
        self._label = partial(viser_scene.add_label, font_screen_scale=_WORDS,
                              anchor="center-center")  # fmt: skip
        self._arrow = partial(viser_scene.add_arrows, shaft_radius=0.7, head_radius=1.8,
                              head_length=4.0)  # fmt: skip
        self._made: dict[str, tuple[Any, dict[str, Any]]] = {}
        self._shown: set[str] = set()
        self._grey = False
        viser_scene.set_up_direction("+y")
        viser_scene.configure_default_lights(cast_shadow=False)

    def show(
        self, scene: Scene, loads: Mapping[str, float] | None = None, ghost: Scene | None = None,
        stale: bool = False, gone: Collection[str] = (),
    ) -> None:  # fmt: skip
        """Draw a pose, a `ghost` in thin lines; grey where it is `stale`; cut what is `gone`."""
        self._shown, self._grey = set(), stale
        for bone, (turn, shift) in scene.places.items():
            w = np.roll(Rotation.from_matrix(turn).as_quat(), 1)
            self._keep(f"/{bone}", self._frame, wxyz=w, position=tuple(shift))
        for i, x in enumerate(scene.bones, 1):
            self._surface(scene, x, f"bone {i}", rendering.BONE, rendering.BONE_OPACITY[x.bone])
        for x in scene.condyles:
            self._surface(scene, x, f"cartilage {x.name}", _CONDYLE, 0.6)
        for i, x in enumerate(scene.obstacles, 1):
            self._surface(scene, x, f"wrap {i}", rendering.OBSTACLE, 0.13)
        for x in scene.plateaus:
            bands = rendering.pressure_bands(x, self.pressure, BANDS)
            for i, (colour, faces) in enumerate(bands):
                own = _GROUND if colour == rendering.GROUND else colour
                self._surface(scene, x, f"pressure {x.name}/{i}", own, some=faces)
        many = len(scene.fibres) > rendering.FEW_FIBRES
        for i, (name, fibres) in enumerate(scene.groups.items()):
            self._ligament(name, fibres, gone, many, _SHARES[i % len(_SHARES)])
        for fibre in () if ghost is None else ghost.fibres:
            points, faces = tube(fibre.points_mm, _THIN)
            self._keep(f"/kept/{fibre.name}", self._mesh, vertices=points, faces=faces,
                       color=rgb(_GHOST))  # fmt: skip
        self._axes(scene)
        self._arrows(scene, loads or {})
        for name, (handle, _) in self._made.items():
            if name not in self._shown and handle.visible:
                handle.visible = False

    def tell(self, words: str, position: np.ndarray) -> None:
        """Put words at a place."""
        self._keep("/words/of_fibre", self._label, text=words, position=tuple(map(float, position)))

    def _keep(self, name: str, make: Callable, **props: Any) -> Any:
        """Make a node, or change those of its properties that are others."""
        self._shown.add(name)
        if name not in self._made:
            self._made[name] = (make(name, **props), props)
            return self._made[name][0]
        handle, before = self._made[name]
        for key, value in props.items():
            if before[key] is not value and not np.array_equal(before[key], value):
                setattr(handle, key, value)
        if not handle.visible:
            handle.visible = True
        self._made[name] = handle, before | props
        return handle

    def _surface(
        self, scene: Scene, part: Any, name: str, colour: str, opacity: float | None = None, *,
        some: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """A mesh on its bone, which moves it: its own points are sent once."""
        faces = part.faces if some is None else some
        if not len(faces):
            return
        turn, shift = scene.places[part.bone]
        name = f"/{part.bone}/{name}"
        own = ((part.points_mm.reshape(-1, 3) - shift) @ turn).astype(np.float32)
        known = self._made[name][1]["vertices"] if name in self._made else own[:0]
        if known.shape == own.shape and np.allclose(known, own, rtol=0.0, atol=_SAME_MM):
            own = known
        shown = rendering.SLACK if self._grey else colour
        self._keep(name, self._mesh, vertices=own, faces=faces.astype(np.uint32), color=rgb(shown),
                   opacity=opacity)  # fmt: skip

    def _ligament(
        self, name: str, fibres: Sequence[Any], gone: Collection[str], many: bool, share: float
    ) -> None:
        is_muscle = fibres[0].is_muscle
        for fibre in fibres:
            torn = fibre.name in gone
            thick = _THIN if torn else _SLACK if fibre.slack else _PULLED
            points, faces = tube(fibre.points_mm, thick * (_OF_MANY if many else 1.0))
            pale = self._grey or torn
            colour = rendering.SLACK if pale else rendering.fibre_colour(fibre, self.strain)
            place = f"/ligaments/{name}/{fibre.name}"
            known = place in self._made
            handle = self._keep(place, self._mesh, vertices=points, faces=faces, color=rgb(colour),
                                opacity=0.35 if torn else None)  # fmt: skip
            if self._clicked is not None and not known and not is_muscle:
                handle.on_click(lambda _, own=fibre.name, clicked=self._clicked: clicked(own))
        force, strain = sum(x.tension_N for x in fibres), max(x.strain for x in fibres)
        words = f"{name} {force:.0f} N" + ("" if is_muscle else f", {100 * strain:.1f} %")
        cut = all(x.name in gone for x in fibres)
        if cut or (not is_muscle and strain <= 0):
            words = f"{name} {'cut' if cut else 'slack'}"
        if self.words and (cut or not many or is_muscle or strain > 0):
            where = fibres[len(fibres) // 2].at(share)
            self._keep(f"/words/{name}", self._label, text=words, position=tuple(where.tolist()))

    def _axes(self, scene: Scene) -> None:
        if "/axes/arrows" not in self._made:
            points = scene.points_mm
            start = points.min(axis=0)
            start[2] = scene.lateral * ((scene.lateral * points[:, 2]).min() - 22.0)
            self._ends = {word: start + 16.0 * way for word, way in scene.directions.items()}
            self._arrows_at = np.array([[start, end] for end in self._ends.values()], np.float32)
        self._keep("/axes/arrows", self._arrow, points=self._arrows_at, colors=rgb("#777777"))
        for word, end in self._ends.items():
            place = tuple(map(float, end))
            self._keep(f"/axes/{word}", self._label, text=word, position=place)

    def _arrows(self, scene: Scene, loads: Mapping[str, float]) -> None:
        """Forces and moments on the tibia, from below its plateaux; a moment along its axis."""
        tibial = [x.points_mm.reshape(-1, 3) for x in scene.plateaus if x.bone == TIBIA]
        points = np.concatenate(tibial or [scene.points_mm])
        middle = points.mean(axis=0)
        middle[1] = points[:, 1].min() - 6.0
        for name, size in loads.items():
            if not size:
                continue
            axis, is_moment, way = _LOADS[name], name.endswith("Nm"), np.zeros(3)
            way[axis] = scene.lateral if axis == 2 or is_moment else 1.0
            long = _PER_100_MM * size / (10.0 if is_moment else 100.0)
            along = way * np.clip(long, -_LONGEST_MM, _LONGEST_MM)
            start = middle - along * (axis == 1 and not is_moment)
            arrow = np.array([[start, start + along]], np.float32)
            colour = rendering.MUSCLE if is_moment else _LOAD
            self._keep(f"/loads/{name}", self._arrow, points=arrow, colors=rgb(colour))
            self._keep(f"/loads/{name} words", self._label, text=NAMED_LOADS[name].words(size),
                       position=tuple(map(float, arrow[0, 1])))  # fmt: skip


#: What a pose of several is shown for, s.
_POSE_S = 0.25
_ROW = "display:flex;justify-content:space-between"
_CORNER = ("position:fixed;left:0.8em;bottom:3.2em;width:min(23em,calc(100vw - 1.6em));z-index:2;"
           "pointer-events:none;font:0.8em/1.35 system-ui,sans-serif;color:#555")  # fmt: skip


def scene_page(every: Sequence[Scene], most: int = 41) -> str:
    """A page that shows a knee in space; with several poses it bends, and has a bar to stop it.

    It can be turned and enlarged, and its tree switches bones and ligaments off; each ligament is
    labelled with its force and its largest strain. Everything is inside, the drawing library too.

    Args:
        every: scenes of one knee, from `scenes`.
        most: poses at most; of more, evenly spaced ones are shown.

    Returns:
        The page.

    Raises:
        MissingPackage: viser is not installed.
        ValueError: there are no scenes.
    """
    shown, limits = rendering.chosen(every, most)
    viser = imported("viser", "viser", "view")
    with patch("rich.print"):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        look_at(server, shown[0])
        server.scene.world_axes.visible = False
        drawing, record = SceneView(server.scene, None, *limits), server.get_scene_serializer()
        above = shown[0].points_mm.max(axis=0) * [0.0, 1.0, 0.0] + [0.0, 8.0, 0.0]
        for scene in shown:
            drawing.show(scene)
            drawing.tell(f"{degrees(scene.flexion_deg)} flexion", above)
            if len(shown) > 1:
                record.insert_sleep(_POSE_S)
        page = record.as_html()
    finally:
        server.stop()
    title = html.escape(f"{shown[0].title} (the tibia held still)")
    words = f"<div style='{_CORNER}'><b>{title}</b>{scales(*limits)}</div>"
    # In the head: what viser has in its body is packed.
    words = json.dumps(words).replace("<", "\\u003c")
    add = ("<script>addEventListener('load', () => document.body.insertAdjacentHTML('beforeend', "
           f"{words}))</script>")  # fmt: skip
    page = page.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    return page.replace("</head>", f"{add}</head>", 1)


def look_at(server, scene: Scene) -> None:
    """Begin where the whole knee is seen, from the front and its lateral side."""
    points = scene.points_mm
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    way = np.array([1.0, 0.35, 0.55 * scene.lateral])
    place = middle + 2.9 * size * way / np.linalg.norm(way)
    server.initial_camera.look_at = tuple(map(float, middle))
    server.initial_camera.position = tuple(map(float, place))
    server.initial_camera.fov = 0.6


def scales(strain: float, pressure: float) -> str:
    """The scales of colours of strain and pressure, MPa, to their ends, as HTML."""
    parts = []
    for title, shades, low, high in (
        ("Strain, %", rendering.strain_colours(), "0 (grey: slack)", 100 * strain),
        ("Pressure, MPa", colormaps[PRESSURE_COLOURS], "0", pressure),
    ):
        colours = ",".join(to_hex(shades(x)) for x in np.linspace(0.0, 1.0, 9))
        strip = f"height:7px;background:linear-gradient(to right,{colours})"
        ends = f"<div style='{_ROW}'><span>{low}</span><span>{high:.3g}</span></div>"
        parts.append(f"<div style='flex:1'>{title}<div style='{strip}'></div>{ends}</div>")
    return f"<div style='display:flex;gap:1.5em;margin-top:0.4em'>{''.join(parts)}</div>"
