"""What is wrong with poses, in words and numbers: which part, by how much, against which limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax
import numpy as np
from numpy.typing import ArrayLike

from kneejax.experiments import Mechanics, Motion, flipped, near_flip
from kneejax.geometry import COLUMNS, COORDINATES, free_of, scales
from kneejax.mechanics import LIMITS, OFF_SURFACE_MM, WIDEST_GAP_MM, Knee, load_words
from kneejax.statics import Status, converged

# All compartments farther apart than this: something pulls the bones apart, mm.
_APART_MM = 0.5
#: A search that ended so near, mm, has found a balance.
_BALANCED_MM = 1e-6
# Fibres that are named; the others are counted.
_MOST_NAMED = 3


def pose_words(knee: Knee, found: Mechanics, also: Sequence[str] | None = None) -> tuple[str, ...]:
    """Say for each pose what is wrong with it, or worth knowing, in numbers.

    Args:
        knee: with which the poses were evaluated.
        found: their mechanics.
        also: what else is known of each pose, e.g. how far a search was from a balance.

    Returns:
        A text per pose; empty where there is nothing to say. Several doubts are separated by `; `.
    """
    found, flips = jax.tree.map(np.asarray, found), flipped(found)
    also = [""] * len(flips) if also is None else also
    return tuple(
        "; ".join([*_of_pose(knee, found, row, flips[row]), *filter(None, [more])])
        for row, more in enumerate(also)
    )


def search_words(motion: Motion, loads: Mapping[str, ArrayLike] | None = None) -> tuple[str, ...]:
    """Say for each pose without a balance how far the knee held, and how far the search was.

    Args:
        motion: as it was found.
        loads: those that acted, by the names of `kneejax.mechanics.NAMED_LOADS`, and how far a
            machine was to move a coordinate, by its name, mm or degrees; one for all poses, or one
            per pose.

    Returns:
        A text per pose, empty where a balance was found; for `pose_words`.
    """
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
    """Say where a second stable balance lies: the rotation and the translation that differ most.

    Args:
        other: its pose, degrees and mm, `(6,)`, in the order of `kneejax.geometry.COLUMNS`.
        own: the pose that is reported; NaN where there is none.
    """
    away = np.abs(other - own) if np.isfinite(own).all() else np.abs(other)
    parts = []
    for k in (1 + int(away[1:3].argmax()), 3 + int(away[3:].argmax())):
        name, unit = COLUMNS[k].rsplit("_", 1)
        here = f" (here {own[k]:.1f})" if np.isfinite(own[k]) else ""
        parts.append(f"{name.replace('_', ' ')} {other[k]:.1f} {unit}{here}")
    return f"second stable balance at {', '.join(parts)}"


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
    # A pose that is NaN has no parts to speak of.
    if np.isfinite(found.displacement[row]).all():
        yield from _of_contacts(knee, found, row)
        yield from _of_place(found, row)
        yield from _of_fibres(knee, found, row, flips)


def _of_contacts(knee: Knee, found: Mechanics, row: int):
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
            yield f"{name} contact{_beyond(found, row, k)}"
    if len(depth) and (depth < -_APART_MM).all() and (depth >= -WIDEST_GAP_MM).all():
        gaps = ", ".join(
            f"{name} {-d:.1f} mm" for name, d in zip(knee.contact_names, depth, strict=True)
        )
        yield f"compartments apart: {gaps}"


def _beyond(found: Mechanics, row: int, k: int) -> str:
    far, share = float(found.beyond_mm[row, k]), float(found.beyond_share[row, k])
    if not np.isfinite([far, share]).all():
        return " off the fitted surfaces"
    counts = "no doubt up to" if found.known[row, k] else "at most"
    return (
        f" {far:.2g} mm off the fitted surfaces ({counts} {OFF_SURFACE_MM:g}) with "
        f"{100 * share:.2g} % of its force"
    )


def _of_place(found: Mechanics, row: int):
    for value, column in zip(found.displacement[row], COLUMNS[1:], strict=True):
        name, unit = column.rsplit("_", 1)
        if abs(value) > LIMITS[name]:
            words = name.replace("_", " ")
            yield f"{words} {value:.1f} {unit} from the reference pose (at most {LIMITS[name]:g})"


def _of_fibres(knee: Knee, found: Mechanics, row: int, flips: np.ndarray):
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
            yield f"{_listed([names[j] for j in rows])} {words}"
    torn = np.flatnonzero(strain > fails)
    if len(torn):
        worst = sorted(torn, key=lambda j: strain[j] / fails[j], reverse=True)
        words = [f"{names[j]} strained by {strain[j]:.3f} (fails at {fails[j]:g})" for j in worst]
        yield _listed(words)


def _listed(words: list[str]) -> str:
    more = len(words) - _MOST_NAMED
    return ", ".join(words[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
