"""Files and names that a command is given, looked at before anything heavy is imported."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic.fields import FieldInfo

from kneejax.cli._command import (
    Angles,
    Bundled,
    Command,
    File,
    Parameters,
    marks,
    shown_name,
)
from kneejax.files import InputProblem
from kneejax.files.reading import Mistakes


def check_inputs(asked: Command, folder: Path, gone: str = "") -> None:
    """Refuse files that are missing from a folder, and names of bundled data or parameters that are
    unknown; `gone` is the file of settings that names them, if they were recorded earlier."""
    mistakes, knee = Mistakes(), getattr(asked, "knee", None)
    for name, field in type(asked).model_fields.items():
        value = getattr(asked, name)
        for one in value if isinstance(value, list) else [value]:
            with mistakes.gathered():
                if one is not None:
                    _check_input(field, str(one), folder, gone)
        if marks(field, Parameters) and value and knee and not mistakes:
            from kneejax.studies import misspelt

            path = folder / knee
            for one in misspelt(os.fspath(path) if path.exists() else knee, value):
                place = (shown_name(field), "name")
                mistakes.append(InputProblem(*place, one.value, one.expected, one.nearest))
    mistakes.check()


def _check_input(field: FieldInfo, value: str, folder: Path, gone: str) -> None:
    if marks(field, Angles):
        from kneejax.files import parse_flexion

        parse_flexion(value)
    bundled, files, path = marks(field, Bundled), marks(field, File), folder / value
    if not (bundled or files) or any(c in value for c in "*?["):
        return
    if os.path.exists(path):
        is_study = bundled and bundled[0].kind == "studies" and os.path.isfile(path)
        if is_study and value.lower().endswith((".yaml", ".yml")):
            from kneejax.cohorts import is_cohort
            from kneejax.studies import check_study_file

            # What its fields say is known before JAX is imported.
            if not (bundled[0].others and is_cohort(path)):
                check_study_file(path)
        return
    named = bundled and not (Path(value).suffix or len(Path(value).parts) > 1)
    if gone and not named:
        expected = f"a file that is still there; {path} is gone"
        raise InputProblem(gone, field.alias or "", value, expected)
    if bundled:
        from kneejax.files import named_path

        try:
            named_path(bundled[0].kind, value)
        except InputProblem as problem:
            if not gone:
                raise
            expected, near = problem.expected, problem.nearest
            raise InputProblem(gone, field.alias or "", value, expected, near) from None
        return
    from kneejax.files.reading import neighbour

    raise InputProblem(value, "file", "missing", files[0].kind, neighbour(path))
