import pytest

from kneejax.files import InputProblem, read_candidates

HEADER = "flexion_deg,anterior_N,internal_Nm,name"
NO_LOAD = dict.fromkeys(
    ("lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm"), 0.0
)


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_rows_become_tests_and_absent_columns_are_zero(tmp_path):
    path = write(tmp_path / "t.csv", HEADER, "30,134,0,Lachman", "90, 0, -3,")
    lachman, turn = read_candidates(path)
    assert lachman == ("Lachman", 30.0, {**NO_LOAD, "anterior_N": 134.0})
    assert turn == ("", 90.0, {**NO_LOAD, "internal_Nm": -3.0})


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("flexion_deg,anteror_N", "30,1"), "header: anteror_N: expected any of"),
        (("flexion_deg,anteror_N", "30,1"), "did you mean anterior_N?"),
        (("flexion,anterior_N", "30,1"), "flexion_deg: missing"),
        (("flexion,anterior_N", "30,1"), "did you mean flexion?"),
        (("flexion_deg,anterior_N,anterior_N", "30,1,2"), "anterior_N: 2 columns"),
        ((HEADER, "30,x,0,a"), "row 1 (line 2), anterior_N: x: expected a number"),
        ((HEADER, "30,1,0,a", "40,nan,0,b"), "row 2 (line 3), anterior_N: nan: expected a finite"),
        ((HEADER, "300,1,0,a"), "row 1 (line 2), flexion_deg: 300: expected between -30 and 180"),
        ((HEADER, "30,1,0,a", "30,1,0,b"), "row 2 (line 3): the test of row 1 again"),
        ((HEADER, "30,1,3000,a"), "between -1000 and 1000 N m; N mm are suspected"),
        ((HEADER, "30,1e30,3,a"), "anterior_N: 1e30: expected between -100,000 and 100,000 N"),
        (("flexion_deg,adduction_Nmm", "30,1"), "did you mean varus_Nm?"),
        (("flexion_deg,internal_rotation_Nmm", "30,1"), "did you mean internal_Nm?"),
        (("flexion_deg,superior_N", "30,1"), "did you mean compression_N?"),
        ((HEADER,), "at least one row"),
    ],
)
def test_a_bad_table_is_refused_in_one_line(tmp_path, lines, words):
    path = write(tmp_path / "t.csv", *lines)
    with pytest.raises(InputProblem) as caught:
        read_candidates(path)
    line = str(caught.value)
    assert words in line and line.startswith(f"{path}: ") and "\n" not in line


def test_a_missing_table_is_refused(tmp_path):
    with pytest.raises(InputProblem, match="missing"):
        read_candidates(tmp_path / "none.csv")
