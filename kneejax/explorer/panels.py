"""What stands beside the knee: numbers, scales of colours, sensitivity bars, curves."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.explorer.answers import FLEXIONS, MOVED, Answer, Curves
from kneejax.geometry import FREE_COORDINATES, coordinate
from kneejax.report.look.colours import (
    BLUE,
    GREY,
    LIGHT,
    VERMILLION,
    part_styles,
)
from kneejax.report.scene import scales
from kneejax.report.scene.scene import Fibre

_BARS = 12
#: Seen on white and on black.
NOW = VERMILLION
_ROW = "display:flex;justify-content:space-between"
_SMALL = "padding:0 1em;font-size:0.8em;line-height:1.35"
#: On a phone the panel takes the lower two fifths, and the knee has the rest.
_NARROW = ("<style>@media (max-width:36em){.mantine-Paper-root[style*='bottom: 0px']"
           "{max-height:38%!important}}</style>")  # fmt: skip


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


def numbers(answer: Answer, strain: float, pressure: float, picked: Sequence[Fibre]) -> str:
    """Coordinates and pressures of a pose as HTML, with what is wrong with it.

    Args:
        answer: of a pose.
        strain: at the end of the scale of colours.
        pressure: likewise, MPa.
        picked: fibres that were clicked.
    """
    rows = [(coordinate(n).label, f"{x:.2f} {unit_of(n)}") for n, x in answer.coordinates.items()]
    rows += [(f"Peak pressure, {n.replace('_', ' ')}", f"{x:.2f} MPa")
             for n, x in answer.peak_MPa.items()]  # fmt: skip
    rows += [(f"Fibre {x.name}", f"{x.tension_N:.1f} N, {100 * x.strain:.2f} %") for x in picked]
    body = "".join(f"<div style='{_ROW}'><span>{html.escape(what)}</span>{number}</div>"
                   for what, number in rows)  # fmt: skip
    bad = sentence(answer.sentence, not answer.status.sound) if answer.sentence else ""
    return f"{_NARROW}<div style='{_SMALL}'>{bad}{body}{scales(strain, pressure)}</div>"


def sentence(words: str, is_bad: bool) -> str:
    """A doubt or a failure as HTML."""
    colour = "#B03A2E" if is_bad else "#7A6000"
    return f"<p style='margin:0.2em 0;color:{colour}'>{html.escape(words)}</p>"


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
    name: str, now: Curves, before: Mapping[str, Curves | None], measured: np.ndarray
) -> dict[str, Any]:
    """A coordinate over flexion: of two other settings, now, and as measured, `(n, 6)`."""
    at = np.union1d(FLEXIONS, measured[:, 0])
    seen = np.full(len(at), np.nan)
    seen[np.searchsorted(at, measured[:, 0])] = measured[:, 1 + FREE_COORDINATES.index(name)]
    how = (_line(GREY, [4, 4]), _line(BLUE, [9, 4]), _line(NOW))
    every = {**before, "now": now}
    lines = dict(zip(every, how, strict=True))
    curves = [x and np.interp(at, FLEXIONS, x.coordinates[name], np.nan, np.nan)
              for x in every.values()]  # fmt: skip
    dots = {"stroke": GREY, "width": 0, "points": {"show": True, "size": 6, "fill": GREY}}
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
    lines = {"A": _line(BLUE, [9, 4]), "now": _line(NOW)}
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
