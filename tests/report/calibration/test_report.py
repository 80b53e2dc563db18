"""The report shows everything, opens offline and bears bad numbers and odd names."""

from __future__ import annotations

import dataclasses
import html
import json
import re

import numpy as np
import pytest

from kneejax import report
from kneejax.inference import Fault, Misfit
from kneejax.inference.calibration._result import Ending
from kneejax.inference.intervals._estimate import IntervalKind
from kneejax.report.calibration_parameters import PARAMETER_COLUMNS, parameters_table
from kneejax.report.calibration_verdict import calibration_notes, verdict, warnings
from kneejax.report.flexion import simulation_figure
from kneejax.report.look import SHOWN
from kneejax.statics._status import Status
from tests.report import made_up

ODD = 'A<b>&"C"$x$'
MISFITS = (
    Misfit("superior", Fault.WORSE_THAN_START, 0.33, 0.26),
    Misfit("lateral", Fault.LARGE, 8.05, 3.0),
    Misfit("adduction", Fault.BEYOND_NOISE, 0.5, 0.1),
)


def _renamed(calibration, old="ACL", new=ODD):
    fits = tuple(
        dataclasses.replace(
            fit,
            estimates=tuple(
                dataclasses.replace(e, name=e.name.replace(old, new)) for e in fit.estimates
            ),
        )
        for fit in calibration.fits
    )
    names = tuple(new if name == old else name for name in calibration.ligaments)
    return dataclasses.replace(calibration, fits=fits, ligaments=names, title=f"Knee {ODD}")


def _all_failed(calibration):
    fit = calibration.fit
    lost = np.full_like(fit.motion.table, np.nan)
    motion = dataclasses.replace(
        fit.motion,
        table=lost,
        ligament_forces=np.full_like(fit.motion.ligament_forces, np.nan),
        contact_forces=np.full_like(fit.motion.contact_forces, np.nan),
    )
    nothing = dict.fromkeys(fit.rmse, np.nan)
    fit = dataclasses.replace(
        fit,
        motion=motion,
        rmse=nothing,
        partial_objectives=nothing,
        objective=np.nan,
        correlation=np.full((8, 8), np.nan),
        estimates=tuple(
            dataclasses.replace(
                e, value=np.nan, standard_error=np.nan, low=np.nan, high=np.nan,
                interval=IntervalKind.NOT_DETERMINED,
            )
            for e in fit.estimates
        ),
        history=(),
        starts=None,
        success=False,
        ending=Ending.STOPPED,
    )
    return dataclasses.replace(calibration, fits=(fit,))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report") / "new"


@pytest.fixture(scope="module")
def paths(folder):
    """Files of the made-up calibration."""
    return report.write_report(made_up.calibration(), folder)


def test_files_are_complete_and_the_page_needs_nothing_else(folder, paths):
    assert paths[0] == folder / "report.html"
    assert len(paths) == 6
    assert all(path.stat().st_size > 1000 for path in paths)
    assert sorted(p for p in folder.rglob("*") if p.is_file()) == sorted(paths)
    page = paths[0].read_text(encoding="utf-8")
    assert not re.search(r"""(?:src|href)\s*=\s*["']?\s*(?:https?:)?//""", page)
    assert not re.search(r"<script\s|<link|@import|url\((?!#)", page)
    assert page.count("<svg") == 5
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))


def test_what_is_wider_than_the_screen_scrolls_in_its_own_box(paths):
    page = paths[0].read_text(encoding="utf-8")
    for wide, inside in (("table", ""), ("svg", '<div class="paper"[^>]*>')):
        boxed = re.findall(f'<div class="wide"[^>]*>{inside}<{wide}', page)
        assert len(boxed) == page.count(f"<{wide}") > 0
    style = page[page.index("<style>") : page.index("</style>")]
    assert ".wide { overflow-x: auto;" in style
    # On a phone a figure keeps a width at which it can be read.
    widths = re.findall(r"([^{}]*){[^{}]*min-width", style)
    assert [selector.strip() for selector in widths] == ["td:last-child:not(.n)", ".picture .paper"]


