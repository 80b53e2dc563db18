"""What data tell and which test is next, on a terminal and in figures."""

import dataclasses

import numpy as np
import pytest

from kneejax import report
from kneejax.inference import Candidate, Design, information, usual_candidates
from kneejax.report.identification_figures import (
    candidates_figure,
    spectrum_figure,
    standard_errors_figure,
)
from kneejax.report.information import (
    candidates_table,
    design_section,
    information_section,
    information_table,
    reason_words,
)
from kneejax.statics import Status

NAMES = ("ACL.stiffness", "PCL.stiffness", "ACL.reference_strain", "PCL.reference_strain")
VALUES = np.array([4500.0, 3860.0, 0.03, -0.1])


def told(names=NAMES, values=VALUES, lost=None, **options):
    """Random derivatives, of the size of what such parameters do."""
    rng = np.random.default_rng(3)
    scale = np.where(np.abs(values) > 1.0, 0.3 * np.abs(values), 0.02)
    jacobian = rng.normal(size=(5, 25, len(names))) / scale
    if lost is not None:
        jacobian[..., lost] = 0.0
    return information(jacobian, 0.5, names, values, **options)


def planned(criterion="D", candidates=None, chosen=(19, 3, 40), names=NAMES):
    """A made-up choice: gains rise with the row, and five candidates did not balance."""
    tests = usual_candidates() if candidates is None else tuple(candidates)
    size, count = len(tests), len(names)
    status = np.zeros(size, int)
    status[[1, 5, -1]] = Status.OUTSIDE_REGION, Status.UNSTABLE, Status.NOT_CONVERGED
    gains = np.where(status == 0, np.linspace(0.0, 0.9, size), np.nan)
    scale = np.where(["stiff" in name for name in names], 1200.0, 0.02)
    fall = 0.6 ** np.arange(len(chosen) + 1)
    errors = scale * fall[:, None] * np.linspace(0.2, 0.8, count)
    after = np.where(status[:, None] == 0, errors[0] * np.linspace(1.0, 0.4, size)[:, None], np.nan)
    return Design(
        criterion, tuple(names), scale, tests, status, tuple(chosen), errors, fall, gains, after,
        np.full(len(chosen), 0.1), scale, np.isfinite(scale), (names[0],),
    )  # fmt: skip


