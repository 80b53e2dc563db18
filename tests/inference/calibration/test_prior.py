"""What is known beforehand: between the data and the belief, as both are worth."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.inference import CalibrationProblem, Noise, identify
from kneejax.inference.calibration import _side_by_side
from kneejax.inference.fit import fit_lanes

pytestmark = pytest.mark.usefixtures("optimised_code")

NAME, TRUE = "PCL.stiffness", 5000.0
NOISE = {"noise_mm": 0.1, "noise_deg": 0.1}
FLEXION = np.array([60.0, 75.0, 90.0, 105.0])


@pytest.fixture(scope="module")
def measured(knee):
    return np.asarray(kj.passive_flexion(knee.replace({NAME: TRUE}), FLEXION).to_table())


@pytest.fixture(scope="module")
def alone(knee, measured):
    """What the data say by themselves."""
    return fitted(knee, measured, None)


def calibrated(knee, measured, parameters, **fields):
    study = kj.Study(
        title="a trial", knee=knee, measured=measured, parameters=parameters, **fields
    )
    return kj.calibrate(study)


def fitted(knee, measured, sd):
    prior = {"prior": {NAME: sd}} if sd else {}
    fit = calibrated(knee, measured, (NAME,), procedures=("III",), **NOISE, **prior)
    return fit[NAME]


@pytest.mark.long
def test_an_estimate_lies_between_data_and_belief_as_each_is_worth(knee, measured, alone):
    """Of one value, precisions add and the estimate is their mean, weighed by them."""
    believed, sd = knee_value(knee), alone.standard_error
    both = fitted(knee, measured, sd)
    assert both.standard_error == pytest.approx(alone.standard_error / np.sqrt(2.0), rel=0.1)
    assert both.value == pytest.approx(0.5 * (alone.value + believed), rel=0.03)
    assert both.high - both.low == pytest.approx(
        (alone.high - alone.low) / np.sqrt(2.0), rel=0.15
    )


def knee_value(knee):
    return float(kj.select(knee, [NAME]).read(knee)[0])


def test_a_vague_belief_leaves_the_data_alone(knee, measured, alone):
    vague = fitted(knee, measured, 1e6)
    assert vague.value == pytest.approx(alone.value, rel=1e-5)
    assert vague.standard_error == pytest.approx(alone.standard_error, rel=1e-4)


@pytest.mark.long
def test_a_certain_belief_moves_nowhere(knee, measured):
    assert fitted(knee, measured, 1.0).value == pytest.approx(knee_value(knee), rel=1e-3)


@pytest.mark.long
def test_calibrate_and_identify_tell_the_same_of_a_belief(knee, measured):
    own = fitted(knee, measured, 300.0)
    chosen, belief = kj.select(knee, [NAME]), {NAME: 300.0}
    noise = Noise.of(**NOISE)
    problem = CalibrationProblem.of(knee, chosen, measured, noise=noise, prior=belief)
    found = identify(problem)
    (interval,) = found.intervals
    assert found.values[0] == pytest.approx(own.value, rel=1e-4)
    assert (interval.low, interval.high) == pytest.approx((own.low, own.high), rel=1e-2)


def test_a_belief_needs_the_noise_that_it_is_weighed_against(knee, measured):
    with pytest.raises(kj.InputProblem, match="prior: .*: expected noise_mm and noise_deg too"):
        calibrated(knee, measured, (NAME,), prior={NAME: 300.0})


def test_further_starts_are_drawn_from_what_is_believed(knee, measured, monkeypatch):
    begun = []

    def kept(balance, data, begin, starts, *box, **options):
        begun.append(starts)
        return fit_lanes(balance, data, begin, starts[:2], *box, **options)

    monkeypatch.setattr(_side_by_side, "fit_lanes", kept)
    calibrated(
        knee, measured, (NAME, "ACL.stiffness"), procedures=("III",), starts=200, seed=0,
        prior={NAME: 100.0}, bounds={"ACL.stiffness": (2000.0, 9000.0)}, **NOISE,
    )  # fmt: skip
    believed, unknown = begun[0][1:].T
    assert np.mean(believed) == pytest.approx(knee_value(knee), abs=25.0)
    assert np.std(believed) == pytest.approx(100.0, rel=0.2)
    # Of what nobody believes anything, anywhere between the bounds.
    assert unknown.min() < 2300.0 and unknown.max() > 8700.0
