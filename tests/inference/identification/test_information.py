"""What data tell: the textbook's numbers, and sentences that hold."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import State
from kneejax.inference import Observations, fit_information, information, noise_of
from kneejax.parameters import UnsuitableData, select
from kneejax.report.information import (
    information_notes,
    reason_words,
    slack_words,
    sloppy_words,
    stiff_words,
)
from kneejax.statics import LoadCases, balance_with_slopes

PARAMETERS = ("*.stiffness", "*.reference_strain")
TWO = ("ACL.reference_strain", "PCL.reference_strain")
ONE = np.ones(2)


def line(x):
    """Derivatives of a straight line by intercept and slope."""
    return np.column_stack([np.ones(len(x)), x])


def passive(knee, flexion, offsets=()):
    """What a passive motion tells, at the knee's own parameters, and the balances."""
    selection, load_cases = select(knee, PARAMETERS), LoadCases.at(flexion)
    values = np.asarray(selection.read(knee))
    fit = balance_with_slopes(knee, selection.apply, values[None], load_cases)
    data = Observations(load_cases, np.zeros((len(flexion), 5)), noise_of(0.1, 0.1), offsets)
    return fit_information(knee, selection, data, fit), fit


def test_a_line_has_the_errors_of_the_textbook():
    x, noise = np.linspace(1.0, 4.0, 31), 0.2
    found = information(line(x), noise, TWO, ONE, scale=np.array([0.5, 3.0]))
    square = ((x - x.mean()) ** 2).sum()
    slope, intercept = noise / square**0.5, noise * ((x**2).mean() / square) ** 0.5
    assert found.standard_error == pytest.approx([intercept, slope], rel=1e-12)
    assert found.correlation[0, 1] == pytest.approx(-x.mean() / (x**2).mean() ** 0.5, rel=1e-12)
    rebuilt = found.eigenvectors * found.eigenvalues @ found.eigenvectors.T
    np.testing.assert_allclose(rebuilt, found.matrix, rtol=1e-12)
    assert found.condition_number == pytest.approx(np.linalg.cond(found.matrix), rel=1e-9)


def test_information_of_two_experiments_adds(rng):
    first, second = rng.normal(size=(5, 7, 2)), rng.normal(size=(5, 4, 2))
    noise = noise_of(0.3, 0.1)
    both = information(np.concatenate([first, second], axis=1), noise, TWO, ONE)
    parts = [information(part, noise, TWO, ONE).matrix for part in (first, second)]
    np.testing.assert_allclose(both.matrix, sum(parts), rtol=1e-12)


def test_each_coordinate_counts_by_its_own_noise():
    jacobian = np.zeros((5, 1, 2))
    jacobian[0, 0, 0], jacobian[4, 0, 1] = 1.0, 1.0
    found = information(jacobian, noise_of(noise_mm=0.4, noise_deg=0.1), TWO, ONE)
    assert found.standard_error == pytest.approx([0.1, 0.4])


def test_scales_change_no_standard_error(rng):
    jacobian = rng.normal(size=(20, 2)) * [1.0, 50.0]
    small = information(jacobian, 0.1, TWO, ONE, scale=np.array([1e-3, 1e-5]))
    large = information(jacobian, 0.1, TWO, ONE, scale=np.array([1e3, 1.0]))
    np.testing.assert_allclose(small.standard_error, large.standard_error, rtol=1e-10)
    np.testing.assert_allclose(small.correlation, large.correlation, rtol=1e-9)


def test_a_stiff_combination_is_named_with_its_standard_error():
    """Only x - 0.5 y is seen."""
    found = information([[1.0, -0.5]] * 4, 0.002, TWO, ONE, scale=np.full(2, 0.02))
    assert stiff_words(found) == [
        "Well-determined combination: ACL reference strain - 0.5 PCL reference strain, standard "
        "error 0.001 strain.",
    ]
    (loose,) = sloppy_words(found)
    assert "PCL reference strain by +0.02" in loose and "ACL reference strain by +0.01" in loose
    assert "together would be invisible (less than 0.001 x noise)" in loose
    assert not found.determined.any() and np.isinf(found.standard_error).all()
    assert "PCL reference strain compensates it exactly" in reason_words(found)[0]


def test_unlike_quantities_are_added_as_parts_of_their_values():
    names, values = ("ACL.reference_strain", "ACL.stiffness"), np.array([0.05, 4000.0])
    # Seen is the strain, plus a tenth of the stiffness' part of its value.
    found = information([[1.0, 0.1 / 4000.0]], 0.001, names, values)
    assert stiff_words(found) == [
        "Well-determined combination: (ACL stiffness / 4,000 N) + 10 ACL reference strain, "
        "standard error 1 %.",
    ]


def test_a_parameter_without_influence_is_named_and_the_others_are_not():
    jacobian = np.zeros((10, 2))
    jacobian[:, 0] = 1.0
    flexion = np.arange(0.0, 100.0, 10.0)
    slack = {"ACL": np.zeros(10, bool), "PCL": np.ones(10, bool)}
    found = information(jacobian, 0.01, TWO, ONE, flexion_deg=flexion, slack=slack)
    assert found.determined.tolist() == [True, False] and reason_words(found)[0] == ""
    expected = "PCL reference strain is not determined by these data: its ligament is slack at"
    assert reason_words(found)[1] == f"{expected} every pose."
    slack["PCL"] = flexion > 40
    found = information(jacobian, 0.01, TWO, ONE, flexion_deg=flexion, slack=slack)
    assert reason_words(found)[1] == f"{expected[:-3]} above 40 degrees."


