"""Figures of maps and profiles show what is there, and hatch what means nothing."""

import dataclasses

import numpy as np
import pytest

from kneejax.inference import Condition, ParameterMap, Profile
from kneejax.report import map_figure, map_matrix_figure, picture_png
from kneejax.report.identification_figures import profiles_figure
from kneejax.report.maps import _levels, correlation, map_answer


def a_map(names=("PCL.stiffness", "PCL.reference_strain")):
    x, y = np.linspace(300.0, 10000.0, 9), np.linspace(-0.2, 0.2, 7)
    values = 1.0 + 1e4 * (y[:, None] + 0.05) ** 2 + (x / 1e4 - 0.3) ** 2
    condition = np.zeros(values.shape, np.int8)
    condition[-1, -1], condition[-1, 0], condition[0, 0] = 4, 2, 1
    return ParameterMap(
        names, ("N", ""), x, y, values, np.stack([values * k for k in range(1, 6)]), condition,
        (condition == 4).astype(int), (3860.0, -0.1), float(values[2, 3]), 0, np.ones(5),
    )  # fmt: skip


def test_the_answer_says_where_it_is_lowest_and_how_well_the_pair_is_determined():
    found = a_map()
    x, y = np.meshgrid((found.x - 5150.0) / 1e4, (found.y + 1 / 15) / 0.4)
    valley = dataclasses.replace(found, objective=1.0 + x**2 + y**2 + 1.9 * x * y)
    assert correlation(valley) == pytest.approx(-0.95, abs=1e-9)
    answer = answer_of(valley)
    at = "lowest, 1.000, at PCL.stiffness 5150 N, PCL.reference_strain -0.06667"
    assert at in answer.sentence
    assert "compensate each other (correlation -0.95)" in answer.sentence
    edge = dataclasses.replace(found, objective=2.0 + x + y)
    assert np.isnan(correlation(edge)) and "on the edge" in answer_of(edge).doubts[0]
    fitted = answer_of(dataclasses.replace(found, start_objective=0.5), "fit")
    assert "the fit has a lower objective, 0.5000, than any grid point" in fitted.doubts[0]


def answer_of(found, begun="start"):
    about = {"study": "S", "knee": "K", "grid": "9x7", "ranges": "r"}
    return map_answer([found], about, {}, begun)


def legend_of(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_map_has_six_panels_marks_and_hatches():
    figure = map_figure(a_map())
    titled = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left").split(",")[0] for axes in titled][:2] == [
        "Objective", "Lateral translation"
    ]  # fmt: skip
    assert len(titled) == 6
    words = legend_of(figure)
    for word in ("start", "lowest grid point", "unphysiological", "no balance"):
        assert word in words
    assert "unstable" not in words
    assert len(picture_png(figure)) > 20_000


def test_what_is_not_sound_is_not_coloured():
    found = a_map()
    figure = map_figure(found)
    axes = next(a for a in figure.axes if a.get_title(loc="left") == "Objective")
    coloured = axes.collections[0]
    inside = any(path.contains_point((9990.0, 0.199)) for path in coloured.get_paths())
    assert not inside
    assert any(path.contains_point((5000.0, 0.0)) for path in coloured.get_paths())


def test_a_map_with_nothing_to_colour_still_says_why():
    found = a_map()
    nothing = dataclasses.replace(
        found,
        condition=np.full(found.condition.shape, int(Condition.NO_BALANCE)),
        objective=np.full(found.objective.shape, np.nan),
        partial_objectives=np.full(found.partial_objectives.shape, np.nan),
    )
    assert nothing.minimum is None
    figure = map_figure(nothing)
    assert legend_of(figure) == ["start", "no balance"]
    assert len(picture_png(figure)) > 10_000


@pytest.mark.parametrize(("low", "high"), [(3.0, 4.0), (0.02, 3e4), (1e-3, 1e9), (5.0, 5.0)])
def test_levels_are_round_and_cover_the_values(low, high):
    levels = _levels(low, high)
    assert levels[0] <= low and levels[-1] >= high
    assert 2 <= len(levels) <= 18
    mantissa = levels / 10.0 ** np.floor(np.log10(levels) + 1e-9)
    assert np.isin(np.round(mantissa, 6), [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8]).all()


def test_all_pairs_stand_in_a_triangle():
    names = ["ACL.stiffness", "PCL.stiffness", "MCL.stiffness"]
    pairs = [(names[0], names[1]), (names[0], names[2]), (names[1], names[2])]
    figure = map_matrix_figure([a_map(pair) for pair in pairs])
    shown = [axes for axes in figure.axes if axes.axison and axes.collections]
    assert len([axes for axes in shown if axes.get_subplotspec()]) == 3


def a_profile(**change):
    values = np.linspace(2000.0, 4000.0, 9)
    made = Profile(
        "PCL.stiffness", "N", 3000.0, 250.0, values, ((values - 3000.0) / 250.0) ** 2,
        values[:, None], 2510.0, 3490.0, "", "", 3.84,
    )  # fmt: skip
    return dataclasses.replace(made, **change)


def test_an_open_end_says_so():
    closed = profiles_figure([a_profile()], {})
    texts = [t.get_text() for axes in closed.axes for t in axes.texts]
    assert texts == []
    beside = [a_profile(high_open="its bound"), a_profile()]
    opened = profiles_figure(beside, {"PCL.stiffness": 9e3})
    texts = [t.get_text() for axes in opened.axes for t in axes.texts]
    assert "open: bound" in texts
    assert texts.count("truth beyond") == 2
