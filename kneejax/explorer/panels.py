"""What stands beside the knee: numbers, scales of colours, sensitivity bars, curves; and gizmos on
the ends of a ligament."""

import functools
import html
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.explorer.setting import ENDS, FLEXIONS, MOVED, TESTS, Answer, Curves, Setting, Subject
from kneejax.explorer.solving import Solver
from kneejax.geometry import FREE_COORDINATES, TIBIA, coordinate
from kneejax.mechanics import NAMED_LOADS
from kneejax.quantities import AXES
from kneejax.report.look.colours import BLUE, GREY, LIGHT, VERMILLION, part_styles
from kneejax.report.look.tables import NONE, plain
from kneejax.report.scene.drawing import scales
from kneejax.report.scene.scene import Fibre
from kneejax.report.scene.surfaces import Places

_BARS = 12
#: Something is being computed, for as long as nobody knows.
WAITING = "<progress aria-label='computing' style='width:100%'></progress>"
#: Seen on white and on black.
NOW = VERMILLION
_ROW = "display:flex;justify-content:space-between"
_SMALL = "padding:0 1em;font-size:0.8em;line-height:1.35"
#: On a phone the panel takes the lower two fifths, and the knee has the rest.
_NARROW = ("<style>@media (max-width:36em){.mantine-Paper-root[style*='bottom: 0px']"
           "{max-height:38%!important;width:100%!important}"
           "[style*='bottom: 0px'] [style*='width: 20em']{width:100%!important}}</style>")


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
    """Numbers of a pose and of clicked fibres as HTML, with the ends of both colour scales."""
    rows = [(coordinate(n).label, f"{x:.2f} {unit_of(n)}" if np.isfinite(x) else NONE)
            for n, x in answer.coordinates.items()]  # fmt: skip
    rows += [(f"Peak pressure, {n.replace('_', ' ')}", f"{x:.2f} MPa")
             for n, x in answer.peak_MPa.items()]  # fmt: skip
    rows += [(f"Fibre {x.name}", f"{x.tension_N:.1f} N, {100 * x.strain:.2f} %") for x in picked]
    body = "".join(f"<div style='{_ROW}'><span>{html.escape(what)}</span>{number}</div>"
                   for what, number in rows)  # fmt: skip
    if answer.status is None:
        bad = sentence(answer.sentence, False) + WAITING
    else:
        bad = sentence(answer.sentence, not answer.status.sound) if answer.sentence else ""
    return f"{_NARROW}<div style='{_SMALL}'>{bad}{body}{scales(strain, pressure)}</div>"


def sentence(words: str, is_bad: bool) -> str:
    """A doubt or a failure as HTML."""
    colour = "#B03A2E" if is_bad else "#7A6000"
    return f"<p style='margin:0.2em 0;color:{colour}'>{html.escape(words)}</p>"


class Charts:
    """Curves over flexion, and what moves a number: two tabs, each with what it can be asked."""

    def __init__(
        self, gui: Any, tabs: Any, solver: Solver, measured: np.ndarray,
        asked: Callable[[str], None],
    ):  # fmt: skip
        """Show nothing yet; `asked` is called with the load of a chosen laxity test, or nothing."""
        self._solver, self._measured = solver, measured
        self._every: Mapping[str, Curves | None] = {"now": None}
        self._answer = solver.unsolved()
        numbers = (*FREE_COORDINATES, *solver.subject.ligaments)
        self._numbers = {title_of(name): name for name in numbers}
        titles, tests = tuple(self._numbers), {"none": ""}
        for name, size in TESTS.items():
            load = NAMED_LOADS[name]
            tests[f"{load.positive} ± {size:g} {load.unit}"] = name
        with tabs.add_tab("Curves"):
            self._shown = gui.add_dropdown("Coordinate", titles[: len(FREE_COORDINATES)],
                                           initial_value=titles[1])  # fmt: skip
            *first, laxity = self._plots()
            self._plotted = [gui.add_uplot(**one) for one in first]
            test = gui.add_dropdown("Laxity test", tuple(tests))
            self._plotted.append(gui.add_uplot(**laxity, visible=False))
        with tabs.add_tab("Sensitivity"):
            self._of = gui.add_dropdown("What moves", titles, initial_value=titles[1])
            self._bars = gui.add_html(WAITING)
        self._shown.on_update(lambda _: self.draw(self._every))
        self._of.on_update(lambda _: self.explain(self._answer))
        test.on_update(lambda _: asked(tests[test.value]))

    def draw(self, every: Mapping[str, Curves | None]) -> None:
        """Show curves: of the knee as it was, of A, and those of now."""
        self._every, now = every, every["now"]
        self._plotted[2].visible = now is not None and bool(now.laxity)
        for plotted, wanted in zip(self._plotted, self._plots(), strict=True):
            for key in ("title", "series", "scales", "data"):
                setattr(plotted, key, wanted[key])

    def explain(self, answer: Answer) -> None:
        """Show what moves a pose."""
        self._answer, solver = answer, self._solver
        name = self._numbers[self._of.value]
        self._bars.content = bars(answer, name, solver.names, solver.unknown)

    def _plots(self) -> list[dict[str, Any]]:
        every, name, measured = self._every, self._numbers[self._shown.value], self._measured
        now, kept = every["now"], every.get("A")
        a, solid = _line(BLUE, [9, 4]), _line(NOW)
        # A coordinate over flexion: of the knee as it was, of A, now, and as measured.
        at = np.union1d(FLEXIONS, measured[:, 0])
        seen = np.full(len(at), np.nan)
        seen[np.searchsorted(at, measured[:, 0])] = measured[:, 1 + FREE_COORDINATES.index(name)]
        how = {"A": a, "now": solid}
        found = [(label, how.get(label, _line(GREY, [4, 4])),
                  np.interp(at, FLEXIONS, x.coordinates[name], np.nan, np.nan))
                 for label, x in every.items() if x]  # fmt: skip
        dots = {"stroke": GREY, "width": 0, "points": {"show": True, "size": 6, "fill": GREY}}
        found += [("measured", dots, seen)] * bool(len(measured))
        force = {} if now is None else now.force_N
        styles = part_styles(force)
        dash = {one: [] if style["linestyle"] == "-" else [6, 3] for one, style in styles.items()}
        forces = [(one, _line(styles[one]["color"], dash[one]), x) for one, x in force.items()]
        (test,) = now.laxity if now and now.laxity else ("anterior_N",)
        both = ("A", a, kept), ("now", solid, now)
        lax = [(label, line, x.laxity[test]) for label, line, x in both if x and test in x.laxity]
        return [
            _plot(title_of(name), at, found), _plot("Ligament force, N", FLEXIONS, forces),
            _plot(f"Laxity, {unit_of(MOVED[test])}", FLEXIONS, lax),
        ]  # fmt: skip


