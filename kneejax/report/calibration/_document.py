"""A calibration as a JSON document."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.parameters import MEANING
from kneejax.report.calibration._estimates import parameter_document, reasons
from kneejax.report.calibration._tests import laxity_errors
from kneejax.report.calibration._verdict import calibration_notes, message, outcome, warnings
from kneejax.report.look import json_safe
from kneejax.report.motion import row_status
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Fit

#: Counts of a whole search; other counts are of its stages.
TOTALS = ("residual", "jacobian", "equilibria")


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
            "parameters": {e.name: parameter_document(e) for e in fit.estimates},
            "units": {e.name: e.unit for e in fit.estimates},
            "remarks": {e.name: reasons(e) for e in fit.estimates if reasons(e)},
            "objective_start": calibration.start_objective,
            "objective": fit.objective,
            "partial_objectives_start": calibration.start_partial_objectives,
            "partial_objectives": fit.partial_objectives,
            "rmse_start": calibration.start_rmse,
            "rmse": fit.rmse,
            "tests": [one._asdict() for one in laxity_errors(calibration)],
            "evaluations": {key: fit.evaluations.get(key, 0) for key in TOTALS},
            "correlation": {
                "parameters": [e.name for e in fit.estimates],
                "matrix": fit.correlation,
            },
            "truth": calibration.truth,
            "frame_offset": {e.name: parameter_document(e) | {"unit": e.unit} for e in fit.offsets},
            "noise": calibration.noise,
            "noise_estimated": calibration.noise_estimated,
            "per_procedure": {one.procedure: _of_procedure(one) for one in calibration.fits},
            "notes": calibration_notes(calibration),
            "seconds": calibration.seconds,
            "versions": calibration.versions,
            "settings": calibration.settings,
            **MEANING,
        }
    )


def _of_procedure(fit: Fit) -> dict[str, Any]:
    names = [e.name for e in (*fit.estimates, *fit.offsets)]
    ends = [] if fit.starts is None else zip(fit.starts.objectives, fit.starts.values, strict=True)
    status = row_status(fit.motion)
    return {
        "procedure": fit.procedure,
        "success": bool(fit.success),
        "message": message(fit),
        "objective": fit.objective,
        "partial_objectives": fit.partial_objectives,
        "rmse": fit.rmse,
        "parameters": {
            e.name: parameter_document(e) | {"unit": e.unit, "remark": reasons(e)}
            for e in fit.estimates
        },
        "evaluations": fit.evaluations,
        "iterations": len(fit.history),
        "starts": [
            {"objective": objective, "values": dict(zip(names, values, strict=True))}
            for objective, values in ends
        ],
        "status": {
            Status(value).word: int(np.sum(status == value))
            for value in sorted(set(status.tolist()))
        },
    }
