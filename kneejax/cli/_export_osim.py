"""`kneejax export osim KNEE MODEL --out NEW`."""

from __future__ import annotations

from kneejax.cli._main import DONE
from kneejax.cli.options import ExportOsim
from kneejax.files import (
    InputProblem,
    counted,
    coupled_motion,
    export_osim,
    read_poses,
    write_bytes,
)


def run(arguments: ExportOsim) -> int:
    """Write a knee's numbers into the OpenSim model that it came from."""
    same = arguments.out.exists() and arguments.out.resolve() == arguments.model.resolve()
    if same:
        raise InputProblem("--out", "file", str(arguments.out), "another file than the model")
    coupled = None
    if arguments.coupled is not None:
        file = str(arguments.coupled)
        coupled = coupled_motion(read_poses(file, arguments.convention), file)
    written = export_osim(
        arguments.knee, arguments.model, replace=arguments.replace, coupled=coupled
    )
    write_bytes(arguments.out, written.data)
    for change in written.changes:
        print(change)
    for note in written.notes:
        print(note)
    count = counted(len(written.changes), "change") if written.changes else "no changes"
    print(f"written: {arguments.out}, {count}")
    return DONE
