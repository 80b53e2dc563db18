"""Statistics against libraries on a published data set, by hand, and in closed form."""

import builtins
import warnings

import numpy as np
import pytest
from scipy import stats

from kneejax.geometry import Pose, rotation_from_angles
from kneejax.joints import (
    MEASURES,
    UnsuitableMotions,
    clinical_measures,
    compare_motions,
    hinge,
    poses_from_clinical,
    repeated_measures,
)
from kneejax.report.joint_comparison import comparison_doubts, comparison_notes

pingouin = pytest.importorskip("pingouin")
FLEXION = np.array([0.0, 20.0, 45.0, 60.0, 90.0])


@pytest.fixture
def cohort(rng):
    """Six persons at five flexions, and two models of them."""
    own = rng.normal(size=(6, 1, 5))
    measured = own + rng.normal(size=(6, 5, 5))
    near = measured + 0.3 * rng.normal(size=(6, 5, 5)) + 0.5
    far = own + 2.0 * rng.normal(size=(6, 5, 5)) - 1.0
    return measured, {"near": near, "far": far}


def published():
    """Reading times of nine persons on four occasions, as pingouin ships them; whole rows only."""
    return pingouin.read_dataset("rm_anova_wide").dropna()


def test_a_published_data_set_gives_the_numbers_of_the_libraries():
    table = published()
    found = repeated_measures({name: table[name].to_numpy() for name in table})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        row = pingouin.rm_anova(table, correction=True, detailed=True).iloc[0]
        long = table.melt(ignore_index=False, var_name="week", value_name="v").reset_index()
        pairs = pingouin.pairwise_tests(
            long, dv="v", within="week", subject="index", padjust="bonf"
        )
    assert found.f == pytest.approx(row["F"], rel=1e-12)
    assert found.epsilon == pytest.approx(row["eps"], rel=1e-12)
    assert found.p == pytest.approx(row["p_GG_corr"], rel=1e-12)
    assert found.df == (3, 24)
    expected = {frozenset((r.A, r.B)): (abs(r["T"]), r.p_corr) for _, r in pairs.iterrows()}
    for pair in found.pairs:
        t, p = expected[frozenset((pair.first, pair.second))]
        assert abs(pair.difference / pair.standard_error) == pytest.approx(t, rel=1e-10)
        assert pair.p == pytest.approx(p, rel=1e-10)
    for name, p in found.normality.items():
        assert p == stats.shapiro(table[name]).pvalue


def test_the_same_data_set_in_statsmodels():
    """A second library, which knows no correction but the same F."""
    model = pytest.importorskip("statsmodels.stats.anova")
    table = published()
    long = table.melt(ignore_index=False, var_name="week", value_name="v").reset_index()
    row = model.AnovaRM(long, "v", "index", within=["week"]).fit().anova_table.iloc[0]
    found = repeated_measures({name: table[name].to_numpy() for name in table})
    assert found.f == pytest.approx(row["F Value"], rel=1e-10)
    assert found.p_uncorrected == pytest.approx(row["Pr > F"], rel=1e-10)


def test_f_of_a_small_table_by_hand():
    """Rows 1 2 6, 2 4 6, 3 3 9: group means 2, 3, 7, subject means 3, 4, 5, grand mean 4.

    Between groups 3 (4 + 1 + 9) = 42, between subjects 3 (1 + 0 + 1) = 6, in all 52: error 4.
    F = (42 / 2) / (4 / 4) = 21.
    """
    values = np.array([[1.0, 2.0, 6.0], [2.0, 4.0, 6.0], [3.0, 3.0, 9.0]])
    assert np.sum((values - values.mean()) ** 2) == 52.0
    found = repeated_measures(dict(zip("abc", values.T, strict=True)))
    assert found.f == pytest.approx(21.0, rel=1e-12)
    assert found.df == (2, 4)


def exact_covariance(covariance, count=8):
    """Values whose sample covariance is just the one wanted."""
    raw = np.random.default_rng(1).normal(size=(count, len(covariance)))
    raw -= raw.mean(axis=0)
    white = raw @ np.linalg.inv(np.linalg.cholesky(np.cov(raw.T))).T
    return white @ np.linalg.cholesky(np.asarray(covariance, float)).T


