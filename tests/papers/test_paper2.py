"""Paper 2's claims: verdicts follow made-up tests whose answers are known."""

import dataclasses

import numpy as np
import pytest

from kneejax.papers.claims import CANNOT_BE_JUDGED, NOT_REPRODUCED, REPRODUCED
from kneejax.papers.paper2 import (
    MEASURED_MM,
    TOTALS,
    Lachman,
    LachmanStudy,
    Octagon,
    claims,
    fitted,
)
from kneejax.planning import Outcome
from kneejax.statics import Status

LOADS = np.linspace(0.0, 100.0, 11)


def made_up(end, *, lcl=(10.0, 20.0), deep=(5.0, 10.0), other=(0.0, 1.0), neutral=0.0):
    """A test that ends at a displacement, its tensions growing on straight lines."""
    part = LOADS / 100.0
    tension = {
        name: low + (high - low) * part
        for name, (low, high) in {"LCL": lcl, "aDMCL": deep, "aMCL": other}.items()
    }
    return Lachman(end * part, tension, neutral, 1.0, Status.BALANCED, 100.0)


def study(**changed):
    calibrated = {
        "two bundles": made_up(2.6, lcl=(10.0, 20.0), deep=(5.0, 10.0)),
        "one bundle": made_up(2.7),
        "deficient": made_up(8.0, lcl=(10.0, 22.2), deep=(5.0, 16.7)),
    }
    printed = {name: one for name, one in calibrated.items()}
    longer = {-0.03: made_up(1.5), 0.03: made_up(3.7)}
    found = LachmanStudy(LOADS, printed, calibrated, {0.0: printed["deficient"]}, 0.1, longer)
    return dataclasses.replace(found, **changed)


def verdicts(found):
    return {claim.number: claim.verdict for claim in claims(found)}


def test_the_papers_own_numbers_reproduce_every_claim_that_is_judged():
    found = verdicts(study())
    assert [found[f"2.{k}"] for k in range(1, 9)] == [REPRODUCED] * 8
    assert [found[f"2.{k}"] for k in range(9, 15)] == [CANNOT_BE_JUDGED] * 6


@pytest.mark.parametrize(
    ("state", "test", "fails"),
    [
        ("deficient", made_up(8.4, lcl=(10.0, 22.2), deep=(5.0, 16.7)), {"2.1"}),
        ("one bundle", made_up(3.5), {"2.2", "2.3"}),
        ("two bundles", made_up(1.9), {"2.3"}),
        # A rise by 200 % instead of 67 %, of 1 % instead of 11 %.
        ("deficient", made_up(8.0, lcl=(10.0, 22.2), deep=(5.0, 30.0)), {"2.6"}),
        ("deficient", made_up(8.0, lcl=(10.0, 20.2), deep=(5.0, 16.7)), {"2.5"}),
        ("deficient", made_up(8.0, lcl=(10.0, 22.2), deep=(5.0, 16.7), other=(0.0, 50.0)),
         {"2.7"}),
    ],
)  # fmt: skip
def test_each_criterion_can_fail(state, test, fails):
    found = verdicts(study(calibrated=study().calibrated | {state: test}))
    assert {number for number, verdict in found.items() if verdict == NOT_REPRODUCED} == fails


def test_every_claim_that_is_not_reproduced_has_a_reason():
    slack = made_up(8.0, lcl=(0.0, 0.5), deep=(0.0, 0.1))
    nothing = dict.fromkeys(study().calibrated, slack)
    for claim in claims(study(calibrated=nothing, longer={-0.03: slack, 0.03: slack})):
        assert claim.criterion and claim.printed
        assert claim.verdict == REPRODUCED or claim.reason


def test_a_knee_that_gives_way_is_no_number():
    lost = dataclasses.replace(made_up(8.0), moved=np.r_[np.linspace(0, 5, 8), [np.nan] * 3],
                               held_N=70.0)  # fmt: skip
    judged = claims(study(calibrated=study().calibrated | {"deficient": lost}))
    first = next(claim for claim in judged if claim.number == "2.1")
    assert first.verdict == NOT_REPRODUCED and "gives way beyond 70 N" in first.ours


def test_what_is_added_lies_between_its_neighbours():
    line = {by: 20.0 - 100.0 * by for by in (0.0, 0.1, 0.2)}
    # On a straight line the first step is exact.
    assert fitted(line) == pytest.approx((20.0 - MEASURED_MM) / 100.0, abs=1e-12)
    assert fitted(line | {0.12: MEASURED_MM}) == 0.12
    assert fitted({0.0: 20.0, 0.1: 15.0}) == 0.1
    assert fitted({0.0: np.nan, 0.1: np.nan}) == 0.1


NAMES = ("pACL", "PCL", "aDMCL", "pDMCL", "LCL", "graft")
SHARES = np.array([0.4, 0.05, 0.2, 0.25, 0.05, 0.05])


def octagon(totals=TOTALS, shares=SHARES, one=2.7, two=2.5):
    nothing = np.zeros(0)
    corners = Outcome(
        nothing, nothing, np.outer(totals, shares), nothing, nothing, nothing, nothing,
        followed=None,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    return Octagon(NAMES, corners, corners, one, two)


def insertions(grafts):
    """The four claims on insertions and bundles."""
    numbers = ("2.9", "2.12", "2.13", "2.14")
    return [claim for claim in claims(study(), grafts) if claim.number in numbers]


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("by", [0, 3])
def test_the_papers_own_octagon_reproduces_its_claims_however_it_is_numbered(by, sense):
    found = insertions(octagon(np.roll(TOTALS, by)[::sense]))
    assert [one.verdict for one in found] == [REPRODUCED] * 4


@pytest.mark.parametrize(
    ("changed", "fails"),
    [
        # The next best lies opposite to the best.
        ({"totals": (8.0, 14.9, 22.1, 21.9, 14.2, 9.6, 5.0, 4.9)}, {"2.9"}),
        ({"totals": np.array(TOTALS) + 20.0}, {"2.12"}),
        ({"shares": SHARES[[1, 0, 2, 3, 4, 5]]}, {"2.13"}),
        ({"two": 2.0}, {"2.14"}),
        ({"totals": (np.nan, *TOTALS[1:])}, {"2.9", "2.12", "2.13"}),
    ],
)
def test_each_criterion_on_the_octagon_can_fail(changed, fails):
    found = insertions(octagon(**changed))
    assert {one.number for one in found if one.verdict == NOT_REPRODUCED} == fails
    assert all(one.reason for one in found if one.number in fails)


def test_without_the_package_the_octagon_cannot_be_judged():
    found = insertions(None)
    assert {one.verdict for one in found} == {CANNOT_BE_JUDGED}
    assert all("dtaidistance" in one.reason for one in found)
