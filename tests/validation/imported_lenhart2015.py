"""The published knee and its unseen twin, through the importer's command line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from kneejax.files import KneeFile, load_knee_file

if TYPE_CHECKING:
    from second_knee import SecondKnee


def import_both(data: Path, second: SecondKnee, out: Path) -> tuple[KneeFile, KneeFile]:
    """Import the model of a folder and its twin, side by side.

    Args:
        data: folder `lenhart2015`.
        second: the twin.
        out: folder to write into.
    """
    # The iliotibial band begins on the pelvis: without a patella section it has no place.
    band = next(name for name, original in second.fibres.items() if original == "ITB1")
    # The twin has the two meshes of the tibiofemoral joint only.
    less = "--without-patella", "--without", band
    orders = (
        (data / "lenhart2015.osim", "r", data / "meshes", out / "first"),
        (second.model, second.side, second.model.parent, out / "second", *less),
    )
    for process in [_import(*order) for order in orders]:
        said = process.communicate(timeout=600)[0]
        if process.returncode != 0:
            raise RuntimeError(said)
    first, twin = (load_knee_file(order[3] / "knee.yaml") for order in orders)
    return first, twin


def _import(
    model: Path, side: str, geometry: Path, out: Path, *more: str
) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "kneejax.cli", "import", "osim", str(model), "--side", side]
    return subprocess.Popen(
        [*command, "--geometry", str(geometry), "--out", str(out), *more],
        # The fits are many small systems: threads of the linear algebra only wait for each other.
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
