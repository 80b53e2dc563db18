"""What a study of sensitivity found, on a terminal: which parameter moves what, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import SHOWN, aligned, listed, number, wrapped
from kneejax.report.sensitivity._sweep_figure import FREE_COLUMN
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from kneejax.inference import LocalSensitivity, MotionIndices, Sweep, Sweeps

#: Narrow names of the coordinates, in the order of `SHOWN`.
_HEADS = ("lateral", "anterior", "superior", "adduction", "int.rot.")
_PER = {"prior": "standard deviation of a parameter's prior", "percent": "per cent of a parameter"}
_OF_FIBRES = (Status.OVERSTRETCHED, Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE)
_MOST_ROWS = 24


def sensitivity_summary(
    local: LocalSensitivity, sweeps: Sweeps, found: MotionIndices | None = None
) -> str:
    """Say which parameter moves which coordinate most, where, and what failed on the way.

    Args:
        local: exact slopes.
        sweeps: one at a time.
        found: global indices, if any were asked for.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    lines = wrapped(
        f"Largest change of each coordinate (mm, deg) per {_PER[local.scale]}, and the flexion "
        "where it occurs; * the largest of a column"
    )
    lines += aligned(_largest_rows(local))
    lines += _sweep_lines(sweeps)
    if found is not None:
        lines += ["", *_index_lines(found)]
    return "\n".join(lines)


def sensitivity_doubts(
    local: LocalSensitivity, sweeps: Sweeps, found: MotionIndices | None = None
) -> list[str]:
    """What casts doubt on the results, a sentence each; empty if nothing does.

    That a knee comes apart at the ends of a sweep is a finding. That it does so as it is, or in
    much of the ranges that global indices stand for, is a doubt.

    Args:
        local: exact slopes.
        sweeps: one at a time.
        found: global indices, if any were asked for.

    Returns:
        Sentences without a full stop.
    """
    doubts = []
    # Slopes and sweeps know the same poses; either may have lost one.
    status = np.maximum(local.status, sweeps.status)
    for outcome in tuple(Status)[1:]:
        angles = [f"{angle:g}" for angle in local.flexion_deg[status == outcome]]
        if angles:
            doubts.append(f"the knee itself at {listed(angles)} degrees: {outcome.sentence}")
    if found is not None and found.left_out_deg:
        angles = [f"{angle:g}" for angle in found.left_out_deg]
        doubts.append(f"global indices without the poses at {listed(angles)} degrees")
    if found is not None and found.indices.doubtful:
        doubts.append(f"global indices: {found.indices.treatment}")
    return doubts


def _largest_rows(local: LocalSensitivity) -> list[list[str]]:
    slopes, rows = local.largest()
    order = [FREE_COLUMN[name] for name in SHOWN]
    most = np.abs(slopes).argmax(axis=1)
    table = [["parameter", *_HEADS]]
    for i, name in enumerate(local.names[:_MOST_ROWS]):
        cells = [
            f"{slopes[c, i]:+.2f} at {local.flexion_deg[rows[c, i]]:3.0f}"
            + ("*" if most[c] == i else " ")
            for c in order
        ]
        table.append([name, *cells])
    if len(local.names) > _MOST_ROWS:
        rest = len(local.names) - _MOST_ROWS
        table.append([f"({rest} more in local_sensitivity.csv)", *[""] * len(order)])
    return table


def _sweep_lines(sweeps: Sweeps) -> list[str]:
    poses = sum(one.status.size for one in sweeps.sweeps)
    parameters = f"{len(sweeps.sweeps)} parameter{'s' * (len(sweeps.sweeps) > 1)}"
    at_fault = [one for one in sweeps.sweeps if (~one.sound | (one.status > 0)).any()]
    if not at_fault:
        return ["", f"Sweeps: {parameters}, {poses} poses, all of them sound"]
    lines = wrapped(f"Sweeps: {parameters}, {poses} poses; poses at fault:")
    head = ["parameter", "sound over", "outside", "fibres", "unphysiol.", "unstable", "no balance"]
    rows = [head]
    for one in at_fault[:_MOST_ROWS]:
        counts = [
            int((one.status == Status.OUTSIDE_REGION).sum()),
            int(np.isin(one.status, _OF_FIBRES).sum()),
            int((one.unphysiological | (one.status == Status.DISLOCATED)).sum()),
            int((one.status == Status.UNSTABLE).sum()),
            int((~converged(one.status)).sum()),
        ]
        rows.append([one.name, _sound_range(one), *(str(count or "-") for count in counts)])
    if len(at_fault) > _MOST_ROWS:
        rows.append([f"({len(at_fault) - _MOST_ROWS} more in sweeps.csv)", *[""] * 6])
    return ["", *lines, *aligned(rows, (0, 1))]


def _sound_range(one: Sweep) -> str:
    """Values about the knee's own at which every pose is sound."""
    sound = np.all(one.sound, axis=1)
    at = int(np.argmin(np.abs(one.values - one.own)))
    if not sound[at]:
        return "none"
    bad = np.flatnonzero(~sound)
    first = bad[bad < at].max(initial=-1) + 1
    last = bad[bad > at].min(initial=len(sound)) - 1
    return f"{number(one.values[first], 3)} to {number(one.values[last], 3)}"


def _index_lines(found: MotionIndices) -> list[str]:
    indices = found.indices
    main, other = list(indices.measures)[:2]
    kind = "Sobol" if indices.method == "sobol" else "Morris"
    half, row = indices.half_widths[main], found.row("")
    order = np.argsort(-np.nan_to_num(indices.measures[main][row]), kind="stable")
    words = main.replace("_", " ")
    table = [["parameter", "range", words, "half width", other.replace("_", " "), "largest for"]]
    for i in order[:_MOST_ROWS]:
        best = [
            one.coordinate
            for k, one in enumerate(found.outputs)
            if one.coordinate
            and one.flexion_deg is None
            and np.nan_to_num(indices.measures[main][k]).argmax() == i
            and np.isfinite(indices.measures[main][k]).any()
        ]
        names = [_HEADS[SHOWN.index(name)] for name in SHOWN if name in best]
        table.append(
            [
                indices.names[i],
                f"{number(indices.lower[i], 3)} to {number(indices.upper[i], 3)}",
                number(indices.measures[main][row, i], 3),
                number(half[row, i], 2),
                number(indices.measures[other][row, i], 3),
                "all errors" if len(names) == len(SHOWN) else ", ".join(names),
            ]
        )
    lines = wrapped(
        f"{kind} indices of the objective ({indices.runs} motions, {100 * indices.confidence:g} % "
        "intervals by half width), and the coordinates whose error each parameter decides most"
    )
    lines += aligned(table, (0, 1, 5))
    if indices.treatment:
        lines += wrapped(indices.treatment + ".")
    return lines