@pytest.mark.parametrize(
    ("slack", "words"),
    [
        ("00000", ""),
        ("11111", "at every pose"),
        ("11000", "below 20 degrees"),
        ("00011", "above 20 degrees"),
        ("01110", "between 0 and 40 degrees"),
        ("10101", "below 10, between 10 and 30 and above 30 degrees"),
    ],
)
def test_slack_poses_become_ranges(slack, words):
    flexion = np.arange(0.0, 50.0, 10.0)
    where = np.array([mark == "1" for mark in slack])
    assert slack_words(flexion, where) == words
    # The order of the poses says nothing, nor does a pose that was measured twice.
    assert slack_words(np.r_[flexion[::-1], flexion], np.r_[where[::-1], where]) == words


def test_a_flexion_with_a_taut_pose_is_not_slack():
    assert slack_words(np.array([0.0, 10.0, 10.0]), np.array([True, True, False])) == (
        "below 10 degrees"
    )


def test_fewer_data_than_parameters_is_said():
    names = tuple(f"{name}.reference_strain" for name in "ABCD")
    found = information(np.eye(4)[:3], 0.001, names, np.ones(4))
    (note,) = information_notes(found)
    assert "3 measured numbers for 4 free parameters: at least 1 comb" in note
    assert np.isinf(found.condition_number) and found.determined.tolist() == [True] * 3 + [False]


def test_a_parameter_on_its_bound_is_held_and_the_others_know_more_for_it():
    jacobian = line(np.linspace(1.0, 4.0, 31))
    free = information(jacobian, 0.1, TWO, ONE)
    held = information(jacobian, 0.1, TWO, ONE, at_bound=np.array([False, True]))
    assert held.standard_error[0] == pytest.approx(0.1 / 31**0.5)
    assert held.standard_error[0] < free.standard_error[0]
    assert np.isnan(held.standard_error[1]) and np.isnan(held.correlation[1]).all()
    assert "on its bound" in reason_words(held)[1] and "On a bound" in information_notes(held)[0]
    np.testing.assert_allclose(held.matrix, free.matrix)


def test_poses_without_a_balance_count_for_nothing_and_are_counted():
    jacobian = np.ones((5, 3, 2)) * np.arange(1.0, 4.0)[:, None]
    jacobian[2, 1] = np.nan
    found = information(jacobian, 1.0, TWO, ONE)
    assert found.data == 10 and "1 pose counts for nothing" in " ".join(information_notes(found))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"noise": 0.0}, "noise 0.0: expected standard deviations above 0"),
        ({"noise": np.ones(3)}, r"noise of shape \(3,\): expected \(4,\)"),
        ({"jacobian": np.ones((4, 3))}, r"Jacobian of shape \(4, 3\) for 2 parameters"),
        ({"scale": np.array([0.02, 0.0])}, "PCL.reference_strain: scale 0: expected"),
        ({"scale": np.ones(3)}, r"scale of shape \(3,\): expected \(2,\)"),
        ({"values": np.ones(3)}, r"values of shape \(3,\)"),
    ],
)
def test_unsuitable_input_is_refused(change, words):
    good = {"jacobian": np.ones((4, 2)), "noise": 0.1, "names": TWO, "values": ONE}
    with pytest.raises(UnsuitableData, match=words):
        information(**(good | {"scale": np.ones(2)} | change))


@pytest.mark.parametrize(("mm", "deg", "words"), [(0.0, 0.1, "noise_mm"), (1, -1.0, "noise_deg")])
def test_noise_without_width_is_refused(mm, deg, words):
    with pytest.raises(UnsuitableData, match=f"{words}.*above 0"):
        noise_of(mm, deg)


def test_the_reason_of_an_undetermined_stiffness_is_the_slack_of_its_ligament(knee):
    loose = knee.replace({"ACL.reference_strain": -0.19})
    flexion = np.arange(0.0, 121.0, 5.0)
    found, fit = passive(loose, flexion)
    assert reason_words(found)[0].startswith(
        "ACL stiffness is not determined by these data: its ligament is slack "
    )
    # As the strains at the poses say.
    poses = State.of({"flexion": np.deg2rad(flexion)}, fit.q[0].T).tibia
    slack = np.asarray(kj.evaluate(loose, poses).strain)[:, 0] <= 0.0
    assert slack_words(flexion, slack) in reason_words(found)[0]
    assert found.determined[1:].all() and not any(reason_words(found)[1:])


def test_unknown_offsets_take_their_information_with_them(knee):
    """What is left is the Schur complement of parameters and offsets together."""
    flexion = np.arange(0.0, 121.0, 5.0)
    alone, fit = passive(knee, flexion)
    found, _ = passive(knee, flexion, ("anterior", "lateral"))
    units = np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0]
    rows = np.moveaxis(fit.jacobian[0], 1, 0) * units[:, None, None] / 0.1 * alone.scale
    shifts = np.zeros((5, len(flexion), 2))
    shifts[2, :, 0] = shifts[4, :, 1] = 10.0
    full = np.concatenate([rows, shifts], axis=2).reshape(-1, 10)
    matrix = full.T @ full
    left = matrix[:8, :8] - matrix[:8, 8:] @ np.linalg.solve(matrix[8:, 8:], matrix[8:, :8])
    np.testing.assert_allclose(found.matrix, left, rtol=1e-8, atol=1e-8 * left.max())
    assert (found.standard_error > alone.standard_error).all()
    assert len(found.names) == 8
