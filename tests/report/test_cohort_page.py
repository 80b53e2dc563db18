"""Free text of a cohort's files is text on its page and in its table."""

import csv

from kneejax.cohorts import KneeAnswer, summed_up
from kneejax.files import write_rows
from kneejax.report.cohort import cohort_answer

ODD = '=HYPERLINK("http://a")<script>alert(1)</script>'


def test_free_text_is_neither_markup_nor_a_formula(tmp_path):
    known = {"mass_kg": -71.0, "remark": ODD, ODD: "-1"}
    answers = [KneeAnswer("K1", known, failed=ODD), KneeAnswer("K2", known, outcome=ODD)]
    summary = summed_up(ODD, answers)
    answer = cohort_answer(summary, "knees")
    page = answer.page({})
    assert "<script>alert" not in page and "&lt;script&gt;alert" in page
    path = tmp_path / "cohort.csv"
    write_rows(path, answer.tables["cohort"].names, answer.tables["cohort"].rows)
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header[-3:] == ["mass_kg", "remark", f"'{ODD}"]
    assert rows[0][-3:] == ["-71.0", f"'{ODD}", "-1"]
    cells = [cell for row in (header, *rows) for cell in row]
    assert f"'{ODD}" in cells and ODD not in cells
