"""Columns of the other sense, and constants that absorb all readings, are named before a fit."""

import re

import numpy as np
import pytest

from kneejax.files import InputProblem
from tests.studies.test_lab_tests import study, table

ROBOT = {
    "anterior_N": "Applied Load (N)", "flexion_deg": "Knee JCS Flexion [deg]",
    "anterior_mm": "Knee JCS Posterior [mm]",
}  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (ROBOT, 'Posterior [mm]: anterior_mm from -0.2 to -7.5 at 30 degrees: expected a '
                'coordinate that rises with its load, anterior_N from -90 to 90 N'),
        (ROBOT, 'write anterior_mm: "-Knee JCS Posterior [mm]" under columns'),
        (ROBOT | {"anterior_mm": "-Back [mm]", "anterior_N": "Posterior Load (N)"},
         'write anterior_N: "-Posterior Load (N)" under columns'),
        (ROBOT | {"anterior_mm": "-Back [mm]"}, 'write anterior_mm: "Back [mm]" under columns'),
    ],
)  # fmt: skip
def test_a_column_of_the_other_sense_is_named_before_the_fit(columns, said, tmp_path):
    sense = -1.0 if columns["anterior_mm"].startswith("-") else 1.0
    force, moved = (-90.0, -45.0, 0.0, 45.0, 90.0), (-0.2, -1.9, -3.4, -5.9, -7.5)
    rows = [(x, 30.0, sense * y) for x, y in zip(force, moved, strict=True)]
    header = [columns[x].lstrip("-") for x in ("anterior_N", "flexion_deg", "anterior_mm")]
    table(tmp_path, header=header, rows=rows)
    item = {"name": "ap", "file": "drawer.csv", "counted_from": "least_load"}
    with pytest.raises(InputProblem, match=re.escape(said)) as problem:
        study(tmp_path, [item | {"columns": columns}])
    assert str(tmp_path / "drawer.csv") in str(problem.value) and "\n" not in str(problem.value)
    turned = dict(columns)
    name = re.search(r'write (\w+): "', str(problem.value))[1]
    turned[name] = re.search(r'write \w+: "([^"]*)"', str(problem.value))[1]
    assert study(tmp_path, [item | {"columns": turned}]).tests


@pytest.mark.parametrize(
    ("rows", "counted_from", "said"),
    [
        # Each reading is the only one at its flexion.
        ([(29.8, -90.0, -4.0), (31.4, 90.0, 5.8)], "offset_each_flexion",
         r"anterior under one load at 29.8 degrees: expected readings under two loads or more"),
        # Two readings of the same state differ by noise alone.
        ([(30.0, 90.0, 4.0), (30.0, 90.0, 4.4), (60.0, 90.0, 3.0), (60.0, 0.0, 0.0)],
         "offset_each_flexion", "anterior under one load at 30 degrees"),
        ([(30.0, 90.0, 4.0)], "offset", "anterior under one load: expected"),
        ([(30.0, 0.0, 4.0), (60.0, 0.0, 3.0), (60.0, 9.0, np.nan)], "least_load",
         "least_load and no other row: expected rows beside those"),
    ],
)  # fmt: skip
def test_constants_that_absorb_all_that_was_read_are_refused(tmp_path, rows, counted_from, said):
    file = "drawer.csv"
    lines = [",".join("" if np.isnan(x) else f"{x:g}" for x in row) for row in rows]
    (tmp_path / file).write_text("\n".join(["flexion_deg,anterior_N,anterior_mm", *lines]))
    item = {"name": "drawer", "file": file, "counted_from": counted_from}
    with pytest.raises(InputProblem, match=rf"tests\[0\].counted_from: {said}"):
        study(tmp_path, [item])


def test_trials_whose_flexions_differ_by_degrees_share_a_constant_as_stated(tmp_path):
    """A robot's anterior and posterior trials are seldom at quite the same flexion."""
    rows = [(28.1, -90.0, -4.0), (31.9, 90.0, 5.8), (58.0, -90.0, -2.0), (61.5, 90.0, 3.0)]
    table(tmp_path, rows=rows)
    item = {"name": "drawer", "file": "drawer.csv", "counted_from": "offset_each_flexion"}
    with pytest.raises(InputProblem, match=r"within 1 degrees \(within_deg\) share one"):
        study(tmp_path, [item])
    (test,) = study(tmp_path, [item | {"within_deg": 4}]).tests
    assert test.groups.tolist() == [0, 0, 1, 1]
    # Each row is computed at the flexion that it has.
    assert test.bent_deg.tolist() == [28.1, 31.9, 58.0, 61.5]
    assert test.curve_deg.tolist() == [30.0, 30.0, 59.8, 59.8]
    with pytest.raises(InputProblem, match=r"within_deg: 40.*between 0 and 15 degrees"):
        study(tmp_path, [item | {"within_deg": 40}])


def test_opposite_trials_are_paired_within_the_stated_flexion(tmp_path):
    table(tmp_path, rows=[(28.1, -90.0, -4.0), (31.9, 90.0, 5.8)])
    item = {"name": "drawer", "file": "drawer.csv", "counted_from": "opposite"}
    with pytest.raises(InputProblem, match=r"1 degree of its flexion \(within_deg\)"):
        study(tmp_path, [item])
    assert study(tmp_path, [item | {"within_deg": 4}]).tests[0].partner.tolist() == [0, 0]


def test_the_least_load_of_a_curve_may_be_at_another_flexion(tmp_path):
    table(tmp_path, rows=[(29.6, -90.0, -4.0), (30.0, 0.0, 0.5), (30.5, 90.0, 5.8)])
    item = {"name": "drawer", "file": "drawer.csv", "counted_from": "least_load"}
    assert study(tmp_path, [item]).tests[0].partner.tolist() == [1, 1, 1]
