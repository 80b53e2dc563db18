"""Measured curves: which rows are opposite, and whether the tibia moves with its load."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import against_load
from kneejax.geometry import FREE_COORDINATES


def measured(flexion, loads, moved, coordinate="anterior", **given):
    observed = np.full((len(flexion), 5), np.nan)
    observed[:, FREE_COORDINATES.index(coordinate)] = moved
    return kj.MeasuredTest("test", flexion, loads, observed, **given)


def test_opposite_trials_of_a_robot_differ_by_fractions_of_a_degree():
    flexion = [30.2, 60.1, 29.7, 60.6, 60.0]
    force = {"anterior_N": [90.0, 88.0, -91.0, -90.0, -50.0]}
    test = measured(flexion, force, [5.0, 4.0, -2.0, -1.5, 0.0], counted_from="opposite")
    assert test.partner.tolist() == [2, 3, 2, 3, 4]


@pytest.mark.parametrize(
    ("flexion", "force", "said"),
    [
        ([30.0, 32.0], [90.0, -90.0], "1 degree .* the nearest is row 2, -90 at 32 degrees"),
        ([30.0, 30.0], [90.0, -70.0], "within 5 % .* the nearest is row 2, -70 at 30 degrees"),
        ([30.0, 30.0], [90.0, 45.0], "no row has a load of the opposite sense"),
    ],
)
def test_a_trial_without_a_partner_is_refused_with_the_nearest(flexion, force, said):
    with pytest.raises(ValueError, match=f"row 1: anterior_N 90 at 30 degrees.*{said}"):
        measured(flexion, {"anterior_N": force}, [5.0, -2.0], counted_from="opposite")


FORCE = np.array([-90.0, -45.0, 0.0, 45.0, 90.0])
FALLS = np.array([-0.2, -1.9, -3.4, -5.9, -7.5])


@pytest.mark.parametrize("counted_from", ["least_load", "offset", "absolute", "unloaded"])
def test_a_curve_that_falls_with_its_load_is_found(counted_from):
    moved = FALLS + 3.4 * (counted_from == "unloaded")
    test = measured(np.full(5, 30.0), {"anterior_N": FORCE}, moved, counted_from=counted_from)
    found = against_load(test)
    assert found[:4] == ("anterior_N", "anterior", 30.0, (-90.0, 90.0))
    assert found.values == pytest.approx((moved[0], moved[-1]))
    rises = dataclasses.replace(test, observed=-test.observed)
    assert against_load(rises) is None


def test_each_curve_is_judged_and_one_row_from_rest_is_a_curve():
    flexion, force = [0.0, 30.0, 60.0], {"internal_Nm": [5.0, 5.0, 5.0]}
    found = against_load(measured(flexion, force, [9.0, 11.0, -12.0], "internal_rotation"))
    assert (found.flexion_deg, found.loads, found.values) == (60.0, (0.0, 5.0), (0.0, -12.0))


def test_opposite_loads_are_judged_too():
    given = {"anterior_N": [90.0, -90.0]}
    assert against_load(measured([30.2, 30.0], given, [-4.0, 3.0], counted_from="opposite"))
    assert not against_load(measured([30.2, 30.0], given, [4.0, -3.0], counted_from="opposite"))


@pytest.mark.parametrize(
    ("loads", "moved", "given"),
    [
        # A stiff knee's curve, as noisy as it is long.
        ({"compression_N": FORCE}, 0.1 * FALLS, {}),
        ({"anterior_N": FORCE}, FALLS, {"sd_mm": 3.0}),
        # A second load acts, and may move the tibia the other way.
        ({"anterior_N": FORCE, "internal_Nm": FORCE / 10.0}, FALLS, {}),
        ({"anterior_N": FORCE}, FALLS, {"point_mm": (0.0, -300.0, 0.0)}),
        ({"anterior_N": FORCE}, FALLS, {"tensions": {"hamstrings": 50.0 + FORCE}}),
        # Nothing changes along it.
        ({"anterior_N": np.full(5, 90.0)}, FALLS, {"counted_from": "absolute"}),
    ],
)
def test_what_tells_no_sense_is_not_judged(loads, moved, given):
    coordinate = "superior" if "compression_N" in loads else "anterior"
    given = {"counted_from": "offset"} | given
    assert against_load(measured(np.full(5, 30.0), loads, moved, coordinate, **given)) is None
