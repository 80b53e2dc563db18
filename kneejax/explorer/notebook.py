"""Sliders, curves and a map of two parameters, side by side in a notebook."""

__all__ = ["explore"]

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from kneejax.explorer.by_hand import ByHand
from kneejax.geometry import FREE_COORDINATES, coordinate
from kneejax.inference import Condition
from kneejax.numerics import imported
from kneejax.report.look.colours import BLACK, BLUE, GREY, VERMILLION
from kneejax.statics import Status, converged
from kneejax.studies import Study

#: Width and height of both figures, pixels: together, with sliders above, they fit 1,280.
_CURVES, _MAP = (430, 560), (400, 560)
#: Marks of poses, and of points of a map.
_FAULTS = {"not to be trusted": "triangle-down-open", "no balance": "x-thin-open"}
#: Steps of a slider at least, each a power of ten: a page shows round numbers as they are.
_STEPS = 200


def explore(
    study: Study | str | os.PathLike[str],
    at: Mapping[str, float] | None = None,
    pair: tuple[str, str] | None = None,
    grid: tuple[int, int] = (25, 25),
) -> "Explorer":
    """Move a study's parameters by sliders in a notebook, with its curves and a map of two of them.

    Needs a running kernel and `kneejax[notebook]`. `kneejax explore STUDY` shows the knee in space.

    Args:
        study: a study with poses, or the name or file of one.
        at: parameter -> value, where the sliders begin; where the study's search begins otherwise.
        pair: parameters of the map; the first two of one ligament otherwise.
        grid: points of the map.

    Returns:
        What a cell shows; its `values` are where the sliders stand.

    Raises:
        MissingPackage: ipywidgets, Plotly or anywidget is not installed.
        UnsuitableData: a study without poses, or one whose knee balances at none of them.

    Example:
        >>> import kneejax as kj
        >>> shown = kj.explore("passive_flexion")  # doctest: +SKIP
        >>> shown.values["ACL.stiffness"]  # doctest: +SKIP
        5000.0
    """
    return Explorer(ByHand(study, at), pair, grid)


