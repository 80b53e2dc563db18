"""A scene as one HTML page that turns, tells numbers, and needs no network."""

from __future__ import annotations

import dataclasses
import html
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from kneejax.geometry import TIBIA
from kneejax.report.scene import rendering
from kneejax.report.scene.pressure import PRESSURE_COLOURS, spread
from kneejax.report.scene.scene import BoneMesh, Fibre, Plateau, Scene, Sheet
from kneejax.report.scene.surfaces import grid_triangles

_DECIMALS = 2
#: The page does not sort triangles by depth: less pale bones would be mottled.
_BONE_OPACITY = 0.25
#: Bones reach so far above and below fibres and cartilage, mm.
_SHAFT_MM = 15.0
#: On a screen narrower than this, pixels, the legend stands below the knee, not upon it, and words
#: take the place of the scales of colours.
_NARROW = 600
_ON_TIBIA = "tibial surfaces"
_VIEWPORT = '<meta name="viewport" content="width=device-width, initial-scale=1">'


def scene_page(every: Sequence[Scene], most: int = 41) -> str:
    """A page that shows a knee in space; with several poses it has a slider.

    It can be turned and enlarged, groups of ligaments can be switched off, and a fibre under the
    pointer tells its name, strain and tension. Everything is inside, the drawing library too. On a
    phone the legend stands below the knee, with the scales of colours in words.

    Args:
        every: scenes of one knee, from `scenes`.
        most: poses at most; of more, evenly spaced ones are shown.

    Returns:
        The page.

    Raises:
        MissingPackage: Plotly is not installed.
        ValueError: there are no scenes.
    """
    if not every:
        raise ValueError("no scenes to draw")
    go = rendering.plotly()
    shown = _with_short_shafts([every[row] for row in spread(len(every), most)])
    limits = rendering.strain_limit(shown), rendering.pressure_limit(shown)
    tibial = [bone for bone in shown[0].bones if bone.bone == TIBIA]
    still = [_bone(go, bone, number) for number, bone in enumerate(tibial)]
    still += _axes(go, shown[0])
    figure = go.Figure([*_traces(go, shown[0], *limits, first=True), *still])
    figure.frames = [
        go.Frame(name=str(number), data=_moved(go, _traces(go, scene, *limits, first=False)))
        for number, scene in enumerate(shown)
        if len(shown) > 1
    ]
    figure.update_layout(**_layout(shown, limits))
    page = figure.to_html(include_plotlyjs=True, full_html=True, auto_play=False,
                          config={"displaylogo": False, "responsive": True}, default_height="96vh",
                          post_script=_arrange(limits))  # fmt: skip
    return page.replace("<head>", f"<head>{_VIEWPORT}", 1)


def _with_short_shafts(every: Sequence[Scene]) -> list[Scene]:
    """Bones cut at a distance from the knee, by their place in the first scene.

    The whole of a long bone would make the knee small.
    """
    heights = every[0].points_mm[:, 1]
    limits = heights.min() - _SHAFT_MM, heights.max() + _SHAFT_MM
    cuts = [_cut(bone, *limits) for bone in every[0].bones]
    answer = []
    for scene in every:
        bones = []
        for bone, (start, end, share, faces) in zip(scene.bones, cuts, strict=True):
            points = bone.points_mm[start] + share * (bone.points_mm[end] - bone.points_mm[start])
            bones.append(dataclasses.replace(bone, points_mm=points, faces=faces))
        answer.append(dataclasses.replace(scene, bones=tuple(bones)))
    return answer


def _cut(bone: BoneMesh, low: float, high: float):
    """The part between two heights: its points as shares of the ways between two corners."""
    height, faces = bone.points_mm[:, 1], np.asarray(bone.faces)
    inside = (height > low) & (height < high)
    faces = faces[inside[faces].any(axis=1)]
    # A corner outside moves along an edge to the cut.
    partner = np.arange(len(height))
    inner = faces[np.arange(len(faces)), np.argmax(inside[faces], axis=1)]
    for corner in faces.T:
        outside = ~inside[corner]
        partner[corner[outside]] = inner[outside]
    way = height - height[partner]
    to_cut = np.clip(height, low, high) - height[partner]
    share = np.where(inside, 1.0, to_cut / np.where(way == 0, 1.0, way))
    rows, places = np.unique(faces, return_inverse=True)
    return partner[rows], rows, share[rows, None], places.reshape(-1, 3)


