"""What is said of one estimate: its limits, and why it is where it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from kneejax.inference import IntervalKind
from kneejax.report.look import number

if TYPE_CHECKING:
    from kneejax.inference import Estimate


def limits(estimate: Estimate) -> str:
    """The 95 % limits of an estimate in words; empty if the data give none."""
    low, high = number(estimate.low), number(estimate.high)
    if math.isfinite(estimate.low) and math.isfinite(estimate.high):
        return f"{low} to {high}"
    if math.isfinite(estimate.low):
        return f"above {low}"
    return f"below {high}" if math.isfinite(estimate.high) else ""


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
        words.append(_slack(estimate))
    if estimate.interval is IntervalKind.PRIOR:
        words.append("known from the prior alone")
    if estimate.beside:
        words.append(_outside(estimate))
    if estimate.reason:
        which = "limits" if estimate.interval is IntervalKind.NOT_COMPUTED else "a limit"
        words.append(f"{which} could not be computed: {estimate.reason}")
    return "; ".join(words)


def line_remark(estimate: Estimate) -> str:
    """What stands on the line of an estimate, in few words; empty if nothing."""
    kinds = {
        IntervalKind.NOT_DETERMINED: "not determined",
        IntervalKind.NOT_COMPUTED: "limits not computed",
        IntervalKind.PRIOR: "prior alone",
    }
    words = [kinds[estimate.interval]] if estimate.interval in kinds else []
    words += ["at bound"] * estimate.at_bound
    words += [_outside(estimate)] * estimate.beside
    return ", ".join(words)


def _outside(estimate: Estimate) -> str:
    """Why an estimate lies outside its limits: they follow the likelihood, which is lowest
    elsewhere."""
    likeliest = number(estimate.likeliest)
    if estimate.same_sum:
        return f"outside: a better fit is at {likeliest}"
    return f"outside: weights are not 1/noise^2; likeliest {likeliest}"


def _slack(estimate: Estimate) -> str:
    where = "every pose" if estimate.slack == 1.0 else f"{estimate.slack:.0%} of the poses"
    return f"its ligament is slack at {where}"
