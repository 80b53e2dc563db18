"""The papers' files are whole, and a verdict follows what was found."""

import pytest

from kneejax.papers.claims import (
    CANNOT_BE_JUDGED,
    NOT_REPRODUCED,
    REPRODUCED,
    Finding,
    claimed,
    judged,
)

#: Claims of each paper: none is lost.
COUNTS = {1: 14, 2: 14, 3: 15, 4: 24, 5: 24}
WORDS = {"torque_Nm": 3.0, "modulus_share": 0.29, "asterisks": 22}


@pytest.mark.parametrize(("paper", "count"), COUNTS.items())
def test_a_papers_file_has_every_claim_with_criterion_and_printed_value(paper, count):
    document = claimed(paper)
    assert document["title"].startswith(f"Paper {paper}: ") and document["about"]
    assert set(document["claims"]) == {f"{paper}.{k}" for k in range(1, count + 1)}
    for entry in document["claims"].values():
        assert {"statement", "criterion", "printed"} <= entry.keys()
        assert entry.keys() <= {"statement", "criterion", "printed", "reason", "otherwise"}
        assert all(isinstance(text, str) and text for text in entry.values())


@pytest.mark.parametrize("paper", COUNTS)
def test_without_findings_no_claim_can_be_judged(paper):
    claims = judged(paper, {}, **WORDS)
    assert {claim.verdict for claim in claims} == {CANNOT_BE_JUDGED}
    assert all(claim.ours == "-" and "{" not in claim.criterion for claim in claims)


def test_a_reason_is_the_findings_or_stands_in_the_file():
    def claim(*finding):
        return next(x for x in judged(2, {"2.3": Finding(*finding)}) if x.number == "2.3")

    assert claim(True, "1 mm").verdict == REPRODUCED and not claim(True, "1 mm").reason
    assert claim(False, "1 mm").verdict == NOT_REPRODUCED
    assert claim(False, "1 mm").reason.startswith("at 20 degrees pACL is slack")
    assert claim(False, "1 mm", "another").reason == "another"
    assert claim(None, "-", "none here").verdict == CANNOT_BE_JUDGED


def test_a_finding_on_no_claim_of_the_paper_is_refused():
    with pytest.raises(ValueError, match="paper2.yaml lacks"):
        judged(2, {"2.99": Finding(True, "")})
