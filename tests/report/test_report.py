"""The report shows everything, opens offline and bears bad numbers and odd names."""

from __future__ import annotations

import dataclasses
import html
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import made_up

from kneejax import report
from kneejax.statics._status import Status

ODD = 'A<b>&"C"$x$'


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
            dataclasses.replace(e, value=np.nan, standard_error=np.nan) for e in fit.estimates
        ),
        history=(),
        starts=(),
        success=False,
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
    assert len(paths) == 13
    assert all(path.stat().st_size > 1000 for path in paths)
    assert sorted(p for p in folder.rglob("*") if p.is_file()) == sorted(paths)
    page = paths[0].read_text(encoding="utf-8")
    assert not re.search(r"""(?:src|href)\s*=\s*["']?\s*(?:https?:)?//""", page)
    assert not re.search(r"<script|<link|@import|url\((?!#)", page)
    assert page.count("<svg") == 6
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))


def test_page_names_every_parameter_and_warning(paths):
    calibration, page = made_up.calibration(), paths[0].read_text(encoding="utf-8")
    text = html.unescape(page)
    for estimate in calibration.fit.estimates:
        assert f"<td>{estimate.name}</td>" in page
    for sentence in report.warnings(calibration):
        assert sentence in text
    assert made_up.REASON in text
    assert Status.NOT_CONVERGED.sentence in text
    assert Status.UNSTABLE.sentence in text
    assert calibration.notes[0] in text
    for count in (167, 159, 233, 98, 69, 65, 94):
        assert f">{count}</td>" in page


def test_report_is_the_same_every_time(paths, tmp_path):
    again = report.write_report(made_up.calibration(), tmp_path)
    assert [p.read_bytes() for p in paths] == [p.read_bytes() for p in again]