def _traces(go, scene: Scene, strain: float, pressure: float, first: bool) -> list[Any]:
    """What changes with the pose, always in the same order."""
    bones = [bone for bone in scene.bones if bone.bone != TIBIA]
    started: set[str] = set()
    traces = [_bone(go, bone, number) for number, bone in enumerate(bones)]
    traces += [_plateau(go, plateau, pressure) for plateau in scene.plateaus]
    for sheets, colour, opacity, name in (
        (scene.condyles, rendering.CONDYLE, 0.45, "femoral surfaces"),
        (scene.obstacles, rendering.OBSTACLE, 0.13, "wrap obstacles"),
    ):
        traces += [_sheet(go, sheet, colour, opacity, name) for sheet in sheets]
    traces += [_center(go, plateau) for plateau in scene.plateaus]
    for fibre in scene.fibres:
        traces.append(_fibre(go, fibre, strain, fibre.group not in started, len(scene.fibres)))
        started.add(fibre.group)
    named: set[str] = set()
    for trace in traces:
        if trace.legendgroup and not isinstance(trace, go.Scatter3d):
            trace.showlegend = trace.legendgroup not in named
            named.add(trace.legendgroup)
    return traces


def _moved(go, traces: list[Any]) -> list[Any]:
    """The same with what differs between poses alone: triangles, colours of sheets, names stay."""
    answer = []
    for trace in traces:
        if not isinstance(trace, go.Mesh3d):
            answer.append(trace)
        elif trace.legendgroup == _ON_TIBIA:  # it stands still, its pressure changes
            answer.append(go.Mesh3d(intensity=trace.intensity))
        else:
            moved = {"x": trace.x, "y": trace.y, "z": trace.z}
            pressed = {} if trace.intensity is None else {"intensity": trace.intensity}
            answer.append(go.Mesh3d(**moved, **pressed))
    return answer


def _places(points_mm: np.ndarray) -> dict[str, np.ndarray]:
    """Anterior, lateral and superior as the page's x, y and z: it turns about its z."""
    flat = np.round(np.asarray(points_mm, float).reshape(-1, 3), _DECIMALS).astype(np.float32)
    # The page's y runs to the person's left, so that its axes stay right-handed.
    return {"x": flat[:, 0], "y": -flat[:, 2], "z": flat[:, 1]}


_LIGHT = {"ambient": 0.75, "diffuse": 0.45, "specular": 0.1, "roughness": 0.8}


def _mesh(go, points_mm: np.ndarray, faces: np.ndarray, group: str, **how: Any):
    corners = dict(zip("ijk", np.asarray(faces, np.int32).T, strict=True))
    return go.Mesh3d(**_places(points_mm), **corners, lighting=_LIGHT, legendgroup=group,
                     name=group, **how)  # fmt: skip


def _sheet(go, sheet: Sheet, colour: str, opacity: float, group: str):
    return _mesh(go, sheet.points_mm, grid_triangles(*sheet.points_mm.shape[:2]), group,
                 color=colour, opacity=opacity, hoverinfo="skip")  # fmt: skip


def _bone(go, bone, number: int):
    return _mesh(go, bone.points_mm, bone.faces, bone.bone, color=rendering.BONE,
                 opacity=_BONE_OPACITY, hoverinfo="skip", showlegend=number == 0)  # fmt: skip


def _plateau(go, plateau: Plateau, limit: float):
    pressure = np.round(np.nan_to_num(plateau.pressure_MPa, nan=limit), 3).ravel()
    group = _ON_TIBIA if plateau.bone == TIBIA else f"{plateau.bone}'s surface"
    says = "%{intensity:.2f} MPa<extra>" + html.escape(plateau.name) + "</extra>"
    return _mesh(go, plateau.points_mm, plateau.faces, group, intensity=pressure.astype(np.float32),
                 coloraxis="coloraxis2", hovertemplate=says)  # fmt: skip


def _center(go, plateau: Plateau):
    center = plateau.center_mm + np.array([0.0, 0.5, 0.0])
    return go.Scatter3d(
        **_places(center), mode="markers", marker={"symbol": "cross", "size": 4, "color": "black"},
        hovertemplate="centre of pressure<extra>" + html.escape(plateau.name) + "</extra>",
        legendgroup="centre of pressure", name="centre of pressure", showlegend=False,
    )


def _fibre(go, fibre: Fibre, limit: float, first: bool, count: int):
    thick = 9 if count <= rendering.FEW_FIBRES else 5
    strain = "" if fibre.is_muscle else f"strain {100 * fibre.strain:.2f} %<br>"
    says = f"{strain}tension {fibre.tension_N:.1f} N"
    owner = "muscle" if fibre.is_muscle else "ligament"
    return go.Scatter3d(
        **_places(fibre.points_mm), mode="lines",
        line={"width": 2 if fibre.slack else thick, "color": rendering.fibre_colour(fibre, limit)},
        hovertemplate=f"{html.escape(fibre.name)}<br>{says}<extra></extra>",
        legendgroup=f"{owner} {fibre.group}", name=html.escape(fibre.group), showlegend=first,
    )


