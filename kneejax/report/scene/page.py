"""A scene as one HTML page that turns and bends, and needs no network."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from unittest.mock import patch

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from kneejax.numerics import imported
from kneejax.report.scene import rendering
from kneejax.report.scene.drawing import Drawing
from kneejax.report.scene.pressure import PRESSURE_COLOURS, degrees, spread
from kneejax.report.scene.scene import Scene

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
    if not every:
        raise ValueError("no scenes to draw")
    viser = imported("viser", "viser", "view")
    shown = [every[row] for row in spread(len(every), most)]
    limits = rendering.strain_limit(shown), rendering.pressure_limit(shown)
    with patch("rich.print"):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        look_at(server, shown[0])
        server.scene.world_axes.visible = False
        drawing, record = Drawing(server.scene, None, *limits), server.get_scene_serializer()
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
    """The scales of colours as HTML.

    Args:
        strain: at the end of its scale.
        pressure: likewise, MPa.
    """
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
