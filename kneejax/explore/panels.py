"""What stands beside the knee: numbers, scales of colours, sensitivity bars, curves."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from kneejax.explore.drawing import MOST_MPA, MOST_STRAIN
from kneejax.explore.solving import FLEXIONS, MOVED, Answer, Curves
from kneejax.geometry import FREE_COORDINATES, coordinate
from kneejax.report.look.colours import (
    BLACK,
    BLUE,
    GREY,
    LIGHT,
    VERMILLION,
    part_styles,
)
from kneejax.report.scene import PRESSURE_COLOURS, strain_colours

_BARS = 12
_ROW = "display:flex;justify-content:space-between"
_SMALL = "padding:0 1em;font-size:0.8em;line-height:1.35"


def unit_of(name: str) -> str:
    """Unit of a coordinate, or of a ligament's force, as it is shown."""
    if name not in FREE_COORDINATES:
        return "N"
    return "°" if coordinate(name).unit == "deg" else "mm"


def title_of(name: str) -> str:
    """A coordinate, or a ligament's force, with its unit."""
    if name not in FREE_COORDINATES:
        return f"{name} force, N"
    return f"{coordinate(name).label}, {unit_of(name)}"


def numbers(answer: Answer) -> str:
    """Coordinates and pressures of a pose as HTML, with what is wrong with it."""
    rows = [(coordinate(n).label, f"{x:.2f} {unit_of(n)}") for n, x in answer.coordinates.items()]
    rows += [(f"Peak pressure, {n.replace('_', ' ')}", f"{x:.2f} MPa")
             for n, x in answer.peak_MPa.items()]  # fmt: skip
    body = "".join(f"<div style='{_ROW}'><span>{html.escape(what)}</span>{number}</div>"
                   for what, number in rows)  # fmt: skip
    bad = sentence(answer.sentence, not answer.status.sound) if answer.sentence else ""
    return f"<div style='{_SMALL}'>{bad}{body}{_scales()}</div>"


def sentence(words: str, is_bad: bool) -> str:
    """A doubt or a failure as HTML."""
    colour = "#B03A2E" if is_bad else "#7A6000"
    return f"<p style='margin:0.2em 0;color:{colour}'>{html.escape(words)}</p>"


def _scales() -> str:
    """The scales of strain and pressure."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    parts = []
    for title, shades, low, high in (
        ("Strain, %", strain_colours(), "0 (grey: slack)", 100 * MOST_STRAIN),
        ("Pressure, MPa", colormaps[PRESSURE_COLOURS], "0", MOST_MPA),
    ):
        colours = ",".join(to_hex(shades(x)) for x in np.linspace(0.0, 1.0, 9))
        strip = f"height:7px;background:linear-gradient(to right,{colours})"
        ends = f"<div style='{_ROW}'><span>{low}</span><span>{high:g}</span></div>"
        parts.append(f"<div style='flex:1'>{title}<div style='{strip}'></div>{ends}</div>")
    return f"<div style='display:flex;gap:1.5em;margin-top:0.4em'>{''.join(parts)}</div>"


def bars(answer: Answer, of: str, names: tuple[str, ...], unknown: np.ndarray) -> str:
    """What moves a number, as HTML: its derivatives times what is not known of each parameter.

    Args:
        answer: of a pose.
        of: a coordinate or a ligament.
        names: of the parameters.
        unknown: their prior standard deviations.
    """
    if of not in answer.slopes or not np.isfinite(answer.slopes[of]).all():
        return sentence("There are no derivatives where nothing balances.", True)
    moves = answer.slopes[of] * unknown
    most, rows = max(float(np.abs(moves).max()), 1e-12), []
    for i in np.argsort(-np.abs(moves))[:_BARS]:
        colour, long = VERMILLION if moves[i] > 0 else BLUE, 100.0 * abs(moves[i]) / most
        words = html.escape(names[i].replace("_", " ").replace(".", " ", 1))
        rows.append(
            f"<div style='{_ROW}'><span>{words}</span><span>{moves[i]:+.2g} {unit_of(of)}</span>"
            f"</div><div style='background:{LIGHT};height:5px;margin-bottom:4px'>"
            f"<div style='background:{colour};height:5px;width:{long:.0f}%'></div></div>"
        )
    head = "<p style='margin:0 0 0.5em'>Change by one prior standard deviation of each.</p>"
    return f"<div style='{_SMALL}'>{head}{''.join(rows)}</div>"


def coordinate_plot(
    name: str, now: Curves, own: Curves, kept: Curves | None, measured: np.ndarray
) -> dict[str, Any]:
    """A coordinate over flexion: of the knee as read, of A, now, and as measured, `(n, 6)`."""
    at = np.union1d(FLEXIONS, measured[:, 0])
    seen = np.full(len(at), np.nan)
    seen[np.searchsorted(at, measured[:, 0])] = measured[:, 1 + FREE_COORDINATES.index(name)]
    lines = {"as read": _line(GREY, [4, 4]), "A": _line(BLUE, [9, 4]), "now": _line(BLACK)}
    curves = [x and np.interp(at, FLEXIONS, x.coordinates[name], np.nan, np.nan)
              for x in (own, kept, now)]  # fmt: skip
    dots = {"stroke": VERMILLION, "width": 0,
            "points": {"show": True, "size": 6, "fill": VERMILLION}}  # fmt: skip
    return _plot(title_of(name), at, lines | {"measured": dots}, [*curves, seen])


def force_plot(now: Curves) -> dict[str, Any]:
    """Every ligament's force over flexion."""
    styles = part_styles(now.force_N)
    lines = {one: _line(styles[one]["color"], [] if styles[one]["linestyle"] == "-" else [6, 3])
             for one in now.force_N}  # fmt: skip
    return _plot("Ligament force, N", FLEXIONS, lines, [*now.force_N.values()])


def laxity_plot(now: Curves, kept: Curves | None) -> dict[str, Any]:
    """Laxity over flexion in the test that was asked for."""
    test, values = next(iter(now.laxity.items()), ("anterior_N", None))
    before = None if kept is None else kept.laxity.get(test)
    lines = {"A": _line(BLUE, [9, 4]), "now": _line(BLACK)}
    return _plot(f"Laxity, {unit_of(MOVED[test])}", FLEXIONS, lines, [before, values])


def _line(colour: str, dash: list[int] | None = None) -> dict[str, Any]:
    return {"stroke": colour, "width": 1.8, "dash": dash or [], "points": {"show": False}}


def _plot(title: str, x: np.ndarray, lines: dict[str, Any], every: list) -> dict[str, Any]:
    """Arguments of a uPlot; a curve that is not there, or not finite, has no place in its range."""
    data = [np.full(len(x), np.nan) if y is None else y for y in every]
    found = np.concatenate(data)
    found = found[np.isfinite(found)] if np.isfinite(found).any() else np.zeros(1)
    room = 0.08 * np.ptp(found) + 1e-3
    heights = float(found.min() - room), float(found.max() + room)
    series = [{"label": label, **how} for label, how in lines.items()]
    return {
        "title": title, "aspect": 1.9, "data": (x, *data),
        "series": ({"label": "flexion, °"}, *series),
        "scales": {"x": {"time": False, "range": (0.0, 120.0)}, "y": {"range": heights}},
    }  # fmt: skip
