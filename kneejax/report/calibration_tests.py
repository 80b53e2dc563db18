"""Tests under load beside what the fitted knee does: figure, table rows and doubts."""

from typing import Any

import numpy as np

from kneejax.experiments import counts_like_poses, reading_unit
from kneejax.geometry import COORDINATES, OTHER_COLUMNS
from kneejax.inference import Calibration, FittedTest
from kneejax.mechanics import NAMED_LOADS
from kneejax.report.look.colours import BLACK, GREY, shades
from kneejax.report.look.style import Figure, styled, verbatim
from kneejax.report.look.tables import Column, Table, change
from kneejax.report.panels import grid, labelled, part_legend
from kneejax.statics import Status

#: mm and degrees: how far a motion that repeats itself may be from where it was a period before.
_REPEATS_WITHIN = 0.05
_PANEL = 2.9  # inches high
#: Flexions with a curve each that a legend names.
_MOST_NAMED = 8
#: What was compared, by what it is counted from.
_COMPARED = {"unloaded": "Change from the unloaded pose", "intact": "Change from the intact knee",
             "least_load": "Change from the least load", "opposite": "Difference of opposite loads",
             "offset": "Pose in the laboratory's frame",
             "offset_each_flexion": "Pose in the laboratory's frame", "absolute": "Pose",
             "extension": "Change from extension"}  # fmt: skip


def laxity_errors(calibration: Calibration) -> list[dict[str, Any]]:
    """Root mean square errors of each test's coordinates, at each flexion, and before these at all
    of them together, where `flexion_deg` is None."""
    found = []
    for own, before in zip(calibration.fit.tests, calibration.start_tests, strict=True):
        for name, (measured, _) in own.compared.items():
            seen = np.isfinite(measured)
            for flexion in (None, *np.unique(own.test.curve_deg[seen]).tolist()):
                rows = seen if flexion is None else seen & (own.test.curve_deg == flexion)
                found.append({"test": own.test.name, "flexion_deg": flexion, "coordinate": name,
                              "readings": int(rows.sum()), "start": before.rmse(name, flexion),
                              "fitted": own.rmse(name, flexion)})  # fmt: skip
    return found


def errors_table(calibration: Calibration) -> Table:
    """Root mean square errors of each test, coordinate and flexion, as people read them; those of a
    single reading are left to tests.csv, which has the reading itself."""
    columns = [Column("test", "test under load", words=True), Column("coordinate", words=True),
               Column("flexion", "flexion, deg", words=True), Column("readings"),
               Column("start", "start RMSE", "3"), Column("fitted", "fitted", "3"),
               Column("change", words=True)]  # fmt: skip
    rows = []
    for one in laxity_errors(calibration):
        test, flexion, name, readings, *errors = one.values()
        if flexion is None:
            label, unit = label_of(name), unit_of(name)
            place = [test, f"{label[:1].upper()}{label[1:]}" + f", {unit}" * bool(unit), "all"]
        else:
            place = ["", "", f"{flexion:g}"]
        if flexion is None or readings > 1:
            rows.append([*place, readings, *errors, change(*errors)])
    return Table(columns, rows)


def reading_table(calibration: Calibration) -> Table:
    """The table of tests.csv: every reading of every test beside what the knee does."""
    tests = [own.test for own in calibration.fit.tests]
    lines = tuple(dict.fromkeys(line for test in tests for line in test.tensions))
    pulls = (f"{line}.tension_N" for line in lines)
    timed = any(test.frames is not None for test in tests)
    header = ("test", *("time_s",) * timed, "flexion_deg", *NAMED_LOADS, *pulls, "coordinate",
              "unit", "counted_from", "measured", "start", "fitted", "status")  # fmt: skip
    rows = []
    for own, before in zip(calibration.fit.tests, calibration.start_tests, strict=True):
        test = own.test
        nothing = np.zeros(len(test.flexion_deg))
        acting = [test.loads.get(name, nothing) + test.constant.get(name, 0.0)
                  for name in NAMED_LOADS]  # fmt: skip
        acting += [test.tensions.get(line, nothing) for line in lines]
        rows += [
            [test.name, *["" if test.frames is None else test.frames.time_s[row]] * timed,
             test.flexion_deg[row], *(size[row] for size in acting), name, unit_of(name),
             test.counted_from if name in COORDINATES or counts_like_poses(name) else "absolute",
             measured[row], before.compared[name][1][row], fitted[row],
             Status(int(own.status[row])).word]
            for row in range(len(test.flexion_deg))
            for name, (measured, fitted) in own.compared.items()
            if np.isfinite(measured[row])
        ]  # fmt: skip
    return Table.plain(header, rows)


def unit_of(name: str) -> str:
    """Of a coordinate, or of a reading; a strain has none."""
    return COORDINATES[name].unit if name in COORDINATES else reading_unit(name)


def label_of(name: str) -> str:
    """Of a coordinate, or of what was read of a part, within a sentence."""
    if name in COORDINATES:
        return COORDINATES[name].phrase
    if name in OTHER_COLUMNS:
        return OTHER_COLUMNS[name].phrase
    part, _, kind = name.rpartition(".")
    words = {"tension_N": "tension", "contact_N": "contact force"}
    return f"{part} {words.get(kind, kind)}"