def assert_inside(figure):
    """Nothing that is drawn is cut; returns the texts."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn, (wide, high) = figure.get_tightbbox(canvas.get_renderer()), figure.get_size_inches()
    assert drawn.x0 >= -0.01 and drawn.y0 >= -0.01
    assert drawn.x1 <= wide + 0.01 and drawn.y1 <= high + 0.01
    return {text.get_text() for text in figure.findobj(match=lambda a: hasattr(a, "get_text"))}


def plain(text):
    lines = text.splitlines()
    assert text.isascii() and max(map(len, lines)) < 100
    return text


def test_a_terminal_shows_value_error_and_reason():
    found = told(lost=1)
    text = plain(information_table(found, found.determined, {}).terminal())
    assert "4500" in text and "unlimited" in text and "not determined" in text
    reason = "PCL stiffness is not determined by these data: a change of 1,158 N"
    assert any(reason in words for words in reason_words(found))
    assert "Well-determined combination" in plain(information_section(found).terminal())


def test_a_terminal_shows_what_is_held_on_a_bound():
    held = np.array([True, False, False, False])
    found = told(at_bound=held)
    assert "at bound" in information_table(found, found.determined, {}).terminal()
    text = plain(information_section(found).terminal())
    assert "On a bound and held there: ACL.stiffness." in text


def test_rows_have_the_columns_of_the_table():
    found = told(lost=1)
    rows = information_table(found, found.determined, {}).records()
    names = ["name", "value", "standard_error", "unit", "scale", "times_better", "remark"]
    assert [[*row] for row in rows] == [names] * 4
    assert [row["remark"] for row in rows] == ["", "not determined", "", ""]
    tests = candidates_table(planned()).records()
    loads = ["lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm"]
    assert [[*row] for row in tests] == [
        ["name", "flexion_deg", *loads, "status", "gain", "chosen"]
    ] * 72  # fmt: skip
    assert tests[19]["chosen"] == 1 and tests[40]["chosen"] == 3 and tests[0]["chosen"] is None
    assert tests[1]["status"] == Status.OUTSIDE_REGION.word and tests[1]["gain"] is None


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_a_terminal_says_what_to_measure_next(criterion):
    design = planned(criterion)
    text = plain(design_section(design).terminal())
    assert "Next: posterior force 100 N at 15 degrees; it cuts the standard error of" in text
    assert "Then:" in text and "The data alone leave combinations" in text
    assert "3 of 72 candidates are left out" in text
    assert "On a bound at the fit, but counted as free here: ACL stiffness." in text
    assert f"({criterion}-optimal" in text
    best = int(np.nanargmax(design.gains))
    shown = "0.9" if criterion == "D" else "89"
    (line,) = [
        x for x in text.splitlines() if x.startswith(str(design.candidates[best])) and shown in x
    ]
    assert line.split()[-1] == shown


def test_many_tests_fit_on_a_terminal():
    lines = plain(design_section(planned(chosen=tuple(range(20, 32)))).terminal()).splitlines()
    assert max(map(len, lines)) <= 100
    assert sum(line.startswith("Then:") for line in lines) == 11


@pytest.mark.parametrize("count", [1, 4, 30])
def test_the_spectrum_shows_every_parameter(count):
    names = tuple(f"bundle{i}.reference_strain" for i in range(count))
    found = told(names, np.full(count, 0.05))
    words = assert_inside(spectrum_figure(found))
    assert all(f"bundle{i} reference strain" in words for i in range(count))


def test_the_spectrum_bears_nothing_known_and_parameters_on_a_bound():
    nothing = information(np.zeros((5, 4)), 0.1, NAMES, VALUES)
    assert_inside(spectrum_figure(nothing))
    held = told(at_bound=np.array([False, True, False, False]))
    assert "PCL stiffness" not in assert_inside(spectrum_figure(held))


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_the_candidates_are_hatched_or_numbered(criterion):
    design = planned(criterion)
    figure = candidates_figure(design)
    words = assert_inside(figure)
    assert {"1", "2", "3", "outside fitted surfaces", "unstable", "no balance"} <= set(words)
    hatched = [patch for patch in figure.axes[0].patches if patch.get_hatch()]
    assert len(hatched) == 3


def test_the_candidates_of_a_person_need_fill_no_grid():
    tests = [
        Candidate("drawer", 20.0, anterior_N=90.0),
        Candidate("drawer", 20.0, anterior_N=134.0),
        Candidate("A $x$ test & <more>", 47.5),
        *(Candidate("torque", float(angle)) for angle in range(40)),
    ]
    words = assert_inside(candidates_figure(planned(candidates=tests, chosen=(0, 7, 7))))
    assert {"drawer", "drawer (2)", "2, 3"} <= set(words)


def test_standard_errors_before_and_after_stand_in_their_units():
    words = assert_inside(standard_errors_figure(planned()))
    assert {"before", "after", "N", "240", "after all 3 tests"} <= set(words)
    one = dataclasses.replace(planned(chosen=(4,)), names=NAMES)
    assert "after the test" in assert_inside(standard_errors_figure(one))


def test_a_fit_with_nothing_free_is_said_on_the_spectrum():
    held = information(
        np.eye(2), 1.0, ["ACL.stiffness", "PCL.stiffness"], np.ones(2), at_bound=np.ones(2, bool)
    )
    figure = spectrum_figure(held)
    assert "nothing is free" in figure.texts[0].get_text()
    assert report.picture_png(figure)