@pytest.mark.parametrize(
    ("covariance", "epsilon"),
    [
        # Compound symmetry: 1, whatever the correlation.
        ([[2.0, 0.6, 0.6], [0.6, 2.0, 0.6], [0.6, 0.6, 2.0]], 1.0),
        # Independent with variances a, b, c: the squared trace of the doubly centred covariance,
        # (2 (a + b + c) / 3)^2, over twice the sum of its squares.
        (np.diag([1.0, 1.0, 4.0]), 16.0 / (2.0 * 10.0)),
    ],
)
def test_epsilon_in_closed_form(covariance, epsilon):
    centred = (c := np.eye(3) - 1.0 / 3.0) @ np.asarray(covariance) @ c
    assert np.trace(centred) ** 2 / (2.0 * np.sum(centred**2)) == pytest.approx(epsilon)
    values = exact_covariance(covariance) + np.array([0.0, 1.0, 2.0])
    found = repeated_measures(dict(zip("abc", values.T, strict=True)))
    assert found.epsilon == pytest.approx(epsilon, rel=1e-10)
    # The corrected p is that of F with fewer degrees of freedom.
    df = epsilon * np.array(found.df)
    assert found.p == pytest.approx(stats.f.sf(found.f, *df), rel=1e-8)


def test_an_interval_holds_just_the_differences_that_are_not_significant(rng):
    """Interval of 1 - alpha without zero and p below alpha are the same statement."""
    for shift in np.linspace(0.0, 2.0, 15):
        base = rng.normal(size=10)
        groups = {"a": base, "b": base + rng.normal(size=10) + shift, "c": rng.normal(size=10)}
        for pair in repeated_measures(groups, alpha=0.05).pairs:
            assert (pair.lower > 0.0 or pair.upper < 0.0) == (pair.p < 0.05)


def test_the_means_of_a_comparison_by_hand(cohort):
    measured, models = cohort
    found = compare_motions(FLEXION, measured, models, calibrated_at_deg=(0.0, 90.0))
    assert found.compared.tolist() == [False, True, True, True, False]
    near = next(d for d in found.differences if (d.first, d.second) == ("measured", "near"))
    assert near.conditions == ("20", "45", "60", "average")
    apart = measured - models["near"]
    assert near.mean[1] == pytest.approx(apart[:, 2].mean(axis=0))
    assert near.standard_error[1] == pytest.approx(apart[:, 2].std(axis=0, ddof=1) / np.sqrt(6))
    own = apart[:, 1:4].mean(axis=1)
    assert near.mean[3] == pytest.approx(own.mean(axis=0))
    assert near.standard_error[3] == pytest.approx(own.std(axis=0, ddof=1) / np.sqrt(6))
    line = found.predictions[0]
    x, y = models["near"][:, 1:4, 2].ravel(), measured[:, 1:4, 2].ravel()
    assert line.points == 18
    assert line.r2[2] == pytest.approx(np.corrcoef(x, y)[0, 1] ** 2)
    slope, intercept = np.polyfit(x, y, 1)
    left = np.sum((y - slope * x - intercept) ** 2) / 16.0
    assert line.adjusted_r2[2] == pytest.approx(1.0 - left / np.var(y, ddof=1))
    assert line.rmse[2] == pytest.approx(np.sqrt(np.mean((x - y) ** 2)))
    summary = found.summaries[0]
    assert summary.conditions[5:] == ("average", "average compared", "min", "max", "ROM")
    assert summary.sd[1] == pytest.approx(measured[:, 1].std(axis=0, ddof=1))
    assert summary.sd[5] == pytest.approx(summary.sd[:5].mean(axis=0))
    assert summary.mean[9] == pytest.approx(np.ptp(measured, axis=1).mean(axis=0))
    assert any("0, 90 degrees" in note for note in comparison_notes(found))


