"""What is wrong with poses, in words and numbers: which part, by how much, against which limit."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import jax
import numpy as np
from numpy.typing import ArrayLike

from kneejax import inference
from kneejax.experiments import Mechanics, Motion, flipped, near_flip, status_of, with_flips
from kneejax.geometry import COLUMNS, COORDINATES, free_of, scales
from kneejax.mechanics import LIMITS, OFF_SURFACE_MM, WIDEST_GAP_MM, Knee, load_words
from kneejax.report.look.tables import listed
from kneejax.statics import Status, converged

# All compartments farther apart than this: something pulls the bones apart, mm.
_APART_MM = 0.5
#: A search that ended so near, mm, has found a balance.
_BALANCED_MM = 1e-6
# Fibres that are named; the others are counted.
_MOST_NAMED = 3


def status_doubts(
    status: ArrayLike, words: Sequence[str], where: Callable[[np.ndarray], str],
    at: Callable[[int], str], *, given: bool = False, accepted: Collection[Status] = (),
) -> Iterator[str]:
    """Say which poses are not simply balanced, what to try next, and what is wrong in numbers.

    For each `Status` that is not `accepted` a sentence, and on lines of their own the `words` of
    the first, a middle and the last of its poses, called as `where` (several, by their rows) and
    `at` (one) say; of balanced poses only these lines. `given` says whether poses were not searched
    for.

    Example:
        >>> places = named_places(["0", "30"], "degrees")
        >>> print(*status_doubts([0, 12], ["", "the search stopped 2 mm from a balance"], *places))
        30 degrees: no balance found: look for a fibre too tight or a load that nothing holds, or \
leave this pose out
          at 30: the search stopped 2 mm from a balance
    """
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
    status = with_flips(status_of(found, knee), found)
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
    found, flips = jax.tree.map(np.asarray, found), flipped(found)
    also = [""] * len(flips) if also is None else also
    return tuple("; ".join([*_of_pose(knee, found, row, flips[row]), *filter(None, [more])])
                 for row, more in enumerate(also))  # fmt: skip


def search_words(motion: Motion, loads: Mapping[str, ArrayLike] | None = None) -> tuple[str, ...]:
    """Say for each pose without a balance how far the knee held, and how far the search was."""
    motion = jax.tree.map(np.asarray, motion)
    lost = ~converged(motion.status)
    sizes = {name: np.broadcast_to(size, lost.shape) for name, size in (loads or {}).items()}
    return tuple(
        _of_lost(motion, row, {name: float(size[row]) for name, size in sizes.items()})
        if gone
        else ""
        for row, gone in enumerate(lost)
    )


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
    left = motion.equilibrium.residual[:, row] * scales(
        free_of(motion.equilibrium.prescribed, motion.knee.bodies)
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
    for where, words in (
        (found.wrap_inside[row], "ends inside the obstacle"),
        (found.wrap_beyond[row], "touches its cylinder beyond its length"),
        (flips, "flipped to the other side of the obstacle"),
        (near_flip(found)[row] & ~flips, "may flip: both ways around are nearly as long"),
    ):
        rows = np.flatnonzero(where)
        if len(rows):
            yield f"{listed([names[j] for j in rows], _MOST_NAMED)} {words}"
    torn = np.flatnonzero(strain > fails)
    if len(torn):
        worst = sorted(torn, key=lambda j: strain[j] / fails[j], reverse=True)
        words = [f"{names[j]} strained by {strain[j]:.3f} (fails at {fails[j]:g})" for j in worst]
        yield listed(words, _MOST_NAMED)
