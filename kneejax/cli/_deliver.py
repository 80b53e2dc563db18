"""An answer becomes files, a page and what is printed: the same for every command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kneejax._whole_files import written_place
from kneejax.cli._command import Drawn
from kneejax.files import InputProblem, write_calibrated_knee, write_poses, write_rows, write_text
from kneejax.geometry import PATELLA
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

if TYPE_CHECKING:
    from kneejax.inference import Calibration
    from kneejax.report.look import Answer

#: Files of every calibration.
FILES = ("result.json", "parameters.csv", "poses.csv", "report.html", "knee.yaml")


def deliver(
    answer: Answer,
    arguments: Drawn,
    written: Sequence[str] = (),
    seconds: dict[str, float] | None = None,
) -> int:
    """Write tables, figures, result.json and report.html; then print what was found.

    Args:
        answer: what a command found.
        arguments: of the command: where results go, and what the page says was asked for.
        written: names of files that the command has written itself.
        seconds: part of the work -> how long it took; `figures` is added.

    Returns:
        The exit status.

    Raises:
        InputProblem: a file cannot be written.
    """
    from kneejax.inference import versions

    settings = {"command": arguments.command, **arguments.options()}
    with stages_on_terminal("figures and report"):
        write_answer(
            answer, arguments.out, svg=arguments.svg, settings=settings, versions=versions(),
            seconds=seconds,
        )  # fmt: skip
    return say(answer, arguments.out, written)


def write_answer(answer: Answer, out: Path, **page: Any) -> None:
    """Write tables, figures, result.json and report.html.

    Args:
        answer: what a command found.
        out: folder.
        page: options of `kneejax.report.look.write_page`.

    Raises:
        InputProblem: a file cannot be written.
    """
    from kneejax.report.look import write_page

    for name, table in answer.tables.items():
        write_rows(out / f"{name}.csv", table.names, table.rows)
    write_page(answer, out, **page)
    if answer.document is not None:
        write_text(out / "result.json", answer.json())


def say(answer: Answer, out: Path, written: Sequence[str] = ()) -> int:
    """Print what was found and where it stands; the exit status comes back."""
    from kneejax.report.look import wrapped

    print(answer.terminal())
    files = ["report.html", *(f"{name}.csv" for name in answer.tables), *written]
    files += ["result.json"] * (answer.document is not None) + ["settings.json"]
    files += ["figures/"] * bool(answer.drawings)
    print("\n".join(wrapped(f"{out}/{', '.join(files)}", "written: ")))
    return answer.exit_status


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