def test_the_printed_pairs_of_r2_are_those_of_thirty_points_and_one_predictor():
    """Paper 5, Table 5: R2 and adjusted R2 as printed, both rounded."""
    r2 = np.array([0.31, 0.71, 0.91, 0.79, 0.67, 0.26, 0.21, 0.70, 0.08, 0.27])
    adjusted = np.array([0.29, 0.70, 0.90, 0.78, 0.65, 0.23, 0.18, 0.68, 0.05, 0.25])
    low, high = (1.0 - (1.0 - r2 + half) * 29.0 / 28.0 for half in (0.005, -0.005))
    assert ((low - 0.005 <= adjusted) & (adjusted <= high + 0.005)).all()
    two = 1.0 - (1.0 - r2 - 0.005) * 29.0 / 27.0
    assert (two + 0.005 < adjusted).any()


def test_a_model_that_is_right_but_for_a_line_has_r2_1_and_an_error(cohort):
    measured, _ = cohort
    line = compare_motions(FLEXION, measured, {"half": 0.5 * measured + 3.0}).predictions[0]
    assert line.r2 == pytest.approx(1.0)
    assert (line.rmse > 1.0).all()


def test_every_test_is_of_its_own_measure_and_flexion(cohort):
    measured, models = cohort
    found = compare_motions(FLEXION, measured, models, calibrated_at_deg=(0.0, 90.0))
    assert len(found.tests) == 15
    groups = {name: one[:, 3, 1] for name, one in found.motions.items()}
    assert found.test("AP", 2) == repeated_measures(groups)


def test_one_subject_is_described_and_not_tested(cohort):
    measured, models = cohort
    found = compare_motions(FLEXION, measured[:1], {k: x[:1] for k, x in models.items()})
    assert not found.tests
    assert any("One subject" in note for note in comparison_notes(found))
    assert np.isnan(found.differences[0].standard_error).all()
    assert np.isfinite(found.differences[0].mean).all()
    assert np.isfinite(found.predictions[0].r2).all()
    with pytest.raises(UnsuitableMotions, match="1 subject: expected at least 3"):
        compare_motions(FLEXION, measured[:1], {"near": models["near"][:1]}, anova=True)


def test_a_pose_that_is_missing_is_left_out_and_said(cohort):
    measured, models = cohort
    holed = models["near"].copy()
    holed[0, 1] = np.nan
    found = compare_motions(FLEXION, measured, {"near": holed, "far": models["far"]})
    assert "near has no pose for 1 of 30 values" in next(comparison_doubts(found))
    assert found.predictions[0].points == 29
    assert found.test("ML", 1) is None and found.test("ML", 0) is not None
    apart = (measured - holed)[1:, 1]
    assert found.differences[0].mean[1] == pytest.approx(apart.mean(axis=0))


def test_a_flexion_measured_twice_is_two_conditions(cohort):
    measured, models = cohort
    twice = [0, 1, 1, 2, 3, 4]
    two = {name: one[:, twice] for name, one in models.items()}
    found = compare_motions(FLEXION[twice], measured[:, twice], two, calibrated_at_deg=(0.0,))
    first = found.summaries[0]
    assert first.conditions[:4] == ("0", "20", "20", "45")
    assert len(first.mean) == len(first.conditions) == 6 + 5
    assert first.mean[-4] == pytest.approx(measured[:, twice[1:]].mean(axis=(0, 1)))


def test_one_person_three_times_is_no_cohort():
    """Values that agree exactly leave an analysis of variance, and a pair's p, undefined."""
    person = np.arange(10.0).reshape(2, 5)
    same, other = np.stack([person] * 3), np.stack([person + 1.0] * 3)
    found = compare_motions([0.0, 20.0], same, {"same": same, "other": other}, alpha=0.005)
    assert any("p = 0.005, intervals of 99.5%" in note for note in comparison_notes(found))
    assert all(np.isnan([test.f, test.p, test.epsilon]).all() for test in found.tests)
    assert found.tests[0].df == (2, 4)
    pairs = found.tests[0].pairs
    assert np.isnan(pairs[0].p) and pairs[1].p == 0.0
    assert "10 of 10 analyses of variance are undefined" in next(comparison_doubts(found))


