"""How wide priors are, and which poses are no longer those of a knee."""

import numpy as np
import pytest

from kneejax.parameters import (
    UnknownParameter,
    UnsuitableData,
    percent_scales,
    prior_scales,
    select,
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
