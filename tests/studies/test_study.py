"""Studies made in Python: checked as a file is, and the same after a change."""

import numpy as np
import pytest

import kneejax as kj
from kneejax import inference
from kneejax.geometry import FREE_COORDINATES
from kneejax.parameters import UnsuitableData
from kneejax.report.information import design_notes

TABLE = np.array([[x, 0.5, -2.0, 3.0, -20.0, 2.0] for x in (0.0, 30.0, 60.0)])


def study(knee, **changes):
    given = {"parameters": ["*.stiffness"], "measured": TABLE} | changes
    return kj.Study(title="a trial", knee=knee, **given)


def test_what_python_gives_is_kept_in_one_form(knee):
    found = study(
        knee, parameters=("ACL.stiffness",), frame_offset=True, weights={"mm": np.float64(2.0)},
        bounds={"ACL.stiffness": np.array([300.0, 9000.0])},
    )  # fmt: skip
    assert found.frame_offset == FREE_COORDINATES
    assert list(found.weights.values()) == [8.0, 8.0, 2.0, 2.0, 2.0]
    assert found.limits == {"ACL.stiffness": (300.0, 9000.0)}
    again = found.replace(seed=3)
    assert again.seed == 3 and again.settings() == found.settings() | {"seed": 3}


def test_noise_of_synthetic_poses_follows_them(knee):
    made = kj.Synthetic(
        parameters={"ACL.stiffness": 5000.0}, flexion_deg="0:60:30", noise_mm=0.1
    )
    found = study(knee, measured=None, synthetic=made)
    other = found.replace(synthetic=made.replace(noise_mm=0.5))
    assert (found.noise, other.noise) == ((0.1, None), (0.5, None))
    assert found.flexion_deg.tolist() == [0.0, 30.0, 60.0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"measured": None}, "exactly one of measured, synthetic"),
        ({"measured": TABLE[:, :5]}, "study: measured: shape (3, 5): expected poses, (n, 6)"),
        ({"measured": np.where(TABLE == 3.0, np.nan, TABLE)}, "measured[0]: not finite"),
        ({"frame_offset": ["flexion"]}, "flexion is prescribed as it was measured"),
        ({"frame_offset": ["anteriorr"]}, "did you mean anterior?"),
        ({"procedures": ["IV"]}, "one of I, II, III"),
        ({"method": "simplex"}, "one of least_squares, lbfgsb"),
        ({"bounds": {"stiffness": (4000.0, 300.0)}}, "a lower and a larger upper limit"),
        ({"starts": 3, "procedures": ["II"]}, "multistart needs procedure III"),
        ({"start": {"ACL.stiffness": 1e30}}, "expected between 0.001"),
    ],
)
def test_a_study_that_means_nothing_is_refused_when_it_is_made(knee, changes, words):
    with pytest.raises(kj.InputProblem) as caught:
        study(knee, **changes)
    assert words in str(caught.value)


def test_a_name_is_no_knee_and_bounds_hold_the_start(knee):
    with pytest.raises(kj.InputProblem, match="a knee, as kneejax.load_knee gives"):
        study(4)
    with pytest.raises(UnsuitableData, match="study: ACL.stiffness: .* exclude the start 4500"):
        study(knee, bounds={"ACL.stiffness": (300.0, 4000.0)})
    moved = study(knee, bounds={"ACL.stiffness": (300.0, 4000.0)}, start={"ACL.stiffness": 3500.0})
    assert moved.limits["ACL.stiffness"] == (300.0, 4000.0)


def test_more_free_numbers_than_readings_are_refused_before_any_work(knee):
    poses = np.zeros((2, 6))
    names = ["*.stiffness", "*.reference_strain", "ACL.femoral_attachment"]
    study = kj.Study(title="too many", knee=knee, measured=poses, parameters=names)
    with pytest.raises(kj.parameters.UnsuitableData, match="11 free numbers for 10 readings"):
        study.problem()
    believed = study.replace(prior={"ACL.femoral_attachment": 2.0}, noise_mm=0.5, noise_deg=0.5)
    assert len(believed.problem().start) == 11


def test_noise_that_is_stated_weighs_what_data_determine_whatever_the_weights(knee):
    table = np.array(kj.passive_flexion(knee, [0.0, 30.0, 60.0, 90.0]).to_table())
    table[:, 1:] += 0.1 * np.random.default_rng(0).standard_normal((4, 5))
    asked = {"title": "x", "knee": knee, "measured": table, "parameters": ["ACL.stiffness"]}
    plain = kj.identify(kj.Study(**asked, noise_mm=0.1, noise_deg=0.1))
    weighed = kj.identify(kj.Study(**asked, weights="paper1"), noise_mm=0.1, noise_deg=0.1)
    assert weighed.found.values == pytest.approx(plain.found.values)
    assert not weighed.found.noise_estimated
    assert kj.identify(kj.Study(**asked, weights="paper1")).found.noise_estimated


def test_what_a_study_believes_counts_in_the_posterior_and_in_what_to_measure_next(
    knee, monkeypatch
):
    table = np.array(kj.passive_flexion(knee, [0.0, 30.0, 60.0, 90.0]).to_table())
    study = kj.Study(title="x", knee=knee, measured=table, prior={"ACL.stiffness": 9.0},
                     parameters=["ACL.stiffness", "PCL.stiffness"], noise_mm=0.1, noise_deg=0.1,
                     start={"ACL.stiffness": 4490.0})  # fmt: skip
    drawn = []
    monkeypatch.setattr(inference, "posterior", lambda *_, priors, **__: drawn.append(priors))
    found = kj.identify(study, posterior=True)
    assert found.design.standard_errors[0, 0] < 9.0
    assert found.design.prior.tolist() == [9.0, np.inf]
    assert found.found.information.scale[0] == 9.0 < found.found.information.scale[1]
    assert "The prior that is stated of ACL stiffness is" in design_notes(found.design)[0]
    # What is asked for counts before what the study says.
    found = kj.identify(study, posterior=True, prior={"*.stiffness": (4500.0, 2.0)})
    assert found.design.prior.tolist() == [2.0, 2.0]
    assert drawn == [{"ACL.stiffness": (4490.0, 9.0)},
                     dict.fromkeys(("ACL.stiffness", "PCL.stiffness"), (4500.0, 2.0))]  # fmt: skip
    sweep = {"ACL.stiffness": (4400.0, 4500.0, 2)}
    for prior, width in (({}, 9.0), ({"*.stiffness": 2.0}, 2.0)):
        assert kj.sensitivity(study, sweep=sweep, prior=prior).local.widths[0] == width


def test_so_many_fibres_are_doubted_with_the_structures_to_free_instead():
    whole = kj.load_knee("lenhart2015")
    study = kj.Study(
        title="every fibre", knee=whole, measured=np.zeros((12, 6)), parameters=["*.stiffness"]
    )
    with pytest.warns(kj.parameters.DoubtfulValue, match=r"55 free.*ACL \(12 fibres\)"):
        study.problem()
