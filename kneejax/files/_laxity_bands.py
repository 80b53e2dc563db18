"""Laxities as others measured them: means and standard deviations over flexion."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection
from pathlib import Path

import numpy as np

from kneejax.files._bundled import bundled_files
from kneejax.files.reading import Field, load_yaml
from kneejax.files.tables import read_rows

_COLUMNS = ["flexion_deg", "mean", "sd", "cut"]


@dataclasses.dataclass(frozen=True)
class LaxityBand:
    """A published laxity.

    Attributes:
        name: of its file.
        label: for a figure's legend.
        source: where it was published, and on whom it was measured.
        load: that acted, a name of `kneejax.mechanics.NAMED_LOADS`.
        size: of the load, in the unit of its name.
        cut: ligaments that were cut.
        flexion_deg: `(n,)`.
        mean: displacement under the load, `(n,)`, mm or degrees.
        sd: its standard deviation over knees, `(n,)`; NaN where none was published.
    """

    name: str
    label: str
    source: str
    load: str
    size: float
    cut: tuple[str, ...]
    flexion_deg: np.ndarray
    mean: np.ndarray
    sd: np.ndarray


def bundled_bands(cut: Collection[str] | None = None) -> list[LaxityBand]:
    """The laxities that come with the package.

    Args:
        cut: only those of knees with exactly these ligaments cut; all by default.

    Example:
        >>> sorted({band.cut for band in bundled_bands()})
        [(), ('ACL',)]
    """
    every = [band for path in bundled_files("laxity").values() for band in _read(path)]
    return [band for band in every if cut is None or set(band.cut) == set(cut)]


def _read(path: Path) -> list[LaxityBand]:
    field = Field(os.fspath(path), "", load_yaml(path, "source of a laxity table"))
    field.mapping(("label", "source", "load", "size"))
    label, source, load = (field[name].text() for name in ("label", "source", "load"))
    size = field["size"].number()
    header, rows = read_rows(os.fspath(path.with_suffix(".csv")), _COLUMNS)
    place = [header.index(name) for name in _COLUMNS]
    flexion, mean, sd, cuts = zip(*([cells[i] for i in place] for _, cells in rows), strict=True)
    numbers = np.array([flexion, mean, sd], float)
    kinds = dict.fromkeys(cuts)
    own = {cut: numbers[:, [one == cut for one in cuts]] for cut in kinds}
    return [
        LaxityBand(path.stem, label, source, load, size, tuple(cut.split()), *table)
        for cut, table in own.items()
    ]
