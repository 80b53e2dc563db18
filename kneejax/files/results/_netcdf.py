"""Data sets as netCDF files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from kneejax.files.reading import write_bytes

if TYPE_CHECKING:
    from xarray import Dataset


def write_netcdf(path: str | os.PathLike[str], dataset: Dataset) -> Path:
    """Write a data set as netCDF 4, completely or not at all.

    Args:
        path: where; folders are made.
        dataset: with coordinates and units (`ParameterMap.to_dataset`).

    Returns:
        The path.

    Raises:
        InputProblem: the file cannot be written.
    """
    # HDF5 that meets a full disk may end the process when it closes its file.
    content = dataset.to_netcdf(engine="h5netcdf", format="NETCDF4")
    write_bytes(path, bytes(content))
    return Path(path)
