"""Options of the commands that concern other commands: run one again, complete their words."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from kneejax.cli._command import Command, Place


class Rerun(Command):
    """Repeat the run that wrote a folder."""

    command: ClassVar = "rerun"
    example: ClassVar = (
        "kneejax simulate passive-flexion && kneejax rerun kneejax-passive-flexion --out again"
    )
    body: ClassVar = "kneejax.cli._again:rerun"

    folder: Annotated[Path, Place("FOLDER")] = Field(
        description="folder with the settings.json of a command"
    )
    out: Path | None = Field(
        None, description="folder for the results; the same one otherwise"
    )


class Completion(Command):
    """Print a script that lets a shell complete commands, options and files."""

    command: ClassVar = "completion"
    example: ClassVar = 'eval "$(kneejax completion bash)"'
    body: ClassVar = "kneejax.cli._again:completion"

    shell: Annotated[Literal["bash", "zsh", "fish"], Place("SHELL")] = Field(
        description="bash, zsh or fish"
    )
