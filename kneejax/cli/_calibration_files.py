"""Files of a calibration: its numbers, the calibrated knee, and the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kneejax._whole_files import written_place
from kneejax.cli._deliver import write_answer
from kneejax.files import InputProblem, write_calibrated_knee, write_poses
from kneejax.geometry import PATELLA
from kneejax.inference import Calibration
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.report.look import Answer

#: Files of every calibration.
FILES = ("result.json", "parameters.csv", "poses.csv", "report.html", "knee.yaml")


def write_results(
    result: Calibration, out: Path, *, svg: bool, figures: bool = True
) -> tuple[Answer, str]:
    """Write what was found, the calibrated knee and the report.

    Args:
        result: of a study.
        out: folder.
        svg: whether figures are written as SVG too.
        figures: whether they are files at all; the report holds them.

    Returns:
        The answer, and why there is no calibrated knee, where the search ended at none.
    """
    from kneejax.report import calibration_answer, motion_words

    answer, motion = calibration_answer(result), result.fit.motion
    write_answer(
        answer, out, svg=svg, figures=figures, settings=result.settings, versions=result.versions,
        seconds=result.seconds,
    )  # fmt: skip
    words = [Status(s) for s in motion.status]
    write_poses(
        out / "poses.csv",
        motion.table,
        status=words,
        converged=[w.converged for w in words],
        stable=[w.sound for w in words],
        doubts=motion_words(motion),
        patella=motion.other_bones.get(PATELLA),
    )
    try:
        write_calibrated_knee(written_place(out / "result.json"), out / "knee.yaml")
    except InputProblem as problem:
        return answer, str(problem)
    return answer, ""
