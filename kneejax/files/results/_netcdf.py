"""Data sets as netCDF files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from xarray import Dataset


def write_netcdf(path: str | os.PathLike[str], dataset: Dataset) -> Path:
    """Write a data set as netCDF 4, completely or not at all.

    Args:
        path: where; folders are made.
        dataset: with coordinates and units (`ParameterMap.to_dataset`).

    Returns:
        The path.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        dataset.to_netcdf(draft, engine="h5netcdf", format="NETCDF4")
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    return path
