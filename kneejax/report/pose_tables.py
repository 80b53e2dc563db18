"""Poses in tables, with what a load moved and forces; and what is wrong with poses, in words."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike

from kneejax import experiments, geometry, inference
from kneejax.experiments import Mechanics, Motion
from kneejax.geometry import COLUMNS, COORDINATES, FEMORAL
from kneejax.mechanics import LIMITS, OFF_SURFACE_MM, WIDEST_GAP_MM, Knee, load_words
from kneejax.report.look.page import Section, Verdict, prose
from kneejax.report.look.tables import Column, Table, listed
from kneejax.statics import Status, converged

#: Coordinate -> its narrow name, in the order of a table of poses.
HEADS = {name: name for name in COORDINATES} | {"internal_rotation": "int.rot."}
#: Parts whose largest force is less than this part of the largest of all are not listed.
_SMALL = 0.01
# All compartments farther apart than this: something pulls the bones apart, mm.
_APART_MM = 0.5
#: A search that ended so near, mm, has found a balance.
_BALANCED_MM = 1e-6
# Fibres that are named; the others are counted.
_MOST_NAMED = 3


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
    rows = np.asarray(table, float).reshape(-1, len(COLUMNS))
    poses = geometry.convert_table(rows, FEMORAL, convention)
    return poses, {} if convention == FEMORAL else {"convention": convention}


def words_of(status: ArrayLike) -> list[str]:
    """The word of each status."""
    return [Status(int(one)).word for one in np.asarray(status).ravel()]


def pose_table(
    table: ArrayLike, status: ArrayLike, convention: str = FEMORAL, *,
    more: Mapping[str, Sequence[Any]] | None = None,
) -> Table:
    """Poses in a convention, as `poses.csv` holds them and as people read them."""
    shown, last = in_convention(table, convention)
    hidden = {Column(name, shown=False): x for name, x in {**(more or {}), **last}.items()}
    before = {key: x for key, x in hidden.items() if key.name in ("converged", "stable")}
    columns = {tuple(pose_columns()): shown, **before, "status": words_of(status), **hidden}
    return Table.of(columns, f"Poses, {convention}: {geometry.CONVENTION_WORDS[convention]}")


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
    """Of each contact at each pose, `(poses, contacts)`; of menisci share and extrusion too."""
    found = {Column("force_N", show=".0f"): contact_forces(mechanics),
             Column("area_mm2", show=".0f"): mechanics.area,
             Column("max_pressure_MPa", "peak pressure, MPa", ".2f"): mechanics.max_pressure,
             Column("mean_pressure_MPa", show=".2f"): mechanics.mean_pressure}  # fmt: skip
    if knee.menisci:
        share = experiments.load_share(knee, mechanics)
        found |= {Column("load_share", "share of load", ".0%"): share,
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
    forces = bundle_forces(knee, mechanics.tension)
    parts = sorted(((name, *largest(x), None) for name, x in forces.items()), key=lambda x: -x[1])
    parts = [one for one in parts if one[1] > _SMALL * parts[0][1]]
    contacts = contact_forces(mechanics).T, np.asarray(mechanics.max_pressure).T
    parts += [(name, *largest(force), largest(pressure)[0])
              for name, force, pressure in zip(knee.contact_names, *contacts, strict=True)]
    columns = ["part", Column("force_N", "at most, N", ".0f"),
               Column("place", place, "{:g}".format),
               Column("max_pressure_MPa", "peak pressure, MPa", ".2f")]  # fmt: skip
    at = np.asarray(places)
    rows = [[name, size, float(at[row]), peak] for name, size, row, peak in parts]
    return Table(columns, rows, title, "Fibres of a ligament are added.")


def peak_section(knee: Knee, mechanics: Mechanics, places: ArrayLike, place: str) -> Section:
    """`peak_table` below the first screen."""
    return Section("Largest forces", tables=[peak_table(knee, mechanics, places, place)])


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


def status_doubts(
    status: ArrayLike, words: Sequence[str], where: Callable[[np.ndarray], str],
    at: Callable[[int], str], *, given: bool = False, accepted: Collection[Status] = (),
) -> Iterator[str]:
    """Of each status what to try next, and the `words` of its first, a middle and its last pose."""
    status = np.asarray(status)
    for outcome in sorted({Status(int(x)) for x in status} - {*accepted}, reverse=True):
        rows = np.flatnonzero(status == outcome)
        told = [i for i in rows.tolist() if words[i]]
        shown = {told[0], told[len(told) // 2], told[-1]} if told else ()
        lines = [f"  {at(i)}: {words[i]}" for i in told if i in shown]
        if outcome is not Status.BALANCED:
            sentence = outcome.remark if given else outcome.sentence
            lines.insert(0, f"{where(rows)}: {sentence}")
        if lines:
            yield "\n".join(dict.fromkeys(lines))


def named_places(places: Sequence[str], unit: str) -> tuple[Callable, Callable]:
    """`where` and `at` of `status_doubts` for poses with names."""

    def where(rows: np.ndarray) -> str:
        words = [str(places[i]) for i in rows.tolist()]
        if len(words) > 12:
            words = [*words[:10], f"... {words[-1]} ({len(words)} poses)"]
        return f"{', '.join(words)} {unit}"

    return where, lambda i: f"at {places[i]}"


def given_doubts(
    knee: Knee, found: Mechanics, places: Sequence[str]
) -> tuple[np.ndarray, list[str]]:
    """`Status` of poses that were given, not searched for, `(poses,)`, and sentences on them."""
    status = experiments.with_flips(experiments.status_of(found, knee), found)
    named = named_places(places, "(row)")
    return status, [*status_doubts(status, pose_words(knee, found), *named, given=True)]


def pose_doubts(
    motion: inference.Motion, flexion: np.ndarray, accepted: tuple[Status, ...] = ()
) -> list[str]:
    """What is wrong with the poses of a motion that was fitted, a line per status."""
    status = row_status(motion)

    def where(rows: np.ndarray) -> str:
        word = Status(int(status[rows[0]])).word.replace("_", " ")
        angles = listed([f"{flexion[row]:g}" for row in rows], 8)
        return f"{len(rows)} of {len(status)} poses {word} (flexion {angles} deg)"

    accepted = (Status.BALANCED, *accepted)
    found = status_doubts(status, motion_words(motion), where, lambda i: f"At {flexion[i]:g} deg",
                          accepted=accepted)
    return [sentence.replace("\n  ", ". ") + "." for sentence in found]


def row_status(motion: inference.Motion) -> np.ndarray:
    """Status of every row; a row of NaN that claims to be balanced has not converged."""
    status = np.array(motion.status, int)
    lost = ~np.isfinite(np.asarray(motion.table, float)).all(axis=1)
    return np.where(lost & converged(status), int(Status.NOT_CONVERGED), status)


def accepted_statuses(failures: Collection[str]) -> tuple[Status, ...]:
    """What a study that names its `failures` accepts: all balances with another status."""
    return tuple(s for s in Status if s.converged and s.word not in failures) if failures else ()


def motion_words(motion: inference.Motion) -> tuple[str, ...]:
    """What is wrong with each pose, in words and numbers; nothing where no forces are known."""
    if motion.knee is None or motion.mechanics is None:
        return ("",) * len(motion.status)
    return pose_words(motion.knee, motion.mechanics)


def pose_words(knee: Knee, found: Mechanics, also: Sequence[str] | None = None) -> tuple[str, ...]:
    """Say for each pose what is wrong with it, or worth knowing, in numbers."""
    found, flips = jax.tree.map(np.asarray, found), experiments.flipped(found)
    also = [""] * len(flips) if also is None else also
    return tuple("; ".join([*_of_pose(knee, found, row, flips[row]), *filter(None, [more])])
                 for row, more in enumerate(also))  # fmt: skip


def search_words(motion: Motion, loads: Mapping[str, ArrayLike] | None = None) -> tuple[str, ...]:
    """Say for each pose without a balance how far the knee held, and how far the search was."""
    motion = jax.tree.map(np.asarray, motion)
    lost = ~converged(motion.status)
    sizes = {name: np.broadcast_to(size, lost.shape) for name, size in (loads or {}).items()}
    return tuple(_of_lost(motion, row, {name: float(size[row]) for name, size in sizes.items()})
                 if gone else "" for row, gone in enumerate(lost))  # fmt: skip


def second_balance(other: np.ndarray, own: np.ndarray) -> str:
    """Say where a second stable balance lies: the rotation and the translation that differ most."""
    away = np.abs(other - own) if np.isfinite(own).all() else np.abs(other)
    parts = []
    for k in (1 + int(away[1:3].argmax()), 3 + int(away[3:].argmax())):
        name, unit = COLUMNS[k].rsplit("_", 1)
        here = f" (here {own[k]:.1f})" if np.isfinite(own[k]) else ""
        parts.append(f"{name.replace('_', ' ')} {other[k]:.1f} {unit}{here}")
    return f"second stable balance at {', '.join(parts)}"


def with_second(words: Sequence[str], others: np.ndarray, own: np.ndarray) -> list[str]:
    """Words of poses, and where a second balance is known at one, `(poses, 6)`, of that too."""
    return ["; ".join(filter(None, [text, second_balance(other, here)
                                    if np.isfinite(other).all() else ""]))
            for text, other, here in zip(words, others, own, strict=True)]  # fmt: skip


def _of_lost(motion: Motion, row: int, loads: Mapping[str, float]) -> str:
    reached = float(motion.reached[row])
    if motion.status[row] == Status.GIVES_WAY:
        return f"held {_part(loads, reached)}, and nothing beyond"
    left = motion.equilibrium.residual[:, row] * geometry.scales(
        geometry.free_of(motion.equilibrium.prescribed, motion.knee.bodies)
    )
    left_mm, left_N = motion.left_mm[row], np.abs(left).max()
    if not np.isfinite([left_mm, left_N]).all():
        return ""
    if left_mm < _BALANCED_MM:
        return "a balance was found, but no motion leads there"
    told = f"the search stopped {left_mm:.2g} mm and {left_N:.2g} N from a balance"
    if 0.0 < reached < 1.0:
        told += f" beyond {_part(loads, reached)}"
    fault = Status(int(motion.equilibrium.fault[row])).fault
    return f"{told}, where {fault}" if fault else told


def _part(loads: Mapping[str, float], part: float) -> str:
    """A part of all loads and displacements, in words."""
    sizes = {name: float(f"{part * size:.3g}") for name, size in loads.items()}
    moved = [name for name in sizes if name in COORDINATES]
    words = [f"{COORDINATES[x].phrase} of {sizes[x]:g} {COORDINATES[x].unit}" for x in moved]
    if any(name not in moved and size for name, size in sizes.items()):
        words.append(load_words(sizes))
    return ", ".join(words) or f"{part:.3g} of the load"


def _of_pose(knee: Knee, found: Mechanics, row: int, flips: np.ndarray):
    """Of contacts, of the whole knee, and of fibres."""
    # A pose that is NaN has no parts to speak of.
    if not np.isfinite(found.displacement[row]).all():
        return
    depth = found.max_depth[row]
    for k, name in enumerate(knee.contact_names):
        if found.through_bone[row, k]:
            yield f"the {name} condyle has passed through its plateau"
        elif found.no_patch[row, k]:
            yield f"{name} surfaces too flat for an elliptical patch"
        elif found.too_deep[row, k]:
            yield f"{name} overlap of {depth[k]:.1f} mm, the whole layer"
        if depth[k] < -WIDEST_GAP_MM:
            yield f"{name} compartment open by {-depth[k]:.1f} mm (at most {WIDEST_GAP_MM:g})"
        if not found.known[row, k] or found.beyond_mm[row, k] > 0.0:
            far, share = float(found.beyond_mm[row, k]), float(found.beyond_share[row, k])
            words = "off the fitted surfaces"
            if np.isfinite([far, share]).all():
                counts = "no doubt up to" if found.known[row, k] else "at most"
                words = (f"{far:.2g} mm {words} ({counts} {OFF_SURFACE_MM:g}) with "
                         f"{float(f'{100 * share:.2g}'):g} % of its force")
            yield f"{name} contact {words}"
    if len(depth) and (depth < -_APART_MM).all() and (depth >= -WIDEST_GAP_MM).all():
        gaps = ", ".join(f"{name} {-d:.1f} mm"
                         for name, d in zip(knee.contact_names, depth, strict=True))  # fmt: skip
        yield f"compartments apart: {gaps}"
    for value, column in zip(found.displacement[row], COLUMNS[1:], strict=True):
        name, unit = column.rsplit("_", 1)
        if abs(value) > LIMITS[name]:
            words = name.replace("_", " ")
            yield f"{words} {value:.1f} {unit} from the reference pose (at most {LIMITS[name]:g})"
    names, strain = knee.ligaments.names, found.strain[row]
    fails = np.asarray(knee.ligaments.failure_strain)
    near = experiments.near_flip(found)[row] & ~flips
    for where, words in ((found.wrap_inside[row], "ends inside the obstacle"),
                         (found.wrap_beyond[row], "touches its cylinder beyond its length"),
                         (flips, "flipped to the other side of the obstacle"),
                         (near, "may flip: both ways around are nearly as long")):
        rows = np.flatnonzero(where)
        if len(rows):
            yield f"{listed([names[j] for j in rows], _MOST_NAMED)} {words}"
    torn = np.flatnonzero(strain > fails)
    if len(torn):
        worst = sorted(torn, key=lambda j: strain[j] / fails[j], reverse=True)
        words = [f"{names[j]} strained by {strain[j]:.3f} (fails at {fails[j]:g})" for j in worst]
        yield listed(words, _MOST_NAMED)
