"""A movement of knees with a graft in several places, side by side (paper 2, Figure 7)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kneejax.experiments import Activity, Cycle
from kneejax.report.look import BLACK, BLUE, GREY, LIGHT, VERMILLION, WIDTH, styled, verbatim
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Columns of `place_rows`.
PLACE_COLUMNS = (
    "knee", "in_balance", "overstretched", "graft_peak_N", "graft_peak_strain", "contact_peak_N",
    "anterior_rms_from_intact_mm", "internal_rotation_rms_from_intact_deg",
)  # fmt: skip
#: Columns of a table of poses.
_TURN, _FORWARD = 2, 3
_STYLES = {0: (BLACK, (0, (4, 1.5)), 1.6), 1: (VERMILLION, "-", 1.0), 2: (BLUE, "-", 1.2)}


class _Pull(NamedTuple):
    """Of what stands for the ligament in a knee: force, N, and largest strain, `(n,)`."""

    force: np.ndarray
    strain: np.ndarray


def _pulls(found: Mapping[str, Activity]) -> dict[str, _Pull]:
    """Of the ligament where it acts, of the graft elsewhere; NaN where there is neither."""
    acts = np.stack([np.asarray(one.motion.knee.ligaments.stiffness) for one in found.values()])
    changing, answer = np.ptp(acts, axis=0) > 0, {}
    for (name, one), stiffness in zip(found.items(), acts, strict=True):
        rows, told = np.flatnonzero(changing & (stiffness > 0)), one.mechanics
        force, strain = (np.asarray(x)[:, rows] for x in (told.tension, told.strain))
        nothing = np.full(len(force), np.nan)
        answer[name] = _Pull(
            force.sum(axis=1) if len(rows) else nothing,
            strain.max(axis=1) if len(rows) else nothing,
        )
    return answer


def place_rows(found: Mapping[str, Activity]) -> Iterator[list]:
    """Rows of `PLACE_COLUMNS`, one a knee.

    Args:
        found: what a knee is called -> its activity; the intact one first, all of one structure.
    """
    pulls = _pulls(found)
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact = next(iter(tables.values()))
    for name, one in found.items():
        contact = np.linalg.norm(np.asarray(one.mechanics.contact_force), axis=-1)
        away = (tables[name] - intact)[:, [_FORWARD, _TURN]]
        away = away[np.isfinite(away).all(axis=1)]
        rms = np.sqrt(np.mean(away**2, axis=0)) if len(away) else [np.nan, np.nan]
        pull = pulls[name]
        peaks = [_peak(x) for x in (pull.force, pull.strain, contact)]
        torn = np.asarray(one.motion.status) == Status.OVERSTRETCHED
        yield [name, int(one.holds.sum()), int(torn.sum()), *peaks, *rms]


def _peak(values: np.ndarray) -> float:
    """The largest number; NaN where there is none."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan


def place_lines(found: Mapping[str, Activity]) -> Iterator[str]:
    """`place_rows` for a terminal; arguments likewise."""
    count = len(next(iter(found.values())).holds)
    yield f"{count:4d} instants  in balance    over-  ligament or graft   contact   rms from intact"
    yield "                          stretched  peak, N  strain, %  peak, N  forward, mm turn, deg"
    for name, held, torn, *numbers in place_rows(found):
        force, strain, contact, forward, turn = numbers
        cells = (
            f"{one:{form}}" if np.isfinite(one) else f"{'-':>{width}}"
            for one, form, width in (
                (force, "9.0f", 9), (100 * strain, "11.1f", 11), (contact, "9.0f", 9),
                (forward, "13.2f", 13), (turn, "10.2f", 10),
            )
        )  # fmt: skip
        yield f"  {name:<13}{held:9d}{torn:11d}{''.join(cells)}"


@styled
def places_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw what places of a graft do over a record.

    Args:
        found: as in `place_rows`: intact, without the ligament, planned, then other places.
        cycle: of their record.
        title: of the whole.

    Returns:
        Four panels: strain and force of ligament or graft, and how much farther forwards and
        inwards the tibia is than that of the intact knee. The legend says at how many instants a
        knee balances that does not at all.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 5.4))
    panels = figure.subplots(2, 2, sharex=True)
    figure.subplots_adjust(left=0.09, right=0.985, top=0.93, bottom=0.2, wspace=0.25, hspace=0.12)
    figure.suptitle(verbatim(title), x=0.09, ha="left", fontsize=9.5)
    pulls = _pulls(found)
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact = next(iter(tables.values()))
    _curves(panels[0, 0], cycle, {name: 100 * x.strain for name, x in pulls.items()})
    _curves(panels[0, 1], cycle, {name: x.force for name, x in pulls.items()})
    for axes, column in ((panels[1, 0], _FORWARD), (panels[1, 1], _TURN)):
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        away = {name: table[:, column] - intact[:, column] for name, table in tables.items()}
        _curves(axes, cycle, dict(list(away.items())[1:]), first=1)
    words = (
        "Strain of ligament or graft, %", "Force of ligament or graft, N",
        "Forwards of the intact tibia, mm", "Turned inwards of it, deg",
    )  # fmt: skip
    for axes, label in zip(panels.ravel(), words, strict=True):
        axes.set_ylabel(label)
        axes.set_xlim(cycle.percent[0], cycle.percent[-1])
        if np.isfinite(cycle.toe_off):
            axes.axvline(cycle.toe_off, color=LIGHT, linewidth=1.0, zorder=0)
    for axes in panels[-1]:
        axes.set_xlabel(cycle.axis_label)
    own = {label: line for axes in panels.ravel()
           for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}  # fmt: skip
    lines = [own[verbatim(name)] for name in found]
    names = [_label(name, one.holds) for name, one in found.items()]
    # Names with counts are longer: four of them are as wide as the figure.
    columns = 6 if all(one.holds.all() for one in found.values()) else 4
    figure.legend(lines, names, loc="lower center", ncols=columns, fontsize=7.5, handlelength=1.6,
                  columnspacing=1.2)  # fmt: skip
    return figure


def _label(name: str, holds: np.ndarray) -> str:
    """What a knee is called, and at how many instants it balances where that is not all."""
    lost = "" if holds.all() else f" ({int(holds.sum())} of {len(holds)})"
    return verbatim(name) + lost


def _curves(axes: Axes, cycle: Cycle, values: Mapping[str, np.ndarray], first: int = 0) -> None:
    from matplotlib import colormaps

    colours = colormaps["viridis"](np.linspace(0.0, 0.95, 8))
    for k, (name, one) in enumerate(values.items(), first):
        color, dashes, width = _STYLES.get(k, (colours[(k - 3) % 8], "-", 0.7))
        axes.plot(cycle.percent, one, color=color, linestyle=dashes, linewidth=width,
                  label=verbatim(name))  # fmt: skip