def bars(answer: Answer, of: str, names: tuple[str, ...], unknown: np.ndarray) -> str:
    """A number's derivatives times the prior standard deviations of the parameters, as HTML."""
    if answer.status is None:
        return WAITING
    if of not in answer.slopes or not np.isfinite(answer.slopes[of]).all():
        return sentence("There are no derivatives where nothing balances.", True)
    moves = answer.slopes[of] * unknown
    most, rows = max(float(np.abs(moves).max()), 1e-12), []
    for i in np.argsort(-np.abs(moves))[:_BARS]:
        colour, long = VERMILLION if moves[i] > 0 else BLUE, 100.0 * abs(moves[i]) / most
        words = html.escape(plain(names[i]))
        rows.append(
            f"<div style='{_ROW}'><span>{words}</span><span>{moves[i]:+.2g} {unit_of(of)}</span>"
            f"</div><div style='background:{LIGHT};height:5px;margin-bottom:4px'>"
            f"<div style='background:{colour};height:5px;width:{long:.0f}%'></div></div>"
        )
    head = "<p style='margin:0 0 0.5em'>Change by one prior standard deviation of each.</p>"
    return f"<div style='{_SMALL}'>{head}{''.join(rows)}</div>"


def _line(colour: str, dash: list[int] | None = None) -> dict[str, Any]:
    return {"stroke": colour, "width": 1.8, "dash": dash or [], "points": {"show": False}}


def _plot(title: str, x: np.ndarray, lines: list[tuple]) -> dict[str, Any]:
    """Arguments of a uPlot of labelled lines; what is not finite has no place in its range."""
    lines = lines or [("now", _line(NOW), np.full(len(x), np.nan))]
    data = [y for *_, y in lines]
    found = np.concatenate(data)
    found = found[np.isfinite(found)] if np.isfinite(found).any() else np.array([-1.0, 1.0])
    room = 0.08 * np.ptp(found) + 1e-3
    heights = float(found.min() - room), float(found.max() + room)
    series = [{"label": label, **how} for label, how, _ in lines]
    return {
        "title": title, "aspect": 1.9, "data": (x, *data),
        "series": ({"label": "flexion, °"}, *series),
        "scales": {"x": {"time": False, "range": (0.0, 120.0)}, "y": {"range": heights}},
    }  # fmt: skip


class Ends:
    """Gizmos on the ends of one ligament, those on the femur and on the tibia."""

    def __init__(self, viser_scene: Any, subject: Subject, moved: Callable[[str, float], None]):
        """None are shown; `moved` is called with the name of an end's coordinate and its mm."""
        self._scene, self._subject, self._moved = viser_scene, subject, moved
        self._mirror = np.array([1.0, 1.0, -1.0 if subject.knee.side == "left" else 1.0])
        self._shown: dict[str, tuple[str, Any]] = {}
        self._places = Places({})

    def show(self, ligament: str, setting: Setting, answer: Answer) -> None:
        """Put gizmos on a ligament's ends where the bones of an answer are; none where it is ''."""
        self._places = Places.of(answer.state)
        names = {end: [f"{ligament}.{end}.{axis}" for axis in AXES] for end in ENDS}
        names = {end: each for end, each in names.items() if each[0] in self._subject.limits}
        for end in [*self._shown]:
            if end not in names or self._shown[end][0] != ligament:
                self._shown.pop(end)[1].remove()
        for end, each in names.items():
            if end not in self._shown:
                gizmo = self._scene.add_transform_controls(
                    f"/ends/{end}", scale=14.0, disable_rotations=True, disable_sliders=True,
                    depth_test=False,
                )  # fmt: skip
                gizmo.on_update(functools.partial(self._dragged, each))
                self._shown[end] = ligament, gizmo
            point = np.array([self._subject.value(setting, name) for name in each])
            there = self._places.moved(point, ENDS[end], TIBIA, 0) * self._mirror
            self._shown[end][1].position = tuple(map(float, there))

    def _dragged(self, names: list[str], event: Any) -> None:
        if event.client is None:
            return
        point = np.asarray(event.target.position) * self._mirror
        own = self._places.moved(point, TIBIA, ENDS[names[0].split(".")[1]], 0)
        for name, value in zip(names, own.tolist(), strict=True):
            self._moved(name, value)
