"""Meshes in VTK's format, in which most OpenSim models keep their bones."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.reading import InputProblem


def read_vtp(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a `.vtp` file; polygons and strips are cut into triangles.

    Args:
        path: the file.

    Returns:
        Corners `(n, 3)` in the file's unit, and rows of three corners.

    Raises:
        InputProblem: VTK is not installed, or the file is damaged.
    """
    core, filters, reading, arrays = (
        _imported(path, name)
        for name in ("vtkCommonCore", "vtkFiltersCore", "vtkIOXML", "util.numpy_support")
    )
    # VTK would print paragraphs about a damaged file.
    logger = core.vtkLogger
    before = logger.GetCurrentVerbosityCutoff()
    logger.SetStderrVerbosity(logger.VERBOSITY_OFF)
    try:
        reader, triangles = reading.vtkXMLPolyDataReader(), filters.vtkTriangleFilter()
        reader.SetFileName(str(path))
        triangles.SetInputConnection(reader.GetOutputPort())
        triangles.PassLinesOff()
        triangles.PassVertsOff()
        triangles.Update()
    finally:
        logger.SetStderrVerbosity(before)
    if reader.GetErrorCode():
        raise InputProblem(path, "file", "not complete, or damaged", "a triangle mesh in VTP")
    mesh = triangles.GetOutput()
    if mesh.GetNumberOfPolys() == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), int)
    corners = arrays.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray())
    points = arrays.vtk_to_numpy(mesh.GetPoints().GetData())
    return np.array(points, float), np.array(corners, int).reshape(-1, 3)


def _imported(path: Path, name: str) -> Any:
    try:
        return importlib.import_module(f"vtkmodules.{name}")
    except ImportError:
        expected = "VTK to read it (pip install 'kneejax[view]'), or the mesh as STL, PLY or OBJ"
        raise InputProblem(path, "file", path.suffix, expected) from None
