"""What a report says of a fit: badge, notes, limits, exit status."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from kneejax import report
from kneejax.inference import Fault, Misfit
from kneejax.inference.calibration._result import Ending
from kneejax.inference.intervals._estimate import IntervalKind
from kneejax.report.calibration_verdict import noise_words, outcome, verdict, warnings
from tests.report import made_up

MISFITS = (
    Misfit("superior", Fault.WORSE_THAN_START, 0.33, 0.26),
    Misfit("lateral", Fault.LARGE, 8.05, 3.0),
    Misfit("adduction", Fault.BEYOND_NOISE, 0.5, 0.1),
)


def _sound(fit):
    estimates = tuple(
        dataclasses.replace(
            e,
            standard_error=1.0,
            at_bound=False,
            slack=0.0,
            low=e.value - 2.0,
            high=e.value + 2.0,
            interval=IntervalKind.STANDARD_ERROR,
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


def printed(calibration):
    return report.calibration_answer(calibration).terminal()


def test_no_warnings_without_a_reason():
    calibration = made_up.calibration()
    calibration = dataclasses.replace(calibration, fits=(_sound(calibration.fits[1]),))
    assert warnings(calibration) == []
    assert "warning" not in printed(calibration)


def test_summary_says_which_procedure_decides_the_exit_status(tmp_path):
    doubtful = made_up.calibration()
    text = " ".join(printed(doubtful).split())
    answer = doubtful.fit.procedure
    assert f"Procedure {answer}, the first of the study, is the answer and alone" in text
    assert "exit status (1, in doubt)" in text

    fits = (_sound(doubtful.fit), *doubtful.fits[1:])
    sound = dataclasses.replace(doubtful, fits=fits, start=_sound(doubtful.fit).motion)
    assert warnings(sound)
    text = " ".join(printed(sound).split())
    assert "exit status (0, nothing to doubt)" in text
    page = report.write_report(sound, tmp_path)[0].read_text(encoding="utf-8")
    assert "about procedures I and III (comparison only)" in page
    assert 'class="badge good"' in page

    alone = dataclasses.replace(doubtful, fits=doubtful.fits[:1])
    assert "exit status" not in printed(alone)


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
    below = page[page.index("Procedures</h2>") :]
    assert name in below and why in below
    assert "the limit of iterations" in below
    summary = " ".join(printed(calibration).split())
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

    one, two = warnings(_judged(change))
    assert one.startswith("ACL.stiffness, PCL.stiffness are not determined by the data: ")
    assert two == (
        "MCL.stiffness is not determined by the data: its ligament is slack at every pose."
    )


@pytest.mark.long
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
    assert outcome(calibration) is expected
    assert report.result_document(calibration)["outcome"] == expected.value
    page = report.write_report(calibration, tmp_path)[0].read_text(encoding="utf-8")
    badge = re.search(r'<strong class="badge \w+">([^<]+)</strong>', page)
    assert badge and badge[1] == expected.value
    answer = report.calibration_answer(calibration)
    assert answer.badge == expected.value
    assert answer.exit_status == (expected is not report.Outcome.GOOD)


def test_a_poor_fit_says_in_which_coordinate_and_why():
    calibration = _judged(misfits=MISFITS)
    text = " ".join(printed(calibration).split())
    assert "POOR FIT" in text
    assert "Superior translation: RMSE 0.330 mm, 26.9 % higher than at the start (0.260 mm)" in text
    assert "Lateral translation: RMSE 8.05 mm, more than 3.00 mm. Check side, signs and fra" in text
    assert "Adduction: RMSE 0.500 deg, 5.0 times what the stated noise leaves (0.100 deg)" in text
    assert "Poor fit: RMSE" in verdict(calibration)


def _lines(calibration, first="parameter"):
    """Head and lines of the table of parameters, by their first word."""
    lines = printed(calibration).splitlines()
    (head,) = [line for line in lines if line.startswith(first)]
    rows = {line.split()[0]: line for line in reversed(lines) if line.strip()}
    return head, rows


def test_the_column_of_limits_holds_limits_and_nothing_else():
    calibration = made_up.calibration()
    head, rows = _lines(calibration)
    place, after = head.index("95 % limits"), head.index("truth")
    assert "std. error" in head  # what +- is
    for e in calibration.fit.estimates:
        cell = rows[e.name][place:after].strip()
        limits = re.match(r"(\S+ to \S+|above \S+|below \S+|-)(  +|$)", cell)
        assert limits, cell
        if e.interval is IntervalKind.STANDARD_ERROR:
            low, high = map(float, limits[1].split(" to "))
            assert (low, high) == pytest.approx((e.low, e.high), rel=1e-3)


def _first(**changes):
    return lambda fit: {
        "estimates": (dataclasses.replace(fit.estimates[0], **changes), *fit.estimates[1:])
    }


def test_what_the_prior_alone_determines_is_not_counted_as_limited_by_the_data():
    alone = _judged(_first(interval=IntervalKind.PRIOR))
    assert "prior alone" in _lines(alone)[1]["ACL.stiffness"]
    text = " ".join(printed(alone).split())
    assert "Of 9 estimates the data limit 8 by a standard error; 1 is known from the prior" in text
    assert report.result_document(alone)["remarks"]["ACL.stiffness"] == "known from the prior alone"
    assert any("prior alone: ACL.stiffness" in note for note in report.calibration_notes(alone))


def test_limits_that_could_not_be_computed_get_no_reason_that_is_none():
    failed = _first(
        interval=IntervalKind.NOT_COMPUTED, low=np.nan, high=np.nan, standard_error=np.nan,
        reason="no balance beyond",
    )  # fmt: skip
    failed = _judged(failed)
    assert "limits not computed" in _lines(failed)[1]["ACL.stiffness"]
    (said,) = warnings(failed)
    assert said.startswith("The 95 % limits of ACL.stiffness could not be computed: no balance b")
    text = printed(failed)
    assert "not determined" not in text and "make up" not in text


def test_limits_are_printed_where_the_standard_error_means_nothing():
    lines = printed(made_up.calibration()).splitlines()
    rows = {line.split()[0]: line for line in reversed(lines) if line.strip()}
    assert "+-" in rows["ACL.stiffness"]
    assert "not determined" in rows["MCL.stiffness"] and "+-" not in rows["MCL.stiffness"]
    assert "above 8800" in rows["LCL.stiffness"] and "at bound" in rows["LCL.stiffness"]
    assert "+-" not in rows["LCL.stiffness"]
    assert " to " in rows["PCL.reference_strain"] and "+-" not in rows["PCL.reference_strain"]
    assert re.search(r"offset lateral +-0\.30+ +\+- +0\.050+ +mm", "\n".join(lines))


def test_starts_that_end_apart_are_said(tmp_path):
    text = " ".join(printed(made_up.calibration()).split())
    assert "Several starts ended: 2 of 3 at the answer; 1 at worse fits (objective 410.0" in text

    def rival(fit):
        values = fit.starts.values.copy()
        values[1, 0] += 500.0
        rivals = np.array([False, True, False])
        return {"starts": dataclasses.replace(fit.starts, values=values, rivals=rivals)}

    (said,) = warnings(_judged(rival))
    assert said.startswith("1 of 3 starts ended apart from the answer and fit as well: ACL.stiff")


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


def test_noise_in_the_ratio_of_given_weights_is_called_that():
    own = made_up.calibration()
    given = dataclasses.replace(own, settings=own.settings | {"weights": {"lateral": 1.0}})
    assert "in the ratio of the study's weights, estimated from the misfit" in noise_words(given)
    plain = dataclasses.replace(own, settings=own.settings | {"weights": {"lateral": 0.0}})
    assert "deg, estimated from the misfit" in noise_words(plain)
