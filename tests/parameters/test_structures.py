"""Stiffness of structures drawn as several fibres: usual limits, and what is doubted."""

import dataclasses
import warnings

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.inference.sensitivity._sweeps import sweep_values
from kneejax.parameters import (
    DoubtfulValue,
    UnsuitableData,
    default_bounds,
    doubt_prior,
    percent_scales,
    prior_scales,
    select,
    start_within,
    structure_range,
    sums_in_words,
)


@pytest.fixture
def drawn(small_knee):
    """A knee whose cruciates are one structure of 1000 and 3000 N, and its LCL one line."""
    knee = eqx.tree_at(
        lambda k: k.ligaments.stiffness, small_knee, jnp.array([1000.0, 3000.0, 2000.0, 2000.0])
    )
    return dataclasses.replace(knee, groups=(("cruciates", ("ACL", "PCL")),))


def strong(knee, times):
    """With cruciates that are stiffer by a factor."""
    times = np.array([times, times, 1.0, 1.0])
    return eqx.tree_at(lambda k: k.ligaments.stiffness, knee, times * knee.ligaments.stiffness)


def test_usual_limits_are_a_structures_and_hold_its_stiffness(drawn):
    """Paper 1's, of thick single lines; of a structure of fibres a quarter to four times its own,
    and its fibres' in proportion."""
    usual = (300.0, 10000.0)
    assert structure_range(drawn, ("LCL",), usual) == usual
    assert structure_range(drawn, ("ACL", "PCL"), usual) == (1000.0, 16000.0)
    assert structure_range(drawn, ("ACL",), usual) == (250.0, 4000.0)
    stiff = strong(drawn, 4.0)
    assert structure_range(stiff, ("ACL", "PCL"), usual) == (4000.0, 64000.0)
    soft = strong(drawn, 0.1)
    assert structure_range(soft, ("ACL", "PCL"), usual) == (100.0, 1600.0)
    assert structure_range(soft, ("PCL",), usual) == (75.0, 1200.0)
    cut = strong(drawn, 0.0)
    assert structure_range(cut, ("ACL", "PCL"), usual) == usual
    for knee in (drawn, stiff, soft):
        selection = select(knee, ["cruciates.stiffness", "LCL.stiffness", "cruciates.damping"])
        lower, upper = map(np.asarray, default_bounds(knee, selection))
        start_within(knee, selection, lower, upper)
        assert lower[1:].tolist() == [300.0, 0.0] and upper[1:].tolist() == [10000.0, 400.0]
        _, lines = sweep_values(knee, ["cruciates.stiffness", "LCL.stiffness"])
        assert lines[0][0] < selection.read(knee)[0] < lines[0][-1]
        assert lines[1][[0, -1]].tolist() == [300.0, 9300.0]


@pytest.mark.parametrize(("times", "limits"), [(1.0, (1000.0, 16000.0)), (0.1, (100.0, 9840.0)),
                                               (10.0, (3100.0, 160000.0))])  # fmt: skip
def test_limits_of_a_known_ligament_hold_what_is_published_of_it(drawn, times, limits):
    named = dataclasses.replace(strong(drawn, times), groups=(("ACL", ("ACL", "PCL")),))
    assert structure_range(named, ("ACL", "PCL"), (300.0, 10000.0)) == pytest.approx(limits)


@pytest.mark.parametrize(("value", "limits"), [(100.0, (25.0, 10000.0)), (300.0, (300.0, 10000.0)),
                                               (20000.0, (300.0, 80000.0))])  # fmt: skip
def test_a_single_line_beyond_the_usual_limits_is_within_its_own(drawn, value, limits):
    knee = drawn.replace({"LCL.stiffness": value})
    assert structure_range(knee, ("LCL",), (300.0, 10000.0)) == limits


def test_widths_in_proportion_are_of_the_sum(drawn):
    selection = select(drawn, ["cruciates.stiffness"])
    values = selection.read(drawn)
    assert prior_scales(selection, values).tolist() == [1200.0]
    assert percent_scales(selection, values).tolist() == [40.0]


@pytest.mark.parametrize("value", [300.0, 2000.0, 2800.0])
def test_a_value_nearer_to_one_fibre_than_to_the_structure_is_doubted(drawn, value):
    said = (
        f"cruciates.stiffness: {value:g} N is of the whole cruciates, drawn as 2 fibres with "
        "4,000 N in this knee; one fibre has 2,000 N in the mean"
    )
    with pytest.warns(DoubtfulValue) as found:
        changed = drawn.replace({"cruciates.stiffness": value})
    assert [str(one.message) for one in found] == [said]
    assert float(changed.ligaments.stiffness[:2].sum()) == pytest.approx(value, rel=1e-14)


def test_other_values_are_not(drawn):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        drawn.replace({"cruciates.stiffness": 2900.0, "LCL.stiffness": 100.0})
        drawn.replace({"ACL.stiffness": 10.0, "cruciates.slack_length": 10.0})
        drawn.replace({"cruciates.damping": 1.0})
        doubt_prior(drawn, "cruciates.stiffness", 200.0)
        doubt_prior(drawn, "cruciates.stiffness", 99.0)
        doubt_prior(drawn, "LCL.stiffness", 1.0)
        doubt_prior(drawn, "cruciates.reference_strain", 0.001)
    assert not found


def test_a_prior_that_is_wide_for_a_fibre_only_is_doubted(drawn):
    with pytest.warns(DoubtfulValue, match="a prior of 150 N is of the whole cruciates"):
        doubt_prior(drawn, "cruciates.stiffness", 150.0)


def test_bounds_that_hold_a_fibre_only_say_so(drawn):
    selection = select(drawn, ["cruciates.stiffness"])
    with pytest.raises(UnsuitableData) as caught:
        start_within(drawn, selection, np.array([500.0]), np.array([3500.0]))
    assert str(caught.value) == (
        "cruciates.stiffness: bounds 500 to 3500 exclude the start 4000; it is the sum over the 2 "
        "fibres of cruciates, whose mean is 2000"
    )
    with pytest.raises(UnsuitableData, match="exclude the start 4000$"):
        start_within(drawn, selection, np.array([5000.0]), np.array([9000.0]))


def test_results_say_which_numbers_are_sums(drawn):
    names = ["cruciates.stiffness", "LCL.stiffness", "cruciates.slack_length"]
    said = "Sums over the fibres of a structure: cruciates.stiffness (2 fibres)."
    assert sums_in_words(drawn, names) == said
    assert sums_in_words(drawn, names[1:]) == sums_in_words(None, names) == ""
