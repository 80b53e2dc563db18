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

sys.path.insert(0, str(Path(__file__).parents[1]))
import made_up

from kneejax import report
from kneejax.inference.calibration._quality import Fault, Misfit
from kneejax.inference.calibration._result import Ending
from kneejax.inference.intervals._intervals import IntervalKind
from kneejax.report.calibration import calibration_notes
from kneejax.report.look import SHOWN
from kneejax.statics._status import Status

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
    assert not re.search(r"<script|<link|@import|url\((?!#)", page)
    assert page.count("<svg") == 5
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))


def test_what_is_wider_than_the_screen_scrolls_in_its_own_box(paths):
    page = paths[0].read_text(encoding="utf-8")
    for wide in ("table", "svg"):
        assert page.count(f'<div class="wide"><{wide}') == page.count(f"<{wide}") > 0
    style = page[page.index("<style>") : page.index("</style>")]
    assert ".wide { overflow-x: auto;" in style
    # On a phone a figure keeps a width at which it can be read, and says that it scrolls.
    widths = re.findall(r"([^{}]*){[^{}]*min-width", style)
    assert [selector.strip() for selector in widths] == ["td:last-child:not(.n)", "figure svg"]
    assert 'content: "scroll sideways for more"' in style


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
    assert all(note in text for note in calibration_notes(calibration))
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
    rows = report.parameters_rows(made_up.calibration())
    assert len(rows) == 9 and rows[-1]["name"] == "frame_offset.lateral"
    assert rows[-1]["standard_error"] == 0.05 and rows[-1]["unit"] == "mm"
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
    calibration = dataclasses.replace(calibration, fits=(_sound(calibration.fits[1]),))
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
    from kneejax.report.look._numbers import number

    assert number(value) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [(200.0, 100.0, "50.0 % lower"), (100.0, 150.0, "50.0 % higher"), (1e6, 1.0, "more than 99.9"),
     (5.0, 0.0, "100 % lower"), (100.0, 100.01, "unchanged"), (0.0, 1.0, ""), (np.nan, 1.0, "")],
)  # fmt: skip
def test_a_change_is_said_in_its_direction(before, after, text):
    from kneejax.report.look._numbers import change

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
    said = report.verdict(dataclasses.replace(calibration, fits=(fit,)))
    assert f"{inside} of 7 lie within the 95 % limits" in said


def _sound(fit):
    estimates = tuple(
        dataclasses.replace(
            e, standard_error=1.0, at_bound=False, slack=0.0, low=e.value - 2.0,
            high=e.value + 2.0, interval=IntervalKind.STANDARD_ERROR,
        )
        for e in fit.estimates
    )
    motion = dataclasses.replace(
        fit.motion,
        status=np.zeros(len(fit.motion.status), int),
        table=np.nan_to_num(fit.motion.table, nan=1.0),
    )
    return dataclasses.replace(
        fit, estimates=estimates, motion=motion, success=True, ending=Ending.CONVERGED
    )


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
    assert "about procedures I and III (comparison only)" in page
    assert 'class="badge good"' in page

    alone = dataclasses.replace(doubtful, fits=doubtful.fits[:1])
    assert "exit status" not in report.calibration_summary(alone)


@pytest.mark.parametrize(
    ("method", "name", "why"),
    [
        ("lbfgsb", "L-BFGS-B", "projected gradient"),
        ("least_squares", "Levenberg", "further steps no longer improve the fit"),
    ],
)
def test_page_and_summary_say_which_optimiser_ran_and_why_it_stopped(tmp_path, method, name, why):
    calibration = made_up.calibration()
    fits = (
        calibration.fit,
        dataclasses.replace(
            calibration.fits[1], reason="the limit of iterations", ending=Ending.STOPPED
        ),
    )
    calibration = dataclasses.replace(calibration, fits=fits, settings={"method": method})
    page = report.write_report(calibration, tmp_path)[0].read_text(encoding="utf-8")
    head = page[: page.index("</header>")]
    assert name in head and why in head
    assert "the limit of iterations" in page[page.index("Procedures</h2>") :]
    summary = " ".join(report.calibration_summary(calibration).split())
    assert name in summary and why in summary


def _judged(change=None, **changes):
    """A sound calibration, its answer or itself changed."""
    calibration = made_up.calibration()
    fit = _sound(calibration.fit)
    fit = dataclasses.replace(fit, **(change(fit) if change else {}))
    return dataclasses.replace(calibration, fits=(fit,), start=fit.motion, **changes)


def _lost(e, slack=0.0):
    nothing = {"standard_error": np.nan, "low": np.nan, "high": np.nan, "slack": slack}
    return dataclasses.replace(e, interval=IntervalKind.NOT_DETERMINED, **nothing)


