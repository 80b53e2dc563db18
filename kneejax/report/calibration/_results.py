"""A calibration as a JSON document and as rows of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.parameters import MEANING
from kneejax.report.calibration._estimates import reasons, remark
from kneejax.report.calibration._notes import calibration_notes
from kneejax.report.calibration._tests import laxity_errors
from kneejax.report.calibration._verdict import message, outcome, warnings
from kneejax.report.look import json_safe
from kneejax.report.motion import row_status
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Estimate, Fit

#: Columns of parameters.csv.
PARAMETER_COLUMNS = (
    "name",
    "value",
    "unit",
    "start",
    "lower",
    "upper",
    "standard_error",
    "at_bound",
    "low",
    "high",
    "interval",
    "remark",
)
_TOTALS = ("residual", "jacobian", "equilibria")


def _parameter(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": float(estimate.value),
        "start": float(estimate.start),
        "lower": float(estimate.lower),
        "upper": float(estimate.upper),
        "standard_error": float(estimate.standard_error),
        "at_bound": bool(estimate.at_bound),
        "low": float(estimate.low),
        "high": float(estimate.high),
        "interval": None if estimate.interval is None else estimate.interval.value,
    }


def _starts(fit: Fit) -> list[dict[str, Any]]:
    starts = fit.starts
    if starts is None:
        return []
    names = [e.name for e in (*fit.estimates, *fit.offsets)]
    return [
        {"objective": objective, "values": dict(zip(names, values, strict=True))}
        for objective, values in zip(starts.objectives, starts.values, strict=True)
    ]


def _statuses(fit: Fit) -> dict[str, int]:
    status = row_status(fit.motion)
    return {
        Status(value).word: int(np.sum(status == value)) for value in sorted(set(status.tolist()))
    }


def _fit_document(fit: Fit) -> dict[str, Any]:
    return {
        "procedure": fit.procedure,
        "success": bool(fit.success),
        "message": message(fit),
        "objective": fit.objective,
        "partial_objectives": fit.partial_objectives,
        "rmse": fit.rmse,
        "parameters": {
            e.name: _parameter(e) | {"unit": e.unit, "remark": reasons(e)} for e in fit.estimates
        },
        "evaluations": fit.evaluations,
        "iterations": len(fit.history),
        "starts": _starts(fit),
        "status": _statuses(fit),
    }


def result_document(calibration: Calibration) -> dict[str, Any]:
    """Gather what result.json of a calibration holds.

    Args:
        calibration: the answer to write.

    Returns:
        A JSON-safe dictionary; NaN and infinity are null.
    """
    fit = calibration.fit
    return json_safe(
        {
            "title": calibration.title,
            "knee": calibration.knee,
            "success": bool(fit.success),
            "outcome": outcome(calibration).value,
            "message": message(fit),
            "warnings": warnings(calibration),
            "procedure": fit.procedure,
            "parameters": {e.name: _parameter(e) for e in fit.estimates},
            "units": {e.name: e.unit for e in fit.estimates},
            "remarks": {e.name: reasons(e) for e in fit.estimates if reasons(e)},
            "objective_start": calibration.start_objective,
            "objective": fit.objective,
            "partial_objectives_start": calibration.start_partial_objectives,
            "partial_objectives": fit.partial_objectives,
            "rmse_start": calibration.start_rmse,
            "rmse": fit.rmse,
            "tests": [one._asdict() for one in laxity_errors(calibration)],
            "evaluations": {key: fit.evaluations.get(key, 0) for key in _TOTALS},
            "correlation": {
                "parameters": [e.name for e in fit.estimates],
                "matrix": fit.correlation,
            },
            "truth": calibration.truth,
            "frame_offset": {e.name: _parameter(e) | {"unit": e.unit} for e in fit.offsets},
            "noise": calibration.noise,
            "noise_estimated": calibration.noise_estimated,
            "per_procedure": {one.procedure: _fit_document(one) for one in calibration.fits},
            "notes": calibration_notes(calibration),
            "seconds": calibration.seconds,
            "versions": calibration.versions,
            "settings": calibration.settings,
            **MEANING,
        }
    )


def parameters_rows(calibration: Calibration) -> list[dict[str, Any]]:
    """List the identified parameters for parameters.csv.

    Args:
        calibration: the answer to write.

    Returns:
        One dictionary per parameter, then one per constant between frames
        (`frame_offset.COORDINATE`), with the keys `PARAMETER_COLUMNS` in that order.
    """
    fit = calibration.fit
    named = [(e.name, e) for e in fit.estimates]
    named += [(f"frame_offset.{e.name}", e) for e in fit.offsets]
    return [
        {"name": name, "value": float(e.value), "unit": e.unit}
        | {key: value for key, value in _parameter(e).items() if key != "value"}
        | {"remark": remark(e)}
        for name, e in named
    ]
