"""Knees side by side in figures, tables and words, with knees that lack things."""

import json

import numpy as np
import pytest
from markupsafe import escape

from kneejax.papers import knee_comparison_report as report
from kneejax.papers.claims import CANNOT_BE_JUDGED, answered, claimed
from kneejax.papers.knee_comparison import LIMITS
from kneejax.papers.paper4 import claims
from kneejax.report.look import picture_svg, write_page
from tests.papers.compared_knees import comparison, study


def test_every_score_is_in_the_heatmap_and_unknown_ones_are_hatched():
    found = comparison()
    picture = picture_svg(report.score_figure(found), "scores")
    for word in ("MCL prestretch", "LCL Young's modulus", "ACL attachment", "a_third"):
        assert word.replace("'", "&#x27;") in picture or word in picture
    assert "not in this knee" in picture
    assert "not in this knee" not in picture_svg(report.score_figure(comparison(study("x"))), "x")


@pytest.mark.parametrize("parameter", ["MCL.prestretch", "LCL.youngs_modulus", "ACL.attachment"])
@pytest.mark.parametrize("count", [1, 3, 6])
def test_ramps_are_drawn_for_the_knees_that_have_the_parameter(parameter, count):
    knees = [study(f"k{i}", lost=i == 0, attachments=i != 1) for i in range(count)]
    figure = report.ramp_figure(comparison(*knees), parameter)
    drawn = [axes for axes in figure.axes if axes.axison and axes.get_title(loc="left")[:1] == "k"]
    assert len(drawn) == sum(parameter in knee.parameters for knee in knees)


def test_tables_have_a_row_for_everything_under_their_headers():
    found = comparison()
    changes = sum(len(knee.changes) for knee in found.knees)
    scores = sum(len(LIMITS) * len(knee.parameters) for knee in found.knees)
    held = sum(int(run.held.sum()) for knee in found.knees for run in knee.runs.values())
    tables = report.comparison_answer(found).tables
    counts = (2 * changes, 4 * changes, scores, held)
    assert list(tables) == ["outcomes", "pressures", "scores", "rotations"]
    for table, count in zip(tables.values(), counts, strict=True):
        assert len(table.rows) == count
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_the_document_is_json_and_says_how_it_was_made():
    document = json.loads(report.comparison_answer(comparison()).json())
    assert document["settings"]["reference_modulus_MPa"] == 345.0
    assert document["versions"] and document["doubts"]
    assert document["unchanged"]["a_third"]["varus"]["ending"] == "outside_region"


def test_words_on_a_terminal_fit_it_and_are_ascii():
    found = comparison()
    printed = report.comparison_answer(found).terminal()
    about = dict.fromkeys(("axial_N", "full_Nm", "reference_modulus_MPa"), 1.0)
    about |= dict.fromkeys(("knees", "drawn", "drawn_around"), "4")
    answer = answered(4, claims(found), {}, {}, {}, found.doubts, about)
    for words in (printed, answer.terminal()):
        assert words.isascii()
        assert max(map(len, words.splitlines())) <= 100
    assert "warning: a_third: unchanged, it holds" in printed


def test_a_page_shows_every_claim_with_its_verdict_and_needs_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setitem(claimed(4)["words"], "kinship", "They are <kin>.")
    found = comparison()
    judged = claims(found)
    drawn = {"scores": (report.score_figure(found), "Scores & more")}
    words = dict.fromkeys(("axial_N", "full_Nm", "reference_modulus_MPa"), 1.0)
    words |= dict.fromkeys(("knees", "drawn", "drawn_around"), "<4>")
    answer = answered(4, judged, drawn, {}, {"a": 1}, found.doubts, words)
    assert [*answer.tables] == ["reproduction"] and answer.exit_status == bool(found.doubts)
    write_page(answer, tmp_path)
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["scores.png"]
    page = (tmp_path / "report.html").read_text()
    for claim in judged:
        assert f"<summary><h2>{escape(f'{claim.number} {claim.statement}')}</h2>" in page
    unknown = sum(claim.verdict == CANNOT_BE_JUDGED for claim in judged)
    assert page.count(f"<p>Verdict: {CANNOT_BE_JUDGED}</p>") == unknown
    assert "&lt;4&gt;" in page and "They are &lt;kin&gt;." in page and "<kin>" not in page
    assert "Scores &amp; more" in page and "<4>" not in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "another_$knee$" in page


def test_an_average_of_nothing_is_shown_as_unknown():
    nothing = ((0.0, 0.0), (0.1, 0.5), (np.nan, np.nan), (0.2, 0.5))
    found = comparison(study("x", MCL=nothing))
    line = next(
        line
        for line in report.comparison_answer(found).terminal().splitlines()
        if line.split()[:1] == ["MCL.prestretch"]
    )
    assert line.split()[3] == "-"
    rows = report.comparison_answer(found).tables["scores"].rows
    assert any(np.isnan(row[-1]) for row in rows)
