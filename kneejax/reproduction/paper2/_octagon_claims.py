"""Paper 2's claims on insertions and bundles, each with a criterion written before it was run.

The paper prints neither where the octagon's numbers begin nor their sense, so a claim on numbers is
judged over all sixteen numberings; its Table 4 has a column for pACL, so only aACL was moved, and
one of resting lengths and tensions stays as it was: lengths, of which alone the paper speaks.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kneejax.reproduction._claims import CANNOT_BE_JUDGED, Claim, judged
from kneejax.reproduction.paper2._octagon import Octagon

#: Totals of Table 4 at positions 1 to 8.
TOTALS = (5.019, 14.948, 22.068, 21.867, 14.230, 9.620, 10.131, 4.870)
#: The three ligaments of Table 4 whose distance differs most between positions.
TELLING = ("pACL", "aDMCL", "pDMCL")
#: A second graft adds little where it changes the laxity by less than this part.
LITTLE = 0.2
_SAID = (
    ("2.9", "Of eight tibial insertions on an octagon, position 8 keeps the ligaments' strains "
     "nearest to the intact knee's, 1 is next, 3 and 4 are worst.",
     "Table 4: totals " + ", ".join(f"{x:.1f}" for x in TOTALS)),
    ("2.12", "The insertion matters: the worst is several times farther from the intact knee than "
     "the best.", f"{max(TOTALS) / min(TOTALS):.1f} times (Table 4)"),
    ("2.13", "Strains of pACL and of the two deep medial bundles tell insertions apart most.",
     "differences of 4.8, 2.7 and 2.6 between positions (Table 4)"),
    ("2.14", "A second bundle of the graft adds little.", "does not contribute much (4.3)"),
)  # fmt: skip


def octagon_claims(found: Octagon | None) -> tuple[Claim, ...]:
    """Judge the claims on insertions and bundles.

    Args:
        found: None where the package that compares curves is not installed.
    """
    if found is None:
        reason = "needs dtaidistance: pip install 'kneejax[planning]'"
        return tuple(
            Claim(number, said, "None.", printed, "-", CANNOT_BE_JUDGED, reason)
            for number, said, printed in _SAID
        )
    return _order(found), _size(found), _telling(found), _second(found)


def numberings(totals: np.ndarray) -> Iterator[np.ndarray]:
    """The sixteen ways to number the corners of an octagon, `(8,)` each."""
    for sense in (totals, totals[::-1]):
        yield from (np.roll(sense, by) for by in range(8))


def _order(found: Octagon) -> Claim:
    number, said, printed = _SAID[0]

    def holds(totals: np.ndarray) -> bool:
        order = np.argsort(totals) + 1
        return bool(np.isfinite(totals).all()) and (
            order[0] == 8 and order[1] == 1 and set(order[-2:]) == {3, 4}
        )

    any_holds = any(holds(one) for one in numberings(found.moved.total))
    beside = any(holds(one) for one in numberings(found.planned.total))
    return Claim(
        number, said,
        "aACL with its resting length in the eight corners: with one of the sixteen numberings of "
        "the corners the least total is at 8, the next at 1, and the two largest at 3 and 4.",
        printed,
        f"from front and medial by way of the lateral side: {_told(found.moved.total)}. A "
        f"hamstring graft in place of both bundles, under 80 N: {_told(found.planned.total)}",
        judged(any_holds),
        "" if any_holds else "the best and the worst corner depend on where the bundle begins on "
        "the femur and on what holds the knee beside it, neither of which is printed; the "
        f"retensioned graft's order {'does' if beside else 'does not'} fit either",
    )  # fmt: skip


def _size(found: Octagon) -> Claim:
    number, said, printed = _SAID[1]
    own, theirs = (float(np.max(x) / np.min(x)) for x in (found.moved.total, np.array(TOTALS)))
    retensioned = float(np.max(found.planned.total) / np.min(found.planned.total))
    holds = bool(0.5 * theirs < own < 2.0 * theirs)
    return Claim(
        number, said, "The largest total by the least is between half and twice the printed one.",
        printed, f"{own:.1f} times; of the retensioned graft {retensioned:.1f}", judged(holds),
        "" if holds else "a bundle that keeps its resting length changes little where its new way "
        f"is about as long as the old one, as at corner {np.argmin(found.moved.total) + 1} here: "
        "the ratio tells where the femoral end lies, which is not printed",
    )  # fmt: skip


def _telling(found: Octagon) -> Claim:
    number, said, printed = _SAID[2]
    spread = np.ptp(found.moved.distance, axis=0)
    order = np.argsort(-np.nan_to_num(spread))[: len(TELLING)]
    names = [found.ligaments[k].replace("graft", "aACL") for k in order]
    holds = set(names) == set(TELLING)
    return Claim(
        number, said, "The same three ligaments have the largest differences between corners.",
        printed, ", ".join(f"{n} {spread[k]:.2f}" for n, k in zip(names, order, strict=True)),
        judged(holds),
        "" if holds else "which bundles are stretched as the tibia is drawn aside depends on their "
        "attachments, which the paper does not print",
    )  # fmt: skip


def _second(found: Octagon) -> Claim:
    number, said, printed = _SAID[3]
    holds = bool(abs(found.two - found.one) < LITTLE * found.one)
    return Claim(
        number, said,
        "A second hamstring graft from end to end of pACL, as stiff and as tight (80 N at 20 "
        "degrees) as the first along aACL, changes the laxity under 100 N by less than "
        f"{LITTLE:.0%}.",
        printed, f"{found.one:.2f} mm with one, {found.two:.2f} mm with both", judged(holds),
        "" if holds else "the two lie beside each other on these bones and share the load",
    )  # fmt: skip


def _told(totals: np.ndarray) -> str:
    return ", ".join(f"{x:.2f}" if np.isfinite(x) else "no balance" for x in totals)
