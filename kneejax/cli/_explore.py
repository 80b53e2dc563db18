"""The explorer: a knee to move in the browser, until Ctrl-C."""

from __future__ import annotations

import time
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kneejax import report
from kneejax.cli.options import Explore
from kneejax.explore import Page, Subject, serve
from kneejax.files import (
    InputProblem,
    bundled_studies,
    load_knee_file,
    read_mesh_points,
    study_path,
)
from kneejax.geometry import FEMUR, PATELLA, TIBIA
from kneejax.mechanics import Knee
from kneejax.numerics import MissingPackage
from kneejax.studies import read_study


def explore(asked: Explore) -> int:
    """Serve the page, print its link, and stay until Ctrl-C."""
    page = begin(asked)
    print(f"{page.link}\nCtrl-C ends it.", flush=True)
    if asked.open:
        webbrowser.open(page.link)
    try:
        while True:
            time.sleep(3600.0)
    except KeyboardInterrupt:
        page.stop()
    return 0


def _subject(asked: Explore) -> tuple[Knee, dict[str, Any], np.ndarray | None]:
    """The knee, its document, and measured poses where a study has some."""
    named = asked.subject
    if not _is_study(named):
        read = load_knee_file(named)
        return (read.with_patella() if asked.patella else read.knee), read.document, None
    study = read_study(named)
    path = Path(named)
    said = yaml.safe_load(study_path(named).read_text(encoding="utf-8"))["knee"]
    beside = path.parent / said
    read = load_knee_file(beside if beside.exists() else said)
    return study.knee, read.document, study.measured


def _is_study(named: str) -> bool:
    if named in bundled_studies():
        return True
    path = Path(named)
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return False
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    return isinstance(document, dict) and "measured" in document


def begin(asked: Explore) -> Page:
    """The page of a command, being served."""
    knee, document, measured = _subject(asked)
    files = {bone: getattr(asked, f"{bone}_bone") for bone in (FEMUR, TIBIA, PATELLA)}
    meshes = {bone: read_mesh_points(path) for bone, path in files.items() if path is not None}
    bones = [report.BoneMesh(bone, mesh.points_mm, mesh.faces) for bone, mesh in meshes.items()]
    pages: list[Page] = []
    try:
        server, link = serve(asked.port, lambda query: pages[0].opened(query) if pages else None)
    except MissingPackage as problem:
        raise InputProblem("kneejax explore", "viser", "not installed",
                           "viser, which comes with pip install 'kneejax[explore]'") from problem
    page = Page(server, Subject.of(knee), document, link, asked.out, measured, bones)
    pages.append(page)
    return page
