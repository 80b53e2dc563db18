"""Verdicts follow the numbers: each criterion is met by one comparison and missed by another."""

import dataclasses

import pytest

from kneejax.papers.claims import CANNOT_BE_JUDGED, NOT_REPRODUCED, REPRODUCED, Claim
from kneejax.papers.knee_comparison import LIMITS, Change
from kneejax.papers.paper4 import claims
from tests.papers.compared_knees import AVERAGES, comparison, outcome, study


def verdicts(*knees):
    return {claim.number: claim.verdict for claim in claims(comparison(*knees))}


def swapped(averages):
    """The same averages with varus and valgus exchanged."""
    return {name: tuple(pair[::-1] for pair in pairs) for name, pairs in averages.items()}


def test_every_finding_has_a_number_of_its_own_and_a_verdict():
    judged = claims(comparison())
    assert [claim.number for claim in judged] == [f"4.{i}" for i in range(1, len(judged) + 1)]
    for claim in judged:
        assert claim.statement and claim.printed and claim.criterion
        if claim.verdict == CANNOT_BE_JUDGED:
            assert claim.reason


def test_collaterals_act_in_their_own_directions():
    alike = verdicts(study("a"), study("b"))
    assert alike["4.6"] == alike["4.7"] == alike["4.14"] == REPRODUCED
    crossed = verdicts(study("a"), study("b", **swapped(AVERAGES)))
    assert crossed["4.6"] == crossed["4.7"] == NOT_REPRODUCED
    tight = {d: dict.fromkeys(("ACL", "PCL", "MCL", "LCL"), 100.0) for d in ("varus", "valgus")}
    assert verdicts(study("a", tension=tight), study("b"))["4.14"] == NOT_REPRODUCED


def test_knees_that_are_alike_do_not_differ():
    alike, apart = (
        verdicts(study("a", attachments=False), study("b", factor=x, attachments=False))
        for x in (1.0, 12.0)
    )
    for number in ("4.4", "4.8", "4.13"):
        assert alike[number] == NOT_REPRODUCED, number
    for number in ("4.8", "4.13"):
        assert apart[number] == REPRODUCED, number
    for number in ("4.5", "4.9"):
        assert (alike[number], apart[number]) == (REPRODUCED, NOT_REPRODUCED), number
    # Pressures four times as large are more than medium for two moduli.
    assert (alike["4.10"], apart["4.10"]) == (REPRODUCED, NOT_REPRODUCED)


def test_what_could_not_be_compared_cannot_be_judged():
    nothing = ((0.0, 0.0), (0.1, 0.5), (float("nan"),) * 2, (0.2, 0.5))
    found = verdicts(study("a", MCL=nothing), study("b", MCL=nothing))
    assert found["4.5"] == found["4.9"] == CANNOT_BE_JUDGED
    without = verdicts(study("a", attachments=False), study("b", attachments=False))
    assert without["4.11"] == CANNOT_BE_JUDGED
    assert verdicts(study("a"), study("b"))["4.11"] == REPRODUCED


def test_horns_of_menisci_have_a_small_influence_or_more():
    def horns(average):
        one, change = study("a"), Change("menisci", "horn_stiffness", 180.0)
        more = (outcome(run, 1, change, [average] * len(LIMITS)) for run in one.runs.values())
        return dataclasses.replace(
            one, changes=(*one.changes, change), outcomes=(*one.outcomes, *more)
        )

    assert verdicts(study("a"))["4.17"] == CANNOT_BE_JUDGED
    assert verdicts(horns(0.1), study("b"))["4.17"] == REPRODUCED
    assert verdicts(horns(30.0), study("b"))["4.17"] == NOT_REPRODUCED


def test_a_claim_has_one_of_three_verdicts():
    with pytest.raises(ValueError, match="expected one of"):
        Claim("1", "", "", "", "", "perhaps")
