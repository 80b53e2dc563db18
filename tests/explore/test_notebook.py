"""Sliders of a notebook move the knee, the point on the map, and nothing else."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.studies import Study

pytest.importorskip("anywidget", reason="anywidget is not installed: kneejax[notebook]")
PAIR = ("PCL.stiffness", "PCL.reference_strain")


@pytest.fixture(scope="module")
def shown(knee):
    measured = kj.passive_flexion(knee, [0.0, 20.0, 40.0, 80.0]).to_table()
    study = Study(title="in a notebook", knee=knee, measured=measured, weights="paper1",
                  parameters=["*.stiffness", "*.reference_strain"])  # fmt: skip
    return kj.explore(study, pair=PAIR, grid=(3, 3))


def test_a_slider_moves_curves_and_the_point_and_stays(shown):
    before = np.array(shown.curves.data[2].y)
    shown.sliders["PCL.stiffness"].value = 1500.0
    assert shown.values["PCL.stiffness"] == 1500.0
    assert np.abs(np.array(shown.curves.data[2].y) - before).max() > 1e-3
    assert shown.plane.data[-1].x[0] == 1500.0
    assert f"Objective {shown.hand.objective:.1f}" in shown.words.value
    shown.move({"ACL.stiffness": 3000.0})
    assert shown.sliders["ACL.stiffness"].value == 3000.0 == shown.values["ACL.stiffness"]
    assert shown.values["PCL.stiffness"] == 1500.0
    assert "earlier knee" in shown.words.value
    shown.map_here()
    assert "earlier knee" not in shown.words.value


def test_a_page_that_rounds_a_slider_moves_nothing(shown):
    slider, before = shown.sliders["MCL.stiffness"], shown.values
    slider.value += 0.4 * slider.step
    assert shown.values == before
    steps = (before["MCL.stiffness"] - slider.min) / slider.step
    assert abs(steps - round(steps)) < 1e-6, "a round number is rounded"


def test_a_map_without_a_pair_waits(shown):
    shown._choices[1].value = PAIR[0]
    shown.sliders["LCL.stiffness"].value += 200.0
    shown._choices[1].value = PAIR[1]
    assert shown.plane.layout.yaxis.title.text == "PCL strain"