def test_page_names_every_parameter_and_warning(paths):
    calibration, page = made_up.calibration(), paths[0].read_text(encoding="utf-8")
    text = html.unescape(page)
    for estimate in calibration.fit.estimates:
        assert f"<td>{estimate.name}</td>" in page
    for sentence in warnings(calibration):
        assert sentence in text
    assert made_up.REASON in text
    assert Status.NOT_CONVERGED.sentence in text
    assert Status.UNSTABLE.sentence in text
    assert all(note in text for note in calibration_notes(calibration))


def test_the_first_screen_is_the_answer(paths):
    page = html.unescape(paths[0].read_text(encoding="utf-8"))
    first, below = page.split("<details>", 1)
    assert "Which 8 values (stiffness, reference strain) make knee knee-04 follow 25 pos" in first
    assert first.count("<table") == first.count("<svg") == 1
    for estimate in made_up.calibration().fit.estimates:
        assert f"<td>{estimate.name}</td>" in first
    # What is doubtful of the answer stands there, what is of a comparison below.
    doubts = first[first.index("What to doubt") :]
    assert "Procedures II, I, III: " in doubts and "Procedure III: " not in doubts
    assert "Procedure III: search not converged" in below


def test_report_is_the_same_every_time(paths, tmp_path):
    again = report.write_report(made_up.calibration(), tmp_path)
    assert [p.read_bytes() for p in paths] == [p.read_bytes() for p in again]


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [
        _all_failed,
        _renamed,
        lambda c: made_up.calibration(synthetic=False, misfits=MISFITS),
        lambda c: made_up.calibration(poses=60),
        lambda c: dataclasses.replace(c, measured=c.measured[::-1][np.argsort(np.arange(25) % 3)]),
        lambda c: dataclasses.replace(c, fits=c.fits[1:2]),
    ],
    ids=["all failed", "odd names", "measured", "dense", "unordered", "one fit"],
)
def test_unusual_calibrations_are_reported(tmp_path, change):
    calibration = change(made_up.calibration())
    page = report.write_report(calibration, tmp_path)[0].read_text(encoding="utf-8")
    assert ">nan<" not in page.lower()
    json.dumps(report.result_document(calibration), allow_nan=False)
    lines = report.calibration_answer(calibration).terminal().splitlines()
    assert all(len(line) < 100 for line in lines)


def test_names_are_escaped(tmp_path):
    page = report.write_report(_renamed(made_up.calibration()), tmp_path)[0]
    page = page.read_text(encoding="utf-8")
    assert "<b>" not in page
    assert f"{ODD}.stiffness" in html.unescape(page)


def test_a_row_of_nan_is_never_called_balanced():
    calibration = _all_failed(made_up.calibration())
    assert any("25 of 25 poses not converged" in s for s in warnings(calibration))


def test_result_document_keeps_its_promises():
    calibration = made_up.calibration()
    document = report.result_document(calibration)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    promised = {
        "parameters", "objective_start", "objective", "partial_objectives", "rmse", "success",
        "message", "procedure", "evaluations", "seconds", "versions",
    }  # fmt: skip
    assert promised <= set(document)
    assert set(document["evaluations"]) == {"residual", "jacobian", "equilibria"}
    for name, entry in document["parameters"].items():
        expected = {"value", "start", "lower", "upper", "standard_error", "at_bound"}
        assert set(entry) == expected | {"low", "high", "interval"}, name
        means = entry["interval"] == "standard error"
        assert (entry["standard_error"] is not None) == means, name
    lost = document["parameters"][made_up.UNDETERMINED]
    assert lost["interval"] == "not determined" and lost["low"] is None
    one_sided = document["parameters"][made_up.AT_BOUND]
    assert one_sided["interval"] == "one-sided" and one_sided["high"] is None
    assert document["parameters"]["PCL.reference_strain"]["interval"] == "profile"
    assert document["frame_offset"]["lateral"]["value"] == -0.3
    assert document["outcome"] == "Converged, with warnings"
    assert document["parameters"][made_up.AT_BOUND]["at_bound"] is True
    assert set(document["per_procedure"]) == {"I", "II", "III"}
    assert document["correlation"]["matrix"][2] == [None] * 8


