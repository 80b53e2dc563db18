"""What data tell about parameters, for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.parameters import unit_of_quantity
from kneejax.report.identification._information_words import (
    information_notes,
    reason_words,
    sloppy_words,
    stiff_words,
)
from kneejax.report.look import aligned, number, trimmed, with_error, wrapped

if TYPE_CHECKING:
    from kneejax.inference import Information

#: Columns of a table of what the data tell of each parameter.
INFORMATION_COLUMNS = (
    "name", "value", "unit", "standard_error", "scale", "determined", "at_bound", "reason",
)  # fmt: skip


def information_rows(found: Information) -> list[dict[str, Any]]:
    """List what the data tell of each parameter, for a table.

    Args:
        found: what the data tell.

    Returns:
        One dictionary per parameter, with the keys `INFORMATION_COLUMNS` in that order.
    """
    reasons = reason_words(found)
    return [
        {
            "name": name,
            "value": float(found.values[i]),
            "unit": unit_of_quantity(name.split(".", 1)[-1]),
            "standard_error": float(found.standard_error[i]),
            "scale": float(found.scale[i]),
            "determined": bool(found.determined[i]),
            "at_bound": bool(found.at_bound[i]),
            "reason": reasons[i],
        }
        for i, name in enumerate(found.names)
    ]


def information_text(found: Information) -> str:
    """Say on a terminal what the data can tell and what not.

    Args:
        found: what the data tell.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    poses = f"{found.data} measured numbers, {len(found.names)} parameters"
    lines = wrapped(
        f"What the data tell ({poses}). A standard error is how far an estimate is typically off; "
        "the prior SD is the spread between knees. Data determine a parameter whose standard error "
        "is smaller than its prior SD."
    )
    table = [["parameter", "value", "", "std. error", "unit", "prior SD", "times better", ""]]
    for row in information_rows(found):
        value, error = with_error(row["value"], row["standard_error"])
        if row["at_bound"]:
            error, remark = "-", "at bound"
        elif not np.isfinite(row["standard_error"]):
            error, remark = "unlimited", "not determined"
        else:
            remark = "" if row["determined"] else "not determined"
        better = row["scale"] / row["standard_error"]
        table.append(
            [row["name"], value, "+-", error, row["unit"], trimmed(row["scale"], 3)]
            + [number(better, 2) if np.isfinite(better) and better > 0 else "-", remark]
        )
    lines += ["", *aligned(table, (0, 2, 4, 7))]
    doubts = [sentence for sentence in reason_words(found) if sentence]
    combinations = [*stiff_words(found)], [*sloppy_words(found)]
    for sentences, first in (*((own, "") for own in combinations), (doubts, "warning: ")):
        lines += [""] * bool(sentences)
        for sentence in sentences:
            lines += wrapped(sentence, first)
    condition = number(found.condition_number, 2)
    if np.isfinite(found.condition_number):
        ratio = number(float(np.sqrt(found.condition_number)), 2)
        lines += ["", *wrapped(
            f"The best-determined combination of parameters is known {ratio} times better than "
            f"the worst (condition number {condition})."
        )]  # fmt: skip
    for note in information_notes(found):
        lines += wrapped(note, "note: ")
    return "\n".join(lines)
