"""How wide priors are, and which poses are no longer those of a knee."""

import numpy as np
import pytest

from kneejax.parameters import (
    UnknownParameter,
    UnsuitableData,
    percent_scales,
    prior_scales,
    select,
    stated_bounds,
    unphysiological,
)

NAMES = (
    "ACL.stiffness",
    "PCL.stiffness",
    "ACL.reference_strain",
    "MCL.slack_length",
    "LCL.femoral_attachment.anterior",
)


def test_priors_follow_the_quantity(small_knee):
    selection = select(small_knee, NAMES)
    values = np.asarray(selection.read(small_knee))
    widths = prior_scales(selection, values)
    expected = [0.3 * values[0], 0.3 * values[1], 0.02, 0.02 * values[3], 2.0]
    np.testing.assert_allclose(widths, expected, rtol=1e-14)
    # A name counts before a wildcard, and that before a quantity.
    given = {"stiffness": 1.0, "*.stiffness": 2.0, "ACL.stiffness": 3.0}
    assert prior_scales(selection, values, given)[:2].tolist() == [3.0, 2.0]


def test_what_is_said_of_all_numbers_of_a_place_holds_for_each(small_knee):
    names = ("ACL.femoral_attachment", "PCL.femoral_attachment", "ACL.stiffness")
    selection = select(small_knee, names)
    values = np.asarray(selection.read(small_knee))
    given = {
        "*.femoral_attachment": 1.0,
        "ACL.femoral_attachment": 3.0,
        "ACL.femoral_attachment.lateral": 0.5,
        "*.femoral_attachment.superior": 2.0,
    }
    widths = dict(zip(selection.names, prior_scales(selection, values, given), strict=True))
    axes = ("anterior", "superior", "lateral")
    assert [widths[f"ACL.femoral_attachment.{axis}"] for axis in axes] == [3.0, 3.0, 0.5]
    assert [widths[f"PCL.femoral_attachment.{axis}"] for axis in axes] == [1.0, 2.0, 1.0]
    assert widths["ACL.stiffness"] == 0.3 * values[-1]
    low, high = stated_bounds(small_knee, selection, {"ACL.femoral_attachment": (-60.0, 70.0)})
    assert (low[:3] == -60.0).all() and (high[:3] == 70.0).all()
    np.testing.assert_allclose(high[3:6] - low[3:6], 20.0)
    with pytest.raises(UnknownParameter, match="prior of 'ACL.tibial_attachment'"):
        prior_scales(selection, values, {"ACL.tibial_attachment": 1.0})


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan, np.inf])
def test_a_prior_without_a_width_is_refused(small_knee, width):
    selection = select(small_knee, NAMES)
    with pytest.raises(UnsuitableData, match="ACL.stiffness: prior of width .* above zero"):
        prior_scales(selection, selection.read(small_knee), {"ACL.stiffness": width})


def test_a_value_of_zero_has_no_usual_width(small_knee):
    selection = select(small_knee, NAMES)
    values = np.array(selection.read(small_knee))
    values[0] = 0.0
    with pytest.raises(UnsuitableData, match="ACL.stiffness: prior of width 0"):
        prior_scales(selection, values)
    with pytest.raises(UnsuitableData, match="ACL.stiffness is 0, it has no per cent"):
        percent_scales(selection, values)


def test_a_prior_of_something_else_names_the_nearest(small_knee):
    selection = select(small_knee, NAMES)
    with pytest.raises(UnknownParameter, match="prior of 'ALC.stiffness'.*'ACL.stiffness'"):
        prior_scales(selection, selection.read(small_knee), {"ALC.stiffness": 1.0})


def test_a_per_cent_of_a_strain_is_a_hundredth_and_of_a_place_nothing(small_knee):
    selection = select(small_knee, NAMES[:4])
    values = np.asarray(selection.read(small_knee))
    expected = [0.01 * values[0], 0.01 * values[1], 0.01, 0.01 * values[3]]
    np.testing.assert_allclose(percent_scales(selection, values), expected, rtol=1e-14)
    selection = select(small_knee, NAMES)
    with pytest.raises(UnsuitableData, match="LCL.femoral_attachment.anterior has no per cent"):
        percent_scales(selection, selection.read(small_knee))


def test_what_a_knee_never_does_is_marked_wherever_it_happens():
    own = np.array([2.0, 10.0, 1.0, -20.0, 0.0])
    still = np.tile(own, (6, 1))
    for k, limit in enumerate([10.0, 20.0, 15.0, 15.0, 15.0]):
        assert not unphysiological(still + 0.99 * limit * np.eye(5)[k], own).any()
        assert unphysiological(still - 1.01 * limit * np.eye(5)[k], own).all()
    # What failed is not marked a second time.
    assert not unphysiological(np.full(5, np.nan), own)
