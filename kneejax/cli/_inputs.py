"""Files and names that a command is given, looked at before anything heavy is imported."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pydantic.fields import FieldInfo

from kneejax.cli import _command
from kneejax.files import InputProblem
from kneejax.files.reading import together


def check_inputs(asked: _command.Command, folder: Path, gone: str = "") -> None:
    """Refuse files that are missing from a folder, and names of bundled data or parameters that are
    unknown; `gone` is the file of settings that names them, if they were recorded earlier."""
    if problems := [*_wrong_inputs(asked, folder, gone)]:
        raise together(problems)


def _wrong_inputs(asked: _command.Command, folder: Path, gone: str) -> Iterator[InputProblem]:
    found, knee = False, getattr(asked, "knee", None)
    for name, field in type(asked).model_fields.items():
        value = getattr(asked, name)
        for one in value if isinstance(value, list) else [value]:
            try:
                if one is not None:
                    _check_input(field, str(one), folder, gone)
            except InputProblem as problem:
                found = True
                yield problem
        if _command.marks(field, _command.Parameters) and value and knee and not found:
            from kneejax.studies import misspelt

            path = folder / knee
            for one in misspelt(os.fspath(path) if path.exists() else knee, value):
                option = _command.shown_name(field)
                yield InputProblem(option, "name", one.value, one.expected, one.nearest)


def _check_input(field: FieldInfo, value: str, folder: Path, gone: str) -> None:
    if _command.marks(field, _command.Angles):
        from kneejax.files import parse_flexion

        parse_flexion(value)
    bundled, files = _command.marks(field, _command.Bundled), _command.marks(field, _command.File)
    named = bundled and not (Path(value).suffix or len(Path(value).parts) > 1)
    if not (bundled or files) or any(c in value for c in "*?["):
        return
    if os.path.exists(folder / value):
        if bundled and bundled[0].kind == "studies" and os.path.isfile(folder / value):
            _check_study(os.fspath(folder / value), bundled[0].others)
        return
    if gone and not named:
        expected = f"a file that is still there; {folder / value} is gone"
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

    raise InputProblem(value, "file", "missing", files[0].kind, neighbour(folder / value))


def _check_study(value: str, others: bool) -> None:
    """Refuse a study for what its fields say, before JAX is imported."""
    from kneejax.cohorts import is_cohort
    from kneejax.studies import check_study_file

    if value.lower().endswith((".yaml", ".yml")) and not (others and is_cohort(value)):
        check_study_file(value)
