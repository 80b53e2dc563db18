"""An answer becomes files, a page and what is printed: the same for every command."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kneejax._whole_files import written_place
from kneejax.cli._command import Drawn
from kneejax.files import InputProblem, write_calibrated_knee, write_poses, write_rows, write_text
from kneejax.geometry import PATELLA
from kneejax.inference import Calibration, versions
from kneejax.report.look.page import Answer, write_page
from kneejax.report.look.tables import wrapped
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal


def deliver(answer: Answer, arguments: Drawn, written: Sequence[str] = (),
            seconds: dict[str, float] | None = None) -> int:  # fmt: skip
    """Write tables, figures, result.json and report.html; print what was found; the exit status.
    `written` are names of files that the command has written itself; `seconds` gets `figures`."""
    settings = {"command": arguments.command, **arguments.options()}
    with stages_on_terminal("figures and report"):
        write_answer(answer, arguments.out, svg=arguments.svg, settings=settings,
                     versions=versions(), seconds=seconds)  # fmt: skip
    return say(answer, arguments.out, written)


def write_answer(answer: Answer, out: Path, **page: Any) -> None:
    """Write tables, figures, result.json and report.html, with options of `write_page`."""
    for name, table in answer.tables.items():
        write_rows(out / f"{name}.csv", table.names, table.rows)
    write_page(answer, out, **page)
    if answer.document is not None:
        write_text(out / "result.json", answer.json())


def say(answer: Answer, out: Path, written: Sequence[str] = ()) -> int:
    """Print what was found and where it stands; the exit status comes back."""
    print(answer.terminal())
    files = ["report.html", *(f"{name}.csv" for name in answer.tables), *written]
    files += ["result.json"] * (answer.document is not None) + ["settings.json"]
    files += ["figures/"] * bool(answer.drawings)
    print("\n".join(wrapped(f"{out}/{', '.join(files)}", "written: ")))
    return answer.exit_status


def write_results(
    result: Calibration, out: Path, *, svg: bool, figures: bool = True
) -> tuple[Answer, str]:
    """Write what was found, the calibrated knee and the report, whose figures need be no files. The
    answer comes back, and why there is no calibrated knee, where the search ended at none."""
    from kneejax.report.calibration import calibration_answer
    from kneejax.report.pose_tables import motion_words

    answer, motion = calibration_answer(result), result.fit.motion
    write_answer(answer, out, svg=svg, figures=figures, settings=result.settings,
                 versions=result.versions, seconds=result.seconds)  # fmt: skip
    words = [Status(s) for s in motion.status]
    write_poses(out / "poses.csv", motion.table, status=words,
                converged=[w.converged for w in words], stable=[w.sound for w in words],
                doubts=motion_words(motion), patella=motion.other_bones.get(PATELLA))  # fmt: skip
    try:
        write_calibrated_knee(written_place(out / "result.json"), out / "knee.yaml")
    except InputProblem as problem:
        return answer, str(problem)
    return answer, ""
