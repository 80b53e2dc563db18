"""A published claim, turned into a criterion, computed and judged."""

from __future__ import annotations

import dataclasses

#: Verdicts. The last is for what this software has no part for, or no data.
REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED = "reproduced", "not reproduced", "cannot be judged"
VERDICTS = (REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED)


@dataclasses.dataclass(frozen=True)
class Claim:
    """One row of a reproduction report.

    Attributes:
        number: e.g. `1.4`.
        statement: what is claimed, in our words.
        criterion: what has to hold of computed numbers; the reason says so if it was changed after
            they were seen.
        printed: what the paper prints for it.
        ours: what was computed.
        verdict: one of `VERDICTS`.
        reason: why the verdict is what it is, where that needs saying.
    """

    number: str
    statement: str
    criterion: str
    printed: str
    ours: str
    verdict: str
    reason: str = ""

    def __post_init__(self):
        if self.verdict not in VERDICTS:
            raise ValueError(f"Claim.verdict is {self.verdict!r}; expected one of {VERDICTS}")


def judged(holds: bool) -> str:
    """The verdict on a claim whose criterion could be computed."""
    return REPRODUCED if holds else NOT_REPRODUCED
