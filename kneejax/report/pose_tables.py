"""Poses, what a load moved, and forces as tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kneejax.experiments import Mechanics, load_share
from kneejax.geometry import COLUMNS, CONVENTION_WORDS, COORDINATES, FEMORAL, convert_table
from kneejax.mechanics import Knee
from kneejax.report.look.page import Verdict, prose
from kneejax.report.look.tables import Column, Table
from kneejax.statics import Status

#: Coordinate -> its narrow name, in the order of a table of poses.
HEADS = {name: name for name in COORDINATES} | {"internal_rotation": "int.rot."}
#: Parts whose largest force is less than this part of the largest of all are not listed.
_SMALL = 0.01



def along(column: str) -> tuple[str, ...]:
    """Columns along the axes of the tibia: of `{}_N` they are `anterior_N` and two others."""
    return tuple(column.format(way) for way in ("anterior", "superior", "lateral"))


def about(column: str) -> tuple[str, ...]:
    """Columns of moments about these axes."""
    return tuple(column.format(way) for way in ("adduction", "internal_rotation", "extension"))


def pose_columns(names: Sequence[str] = COLUMNS) -> list[Column]:
    """Columns of poses, or of their changes, with the headings that people read."""
    return [Column(name, f"{head}, {column.rsplit('_', 1)[1]}", ".2f" if k else ".1f")
            for k, (name, head, column) in enumerate(
                zip(names, HEADS.values(), COLUMNS, strict=True))]  # fmt: skip


def in_convention(table: ArrayLike, convention: str) -> tuple[np.ndarray, dict[str, str]]:
    """Poses in a convention, and the last column of their file where it is not the usual one."""
    poses = convert_table(np.asarray(table, float).reshape(-1, len(COLUMNS)), FEMORAL, convention)
    return poses, {} if convention == FEMORAL else {"convention": convention}


def words_of(status: ArrayLike) -> list[str]:
    """The word of each status."""
    return [Status(int(one)).word for one in np.asarray(status).ravel()]


def pose_table(
    table: ArrayLike, status: ArrayLike, convention: str = FEMORAL, *,
    more: Mapping[str, Sequence[Any]] | None = None,
) -> Table:
    """Poses in a convention, as `poses.csv` holds them and as people read them.

    Example:
        >>> print(pose_table([[30.0, 1.0, 4.0, 2.0, -28.0, 0.5]], [0]).terminal())
        flexion  adduction  int.rot.  anterior  superior  lateral  status
            deg        deg       deg        mm        mm       mm
           30.0       1.00      4.00      2.00    -28.00     0.50  balanced
    """
    hidden = {Column(name, shown=False): cells for name, cells in (more or {}).items()}
    before = {key: x for key, x in hidden.items() if key.name in ("converged", "stable")}
    shown, last = in_convention(table, convention)
    columns = {tuple(pose_columns()): shown, **before, "status": words_of(status), **hidden,
               **{Column(name, shown=False): cells for name, cells in last.items()}}  # fmt: skip
    return Table.of(columns, f"Poses, {convention}: {CONVENTION_WORDS[convention]}")


def change_table(flexion: ArrayLike, moved: ArrayLike) -> Table:
    """How far a load moved the tibia, `displacement.csv`."""
    parts = (column.rsplit("_", 1) for column in COLUMNS[1:])
    names = [COLUMNS[0], *(f"{name}_change_{unit}" for name, unit in parts)]
    columns = {tuple(pose_columns(names)): np.column_stack([flexion, moved])}
    return Table.of(columns, prose("displacement"))


def contact_forces(mechanics: Mechanics) -> np.ndarray:
    """Sizes of the contact forces, N, `(poses, contacts)`."""
    return np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)


def contact_numbers(knee: Knee, mechanics: Mechanics) -> dict[Column, np.ndarray]:
    """What is reported of each contact at each pose, `(poses, contacts)`; of a knee with menisci
    also how they share the load of their compartment, and how far they move outwards."""
    found = {Column("force_N", show=".0f"): contact_forces(mechanics),
             Column("area_mm2", show=".0f"): mechanics.area,
             Column("max_pressure_MPa", "peak pressure, MPa", ".2f"): mechanics.max_pressure,
             Column("mean_pressure_MPa", show=".2f"): mechanics.mean_pressure}  # fmt: skip
    if knee.menisci:
        found |= {Column("load_share", "share of load", ".0%"): load_share(knee, mechanics),
                  Column("max_extrusion_mm", show=".2f"): mechanics.max_extrusion,
                  Column("mean_extrusion_mm", show=".2f"): mechanics.mean_extrusion}  # fmt: skip
    return {column: np.asarray(x) for column, x in found.items()}


def part_table(
    keys: Mapping[Any, Sequence[Any]], part: str, names: Sequence[str], numbers: Mapping[Any, Any],
    last: Mapping[str, Sequence[Any]] | None = None,
) -> Table:
    """Numbers of the parts of a knee, a row for each part at each pose."""
    rows, count = len(next(iter(keys.values()))), len(names)

    def each(cells: Sequence[Any]) -> list[Any]:
        return [cell for cell in cells for _ in range(count)]

    sizes = {name: np.reshape(x, (-1, len(name)) if isinstance(name, tuple) else -1)
             for name, x in numbers.items()}  # fmt: skip
    return Table.of({**{name: each(cells) for name, cells in keys.items()}, part: [*names] * rows,
                     **sizes, **{name: each(cells) for name, cells in (last or {}).items()}})


def force_table(
    knee: Knee, mechanics: Mechanics, keys: Mapping[str, Sequence[Any]], **more: np.ndarray
) -> Table:
    """Forces of ligaments, then of contacts, at each pose: `forces.csv`."""
    names = [*knee.ligaments.names, *knee.contact_names]
    forces = np.concatenate([np.asarray(mechanics.tension), contact_forces(mechanics)], axis=1)
    return part_table(keys, "part", names, {"force_N": forces, **more})


def bundles(knee: Knee, among: Sequence[str] | None = None) -> dict[str, list[str]]:
    """Ligaments, the fibres of the largest groups together: name -> fibres."""
    left = list(knee.ligaments.names if among is None else among)
    answer: dict[str, list[str]] = {}
    # The largest groups first: a bundle that is part of a ligament is drawn with it.
    for group, members in sorted(knee.groups, key=lambda group: -len(group[1])):
        if all(name in left for name in members):
            answer[group] = list(members)
            left = [name for name in left if name not in members]
    return answer | {name: [name] for name in left}


def bundle_forces(
    knee: Knee, tension: ArrayLike, among: Sequence[str] | None = None
) -> dict[str, np.ndarray]:
    """Forces of `bundles`: name -> N, `(poses,)`."""
    tension, names = np.asarray(tension), knee.ligaments.names
    return {name: tension[:, [names.index(fibre) for fibre in fibres]].sum(axis=1)
            for name, fibres in bundles(knee, among).items()}  # fmt: skip


def peak_table(
    knee: Knee, mechanics: Mechanics, places: ArrayLike, place: str, title: str = "Largest forces"
) -> Table:
    """The largest force of each ligament, fibres together, and of each contact."""
    parts = [(name, *largest(x), None)
             for name, x in bundle_forces(knee, mechanics.tension).items()]  # fmt: skip
    parts.sort(key=lambda one: -one[1])
    parts = [one for one in parts if one[1] > _SMALL * parts[0][1]]
    contacts = contact_forces(mechanics).T, np.asarray(mechanics.max_pressure).T
    parts += [(name, *largest(force), largest(pressure)[0])
              for name, force, pressure in zip(knee.contact_names, *contacts, strict=True)]
    at = np.asarray(places)
    columns = [Column("part", words=True), Column("force_N", "at most, N", ".0f"),
               Column("place", place, "{:g}".format),
               Column("max_pressure_MPa", "peak pressure, MPa", ".2f")]  # fmt: skip
    rows = [[name, size, float(at[row]), peak] for name, size, row, peak in parts]
    return Table(columns, rows, title, "Fibres of a ligament are added.")


def largest(values: np.ndarray) -> tuple[float, int]:
    """The largest number, and its place; NaN where there is none."""
    if not np.isfinite(values).any():
        return np.nan, 0
    row = int(np.nanargmax(values))
    return float(values[row]), row


def verdict_of(status: ArrayLike) -> Verdict:
    """Good where every pose is balanced, failed where none has a balance at all."""
    status = np.asarray(status)
    if (status == Status.BALANCED).all():
        return Verdict.GOOD
    return Verdict.DOUBTFUL if any(Status(int(x)).converged for x in status) else Verdict.FAILED