@pytest.mark.parametrize(
    "change",
    [
        _all_failed,
        _renamed,
        lambda c: made_up.calibration(synthetic=False, frame_offset=(), notes=()),
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
    assert all(len(line) < 100 for line in report.calibration_summary(calibration).splitlines())


def test_names_are_escaped(tmp_path):
    page = report.write_report(_renamed(made_up.calibration()), tmp_path)[0]
    page = page.read_text(encoding="utf-8")
    assert "<b>" not in page
    assert html.escape(f"{ODD}.stiffness") in page


def test_a_row_of_nan_is_never_called_balanced():
    calibration = _all_failed(made_up.calibration())
    assert any("25 of 25 poses not converged" in s for s in report.warnings(calibration))


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
        assert set(entry) == expected, name
    assert document["parameters"][made_up.UNDETERMINED]["standard_error"] is None
    assert document["parameters"][made_up.AT_BOUND]["at_bound"] is True
    assert set(document["per_procedure"]) == {"I", "II", "III"}
    assert document["correlation"]["matrix"][2] == [None] * 8


def test_parameter_rows_have_the_columns():
    rows = report.parameters_rows(made_up.calibration())
    assert len(rows) == 8
    assert all(tuple(row) == report.PARAMETER_COLUMNS for row in rows)


def test_summary_is_plain_and_complete():
    calibration = made_up.calibration()
    text = report.calibration_summary(calibration)
    assert text.isascii()
    for estimate in calibration.fit.estimates:
        assert estimate.name in text
    flat = " ".join(text.split())
    for sentence in report.warnings(calibration):
        assert " ".join(sentence.split()) in flat
    assert "published calls" in text
    assert "published" not in report.calibration_summary(made_up.calibration(synthetic=False))


def test_no_warnings_without_a_reason():
    calibration = made_up.calibration()
    fit = calibration.fits[1]
    sound = tuple(
        dataclasses.replace(e, standard_error=1.0, at_bound=False) for e in fit.estimates
    )
    fit = dataclasses.replace(fit, estimates=sound)
    calibration = dataclasses.replace(calibration, fits=(fit,))
    assert report.warnings(calibration) == []
    assert "warning" not in report.calibration_summary(calibration)


def test_simulation_is_drawn_even_at_constant_flexion(tmp_path):
    motion = made_up.calibration().fit.motion
    figure = report.simulation_figure(
        np.full(25, 30.0),
        motion.table,
        motion.status,
        made_up.LIGAMENTS,
        motion.ligament_forces,
        made_up.CONTACTS,
        motion.contact_forces,
    )
    paths = report.save_figure(figure, tmp_path, "simulation")
    assert [path.name for path in paths] == ["simulation.png", "simulation.svg"]
    assert "Step" in paths[1].read_text(encoding="utf-8")


def test_coordinates_are_those_of_every_table():
    from kneejax.geometry import COLUMNS

    assert tuple(one.column for one in report.COORDINATES.values()) == COLUMNS


@pytest.mark.parametrize(
    ("value", "text"),
    [(5876.0, "5876"), (0.03712, "0.03712"), (np.nan, "-"), (0.0, "0"), (1e-9, "1.000e-09"),
     (-np.inf, "-inf"), (123456.0, "123456")],
)  # fmt: skip
def test_numbers_read_well(value, text):
    from kneejax.report._numbers import number

    assert number(value) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [(200.0, 100.0, "50.0 % lower"), (100.0, 150.0, "50.0 % higher"), (1e6, 1.0, "more than 99.9"),
     (5.0, 0.0, "100 % lower"), (100.0, 100.01, "unchanged"), (0.0, 1.0, ""), (np.nan, 1.0, "")],
)  # fmt: skip
def test_a_change_is_said_in_its_direction(before, after, text):
    from kneejax.report._numbers import change

    assert change(before, after).startswith(text) and bool(change(before, after)) == bool(text)


@pytest.mark.parametrize(("away", "inside"), [(1.9, 7), (2.0, 0)])
def test_verdict_counts_the_truths_within_95_per_cent_of_the_determined_parameters(away, inside):
    calibration = made_up.calibration()
    estimates = tuple(
        dataclasses.replace(e, value=calibration.truth[e.name] - away * e.standard_error)
        for e in calibration.fit.estimates
    )
    fit = dataclasses.replace(calibration.fit, estimates=estimates)
    said = report.verdict(dataclasses.replace(calibration, fits=(fit,)))
    assert f"{inside} of 7 determined parameters" in said


def _sound(fit):
    estimates = tuple(
        dataclasses.replace(e, standard_error=1.0, at_bound=False, remark="")
        for e in fit.estimates
    )
    motion = dataclasses.replace(
        fit.motion,
        status=np.zeros(len(fit.motion.status), int),
        table=np.nan_to_num(fit.motion.table, nan=1.0),
    )
    return dataclasses.replace(fit, estimates=estimates, motion=motion, success=True)


def test_summary_says_which_procedure_decides_the_exit_status(tmp_path):
    doubtful = made_up.calibration()
    text = " ".join(report.calibration_summary(doubtful).split())
    answer = doubtful.fit.procedure
    assert f"Procedure {answer}, the first of the study, is the answer and alone" in text
    assert "exit status (1, in doubt)" in text

    fits = (_sound(doubtful.fit), *doubtful.fits[1:])
    sound = dataclasses.replace(doubtful, fits=fits, start=_sound(doubtful.fit).motion)
    assert report.warnings(sound)
    text = " ".join(report.calibration_summary(sound).split())
    assert "exit status (0, nothing to doubt)" in text
    page = report.write_report(sound, tmp_path)[0].read_text(encoding="utf-8")
    assert "only procedures that are there to compare" in page
    assert 'class="badge good"' in page

    alone = dataclasses.replace(doubtful, fits=doubtful.fits[:1])
    assert "exit status" not in report.calibration_summary(alone)


@pytest.mark.parametrize(
    ("method", "name", "why"),
    [("lbfgsb", "L-BFGS-B", "projected gradient"), ("least_squares", "Levenberg", "negligible")],
)
def test_page_and_summary_say_which_optimiser_ran_and_why_it_stopped(tmp_path, method, name, why):
    calibration = made_up.calibration()
    fits = (
        dataclasses.replace(calibration.fit, message="converged"),
        dataclasses.replace(calibration.fits[1], message="the limit of iterations"),
    )
    calibration = dataclasses.replace(calibration, fits=fits, settings={"method": method})
    page = report.write_report(calibration, tmp_path)[0].read_text(encoding="utf-8")
    head = page[: page.index("</header>")]
    assert name in head and why in head
    assert "the limit of iterations" in page[page.index("Procedures</h2>") :]
    summary = " ".join(report.calibration_summary(calibration).split())
    assert name in summary and why in summary


def test_a_remark_of_the_search_makes_a_parameter_undetermined():
    calibration = made_up.calibration()
    fit = _sound(calibration.fit)
    wide = "not determined by these data"
    estimates = (
        dataclasses.replace(fit.estimates[0], standard_error=1e7, remark=wide),
        dataclasses.replace(fit.estimates[1], standard_error=1e7, remark=wide),
        dataclasses.replace(fit.estimates[2], remark=f"{wide}: its ligament is slack"),
        *fit.estimates[3:],
    )
    fit = dataclasses.replace(fit, estimates=estimates)
    calibration = dataclasses.replace(calibration, fits=(fit,), start=fit.motion)
    one, two = report.warnings(calibration)
    assert one.startswith("ACL.stiffness, PCL.stiffness are not determined by the data: ")
    assert two == "MCL.stiffness is not determined by the data: its ligament is slack."


def test_fitted_motion_is_drawn_where_its_errors_are():
    calibration = made_up.calibration()
    fit = _sound(calibration.fit)
    table = calibration.measured.copy()
    table[:, 5] -= 4.0
    fit = dataclasses.replace(fit, motion=dataclasses.replace(fit.motion, table=table))
    calibration = dataclasses.replace(
        calibration, fits=(fit,), frame_offset=(("lateral", 4.0, 0.1),)
    )
    lines = report.motion_figure(calibration).axes[0].lines
    measured, fitted = (np.asarray(lines[i].get_ydata()) for i in (0, 2))
    np.testing.assert_allclose(fitted, measured)