def test_parameters_that_are_not_determined_are_named_by_their_reason():
    def change(fit):
        one, two, three, *rest = fit.estimates
        slack = _lost(three, 1.0)
        return {"estimates": (_lost(one), _lost(two), slack, *rest)}

    one, two = report.warnings(_judged(change))
    assert one.startswith("ACL.stiffness, PCL.stiffness are not determined by the data: ")
    assert two == (
        "MCL.stiffness is not determined by the data: its ligament is slack at every pose."
    )


@pytest.mark.parametrize(
    ("change", "changes", "expected"),
    [
        (None, {}, report.Outcome.GOOD),
        (lambda f: {"estimates": (_lost(f.estimates[0]), *f.estimates[1:])}, {},
         report.Outcome.DOUBTFUL),
        (None, {"misfits": MISFITS[:1]}, report.Outcome.POOR),
        (lambda _: {"success": False}, {"misfits": MISFITS}, report.Outcome.FAILED),
    ],
)  # fmt: skip
def test_badge_terminal_document_and_exit_status_agree(tmp_path, change, changes, expected):
    calibration = _judged(change, **changes)
    assert report.outcome(calibration) is expected
    assert report.outcome(calibration).exit_status == (expected is not report.Outcome.GOOD)
    assert report.result_document(calibration)["outcome"] == expected.value
    page = report.write_report(calibration, tmp_path)[0].read_text(encoding="utf-8")
    badge = re.search(r'<strong class="badge \w+">([^<]+)</strong>', page)
    assert badge and badge[1] == expected.value
    first = report.calibration_summary(calibration).splitlines()[1]
    assert f" {expected.value.lower()}:" in first.lower()


def test_a_poor_fit_says_in_which_coordinate_and_why():
    calibration = _judged(misfits=MISFITS)
    text = " ".join(report.calibration_summary(calibration).split())
    assert "POOR FIT" in text
    assert "Superior translation: RMSE 0.330 mm, 26.9 % higher than at the start (0.260 mm)" in text
    assert "Lateral translation: RMSE 8.05 mm, more than 3.00 mm. Check side, signs and fra" in text
    assert "Adduction: RMSE 0.500 deg, 5.0 times the stated noise (0.100 deg)" in text
    assert "Poor fit: RMSE" in report.verdict(calibration)


def test_limits_are_printed_where_the_standard_error_means_nothing():
    lines = report.calibration_summary(made_up.calibration()).splitlines()
    rows = {line.split()[0]: line for line in reversed(lines) if line.strip()}
    assert "+-" in rows["ACL.stiffness"]
    assert "not determined" in rows["MCL.stiffness"] and "+-" not in rows["MCL.stiffness"]
    assert "above 8800, at bound" in rows["LCL.stiffness"] and "+-" not in rows["LCL.stiffness"]
    assert " to " in rows["PCL.reference_strain"] and "+-" not in rows["PCL.reference_strain"]
    assert re.search(r"offset lateral +-0\.30+ +\+- +0\.050+ +mm", "\n".join(lines))


def test_starts_that_end_apart_are_said(tmp_path):
    text = " ".join(report.calibration_summary(made_up.calibration()).split())
    assert "Several starts ended: 2 of 3 at the answer; 1 at worse fits (objective 410.0" in text

    def rival(fit):
        values = fit.starts.values.copy()
        values[1, 0] += 500.0
        rivals = np.array([False, True, False])
        return {"starts": dataclasses.replace(fit.starts, values=values, rivals=rivals)}

    (said,) = report.warnings(_judged(rival))
    assert said.startswith("1 of 3 starts ended apart from the answer and fit as well: ACL.stiff")


def test_an_answer_outside_its_limits_is_said():
    def change(fit):
        first, *rest = fit.estimates
        return {
            "estimates": (
                dataclasses.replace(
                    first, value=2842.0, low=3000.0, high=9443.0, likeliest=4956.0,
                    interval=IntervalKind.PROFILE,
                ),
                *rest,
            )
        }  # fmt: skip

    (said,) = report.warnings(_judged(change))
    assert "ACL.stiffness, 2842, lies outside its limits (3000 to 9443)" in said
    assert "4956" in said


def test_fitted_motion_is_drawn_where_its_errors_are():
    calibration = made_up.calibration()
    fit = _sound(calibration.fit)
    table = calibration.measured.copy()
    table[:, 5] -= 4.0
    motion = dataclasses.replace(fit.motion, table=table)
    fit = dataclasses.replace(fit, motion=motion, offsets=(made_up.offset("lateral", 4.0),))
    calibration = dataclasses.replace(calibration, fits=(fit,))
    lines = report.motion_figure(calibration).axes[0].lines
    measured, fitted = (np.asarray(lines[i].get_ydata()) for i in (0, 2))
    np.testing.assert_allclose(fitted, measured)