def _axes(go, scene: Scene) -> list[Any]:
    """Anatomical axes beside the knee, and an invisible point for the strain's colours."""
    points = np.concatenate([scene.points_mm, *(bone.points_mm for bone in scene.bones)])
    low = scene.points_mm.min(axis=0)
    start = np.array([points[:, 0].min(), low[1], 0.5 * (points[:, 2].min() + points[:, 2].max())])
    start[2] -= scene.lateral * 0.6 * np.ptp(points[:, 2])
    words = ("anterior", "superior", "lateral")
    ends = {word: start + 18.0 * scene.directions[word] for word in words}
    lines = np.concatenate([[start, end, [np.nan] * 3] for end in ends.values()])
    return [
        go.Scatter3d(**_places(lines), mode="lines", line={"color": "#444444", "width": 3},
                     hoverinfo="skip", showlegend=False),
        go.Scatter3d(**_places(np.array(list(ends.values()))), mode="text", text=list(ends),
                     textfont={"size": 12, "color": "#444444"}, hoverinfo="skip", showlegend=False),
        go.Scatter3d(x=[None], y=[None], z=[None], mode="markers", hoverinfo="skip",
                     showlegend=False, marker={"color": [0.0], "coloraxis": "coloraxis"}),
    ]  # fmt: skip


def _layout(shown: Sequence[Scene], limits: tuple[float, float]) -> dict[str, Any]:
    hidden = {"visible": False, "showbackground": False}
    strain, pressure = limits
    bar = {"len": 0.42, "thickness": 14, "x": 1.0, "xanchor": "left", "outlinewidth": 0}
    layout: dict[str, Any] = {
        "title": {"text": html.escape(f"{shown[0].title} (the tibia held still)"),
                  "font": {"size": 16}, "x": 0.02},
        "template": "plotly_white", "margin": {"l": 0, "r": 0, "t": 44, "b": 0},
        "legend": {"x": 0.0, "y": 0.98, "itemsizing": "constant", "bgcolor": "rgba(0,0,0,0)"},
        "scene": {"xaxis": hidden, "yaxis": hidden, "zaxis": hidden, "aspectmode": "data",
                  "dragmode": "orbit",
                  "camera": {"eye": {"x": 1.4, "y": 0.85 * shown[0].lateral, "z": 0.5}}},
        "coloraxis": {"cmin": 0.0, "cmax": 100 * strain,
                      "colorscale": _scale(rendering.strain_colours()),
                      "colorbar": {**bar, "title": "Strain, %<br>(grey: slack)", "y": 0.76}},
        "coloraxis2": {"cmin": 0.0, "cmax": pressure,
                       "colorscale": _scale(PRESSURE_COLOURS, rendering.GROUND),
                       "colorbar": {**bar, "title": "Contact<br>pressure, MPa", "y": 0.28}},
    }  # fmt: skip
    if len(shown) > 1:
        layout["sliders"] = [_slider(shown)]
    return layout


def _arrange(limits: tuple[float, float]) -> str:
    """A script that makes room for the knee on a narrow screen."""
    strain, pressure = limits
    words = (
        f"Fibres: strain 0 to {100 * strain:g} %, pale to dark red; grey: slack.<br>"
        f"Plateaux: pressure 0 to {pressure:.1f} MPa, yellow to dark red."
    )
    below = {
        "coloraxis.showscale": False, "coloraxis2.showscale": False, "scene.domain.y": [0.32, 1.0],
        "legend": {"orientation": "h", "x": 0.0, "y": 0.2, "yanchor": "top"},
        "modebar.orientation": "v", "title.font.size": 12,
        "annotations": [
            {"text": words, "x": 0.02, "y": 0.3, "xref": "paper", "yref": "paper",
             "xanchor": "left", "yanchor": "top", "align": "left", "showarrow": False,
             "font": {"size": 11}}
        ],
    }  # fmt: skip
    return (
        "var page = document.getElementById('{plot_id}');\n"
        f"if (page.clientWidth < {_NARROW}) Plotly.relayout(page, {json.dumps(below)});"
    )


def _slider(shown: Sequence[Scene]) -> dict[str, Any]:
    still = {"mode": "immediate", "frame": {"duration": 0, "redraw": True},
             "transition": {"duration": 0}}  # fmt: skip
    return {
        "active": 0, "currentvalue": {"prefix": "Flexion ", "suffix": "°", "font": {"size": 14}},
        "pad": {"t": 8, "b": 12, "l": 40, "r": 40},
        "steps": [
            {"label": str(round(scene.flexion_deg)), "method": "animate", "args": [[str(i)], still]}
            for i, scene in enumerate(shown)
        ],
    }


def _scale(colours: Any, ground: str | None = None) -> list[list[Any]]:
    """A matplotlib scale for the page; the colour of what is not pressed at its foot."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shades = colormaps[colours] if isinstance(colours, str) else colours
    scale: list[list[Any]] = [[float(t), to_hex(shades(t))] for t in np.linspace(0.0, 1.0, 33)]
    return scale if ground is None else [[0.0, ground], [0.02, scale[0][1]], *scale[1:]]
