"""Curves of tests in a report: whole, and broken only where the knee holds nothing."""

import dataclasses
from types import SimpleNamespace

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import FittedTest
from kneejax.inference.calibration._answer import misfits_of_test
from kneejax.report.calibration_parameters import (
    _curve,
    errors_table,
    laxity_errors,
    reading_table,
)
from kneejax.report.calibration_verdict import laxity_doubts
from kneejax.statics import Status

COLUMN = FREE_COORDINATES.index("anterior")
LOAD = np.array([-60.0, -30.0, 0.0, 30.0, 60.0])
MOVED = np.array([-4.0, -2.5, 0.0, 2.0, np.nan])


def fitted(counted_from, **changes):
    observed = np.full((5, 5), np.nan)
    observed[:, COLUMN] = [-4.0, -2.5, 0.0, 2.0, 3.0]
    test = MeasuredTest("drawer", [30.0] * 5, {"anterior_N": LOAD}, observed, counted_from)
    measured, own = observed.copy(), np.full((5, 5), np.nan)
    own[:, COLUMN] = MOVED
    for row in changes.get("unseen", ()):
        measured[row] = own[row] = np.nan
    return FittedTest(test, measured, own, np.zeros(5, int))


def test_the_reading_that_counts_as_zero_does_not_break_its_curve():
    x, y = _curve(fitted("least_load"), np.arange(5), "anterior", LOAD)
    np.testing.assert_array_equal(x, MOVED)
    assert y.tolist() == LOAD.tolist()


def test_a_curve_from_the_unloaded_pose_goes_through_it():
    x, y = _curve(fitted("unloaded"), np.array([0, 1, 3]), "anterior", LOAD)
    assert list(zip(x.tolist(), y.tolist(), strict=True)) == [
        (-4.0, -60.0), (-2.5, -30.0), (0.0, 0.0), (2.0, 30.0)
    ]  # fmt: skip


def test_what_is_only_counted_from_is_not_drawn():
    x, y = _curve(fitted("opposite", unseen=[0, 1, 2]), np.arange(5), "anterior", LOAD)
    assert y.tolist() == [30.0, 60.0]
    assert np.isnan(x[1])


def test_a_difference_of_two_readings_may_be_off_by_the_noise_of_both():
    sd, counted = np.full(5, 0.1), np.ones(5, bool)
    found = {}
    for datum, off in (("opposite", 0.25), ("opposite", 0.4), ("unloaded", 0.25)):
        start = dataclasses.replace(fitted(datum), fitted=np.full((5, 5), 9.0))
        rows = {"test": start.test, "measured": start.measured, "status": start.status}
        near = FittedTest(fitted=start.measured + off, **rows)
        found[datum, off] = misfits_of_test(near, start, sd, counted)
    assert found["opposite", 0.25] == ()
    (worse,), (alone,) = found["opposite", 0.4], found["unloaded", 0.25]
    assert worse.against == 0.1 * np.sqrt(2.0) and alone.against == 0.1


def test_a_test_outside_the_cartilage_is_named_with_its_flexions():
    outside = [Status.BALANCED, Status.BALANCED, *[Status.OUTSIDE_REGION] * 3]
    flexion = np.array([30.0, 30.0, 130.0, 140.0, 140.0])
    test = dataclasses.replace(fitted("unloaded").test, flexion_deg=flexion)
    own = dataclasses.replace(fitted("unloaded"), test=test, status=np.array(outside, int))
    (said,) = laxity_doubts((own,))
    assert said.startswith("Test drawer: 3 of 5 loads outside_region")
    assert said.endswith("at 130, 140 deg.")
    assert laxity_doubts((own,), (Status.OUTSIDE_REGION,)) == []


def test_the_table_of_readings_says_which_tension_acted_in_each_row():
    """Of a line that one of two tests pulled; the other's rows stand under no pull."""
    pull = np.array([0.0, 100.0, 200.0, 300.0, 400.0])
    still, pulled = fitted("unloaded"), fitted("unloaded")
    test = dataclasses.replace(pulled.test, name="pulled", tensions={"patellar_tendon": pull})
    pulled = dataclasses.replace(pulled, test=test)
    tests = (still, pulled)
    both = SimpleNamespace(fit=SimpleNamespace(tests=tests), start_tests=tests)
    said = reading_table(both).records()
    acted = {name: [row["patellar_tendon.tension_N"] for row in said if row["test"] == name]
             for name in ("drawer", "pulled")}  # fmt: skip
    assert acted == {"drawer": [0.0] * 5, "pulled": pull.tolist()}
    assert [row["anterior_N"] for row in said] == 2 * LOAD.tolist()
    # Where no line was pulled there is no such column.
    alone = SimpleNamespace(fit=SimpleNamespace(tests=(still,)), start_tests=(still,))
    assert "patellar_tendon.tension_N" not in reading_table(alone).names


def test_an_error_of_one_reading_is_left_to_the_table_of_readings():
    flexion = np.array([30.0, 30.0, 30.0, 60.0, 90.0])
    one = fitted("unloaded")
    one = dataclasses.replace(one, test=dataclasses.replace(one.test, flexion_deg=flexion))
    calibration = SimpleNamespace(fit=SimpleNamespace(tests=(one,)), start_tests=(one,))
    shown = [(error["flexion"], error["readings"]) for error in errors_table(calibration).records()]
    assert shown == [("all", 5), ("30", 3)]
    assert len(laxity_errors(calibration)) == 4
