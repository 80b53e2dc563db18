"""Paper 5's claims: its tables against each other, and verdicts that follow the numbers."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.joints import MEASURES, UnsuitableMotions
from kneejax.papers import paper5_study as study
from kneejax.papers.claims import CANNOT_BE_JUDGED, NOT_REPRODUCED, REPRODUCED
from kneejax.papers.paper5 import claims, pooled_r2
from kneejax.papers.paper5_study import DONOR, FACETS, axis_points

pytest.importorskip("pingouin")


@pytest.fixture(scope="module")
def found():
    """A study with few cohorts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "COHORTS", 2)
        patch.setattr(study, "DRAWS", 100)
        return study.paper5_study(kj.load_knee(DONOR))


def verdicts(found):
    return {claim.number: claim.verdict for claim in claims(found)}


def test_every_claim_has_a_number_of_its_own_a_criterion_and_a_reason_where_needed(found):
    judged = claims(found)
    assert [claim.number for claim in judged] == [f"5.{i}" for i in range(1, len(judged) + 1)]
    for claim in judged:
        assert claim.statement and claim.printed and claim.criterion
        assert claim.reason or claim.verdict == REPRODUCED
        assert "SYNTHETIC" in claim.statement or "cohort" not in claim.criterion


def test_the_printed_tables_agree_but_for_one_number(found):
    """0.96 in Table 4 is 0.985 in the supplementary table, as 35.62 - 34.63 is."""
    judged = {claim.number: claim for claim in claims(found)}
    assert judged["5.2"].verdict == NOT_REPRODUCED
    assert "44 of 45" in judged["5.2"].ours and "CD at 20" in judged["5.2"].reason
    for number in ("5.1", "5.4", "5.5", "5.6", "5.7", "5.11", "5.13", "5.14"):
        assert judged[number].verdict == REPRODUCED, number


def test_pooled_r2_is_the_squared_correlation_of_all_values(rng, monkeypatch):
    """From means, spreads and spreads of differences of made-up values, exactly."""
    x = rng.normal(size=(10, 5, 5)) + np.arange(5)[:, None]
    y = x + rng.normal(size=x.shape)
    for name, one in ((study.MOVING_AXIS, x), (study.EOS, y)):
        monkeypatch.setitem(study.MEAN, name, one.mean(axis=0))
        monkeypatch.setitem(study.SD, name, one.std(axis=0, ddof=1))
    error = (y - x).std(axis=0, ddof=1)[study.COMPARED] / np.sqrt(10)
    monkeypatch.setitem(study.STANDARD_ERROR, (study.EOS, study.MOVING_AXIS), error)
    pooled = pooled_r2(study.MOVING_AXIS)
    for j in range(5):
        values = [one[:, study.COMPARED, j].ravel() for one in (x, y)]
        assert pooled[j] == pytest.approx(np.corrcoef(*values)[0, 1] ** 2)


def test_verdicts_on_the_means_follow_the_motion(found):
    at = [one.name for one in MEASURES].index("AP")
    assert verdicts(found)[f"5.{15 + at}"] == REPRODUCED
    far = {name: one + 100.0 for name, one in found.moving_axis.items()}
    signs = np.where(np.arange(len(found.spread)) % 2, 9.0, -9.0)[:, None, None]
    wide = dataclasses.replace(found, moving_axis=far, spread=found.spread * signs)
    assert verdicts(wide)[f"5.{15 + at}"] == CANNOT_BE_JUDGED
    lost = dataclasses.replace(found, moving_axis=far, spread=found.spread + 100.0)
    assert verdicts(lost)[f"5.{15 + at}"] == NOT_REPRODUCED
    assert verdicts(dataclasses.replace(found, hinge=found.hinge + 9.0))["5.12"] == NOT_REPRODUCED
    assert verdicts(dataclasses.replace(found, stays_fixed=1.0))["5.14"] == NOT_REPRODUCED


@pytest.mark.parametrize("facets", FACETS)
def test_the_stand_in_stands_as_a_femur_does(facets):
    """Extension centres before and above the flexion centres; epicondyles level with the origin."""
    centres, epicondyles = axis_points(kj.load_knee(DONOR), facets)
    extension, flexion = centres
    assert (extension[:, 0] > flexion[:, 0]).all() and (extension[:, 1] > flexion[:, 1]).all()
    distances = np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1)
    assert distances[0] == pytest.approx(distances[1])
    assert epicondyles.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert epicondyles[:, 0] == pytest.approx(np.zeros(2), abs=1e-12)


def test_synthetic_subjects_have_the_printed_means_and_spreads_and_the_assumed_correlation(rng):
    many = study.synthetic_measures(0.5, 20_000, rng)
    sd = study.SD[study.EOS]
    assert np.abs(many.mean(axis=0) - study.MEAN[study.EOS]).max() < 0.03 * sd.max()
    np.testing.assert_allclose(many.std(axis=0), sd, rtol=0.02)
    for j in range(5):
        between = np.corrcoef(many[:, :, j].T)[np.triu_indices(5, 1)]
        np.testing.assert_allclose(between, 0.5, atol=0.03)


def test_the_printed_hinge_begins_at_the_first_row_of_its_table(found):
    assert found.hinge[0] == pytest.approx(study.MEAN[study.HINGE][0], abs=1e-9)


def test_the_same_seed_gives_the_same_cohorts(found):
    one = found.cohorts[0.5][0]
    assert one.tests and not found.cohorts[0.5][1].tests
    assert np.isfinite(one.measured).all() and one.measured.shape == (10, 5, 5)
    # Calibration poses are met by each subject's own joint.
    ends = one.models["moving axis"][:, [0, -1]]
    assert ends == pytest.approx(one.measured[:, [0, -1]], abs=1e-9)


def test_without_pingouin_the_study_says_so(monkeypatch):
    def missing(*_, **__):
        raise UnsuitableMotions("pip install 'kneejax[statistics]'")

    monkeypatch.setattr(study, "is_tested", missing)
    with pytest.raises(UnsuitableMotions, match="statistics"):
        study.paper5_study(kj.load_knee(DONOR))