def laxity_doubts(tests: tuple[FittedTest, ...], accepted: tuple[Status, ...] = ()) -> list[str]:
    """What is wrong with a knee under the loads of tests, and in motion, a sentence per test and
    status."""
    found = []
    for own in tests:
        for value in np.unique(own.status):
            status = Status(int(value))
            if status is Status.BALANCED or status in accepted:
                continue
            rows = own.status == value
            where = ", ".join(f"{x:g}" for x in np.unique(own.test.curve_deg[rows]))
            found.append(
                f"Test {own.test.name}: {int(rows.sum())} of {len(rows)} loads {status.word} "
                f"({status.sentence}), at {where} deg."
            )
        if own.restless > _REPEATS_WITHIN:
            found.append(
                f"Test {own.test.name}: {own.restless:.2g} mm or degrees from where the knee was a "
                "period before, so its start is still seen: more cycles_before, or more damping."
            )
    return found


@styled
def tests_figure(calibration: Calibration) -> Figure:
    """Draw measured tests, and what the knee does in them at the start and fitted.

    Args:
        calibration: with tests.

    Returns:
        A panel for each coordinate of each test. Load over displacement, a colour for each flexion;
        over flexion where there is one reading at each, over time of a knee in motion.
    """
    panels = [(own, before, name)
              for own, before in zip(calibration.fit.tests, calibration.start_tests, strict=True)
              for name in own.compared]  # fmt: skip
    figure, every = grid(len(panels), 1, _PANEL * len(panels) + 0.35, left=0.7, right=1.54,
                         apart=(0, 0.9))  # fmt: skip
    for axes, (own, before, name) in zip(every[:, 0], panels, strict=True):
        test, (measured, fitted) = own.test, own.compared[name]
        loaded = any(np.ptp(size) > 0 for size in test.loads.values())
        along = test.curve_deg if loaded else test.flexion_deg
        seen = np.isfinite(measured)
        moved = _COMPARED[test.counted_from]
        if name.endswith(("_N", ".strain")):
            change = test.counts_from_rest and name.endswith(".strain")
            moved = label_of(name) + ", change" * change
        moved += f", {unit_of(name) or '-'}"
        across, label = test.flexion_deg, "Flexion, deg"
        if test.frames is not None:
            across, label = test.frames.time_s, "Time, s"
        if test.frames is not None or len(np.unique(along[seen])) == seen.sum() > 1:
            order = np.flatnonzero(seen)[np.argsort(across[seen])]
            start, curve = before.compared[name][1][order], fitted[order]
            axes.plot(across[order], start, ":", color=BLACK, linewidth=0.9)
            axes.plot(across[order], curve, color=BLACK)
            axes.plot(across[order], measured[order], "o", color=BLACK, markersize=3)
            axes.set(xlabel=label, ylabel=moved)
        else:
            flexions, load = np.unique(test.curve_deg), test.loads[test.driven_by]
            step = max(1, -(-len(flexions) // _MOST_NAMED))
            for k, (flexion, color) in enumerate(zip(flexions, shades(len(flexions)), strict=True)):
                rows = np.flatnonzero(test.curve_deg == flexion)
                rows = rows[np.argsort(load[rows], kind="stable")]
                named = f"{flexion:g}" if k % step == 0 else None
                axes.plot(*_curve(before, rows, name, load), ":", color=color, linewidth=0.9)
                axes.plot(*_curve(own, rows, name, load), color=color, label=named)
                axes.plot(measured[rows], load[rows], "o", color=color, markersize=3)
            kind = NAMED_LOADS[test.driven_by]
            axes.set(xlabel=moved, ylabel=f"{kind.positive.capitalize()}, {kind.unit}")
            axes.axvline(0.0, color=GREY, linewidth=0.5)
            axes.add_artist(part_legend(axes, labelled(axes), (1.02, 1.02), title="Flexion, deg",
                                        title_fontsize=8, handlelength=1.6))  # fmt: skip
        styles = {"measured": {"marker": "o", "markersize": 3, "linestyle": "none"}, "fitted": {},
                  "start": {"linestyle": ":", "linewidth": 0.9}}  # fmt: skip
        kinds = {name: axes.plot([], [], color=GREY, **style)[0] for name, style in styles.items()}
        part_legend(axes, kinds, (1.02, -0.02), loc="lower left", handlelength=1.6)
        cut = f", {' and '.join(test.cut)} cut" if test.cut else ""
        axes.set_title(verbatim(f"{test.name}: {label_of(name)}{cut}"))
        if test.counted_from != "absolute":
            axes.axhline(0.0, color=GREY, linewidth=0.5)
    return figure


def _curve(one: FittedTest, rows: np.ndarray, name: str, load: np.ndarray):
    """A curve from its readings, and from the unloaded pose that counts as zero."""
    measured, fitted = (each[rows] for each in one.compared[name])
    drawn = np.isfinite(measured)
    x, y = fitted[drawn], load[rows][drawn]
    if one.test.counted_from == "unloaded" and not name.endswith("_N"):
        place = int(np.searchsorted(y, 0.0))
        x, y = np.insert(x, place, 0.0), np.insert(y, place, 0.0)
    return x, y
