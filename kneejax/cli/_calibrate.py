"""Calibrate a study, and write what was found."""

from __future__ import annotations

import dataclasses
import importlib
import threading
import time

from kneejax import studies
from kneejax.cli._command import is_given
from kneejax.cli._deliver import FILES, say, write_results
from kneejax.cli.options import Calibrate
from kneejax.cohorts import is_cohort
from kneejax.files import InputProblem, check_new
from kneejax.numerics import adding_up
from kneejax.studies import stages_on_terminal


def run(arguments: Calibrate) -> int:
    """Calibrate, print the answer, write results, the calibrated knee and the report."""
    if is_cohort(arguments.study):
        from kneejax.cli import _cohort

        return _cohort.run(arguments)
    begun = time.perf_counter()
    for name in ("bootstrap", "blocks", "jobs", "scheduler", "shard"):
        value = getattr(arguments, name)
        if is_given(value):
            expected = (
                "this option with a cohort alone (a folder, a pattern in quotes or a cohort file), "
                f"not {arguments.study}"
            )
            given = "/".join(map(str, value)) if isinstance(value, tuple) else str(value)
            raise InputProblem("calibrate", f"--{name}", given, expected)
    study = studies.read_study(arguments.study)
    for new in ("knee.yaml", "result.json"):
        check_new(arguments.out / new, study.knee_name)
    arguments.results.check_free(*FILES)
    reading = time.perf_counter() - begun
    # XLA compiles without holding Python: what comes last is imported beside the search.
    threading.Thread(target=importlib.import_module, args=("kneejax.report.calibration",)).start()
    with stages_on_terminal("calibration") as progress:
        result = studies.calibrate(study, progress=progress)
    seconds = {"imports": arguments.results.imports_s, "reading": reading, **result.seconds}
    result = dataclasses.replace(result, seconds=adding_up(seconds))
    with stages_on_terminal("figures and report"):
        answer, missing = write_results(result, arguments.out, svg=arguments.svg)
    status = say(answer, arguments.out, ["poses.csv", *["knee.yaml"] * (not missing)])
    if missing:
        print(f"not written: {arguments.out}/knee.yaml: {missing}")
    return max(status, int(bool(missing)))
