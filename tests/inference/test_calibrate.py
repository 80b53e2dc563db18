"""Twin experiments: what made the motion is found again."""

from pathlib import Path

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_path, read_measured, read_study
from kneejax.inference import UnknownParameter, select, synthetic_motion, uncertainty

STUDY = read_study(bundled_path("studies", "paper1"))
TRUTH = dict(STUDY.synthetic.parameters)


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("four_ligament")


@pytest.fixture(scope="module")
def clean(knee):
    return synthetic_motion(knee, TRUTH, np.arange(0.0, 121.0, 5.0), STUDY.parameters)


@pytest.mark.parametrize("procedure", ["III", "II", "I"])
def test_without_noise_the_truth_comes_back(knee, clean, procedure):
    fit = kj.calibrate(knee, clean, STUDY.parameters, procedures=(procedure,)).fit
    assert fit.success
    for estimate in fit.estimates:
        assert estimate.value == pytest.approx(TRUTH[estimate.name], rel=1e-4)
    if procedure == "III":
        assert fit.evaluations["jacobian"] <= 25


@pytest.mark.slow
def test_procedure_i_crawls_out_of_the_corner_that_its_first_step_finds(knee):
    """Stiffnesses alone run into their bounds; Anderson's extrapolation alone stays there."""
    other = {
        "ACL": (2341, 0.035),
        "PCL": (8994, -0.033),
        "MCL": (6567, 0.035),
        "LCL": (3642, 0.049),
    }
    truth = {f"{name}.stiffness": float(k) for name, (k, _) in other.items()}
    truth |= {f"{name}.reference_strain": strain for name, (_, strain) in other.items()}
    motion = synthetic_motion(knee, truth, np.arange(0.0, 121.0, 5.0), STUDY.parameters)
    fit = kj.calibrate(knee, motion, STUDY.parameters, procedures=("I",)).fit
    assert fit.success
    for estimate in fit.estimates:
        assert estimate.value == pytest.approx(truth[estimate.name], rel=1e-4)


def test_an_unknown_method_is_refused(knee, clean):
    with pytest.raises(ValueError, match="unknown method 'simplex': expected one of least_sq"):
        kj.calibrate(knee, clean, STUDY.parameters, method="simplex")


def test_with_noise_the_error_bars_hold_the_truth(knee, clean):
    noise = np.random.default_rng(3).standard_normal((25, 5))
    measured = clean + 0.1 * np.column_stack([np.zeros(25), noise])
    # Wide bounds: an estimate that stops on a bound has no error bar.
    wide = {"stiffness": (300.0, 30000.0)}
    result = kj.calibrate(knee, measured, STUDY.parameters, bounds=wide, procedures=("III",))
    scores = [(e.value - TRUTH[e.name]) / e.standard_error for e in result.fit.estimates]
    assert np.abs(scores).max() < 4.0
    assert all(0.05 < rmse < 0.2 for rmse in result.fit.rmse.values())
    weighted = [w * result.fit.partial_objectives[c] for c, w in STUDY.weights.items()]
    assert sum(weighted) == pytest.approx(result.fit.objective)


def test_several_starts_run_at_once_and_the_best_is_kept(knee, clean):
    result = kj.calibrate(
        knee, clean, STUDY.parameters, procedures=("III",), starts=3, seed=0, truth=TRUTH
    )
    starts = result.fit.starts
    assert len(starts) == 3 and list(starts) == sorted(starts)
    assert result.fit.objective <= starts[0] + 1e-12
    for estimate in result.fit.estimates:
        assert estimate.value == pytest.approx(TRUTH[estimate.name], rel=1e-4)


def test_a_constant_frame_offset_is_found(knee, clean):
    shifted = clean + np.array([0, 0, 0, 0.7, 0, -1.1])
    result = kj.calibrate(
        knee,
        shifted,
        STUDY.parameters,
        procedures=("III",),
        offsets=("anterior", "lateral"),
    )
    found = {name: value for name, value, _ in result.frame_offset}
    # The offset is added to the model to reach the measurement.
    assert found["anterior"] == pytest.approx(0.7, abs=1e-4)
    assert found["lateral"] == pytest.approx(-1.1, abs=1e-4)


def test_a_slack_ligament_is_named_not_hidden(knee):
    """An ACL that is slack at every pose leaves no trace in the motion."""
    slack = kj.with_values(knee, {"ACL.reference_strain": -0.19})
    motion = synthetic_motion(slack, {}, np.linspace(30.0, 60.0, 25), STUDY.parameters)
    noise = np.random.default_rng(0).standard_normal((len(motion), 5))
    motion = motion + 0.1 * np.column_stack([np.zeros(len(motion)), noise])
    result = kj.calibrate(slack, motion, STUDY.parameters, procedures=("III",))
    acl = result.fit.estimates[0]
    assert acl.at_bound or "not determined" in acl.remark
    assert acl.name in " ".join(result.notes)


