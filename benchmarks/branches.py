"""Does a batch find the poses that tiny steps of flexion find, and on the same branch?

    python benchmarks/branches.py [--knees 512] [--percent 10] [--parts 10]

Random knees: reference strains up to `--percent` beside the knee's own. The peer takes nothing from
the continuation: it goes from the reference pose in `--parts` steps for each 5 degrees. Every step
is one solve beside the last pose, and counts where it ends near the line through the last two
poses; otherwise it is taken in 8 parts, and each of these in 8 again. Knees without an equilibrium
at the reference begin at the first flexion at which a solve finds one, and are followed both ways.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from _numpy_knee import UNITS
from _protocol import ANGLES, arguments, finish, load

from kneejax.mechanics import Knee, ligament_law
from kneejax.statics import LoadCases, balance_many, balance_near

#: How far a pose may lie from where the last two lead, and what counts as the same, mm (rotations
#: at 30 mm).
_NEAR_MM, _SAME_MM = 0.3, 1e-5
#: Parts of a step that failed, and how often a step is divided.
_PARTS, _DIVISIONS = 8, 2


class Followed(NamedTuple):
    """Knees on their way, arrays that begin with the knee: its slack lengths, the pose, the contact
    points, the change of the pose with flexion, and whether the knee is still followed."""

    slack: np.ndarray
    q: np.ndarray
    points: np.ndarray
    slope: np.ndarray
    on: np.ndarray


def with_slack(knee: Knee, slack_length) -> Knee:
    """The knee with other slack lengths, `(fibres,)`."""
    return eqx.tree_at(lambda k: k.ligaments.slack_length, knee, slack_length)


def random_slack(knee: Knee, count: int, percent: float, seed: int) -> np.ndarray:
    """Slack lengths of random knees, `(count, fibres)`, mm."""
    draw = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(knee.ligaments.names)))
    strain = np.clip(np.asarray(knee.reference_strain()) + 0.01 * percent * draw, -0.5, 1.0)
    length = np.asarray(knee.reference_length())
    return np.array(ligament_law.slack_length_from_strain(length, strain))


def at(rows, knees: Followed) -> Followed:
    """Some of the knees."""
    return Followed(*(x[rows] for x in knees))


def put(rows, knees: Followed, some: Followed) -> None:
    """Write some of the knees down, in place."""
    for old, new in zip(knees, some, strict=True):
        old[rows] = new


def solved(knee: Knee, knees: Followed, flexion: float, q: np.ndarray) -> Followed:
    """Every knee by itself near a pose; the reference pose where it is NaN."""
    near = q[:, None], knees.points[:, None]
    found = balance_near(knee, with_slack, knees.slack, LoadCases.at([flexion]), *near)
    q, points, on = found.q[:, 0], found.contact_points[:, 0], found.converged[:, 0]
    return Followed(knees.slack, q, points, np.zeros_like(q), on)


def step(knee: Knee, knees: Followed, begin: float, end: float, divisions: int) -> None:
    """Take the knees that are on from one flexion to another, in place."""
    on = np.flatnonzero(knees.on)
    if not len(on):
        return
    before = at(on, knees)
    expected = before.q + (end - begin) * before.slope
    there = solved(knee, before, end, expected)
    there = there._replace(slope=(there.q - before.q) / (end - begin))
    good = there.on & (np.linalg.norm((there.q - expected) / UNITS, axis=-1) < _NEAR_MM)
    put(on[good], knees, at(good, there))
    some, places = at(~good, before), np.linspace(begin, end, _PARTS + 1)
    if divisions:
        for one, other in zip(places[:-1], places[1:], strict=True):
            step(knee, some, one, other, divisions - 1)
    else:
        some.on[:] = False
    put(on[~good], knees, some)


def in_tiny_steps(knee: Knee, slack: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses of all knees at `ANGLES`, NaN where they are lost, `(knees, angles, free)`; and whether
    they balance at the reference, the first angle."""
    grid = np.linspace(ANGLES[0], ANGLES[-1], parts * (len(ANGLES) - 1) + 1)
    count, lost = len(slack), np.full((len(slack), len(UNITS)), np.nan)
    points = np.full((count, knee.patch_count, 2), np.nan)
    knees = Followed(slack, lost.copy(), points, np.zeros_like(lost), np.zeros(count, bool))
    first, begins = np.full(count, len(grid)), jax.tree.map(np.copy, knees)
    poses = np.full((count, len(ANGLES), len(UNITS)), np.nan)
    for place, flexion in enumerate(grid):
        if place:
            step(knee, knees, grid[place - 1], flexion, _DIVISIONS)
        waiting = np.flatnonzero(first == len(grid))
        found = solved(knee, at(waiting, begins), flexion, lost[waiting])
        for some in (knees, begins):
            put(waiting[found.on], some, at(found.on, found))
        first[waiting[found.on]] = place
        if place % parts == 0:
            poses[knees.on, place // parts] = knees.q[knees.on]
    knees = begins._replace(on=np.zeros(count, bool))
    for place in range(len(grid) - 2, -1, -1):
        knees.on[first == place + 1] = True
        step(knee, knees, grid[place + 1], grid[place], _DIVISIONS)
        if place % parts == 0:
            poses[knees.on, place // parts] = knees.q[knees.on]
    return poses, first == 0


def main() -> None:
    options = arguments("branches", __doc__, knees=512, percent=10, parts=10, seed=5)
    knee = load(options.knee)
    slack = random_slack(knee, options.knees, options.percent, options.seed)
    found = balance_many(knee, with_slack, slack, LoadCases.at(ANGLES))
    begun = time.perf_counter()
    poses, at_reference = in_tiny_steps(knee, slack, options.parts)
    tiny, known = np.isfinite(poses).all(axis=-1), found.converged
    apart = np.linalg.norm((found.q - poses) / UNITS, axis=-1)
    rows: dict[str, object] = {"poses": tiny.size, "seconds": time.perf_counter() - begun}
    for words, knees in (("", slice(None)), ("_from_reference", at_reference)):
        total = tiny[knees].sum()
        rows |= {
            f"tiny_steps_find{words}": total,
            f"batch_finds_percent{words}": 100.0 * (tiny & known)[knees].sum() / total,
            f"same_branch_percent{words}": 100.0 * (apart[knees] < _SAME_MM).sum() / total,
            f"batch_alone_finds{words}": (known & ~tiny)[knees].sum(),
        }
    finish(options.out, "Poses of tiny steps that a batch finds", rows)


if __name__ == "__main__":
    main()
