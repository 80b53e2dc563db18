"""Figures of laxity: what a cut knee is counted from stands beside the curve and the band."""

import pytest

import kneejax as kj
from kneejax.files import bundled_bands
from kneejax.report.laboratory import laxity_figure, laxity_table, load_figure


@pytest.mark.parametrize(("from_intact", "said"), [(True, "intact knee"), (False, "neutral pose")])
def test_a_figure_says_what_a_cut_knee_is_counted_from(from_intact, said):
    knee = kj.load_knee("four_ligament")
    tests = kj.lab_tests("drawer", [30.0], force_N=90.0, steps=1)
    curves = kj.load_curves(kj.cut(knee, ["ACL"]), tests, knee if from_intact else None)
    found = kj.laxity(curves[0])
    (axes,) = laxity_figure(curves, found, bundled_bands(["ACL"])).axes
    assert axes.get_ylabel().startswith(f"Change from the {said}:")
    # The published knees' own counting, whatever that of the curve.
    (band, _) = (text.get_text() for text in axes.get_legend().get_texts())
    assert band.endswith("from the intact knee")
    (axes,) = load_figure(curves, [one.searched for one in curves]).axes
    assert axes.get_xlabel().startswith(f"Change from the {said}:")
    (whole,) = kj.load_curves(knee, tests)
    (axes,) = laxity_figure([whole], kj.laxity(whole), bundled_bands([])).axes
    assert "from" not in axes.get_legend().get_texts()[0].get_text()


@pytest.mark.parametrize("both", [False, True])
def test_a_table_shows_the_directions_that_were_tested(both):
    tests = kj.lab_tests("drawer", [30.0], force_N=90.0, steps=1, both=both)
    (curves,) = kj.load_curves(kj.load_knee("four_ligament"), tests)
    table = laxity_table(curves, kj.laxity(curves))
    shown = {column.name for column in table.shown} & {"range", "positive", "negative"}
    assert shown == ({"range", "positive", "negative"} if both else {"positive"})
    # What is not shown is known all the same to whoever saves the table.
    assert {"range", "positive", "negative"} <= set(table.names)
