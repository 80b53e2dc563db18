import csv

import numpy as np
import pytest

from kneejax.files import InputProblem, read_poses, write_poses, write_rows
from kneejax.geometry import COLUMNS, CONVENTIONS

HEADER = ",".join(COLUMNS)
TABLE = np.array(
    [[0.0, 1.0, 2.0, 3.0, -4.0, 5.0], [30.0, 0.5, -7.0, 1 / 3, -25.0, 1.5], [90, 2, -12, 6, -20, 3]]
)


def refusal(path, **options):
    with pytest.raises(InputProblem) as caught:
        read_poses(path, **options)
    lines = str(caught.value).split("\n")
    assert all(line.startswith(f"{path}: ") and "expected " in line for line in lines)
    return "\n".join(lines)


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_round_trip(tmp_path, convention):
    path = tmp_path / "new" / "poses.csv"
    write_poses(path, TABLE, ["balanced"] * 3, [True, True, False], [True] * 3, convention)
    np.testing.assert_allclose(read_poses(path, convention), TABLE, atol=1e-11)
    header = path.read_text().splitlines()[0]
    named = "" if convention == "femoral" else ",convention"
    assert header == f"{HEADER},converged,stable,status{named}"
    assert [p.name for p in path.parent.iterdir()] == ["poses.csv"]


def test_a_table_that_names_another_convention(tmp_path):
    write_poses(tmp_path / "p.csv", TABLE, convention="tibial")
    assert "row 1 (line 2), convention: tibial: expected femoral" in refusal(tmp_path / "p.csv")


def test_other_column_names_and_columns_to_ignore(tmp_path):
    names = [f"knee {name}" for name in COLUMNS]
    text = f"note,{','.join(names)}\n" + "".join(
        f"x,{','.join(map(repr, row))}\n\n" for row in TABLE.tolist()
    )
    path = write(tmp_path / "p.csv", "\ufeff" + text)
    found = read_poses(path, columns=dict(zip(COLUMNS, names, strict=True)))
    np.testing.assert_array_equal(found, TABLE)
    assert "did you mean flexion_deg?" in refusal(path, columns={"flexion": "knee flexion_deg"})
    said = refusal(path)
    assert "\n" not in said and "did you mean flexion_deg by knee flexion_deg, add" in said


def test_a_column_of_the_patella_is_not_offered_for_one_of_the_tibia(tmp_path):
    """As in the cine-MRI of lenhart2015, whose pf_flex_deg is the nearer word."""
    header = "frame,knee_flex_deg,pf_flex_deg,patella_flexion_deg"
    path = write(tmp_path / "p.csv", f"{header}\n1,26.3,22.4,22.4\n")
    assert "flexion_deg, adduction_deg, internal_rotation_deg, anterior_mm" in refusal(path)
    assert "did you mean flexion_deg by knee_flex_deg?" in refusal(path)


def rows(*lines):
    return "\n".join([HEADER, *lines]) + "\n"


GOOD = "30,0,0,1,2,3"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (rows(GOOD, "40,0,nan,1,2,3"), "row 2 (line 3), internal_rotation_deg: nan"),
        (rows(GOOD, "40,0,0,1,-inf,3"), "row 2 (line 3), superior_mm: -inf"),
        (rows("40,0,0,x,2,3"), "row 1 (line 2), anterior_mm: x: expected a number"),
        (rows("40,0,0,,2,3"), "anterior_mm: empty"),
        (rows("40,0,0,1,2"), "row 1 (line 2): 5 cells: expected 6 cells"),
        (rows(), "at least one row"),
        (rows(GOOD).replace("flexion_deg", "flexion_degree"), "did you mean flexion_degree?"),
        (rows(GOOD).replace("anterior_mm", "superior_mm"), "anterior_mm: missing"),
        (rows(GOOD).replace("lateral_mm", "lateral_mm,lateral_mm"), "2 columns"),
        (rows(GOOD).replace(",", ";"), "separated by commas"),
        (rows("30,0,0,0.001,-0.03,0.002"), "metres are suspected"),
        (rows(*(f"{0.4 * i:.1f},0.02,0.1,1,2,3" for i in range(5))), "radians are suspected"),
        (rows('30,"0,0,1,2,3'), "comma separated"),
        ("", "empty"),
        ("   \n", "empty"),
        ("a\x00b", "binary"),
    ],
)
def test_a_bad_table_is_refused(tmp_path, text, words):
    assert words in refusal(write(tmp_path / "p.csv", text))


def test_two_columns_of_one_name(tmp_path):
    text = rows(GOOD + ",4").replace("lateral_mm", "lateral_mm,lateral_mm")
    assert "2 columns" in refusal(write(tmp_path / "p.csv", text))


def test_a_directory_a_missing_file_and_an_unknown_convention(tmp_path):
    assert "a folder" in refusal(tmp_path)
    assert "missing" in refusal(tmp_path / "p.csv")
    path = write(tmp_path / "p.csv", rows(GOOD))
    assert "did you mean grood-suntay?" in refusal(path, convention="groodsuntay")
    (tmp_path / "latin.csv").write_bytes(rows(GOOD).encode() + b"\xe9")
    assert "UTF-8" in refusal(tmp_path / "latin.csv")


@pytest.mark.parametrize("lines", [
    ["0,0,0,0,0,0"],  # translations that are all zero
    [f"0,{i},0,1,2,3" for i in range(6)],  # laxity at one flexion
    [f"{i},0,0,1,2,3" for i in range(4)],  # the first whole degrees
])  # fmt: skip
def test_harmless_tables_are_not_suspected(tmp_path, lines):
    assert len(read_poses(write(tmp_path / "p.csv", rows(*lines)))) == len(lines)


def test_written_cells(tmp_path):
    path = tmp_path / "t.csv"
    write_rows(path, ["a", "b_mm", "c", "d"], [["x", np.float64("nan"), np.True_, None]])
    write_rows(path, ["a", "b_mm", "c", "d"], [["x,y", np.nan, True, 1], ["z", 1 / 3, False, 2]])
    assert path.read_text() == 'a,b_mm,c,d\n"x,y",nan,true,1\nz,0.3333333333333333,false,2\n'
    with pytest.raises(ValueError, match="a row of 1 cells"):
        write_rows(path, ["a", "b"], [["x"]])
    assert path.read_text().startswith("a,b_mm")


def test_a_place_that_cannot_be_written(tmp_path):
    write(tmp_path / "file", "x")
    with pytest.raises(InputProblem, match="a place to write"):
        write_rows(tmp_path / "file" / "t.csv", ["a"], [])
    with pytest.raises(InputProblem, match="a place to write"):
        write_rows(tmp_path, ["a"], [])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_failed_rows_are_written_as_nan(tmp_path):
    table = TABLE.copy()
    table[1, 1:] = np.nan
    write_poses(tmp_path / "p.csv", table, converged=[True, False, True])
    assert (tmp_path / "p.csv").read_text().splitlines()[2] == "30.0,nan,nan,nan,nan,nan,false"


def test_a_text_is_no_formula_and_a_number_stays_one(tmp_path):
    path = tmp_path / "cohort.csv"
    texts = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\tx", "\rx", "\uff1d1+1"]
    plain = ["-5", "+1e3", "-0.5", "K1", "a=b", "", "nan", "1-2", "-"]
    write_rows(path, ["=about", "x_mm"], [[text, -1.5] for text in [*texts, *plain]])
    with open(path, newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head == ["'=about", "x_mm"]
    assert [row[0] for row in rows] == [*(f"'{text}".replace("\r", "\n") for text in texts), *plain]
    assert {row[1] for row in rows} == {"-1.5"}