def test_bounds_that_exclude_the_start_are_refused(knee, clean):
    with pytest.raises(ValueError, match="ACL.stiffness.*exclude the start 4500"):
        kj.calibrate(knee, clean, ("ACL.stiffness",), bounds={"stiffness": (300, 4000)})


def test_a_row_that_is_not_finite_is_refused(knee, clean):
    broken = clean.copy()
    broken[4, 2] = np.nan
    with pytest.raises(ValueError, match="row 4"):
        kj.calibrate(knee, broken, ("ACL.stiffness",))


def test_unknown_parameters_offer_the_nearest(knee):
    with pytest.raises(UnknownParameter, match="did you mean 'ACL.stiffness'"):
        select(knee, ["ACL.stifness"])
    with pytest.raises(UnknownParameter, match="one number"):
        select(knee, ["ACL.slack_length", "ACL.reference_strain"])


def test_values_set_by_name_are_read_back(knee):
    names = ["PCL.stiffness", "PCL.reference_strain", "LCL.tibial_attachment.lateral"]
    selection = select(knee, names)
    values = np.array([1234.0, 0.021, 44.0])
    assert np.allclose(selection.read(selection.apply(knee, values)), values)
    assert len(select(knee, ["*.stiffness"])) == 4
    assert "3 free numbers" in str(selection)


def test_uncertainty_of_a_line_equals_the_textbook():
    """Straight line through one coordinate: variances of intercept and slope."""
    x = np.linspace(-1, 1, 41)
    jacobian = np.zeros((5, 41, 2))
    jacobian[2, :, 0], jacobian[2, :, 1] = 1.0, x
    error = np.zeros((5, 41))
    error[2] = np.random.default_rng(0).standard_normal(41)
    design = np.column_stack([np.ones(41), x])
    error[2] -= design @ np.linalg.lstsq(design, error[2], rcond=None)[0]
    weights = np.array([1e-12, 1e-12, 1.0, 1e-12, 1e-12])
    sure = uncertainty(jacobian, error, weights, np.zeros(2, bool))
    spare = 3 * 41 - 2
    scale = (error[2] ** 2).sum() / spare
    expected = np.sqrt(scale * np.diag(np.linalg.inv(design.T @ design)))
    assert np.allclose(sure.standard_error, expected, rtol=1e-6)


def test_intercept_and_slope_far_from_the_origin_are_correlated_as_the_textbook_says():
    x = np.linspace(3.0, 5.0, 41)
    jacobian = np.zeros((5, 41, 3))
    jacobian[2, :, 0], jacobian[2, :, 2] = 100.0, x
    error = np.zeros((5, 41))
    error[2] = np.random.default_rng(1).standard_normal(41)
    weights = np.array([1e-12, 1e-12, 1.0, 1e-12, 1e-12])
    sure = uncertainty(jacobian, error, weights, np.array([False, True, False]))
    expected = -x.mean() / np.sqrt((x**2).mean())
    assert sure.correlation[0, 2] == pytest.approx(expected, rel=1e-9)
    assert np.allclose(np.diag(sure.correlation)[[0, 2]], 1.0)
    assert np.isnan(sure.correlation[1]).all()


def test_noise_of_a_synthetic_motion_has_its_two_units(knee, clean):
    noisy = synthetic_motion(
        knee, TRUTH, clean[:, 0], STUDY.parameters, noise_mm=0.5, noise_deg=0.02, seed=1
    )
    scatter = np.sqrt(((noisy - clean) ** 2).mean(axis=0))
    assert scatter[0] == 0.0
    assert scatter[1:3] == pytest.approx(0.02, rel=0.4)
    assert scatter[3:] == pytest.approx(0.5, rel=0.4)


def test_a_flexion_where_the_start_finds_no_balance_counts_in_no_mean(knee, clean):
    beyond = clean + np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    beyond[-1, 0] = 175.0
    wide = {"stiffness": (300.0, 30000.0)}
    start = kj.with_values(knee, TRUTH)
    result = kj.calibrate(start, beyond, STUDY.parameters, bounds=wide, procedures=("III",))
    assert result.start_rmse["anterior"] == pytest.approx(1.0)
    assert result.start_objective == pytest.approx(24.0)
    assert result.fit.objective < 24.0
    assert "1 pose was left out" in " ".join(result.notes)


def test_measured_motion_of_the_bundled_knees_person(knee):
    """Cine-MRI of the same person: the fit reaches the noise of the measurement."""
    study = Path(bundled_path("studies", "lenhart2015_mri"))
    target = study.parent / "../../../shared/data/lenhart2015/measured"
    if not target.exists():
        pytest.skip("the measurement is not bundled")
    study = read_study(study)
    result = kj.calibrate(
        knee,
        read_measured(study),
        study.parameters,
        procedures=("III",),
        offsets=tuple(study.frame_offset),
    )
    assert result.fit.success
    assert result.start_rmse["internal_rotation"] > 5.0
    assert all(value < 1.1 for value in result.fit.rmse.values())
