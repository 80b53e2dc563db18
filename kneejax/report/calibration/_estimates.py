"""One estimate: its value, its limits, and why it is where it is; the tables of all of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from kneejax.inference import IntervalKind
from kneejax.report.look import NONE, Column, Table, number, trimmed, with_error

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Estimate

#: What a kind of interval says on the line of an estimate.
_KINDS = {
    IntervalKind.NOT_DETERMINED: "not determined",
    IntervalKind.NOT_COMPUTED: "limits not computed",
    IntervalKind.PRIOR: "prior alone",
}
#: Columns of parameters.csv.
PARAMETER_COLUMNS = (
    "name", "value", "unit", "start", "lower", "upper", "standard_error", "at_bound", "low", "high",
    "interval", "remark",
)  # fmt: skip


def limits(low: float, high: float, digits: int = 4) -> str:
    """The 95 % limits of an estimate in words; empty if the data give none.

    Args:
        low: NaN or infinity where there is no lower limit.
        high: likewise.
        digits: significant digits.

    Example:
        >>> limits(4127.0, 6081.0), limits(4929.0, float("nan"))
        ('4127 to 6081', 'above 4929')
    """
    if math.isfinite(low) and math.isfinite(high):
        return f"{number(low, digits)} to {number(high, digits)}"
    if math.isfinite(low):
        return f"above {number(low, digits)}"
    return f"below {number(high, digits)}" if math.isfinite(high) else ""


def undetermined(estimate: Estimate) -> bool:
    """Whether the data say nothing about a parameter."""
    return estimate.interval is IntervalKind.NOT_DETERMINED


def remark(estimate: Estimate) -> str:
    """What a reader must know about an estimate; empty if nothing."""
    words = ["not determined"] if undetermined(estimate) else []
    words += ["not computed"] if estimate.interval is IntervalKind.NOT_COMPUTED else []
    return ": ".join([*words, *filter(None, [reasons(estimate)])])


def reasons(estimate: Estimate) -> str:
    """Why an estimate is where it is, and as sure as it is; empty if nothing is to be said."""
    words = []
    if estimate.at_bound:
        further = "" if estimate.interval is None else ": the data would move it further"
        words.append(f"on its bound{further}")
    if estimate.slack > 0:
        part = estimate.slack
        where = "every pose" if part == 1.0 else f"{part:.0%} of the poses"
        words.append(f"its ligament is slack at {where}")
    if estimate.interval is IntervalKind.PRIOR:
        words.append("known from the prior alone")
    if estimate.reason:
        which = "limits" if estimate.interval is IntervalKind.NOT_COMPUTED else "a limit"
        words.append(f"{which} could not be computed: {estimate.reason}")
    return "; ".join(words)


def estimates_table(calibration: Calibration, sign: str = "\u00b1") -> Table:
    """Estimates as people read them: a row for each parameter, then for each offset of a frame.

    Args:
        calibration: what was found.
        sign: before a standard error.

    Returns:
        Value, standard error where it gives the limits, 95 % limits, a remark in few words, the
        truth of synthetic data, start and bounds. Columns without any entry are left out.
    """
    heads = ("parameter", "value", "std. error", "unit", "95 % limits", "", "truth", "start",
             "lower", "upper")  # fmt: skip
    fit, rows = calibration.fit, []
    for e in (*fit.estimates, *fit.offsets):
        sure = e.interval is not None and math.isfinite(e.standard_error)
        value, error = with_error(e.value, e.standard_error if sure else math.nan)
        known = "" if e.interval is None else limits(e.low, e.high) or NONE
        words = [_KINDS[e.interval]] if e.interval in _KINDS else []
        words += ["at bound"] * e.at_bound
        name = e.name if e in fit.estimates else f"offset {e.name}"
        row = [name, value, f"{sign} {error}" if sure else "", e.unit, known, ", ".join(words)]
        row += [trimmed(calibration.truth.get(e.name, math.nan))]
        rows.append([*row, trimmed(e.start), trimmed(e.lower), trimmed(e.upper)])
    seen = [i for i, head in enumerate(heads) if any(row[i] for row in rows)]
    seen = [i for i in seen if calibration.truth or heads[i] != "truth"]
    words = ("parameter", "unit", "95 % limits", "")
    columns = [Column(heads[i] or "remark", heads[i] or " ", words=heads[i] in words) for i in seen]
    return Table(columns, [[row[i] for i in seen] for row in rows])


def parameter_document(e: Estimate) -> dict[str, Any]:
    """The numbers of an estimate for result.json; NaN where there is none."""
    names = ("value", "start", "lower", "upper", "standard_error", "at_bound", "low", "high")
    kind = None if e.interval is None else e.interval.value
    return {n: (bool if n == "at_bound" else float)(getattr(e, n)) for n in names} | {
        "interval": kind
    }


def parameters_table(calibration: Calibration) -> Table:
    """The table of parameters.csv.

    Args:
        calibration: what was found.

    Returns:
        A row for each parameter, then for each constant between frames
        (`frame_offset.COORDINATE`), under the columns `PARAMETER_COLUMNS`.
    """
    fit = calibration.fit
    named = [(e.name, e) for e in fit.estimates]
    named += [(f"frame_offset.{e.name}", e) for e in fit.offsets]
    every = [
        {**parameter_document(e), "name": name, "unit": e.unit, "remark": remark(e)}
        for name, e in named
    ]
    words = ("name", "unit", "interval", "remark")
    columns = [Column(name, words=name in words) for name in PARAMETER_COLUMNS]
    return Table(columns, [[one[name] for name in PARAMETER_COLUMNS] for one in every])