def test_parameter_rows_have_the_columns():
    rows = parameters_table(made_up.calibration()).records()
    assert len(rows) == 9 and rows[-1]["name"] == "frame_offset.lateral"
    assert rows[-1]["standard_error"] == 0.05 and rows[-1]["unit"] == "mm"
    assert all(tuple(row) == PARAMETER_COLUMNS for row in rows)


def test_summary_is_plain_and_complete():
    calibration = made_up.calibration()
    text = report.calibration_answer(calibration).terminal()
    assert text.isascii()
    for estimate in calibration.fit.estimates:
        assert estimate.name in text
    flat = " ".join(text.split())
    for sentence in warnings(calibration):
        assert " ".join(sentence.split()) in flat


def test_simulation_is_drawn_even_at_constant_flexion(tmp_path):
    motion = made_up.calibration().fit.motion
    figure = simulation_figure(
        np.full(25, 30.0),
        motion.table,
        motion.status,
        dict(zip(made_up.LIGAMENTS, motion.ligament_forces.T, strict=True)),
        dict(zip(made_up.CONTACTS, motion.contact_forces.T, strict=True)),
    )
    (alone,) = report.save_figure(figure, tmp_path, "simulation")
    assert alone.name == "simulation.png"
    paths = report.save_figure(figure, tmp_path, "simulation", svg=True)
    assert [path.name for path in paths] == ["simulation.png", "simulation.svg"]
    assert "Step" in paths[1].read_text(encoding="utf-8")


def test_figures_show_every_free_coordinate_of_the_tables():
    from kneejax.geometry import FREE_COORDINATES

    assert sorted(SHOWN) == sorted(FREE_COORDINATES)


@pytest.mark.parametrize(
    ("value", "text"),
    [(5876.0, "5876"), (0.03712, "0.03712"), (np.nan, "-"), (0.0, "0"), (1e-9, "1.000e-09"),
     (-np.inf, "-inf"), (123456.0, "123456")],
)  # fmt: skip
def test_numbers_read_well(value, text):
    from kneejax.report.look.tables import number

    assert number(value) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [(200.0, 100.0, "50.0 % lower"), (100.0, 150.0, "50.0 % higher"), (1e6, 1.0, "more than 99.9"),
     (5.0, 0.0, "100 % lower"), (100.0, 100.01, "unchanged"), (0.0, 1.0, ""), (np.nan, 1.0, "")],
)  # fmt: skip
def test_a_change_is_said_in_its_direction(before, after, text):
    from kneejax.report.look.tables import change

    assert change(before, after).startswith(text) and bool(change(before, after)) == bool(text)


@pytest.mark.parametrize(("away", "inside"), [(0.9, 7), (1.1, 0)])
def test_verdict_counts_the_truths_within_the_limits_of_the_determined_parameters(away, inside):
    calibration = made_up.calibration()

    def around(e):
        if e.interval is IntervalKind.NOT_DETERMINED:
            return e
        value = calibration.truth[e.name] - away
        return dataclasses.replace(e, value=value, low=value - 1.0, high=value + 1.0)

    estimates = tuple(map(around, calibration.fit.estimates))
    fit = dataclasses.replace(calibration.fit, estimates=estimates)
    said = verdict(dataclasses.replace(calibration, fits=(fit,)))
    assert f"{inside} of 7 lie within the 95 % limits" in said
