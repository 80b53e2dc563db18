"""The explorer: a knee to move in the browser, until Ctrl-C."""

import json
import time
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kneejax import files, report
from kneejax.cli.options.knees import Explore
from kneejax.explorer import Page, Setting, Subject, serve
from kneejax.geometry import FEMUR, FREE_COORDINATES, PATELLA, TIBIA
from kneejax.mechanics import Knee
from kneejax.studies import read_study


def run(asked: Explore) -> int:
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


def _subject(asked: Explore) -> tuple[Knee, dict[str, Any], np.ndarray | None, str]:
    """The knee, its document, measured poses where there are some, and what the knee itself is."""
    named, path = asked.subject, Path(asked.subject)
    is_study = named in files.bundled_studies()
    if not is_study and path.suffix in (".yaml", ".yml") and path.is_file():
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        is_study = isinstance(document, dict) and "parameters" in document
    if asked.patella and is_study:  # a knee may have the name of a study
        if named not in files.bundled_files("knees"):
            expected = "a knee or a result: the poses of a study are those of a tibia alone"
            raise files.InputProblem(named, "--patella", "with a study", expected)
        is_study = False
    if not is_study:
        read = files.load_knee_file(named)
        found = _measured(path) if named.endswith(".json") else None
        first = "stored fit" if named.endswith(".json") else "as read"
        return (read.with_patella() if asked.patella else read.knee), read.document, found, first
    study = read_study(named)
    said = yaml.safe_load(files.named_path("studies", named).read_text(encoding="utf-8"))["knee"]
    beside = path.parent / said
    read = files.load_knee_file(beside if beside.exists() else said)
    return study.knee, read.document, study.poses(), "as read"


def _measured(result: Path) -> np.ndarray | None:
    """What a result's knee was fitted to, in its own frames; None where the study is gone."""
    said = json.loads(result.read_text(encoding="utf-8")).get("settings") or {}
    if not Path(said.get("path") or "-").is_file():
        return None
    offset = files.read_calibrated(result).frame_offset
    away = np.array([0.0, *(offset.get(name, 0.0) for name in FREE_COORDINATES)])
    return read_study(said["path"]).poses() - away


def begin(asked: Explore) -> Page:
    """The page of a command, being served."""
    knee, document, measured, first = _subject(asked)
    paths = {bone: getattr(asked, f"{bone}_bone") for bone in (FEMUR, TIBIA, PATELLA)}
    meshes = {bone: files.read_mesh_points(path) for bone, path in paths.items() if path}
    bones = [report.BoneMesh(bone, mesh.points_mm, mesh.faces) for bone, mesh in meshes.items()]
    pages: list[Page] = []
    server, link = serve(asked.port, lambda x: pages and pages[0].go(Setting.of_link(x)))
    page = Page(server, Subject.of(knee), document, link, asked.out, measured, bones, first)
    pages.append(page)
    return page
