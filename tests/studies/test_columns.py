"""Columns of a test's table: by other names, of a left knee, twice, left out."""

import pytest
import yaml

import kneejax as kj
from kneejax.files import InputProblem
from kneejax.geometry import FREE_COORDINATES
from tests.studies.tables import study, table

ANTERIOR = FREE_COORDINATES.index("anterior")


def test_columns_of_another_program_are_mapped_with_their_senses(tmp_path):
    table(tmp_path, header=("Applied Load", "Knee JCS Posterior", "Torque [Nmm]"),
          rows=[(90.0, -4.0, 1500.0)])  # fmt: skip
    columns = {
        "anterior_N": "Applied Load", "anterior_mm": "-Knee JCS Posterior",
        "internal_Nm": "-0.001 * Torque [Nmm]",
    }  # fmt: skip
    item = {"name": "drawer", "file": "drawer.csv", "columns": columns, "at_deg": 20}
    (test,) = study(tmp_path, [item]).tests
    assert test.flexion_deg.tolist() == [20.0]
    assert test.loads["internal_Nm"].tolist() == [-1.5]
    assert test.observed[0, ANTERIOR] == 4.0


def test_a_left_knee_is_mirrored(tmp_path):
    header = ("flexion_deg", "internal_Nm", "lateral_N", "internal_rotation_deg", "anterior_mm")
    table(tmp_path, header=header, rows=[(30.0, 3.0, 10.0, 8.0, 1.0)])
    item = {"name": "torsion", "file": "drawer.csv", "mirror": True}
    (test,) = study(tmp_path, [item]).tests
    assert test.loads["lateral_N"].tolist() == [-10.0]
    assert test.observed[0, [1, ANTERIOR]].tolist() == [-8.0, 1.0]


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_where_a_force_acts_is_mirrored_as_the_knee_file_is(tmp_path, side, mirrored):
    """A force 25 mm lateral of the axis turns a left tibia as it turns the right twin's."""
    document = kj.files.load_knee_file("four_ligament").document
    own = kj.files.mirror_document(document) if side == "left" else document
    (tmp_path / "knee.yaml").write_text(yaml.safe_dump(own, sort_keys=False))
    header = ("flexion_deg", "anterior_N", "internal_rotation_deg", "anterior_mm")
    sign = -1.0 if mirrored else 1.0
    table(tmp_path, header=header, rows=[(30.0, 90.0, sign * 8.0, 4.0)])
    lateral = -25.0 if "left" == side or mirrored else 25.0
    item = {"name": "drawer", "file": "drawer.csv", "mirror": mirrored,
            "point_mm": [0.0, -30.0, lateral]}  # fmt: skip
    (test,) = study(tmp_path, [item], knee="knee.yaml").tests
    assert test.point_mm == (0.0, -30.0, 25.0)
    assert test.observed[0, 1] == 8.0


@pytest.mark.parametrize(
    ("header", "change", "words"),
    [
        # One column of two, whichever it is, would be read without a word.
        (("flexion_deg", "anterior_N", "anterior_mm", "anterior_mm"), {},
         "header: anterior_mm: expected one column of anterior_mm"),
        (("flexion_deg", "anterior_N", "anterior_mm", "anterior_N"), {},
         "header: anterior_N: expected one column"),
        (("flexion_deg", "anterior_N", "anterior_mm", "anterior_force_N"), {},
         "header: anterior_N and anterior_force_N: expected one column of anterior_N"),
        (("flexion_deg", "anterior_N", "anterior_mm", "JCS Anterior (mm)"), {},
         r"anterior_mm and JCS Anterior .mm.: expected one column of anterior_mm .columns"),
        (("flexion_deg", "anterior_N", "anterior_mm", "x"), {"at_deg": 60},
         r"header: flexion_deg: expected no at_deg .60. beside it, or flexion_deg under ignore"),
        (("flexion_deg", "anterior_N", "anterior_mm", "x"), {"loads": {"anterior_N": 20}},
         "loads.anterior_N: 20.0: expected no anterior_N beside the column of it"),
    ],
)  # fmt: skip
def test_what_stands_twice_is_refused(tmp_path, header, change, words):
    table(tmp_path, header=header, rows=[(30.0, 90.0, 4.0, 5.0), (30.0, 45.0, 2.5, 3.0)])
    with pytest.raises(InputProblem, match=words):
        study(tmp_path, [{"name": "drawer", "file": "drawer.csv"} | change])


def test_a_flexion_that_is_ignored_gives_way_to_the_one_that_is_said(tmp_path):
    table(tmp_path)
    item = {"name": "drawer", "file": "drawer.csv", "at_deg": 45, "ignore": ["flexion_deg"]}
    assert study(tmp_path, [item]).tests[0].flexion_deg.tolist() == [45.0, 45.0, 45.0]
