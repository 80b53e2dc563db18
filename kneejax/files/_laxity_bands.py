"""Laxities as others measured them: means and standard deviations over flexion."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from kneejax.files._bundled import bundled_files
from kneejax.files.reading import (
    InputProblem,
    Part,
    Text,
    checked,
    load_yaml,
    meaning,
    number,
    one_of,
    reads,
)
from kneejax.files.tables import Table

_COLUMNS = ["flexion_deg", "end", "mean", "sd", "cut"]
#: What a published number is of: the first three as `kneejax.Laxity` has them, the last what the
#: range grows by when the ligaments are cut, a difference of two knees.
ENDS = ("positive", "negative", "range", "range_increase")


@dataclasses.dataclass(frozen=True)
class LaxityBand:
    """A published laxity: rows of one table that are of one end and one state of the knee.

    Attributes:
        name: of its file.
        label: for a figure's legend.
        source: where it was published, and on whom it was measured.
        load: that acted, a name of `kneejax.mechanics.NAMED_LOADS`.
        size: of the load, in the unit of its name; NaN where it is not known.
        end: one of `ENDS`.
        cut: ligaments that were cut.
        flexion_deg: `(n,)`.
        mean: displacement under the load, `(n,)`, mm or degrees; negative at the negative end.
        sd: its standard deviation over knees, `(n,)`; NaN where none was published.
        counted_from: what a cut knee's displacement is counted from, `unloaded` (where it rests
            itself) or `intact`.
    """

    name: str
    label: str
    source: str
    load: str
    size: float
    end: str
    cut: tuple[str, ...]
    flexion_deg: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    counted_from: str = "unloaded"


class AboutLaxity(Part):
    """The YAML file beside a table of laxities."""

    label: Text = meaning("for a figure's legend")
    source: Text = meaning("where it was published")
    load: Text = meaning("that acted")
    size: Annotated[float, reads(number)] = meaning("of the load", np.nan)
    notes: Any = meaning("anything else", None)
    counted_from: Annotated[str, one_of(["unloaded", "intact"])] = meaning(
        "what a cut knee's displacement is counted from", "unloaded"
    )


def bundled_bands(
    cut: Collection[str] | None = None, name: str | None = None
) -> list[LaxityBand]:
    """The laxities that come with the package.

    Args:
        cut: only those of knees with exactly these ligaments cut; all by default.
        name: only those of this table.

    Example:
        >>> [band.cut for band in bundled_bands(name="robot_anterior_90N")]
        [(), ('ACL',)]
        >>> [(band.end, band.mean.tolist()) for band in bundled_bands(name="komzak2013_torsion")]
        [('positive', [12.1]), ('negative', [-10.1])]
    """
    files = bundled_files("laxity")
    every = [band for path in files.values() for band in _read(path)]
    of_name = [band for band in every if name in (None, band.name)]
    return [band for band in of_name if cut is None or set(band.cut) == set(cut)]


def _read(path: Path) -> list[LaxityBand]:
    about = checked(AboutLaxity, load_yaml(path, "source of a laxity table"), os.fspath(path))
    table = Table.read(path.with_suffix(".csv"), _COLUMNS)
    ends, cuts = table.cells("end"), table.cells("cut")
    for place, end in ends:
        if end not in ENDS:
            expected = f"one of {', '.join(ENDS)}"
            table.mistakes.append(InputProblem(table.file, place, end, expected, ENDS))
    numbers = np.stack([table.column("flexion_deg"), table.column("mean"),
                        table.column("sd", empty=True)], axis=1)  # fmt: skip
    table.mistakes.check()
    kinds: dict[tuple[str, str], list[np.ndarray]] = {}
    for (_, end), (_, cut), own in zip(ends, cuts, numbers, strict=True):
        kinds.setdefault((end, cut), []).append(own)
    return [
        LaxityBand(
            path.stem, about.label, about.source, about.load, about.size, end,
            tuple(cut.split()), *np.array(own).T,
            counted_from=about.counted_from if cut else "unloaded",
        )
        for (end, cut), own in kinds.items()
    ]  # fmt: skip