def test_a_model_that_does_not_move_has_no_r2(cohort):
    measured, models = cohort
    still = models["near"].copy()
    still[..., 2] = 30.0
    line = compare_motions(FLEXION, measured, {"still": still}).predictions[0]
    assert np.isnan(line.r2[2]) and np.isfinite(line.rmse[2])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"models": {}}, "no model"),
        ({"calibrated_at_deg": (10.0,)}, "calibrated at 10 degrees"),
        ({"calibrated_at_deg": tuple(FLEXION)}, "0 values to compare"),
        ({"alpha": 5.0}, "alpha"),
        ({"models": {"near": np.zeros((6, 4, 5))}}, "near has the shape"),
        ({"models": {"measured": np.zeros((6, 5, 5))}}, "another name"),
        ({"measured": np.full((6, 5, 5), np.nan)}, "a measured value is missing"),
        ({"flexion": [0.0, np.nan, 45.0, 60.0, 90.0]}, "a flexion is missing"),
    ],
)
def test_what_cannot_be_compared_is_said(cohort, change, said):
    measured, models = cohort
    options = {"flexion": FLEXION, "measured": measured, "models": models} | change
    three = [options.pop(name) for name in ("flexion", "measured", "models")]
    with pytest.raises(UnsuitableMotions, match=said):
        compare_motions(*three, **options)


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ({"a": np.arange(4.0)}, "1 group to compare"),
        ({"a": np.arange(4.0), "b": np.arange(5.0)}, r"a \(4,\), b \(5,\): expected"),
        ({"a": np.arange(2.0), "b": np.arange(2.0)}, "2 subjects: expected at least 3"),
        ({"a": np.arange(3.0), "b": np.array([1.0, np.nan, 3.0])}, "a value of b is missing"),
    ],
)
def test_what_is_no_set_of_groups_is_said(groups, said):
    with pytest.raises(UnsuitableMotions, match=said):
        repeated_measures(groups)


def test_without_pingouin_the_sentence_says_what_to_install(cohort, monkeypatch):
    load = builtins.__import__

    def without(name, *arguments, **options):
        if name == "pingouin":
            raise ImportError(name=name)
        return load(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    measured, models = cohort
    with pytest.raises(UnsuitableMotions, match=r"pip install 'kneejax\[statistics\]'"):
        compare_motions(FLEXION, measured, models)
    assert not compare_motions(FLEXION, measured, models, anova=False).tests


def test_clinical_measures_are_projections_onto_grood_and_suntays_axes(rng):
    """Against axes written out as vectors, paper 5, section 2.4."""
    table = rng.normal(size=(7, 6)) * 10.0 + [60.0, 0.0, 0.0, 0.0, -30.0, 0.0]
    found = clinical_measures(table)
    for row, seen in zip(table, found, strict=True):
        pose = Pose.from_table(row)
        turn = np.array(rotation_from_angles(pose.flexion, pose.adduction, pose.internal_rotation))
        lateral, long_axis = np.array([0.0, 0.0, 1.0]), turn[:, 1]
        floating = np.cross(long_axis, lateral)
        floating /= np.linalg.norm(floating)
        expected = [row[3:] @ lateral, row[3:] @ floating, -row[3:] @ long_axis, *row[1:3]]
        assert seen == pytest.approx(expected)
    assert poses_from_clinical(table[:, 0], found) == pytest.approx(table)
    assert [one.column for one in MEASURES] == ["ML_mm", "AP_mm", "CD_mm", "AA_deg", "IE_deg"]


def test_a_hinge_through_the_origin_of_the_femur_neither_compresses_nor_distracts():
    """As in paper 5's Table 3, whose CD is fixed: true of projections only."""
    axis = [[0.0, -3.0, -40.0], [0.0, 3.0, 40.0]]
    joint = hinge(axis, Pose.from_table([0.0, 3.0, -5.0, -6.0, -35.0, 4.0]))
    measures = clinical_measures(joint.pose(np.deg2rad(np.linspace(0.0, 110.0, 12))).to_table())
    assert np.ptp(measures[:, 2]) < 1e-9
    assert np.ptp(measures[:, 3]) > 1.0