class Explorer:
    """Sliders, curves and a map of a `ByHand`."""

    def __init__(self, hand: ByHand, pair: tuple[str, str] | None, grid: tuple[int, int]):
        """Draw everything once; from then on only numbers change."""
        self._widgets = imported("ipywidgets", "ipywidgets", "notebook")
        self._go = imported("plotly.graph_objects", "Plotly", "notebook")
        imported("anywidget", "anywidget", "notebook")
        self.hand, self._grid, self._elsewhere = hand, grid, {}
        self.sliders = {name: self._slider(name) for name in hand.names}
        pair = pair or (hand.names[0], hand.names[len(hand.names) // 2])
        self._choices = [
            self._widgets.Dropdown(options=hand.names, value=name, description=axis,
                                   layout={"width": "280px"}, style={"description_width": "60px"})
            for axis, name in zip(("across", "up"), pair, strict=True)
        ]  # fmt: skip
        self.words = self._widgets.HTML()
        self._draw_curves()
        self._draw_map()
        for choice in self._choices:
            choice.observe(lambda _: self.map_here(), "value")
        buttons = [self._button("Start", lambda: self.move(hand.begin))]
        if hand.study.truth:
            buttons.append(self._button("Truth", lambda: self.move(hand.study.truth)))
        buttons.append(self._button("Map from here", self.map_here))
        row = {"flex_flow": "row wrap"}
        self.panel = self._widgets.VBox([
            self._widgets.Box([*self.sliders.values()], layout=row),
            self._widgets.Box([*buttons, *self._choices], layout=row), self.words,
            self._widgets.Box([self.curves, self.plane], layout=row),
        ])  # fmt: skip
        self.map_here()

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> where its slider stands."""
        return dict(self.hand.values)

    def move(self, values: Mapping[str, float]) -> None:
        """Put sliders elsewhere; the knee follows once."""
        self.hand.move(values)
        for name, value in self.hand.values.items():
            slider = self.sliders[name]
            slider.min, slider.max = min(slider.min, value), max(slider.max, value)
            slider.value = value
        self._show()

    def _repr_mimebundle_(self, **how: Any) -> Any:
        return self.panel._repr_mimebundle_(**how)

    def _button(self, words: str, act: Any) -> Any:
        made = self._widgets.Button(description=words, layout={"width": "auto"})
        made.on_click(lambda _: act())
        return made

    def _slider(self, name: str) -> Any:
        value, (low, high) = self.hand.values[name], self.hand.study.limits[name]
        low, high = min(low, value), max(high, value)
        slider = self._widgets.FloatSlider(
            value, min=low, max=high, step=10.0 ** np.floor(np.log10((high - low) / _STEPS)),
            readout_format=".4g",
            description=_said(name), layout={"width": "350px"},
            style={"description_width": "100px"},
        )  # fmt: skip

        def follow(change: Any) -> None:
            # A slider that was put where the knee is, and that a page rounds to its steps when it
            # shows it, was moved by nobody.
            if abs(change.new - self.hand.values[name]) > 0.51 * slider.step:
                self.hand.move({name: change.new})
                self._show()

        slider.observe(follow, "value")
        return slider

    # Curves.

    def _draw_curves(self) -> None:
        subplots = imported("plotly.subplots", "Plotly", "notebook")
        hand, titles = self.hand, [coordinate(name).axis_label for name in FREE_COORDINATES]
        self.curves = self._go.FigureWidget(
            subplots.make_subplots(3, 2, subplot_titles=titles, vertical_spacing=0.11)
        )
        flexion, nothing = hand.measured[:, 0], np.full(len(hand.measured), np.nan)
        self._order = np.argsort(flexion, kind="stable")
        self._lines, self._marks = [], []
        for i in range(len(FREE_COORDINATES)):
            place = {"row": i // 2 + 1, "col": i % 2 + 1, "showlegend": i == 0}
            seen, begun = hand.measured[:, 1 + i], hand.now.table[self._order, 1 + i]
            thin = {"color": BLUE, "width": 1, "dash": "dot"}
            for y, name, how in (
                (seen, "measured", {"mode": "markers", "marker": {"color": BLACK, "size": 4}}),
                (begun, "start", {"mode": "lines", "line": thin}),
                (nothing, "this knee", {"mode": "lines", "line": {"color": VERMILLION}}),
            ):
                x = flexion if name == "measured" else flexion[self._order]
                self.curves.add_scatter(x=x, y=y, name=name, **how, **place)
            self._lines.append(self.curves.data[-1])
            for fault, symbol in _FAULTS.items():
                style = {"symbol": symbol, "size": 8, "color": GREY, "line": {"width": 2}}
                self.curves.add_scatter(x=flexion, y=nothing, mode="markers", marker=style,
                                        name=fault, **place)  # fmt: skip
                self._marks.append((i, fault, self.curves.data[-1]))
            both = np.r_[seen, begun[np.isfinite(begun)]]
            pad = max(0.5 * np.ptp(both), 2.0)
            self.curves.update_yaxes(range=(both.min() - pad, both.max() + pad), row=i // 2 + 1,
                                     col=i % 2 + 1)  # fmt: skip
        self.curves.update_annotations(font_size=12)
        self.curves.update_layout(
            template="plotly_white", width=_CURVES[0], height=_CURVES[1], font_size=11,
            margin={"t": 30, "b": 30, "l": 30, "r": 5},
            legend={"x": 0.56, "y": 0.26, "yanchor": "top", "bgcolor": "rgba(0,0,0,0)"},
        )  # fmt: skip

    def _show(self) -> None:
        hand, status = self.hand, self.hand.now.status
        table, nowhere = hand.now.table, ~converged(status)
        doubtful = ((status != Status.BALANCED) | hand.unphysiological) & ~nowhere
        at = dict(zip(_FAULTS, (doubtful, nowhere), strict=True))
        with self.curves.batch_update():
            for i, line in enumerate(self._lines):
                line.y = table[self._order, 1 + i]
            for i, fault, marks in self._marks:
                # A pose without a balance has no height: its cross stands at the lower edge.
                low, high = self.curves.layout[f"yaxis{i + 1 if i else ''}"].range
                edge = low + 0.04 * (high - low)
                height = edge if fault == "no balance" else table[:, 1 + i]
                marks.y = np.where(at[fault], height, np.nan)
        self._show_point()

    # The map.

    @property
    def pair(self) -> tuple[str, str]:
        """Parameters of the map."""
        return tuple(choice.value for choice in self._choices)  # pyright: ignore[reportReturnType]

    def _draw_map(self) -> None:
        self.plane = plane = self._go.FigureWidget()
        plane.add_contour(colorscale="Viridis", connectgaps=False, name="objective",
                          line={"width": 0.5, "color": "white"},
                          colorbar={"title": "objective", "thickness": 12})  # fmt: skip
        for words, symbol in _FAULTS.items():
            style = {"symbol": symbol, "size": 5, "color": GREY, "line": {"width": 1}}
            plane.add_scatter(mode="markers", marker=style, name=words, hoverinfo="skip")
        star = {"symbol": "star", "size": 13, "color": "white", "line": {"width": 1}}
        dot = {"size": 10, "color": VERMILLION, "line": {"width": 1, "color": "white"}}
        plane.add_scatter(mode="markers", marker=star, name="lowest grid point")
        plane.add_scatter(mode="lines", line_color=VERMILLION, name="moves the knee by one")
        plane.add_scatter(mode="markers", marker=dot, name="this knee")
        plane.update_layout(template="plotly_white", width=_MAP[0], height=_MAP[1], font_size=11,
                            plot_bgcolor="#E4E7EA", margin={"t": 20, "b": 40, "l": 50, "r": 10},
                            legend={"orientation": "h", "y": -0.1})  # fmt: skip

    def map_here(self) -> None:
        """Compute the map with the other parameters where they stand."""
        pair, (colours, *crosses, lowest, _, _) = self.pair, self.plane.data
        if pair[0] == pair[1]:  # a choice that waits for the other
            return
        found = self.hand.map(pair, self._grid)
        z = np.log10(np.where(found.drawn & (found.objective > 0), found.objective, np.nan))
        ticks = [t for d in range(-2, 9) for t in (10.0**d, 3 * 10.0**d)]
        self._elsewhere = {k: x for k, x in self.hand.values.items() if k not in pair}
        with self.plane.batch_update():
            colours.x, colours.y = found.x, found.y
            colours.z = [[x if np.isfinite(x) else None for x in row] for row in z.tolist()]
            if np.isfinite(z).any():
                colours.zmin, colours.zmax = np.nanmin(z), np.nanmax(z)
            colours.contours = {"start": -2, "end": 9, "size": 0.25}
            colours.colorbar.tickvals = np.log10(ticks)
            colours.colorbar.ticktext = [f"{t:g}" for t in ticks]
            lost = found.condition == Condition.NO_BALANCE
            for cross, where in zip(crosses, (~found.drawn & ~lost, lost), strict=True):
                rows, columns = np.nonzero(where)
                cross.x, cross.y = found.x[columns], found.y[rows]
            lowest.x, lowest.y = ([x] for x in (found.minimum or (None, None))[:2])
            for axis, name, ends in zip(("xaxis", "yaxis"), pair, (found.x, found.y), strict=True):
                own = self.plane.layout[axis]
                own.title.text = _said(name)
                own.range, own.tickformat = (ends[0], ends[-1]), "~g"
        self._show()

    def _show_point(self) -> None:
        hand, pair, (*_, ellipse, point) = self.hand, self.pair, self.plane.data
        if pair[0] == pair[1]:
            return
        number, bad = hand.objective, hand.condition > Condition.OUTSIDE_REGION
        words = [f"<b>Objective {number:.1f}</b>" if np.isfinite(number) else "<b>No objective</b>"]
        if hand.condition:
            colour = VERMILLION if bad else "inherit"
            words.append(f"<span style='color:{colour}'>{hand.condition.sentence}</span>")
        alone, free, around = hand.coupling(pair)
        words.append(f"correlation of the two alone {alone:.3f}, with the others free {free:.3f}")
        if any(hand.values[name] != value for name, value in self._elsewhere.items()):
            words.append("colours are of an earlier knee: press <i>Map from here</i>")
        self.words.value = "; ".join(words)
        with self.plane.batch_update():
            point.x, point.y = ([hand.values[name]] for name in pair)
            ellipse.x, ellipse.y = around


def _said(name: str) -> str:
    return name.replace(".", " ").replace("_", " ").replace("reference ", "")
