"""A column of a test whose sense is the other one is named before anything is fitted."""

import re

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
