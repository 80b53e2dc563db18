"""What a command is given: files and names, looked at before anything heavy is imported; and
settings.json, in which it stands beside what was written, to run it again."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from kneejax.cli import _command
from kneejax.cli._command import Command, marks, option_name, shown_name
from kneejax.cli._results_folder import FILE, WRITTEN
from kneejax.files import InputProblem
from kneejax.files.reading import Mistakes, load_json, neighbour, together

_COMMAND, _WORKED_IN, VERSIONS = "command", "working_folder", "versions"
#: The field of `kneejax.parameters.MEANING`, whose import would be JAX's.
_MEANING = "stiffness_of"
#: Names that no option may have, since they stand beside the options.
ADDED = (_COMMAND, _WORKED_IN, VERSIONS, _MEANING, WRITTEN)
_EXPECTED = "settings.json of a kneejax command"


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
        if marks(field, _command.Parameters) and value and knee and not mistakes:
            from kneejax.studies import misspelt

            path, place = folder / knee, (shown_name(field), "name")
            for one in misspelt(os.fspath(path) if path.exists() else knee, value):
                mistakes.append(InputProblem(*place, one.value, one.expected, one.nearest))
    mistakes.check()


def _check_input(field: FieldInfo, value: str, folder: Path, gone: str) -> None:
    if marks(field, _command.Angles):
        from kneejax.files import parse_flexion

        parse_flexion(value)
    bundled, files = marks(field, _command.Bundled), marks(field, _command.File)
    path = folder / value
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
            place = gone, field.alias or ""
            raise InputProblem(*place, value, problem.expected, problem.nearest) from None
        return
    raise InputProblem(value, "file", "missing", files[0].kind, neighbour(path))


def asked_for(asked: Command) -> dict[str, Any]:
    """A command, before it has run, and its options as JSON holds them, and where it ran."""
    return {**asked.settings(), _WORKED_IN: os.getcwd()}


def read_settings(folder: Path) -> dict[str, Any]:
    """Read what a command was asked for, of the folder that it wrote."""
    file = folder / FILE
    if not folder.is_dir():
        found = "a file" if folder.exists() else "missing"
        raise InputProblem(folder, "folder", found, "a folder that a kneejax command wrote")
    if not file.is_file():
        expected = "this file, which a kneejax command writes beside its results"
        raise InputProblem(file, "file", "missing", expected)
    settings = load_json(file, _EXPECTED)
    for name, kind in ((_COMMAND, str), (_WORKED_IN, str), (VERSIONS, dict)):
        found = settings.get(name) if isinstance(settings, dict) else None
        if not isinstance(found, kind):
            shown = "missing" if found is None else found
            raise InputProblem(file, name, shown, f"as in {_EXPECTED}")
    return settings


def command_again(
    settings: Mapping[str, Any], commands: Mapping[str, type[Command]], file: Path, out: Path
) -> Command:
    """The command that settings describe, also those of earlier versions, with underscores, checked
    as when it was first asked for, with another folder for the results."""
    words = settings[_COMMAND]
    if words not in commands or "out" not in commands[words].model_fields:
        raise InputProblem(file, _COMMAND, words, "a command of kneejax", commands)
    given = {option_name(k): x for k, x in settings.items() if k not in ADDED and x is not None}
    try:
        asked = commands[words].read({**given, "out": out})
        check_inputs(asked, worked_in(settings), os.fspath(file))
        return asked
    except InputProblem as found:
        problems = getattr(found, "problems", (found,))
        raise together([_of_file(problem, words, file) for problem in problems]) from None


def _of_file(problem: InputProblem, words: str, file: Path) -> InputProblem:
    """What is wrong with an option, said of the file that states it."""
    option = problem.field if problem.file == words else problem.file
    if problem.file != words and not problem.file.startswith("--"):
        return problem
    field, value = option.removeprefix("--"), problem.value
    return InputProblem(file, field, value, problem.expected, problem.nearest)


def check_meaning(settings: Mapping[str, Any], file: Path) -> None:
    """Refuse older settings that give a structure's stiffness as the mean of its fibres."""
    pairs: list[tuple[str, Any]] = []
    for every in settings.values():
        if isinstance(every, dict):
            pairs += every.items()
        elif isinstance(every, list):  # words of options that were lists of words once
            words = (str(word).partition("=") for word in every)
            pairs += [(name, value) for name, equals, value in words if equals]
    given = {name: value for name, value in pairs
             if name.endswith((".stiffness", ".damping")) and "*" not in name}  # fmt: skip
    if _MEANING in settings or not given:
        return
    from kneejax.files import load_knee
    from kneejax.parameters import fibres_summed
    from kneejax.studies import read_study

    def place(name: str) -> str:
        path = worked_in(settings) / name
        return os.fspath(path) if path.is_file() else name

    knees = [load_knee(place(settings["knee"]))] if settings.get("knee") else []
    knees += [read_study(place(settings["study"])).knee] if settings.get("study") else []
    for name, value in given.items():
        count = max((fibres_summed(knee, name) for knee in knees), default=1)
        if count > 1:
            expected = (f"the sum over the structure's {count} fibres; these settings are older "
                        "and have their mean: run the command itself, with the sum")
            raise InputProblem(file, name, value, expected)


def worked_in(settings: Mapping[str, Any]) -> Path:
    """The folder from which the command's paths lead."""
    return Path(settings[_WORKED_IN])
