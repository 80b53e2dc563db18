"""What no knee has is refused, whichever way it is given; what one may have is not."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kneejax.mechanics import (
    NAMED_LOADS,
    RANGES,
    Implausible,
    Range,
    at_reference,
    check_fibres,
    range_of_parameter,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
QUANTITIES = ("stiffness", "slack_length", "reference_strain", "transition_strain",
              "transition_width", "tibial_attachment.anterior")  # fmt: skip


@given(value=finite, field=st.sampled_from(sorted(RANGES)))
def test_a_range_holds_what_it_says_and_its_sentence_names_both_ends(value, field):
    allowed = RANGES[field]
    zero = allowed.or_zero and value == 0.0
    assert allowed.holds(value) == (zero or allowed.lower <= value <= allowed.upper)
    numbers = [float(x.replace(",", "")) for x in re.findall(r"-?[\d.,]+(?:e-?\d+)?", str(allowed))]
    assert numbers[-2:] == [allowed.lower, allowed.upper]
    assert not allowed.holds(float("nan"))


def test_absurd_numbers_are_outside_every_range():
    for allowed in RANGES.values():
        assert not allowed.holds(1e30) and not allowed.holds(-1e30)
        # Around zero anything small is as good as nothing; elsewhere it is absurd.
        assert allowed.holds(1e-300) == (allowed.lower <= 0.0)


def test_every_load_by_name_has_a_range():
    for name, load in NAMED_LOADS.items():
        assert RANGES[name].unit == load.unit


@settings(max_examples=60, deadline=None)
@given(quantity=st.sampled_from(QUANTITIES), value=finite)
def test_a_value_that_no_knee_has_is_not_set(knee, quantity, value):
    allowed = range_of_parameter(quantity)
    assume(not allowed.holds(value))
    with pytest.raises(Implausible, match=re.escape(f"ACL.{quantity}: {value:g}: expected ")):
        knee.replace({f"ACL.{quantity}": value})


@settings(max_examples=25, deadline=None)
@given(stiffness=st.floats(1e-3, 1e7), strain=st.floats(-0.8, 0.5))
def test_a_value_that_a_knee_may_have_is_set(knee, stiffness, strain):
    values = {"PCL.stiffness": stiffness, "LCL.reference_strain": strain}
    changed = knee.replace(values)
    row = knee.ligaments.names.index("PCL")
    assert float(changed.ligaments.stiffness[row]) == pytest.approx(stiffness)
    assert float(changed.reference_strain()[3]) == pytest.approx(strain, abs=1e-12)


def test_what_follows_from_a_value_is_checked_too(knee):
    """An attachment within its range, from which no ligament reaches its other end."""
    with pytest.raises(Implausible, match=r"MCL\.length: .* mm at the reference pose: expected"):
        knee.replace({"MCL.femoral_attachment.superior": 700.0})


@pytest.mark.parametrize(
    ("quantity", "value"),
    [("stiffness", -5.0), ("slack_length", 0.0), ("slack_length", np.nan), ("stiffness", 1e30)],
)
def test_one_place_checks_the_fibres_of_a_knee(knee, quantity, value):
    fibres = knee.ligaments
    fine = at_reference(fibres, knee.at_reference)
    check_fibres(fibres, *fine)
    numbers = getattr(fibres, quantity).at[2].set(value)
    with pytest.raises(Implausible, match=rf"MCL\.{quantity}: "):
        check_fibres(dataclasses.replace(fibres, **{quantity: numbers}), *fine)


def test_a_size_says_what_it_suggests():
    assert RANGES["slack_length_mm"].expected(0.04).endswith("metres are suspected")
    assert RANGES["varus_Nm"].expected(-5000.0).endswith("N mm are suspected")
    assert Range(0.5, 2e4, "N").expected(30e4) == "between 0.5 and 20,000 N"
    assert range_of_parameter("ACL.colour") is None
