"""Decimals of a model, its splines, and what is counted by kind: one case in numbers for each."""

from decimal import Decimal

import numpy as np

from kneejax.files.opensim import exact
from kneejax.files.opensim.engine import named_once
from kneejax.files.opensim.model import simm_spline
from kneejax.files.opensim.report import ACTS, listed, numbers_of_kinds
from kneejax.files.tables.headers import header_meaning


def test_a_double_that_was_printed_is_its_shortest_decimal_and_zeros_stay():
    words = [str(exact.read_decimal(word)) for word in ("0.0017455000000000001", "0.10")]
    assert words == ["0.0017455", "0.10"]
    assert exact.write_decimal(Decimal("0.030750")) == "0.03075"
    assert exact.write_decimal(Decimal("1E+3")) == "1000"


def test_units_change_by_the_point_alone_and_angles_round_correctly():
    assert exact.shifted(Decimal("0.0012345"), exact.METRES_TO_MM) == 1.2345
    assert exact.degrees(Decimal("1.5707963267948966")) == 90.0
    assert exact.degrees(exact.radians(33.3)) == 33.3


def test_a_spline_through_a_cubic_is_the_cubic():
    t = np.array([0.0, 1.0, 3.0, 4.0, 6.0])
    assert round(float(simm_spline(t, t**3 - t, 2.0)), 12) == 6.0


def test_columns_of_one_name_are_left_out():
    table = "nColumns=4\nendheader\ntime\ta\tb\tb\n0\t1\t2\t3\n"
    assert named_once(table).splitlines() == ["nColumns=2", "endheader", "time\ta", "0\t1"]


def test_kinds_are_counted_in_words():
    tags = ["PathSpring", "HuntCrossleyForce", "PathSpring"]
    assert numbers_of_kinds(tags, ["meniscus_r"]) == "1 contact, 2 springs, 1 meniscus"
    assert listed([], ACTS) == []


def test_a_torque_of_the_other_sense_has_a_minus():
    found = header_meaning("JCS Load External Rotation Torque [Nm]")
    assert found is not None and found[1:3] == ("internal_Nm", -1.0)
    assert header_meaning("Patella Flexion [deg]") is None
