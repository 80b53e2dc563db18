"""Measured poses and measured tests under load, as the load cases of one fit."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.experiments import MeasuredTest, counts_like_poses
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference.fit._observed import Observations
from kneejax.inference.fit._readings import Readings, check_readable
from kneejax.mechanics import NAMED_LOADS, Knee, Load, Pull, load_of, pull_of
from kneejax.parameters import Selection, UnsuitableData
from kneejax.statics import LoadCases, balance_one


def observations(
    measured: np.ndarray,
    noise: np.ndarray,
    loads: Sequence[Load] = (),
    tests: Sequence[MeasuredTest] = (),
    stated: np.ndarray | None = None,
) -> Observations:
    """What was measured of a knee: poses as they are, then what tests under load observed.

    Each test brings its rows and, where it counts from them, an unloaded pose per flexion, at
    which nothing is observed. Arguments are those of `Problem.of`, with standard deviations in
    place of weights; `stated` are those that are known, infinite for a coordinate that does not
    count, and `noise` by default.

    Raises:
        UnsuitableData: a test states how well it was measured and the poses do not.

    Example:
        >>> import kneejax as kj
        >>> (test,) = kj.lab_tests("drawer", [0.0, 30.0], steps=2)
        >>> (curves,) = kj.load_curves(kj.load_knee("four_ligament"), test)
        >>> cases = observations(np.zeros((0, 6)), np.ones(5), tests=[kj.MeasuredTest.of(curves)])
        >>> len(cases.load_cases), cases.neutral.tolist()
        (8, [6, 6, 6, 7, 7, 7, -1, -1])
    """
    measured = np.asarray(measured, float).reshape(-1, 6)
    poses, places = len(measured), rows_of_tests(len(measured), tests)
    flexion = np.concatenate(
        [measured[:, 0], *(x for test in tests for x in (test.bent_deg, _unloaded(test)))]
    )
    count = len(flexion)
    blocks = [slice(*ends) for ends in itertools.pairwise([*(x.start for x in places), count])]
    # What tests had cut, each once; first of all nothing.
    cuts = tuple(dict.fromkeys([(), *(test.cut for test in tests)]))
    target, spread = np.full((count, 5), np.nan), np.ones((count, 5))
    target[:poses] = measured[:, 1:]
    neutral, group, cut = np.full(count, -1), np.full(count, -1), np.zeros(count, int)
    for test, rows, block in zip(tests, places, blocks, strict=True):
        target[rows], neutral[rows] = _seen(test, rows.start)
        group[rows] = np.where(test.groups < 0, -1, test.groups + 1 + group.max())
        spread[block] = _spread(test, noise if stated is None else stated)
        if test.weight is not None:
            spread[rows] /= np.sqrt(np.where(test.weight > 0, test.weight, 1.0))[:, None]
        cut[block if test.counted_from != "intact" else rows] = cuts.index(test.cut)
    acting = _acting(tests, places, blocks, count)
    after = (0, count - poses), (0, 0)
    own = (jax.tree.map(lambda x: np.pad(x, after), one.at_each((poses,))) for one in loads)
    return Observations(
        LoadCases.at(flexion, (*own, *acting)), target, noise, clinical=np.arange(count) >= poses,
        neutral=neutral, group=group, spread=spread, cuts=cuts, cut=cut,
    )  # fmt: skip


def _acting(
    tests: Sequence[MeasuredTest], places: Sequence[slice], blocks: Sequence[slice], count: int
) -> list[Load | Pull]:
    """What acts throughout, what lines pull and what grows, at the rows and the unloaded poses of
    tests: a load for each of the axes, zero where others act."""
    point = np.zeros((count, 3))
    for test, block in zip(tests, blocks, strict=True):
        point[block] = test.point_mm

    def along(rows: Sequence[slice], sizes: Iterable[Any]) -> np.ndarray:
        found = np.zeros(count)
        for own, size in zip(rows, sizes, strict=True):
            found[own] = size
        return found

    def loads(rows: Sequence[slice], given: Sequence[Mapping[str, Any]]) -> list[Load]:
        found = []
        for way in dict.fromkeys(test.axes for test in tests):
            own = [x if test.axes == way else {} for test, x in zip(tests, given, strict=True)]
            sizes = {x: along(rows, (one.get(x, 0.0) for one in own)) for x in NAMED_LOADS}
            found.append(load_of(**sizes, point=point, axes=way))
        return found

    constant = loads(blocks, [test.constant for test in tests])
    pulls = [
        pull_of(line, along(places, (test.tensions.get(line, 0.0) for test in tests)))
        for line in dict.fromkeys(line for test in tests for line in test.tensions)
    ]
    grown = loads(places, [test.loads for test in tests])
    return [*(one for one in constant if one.sizes.any()), *pulls, *grown]


def readings_of(
    knee: Knee, selection: Selection, poses: int, tests: Sequence[MeasuredTest]
) -> Readings | None:
    """What tests read of ligaments and contacts, in the order of tests, names and rows, as
    observations after those of so many poses; None without any."""
    names = tuple(dict.fromkeys(name for test in tests for name in test.readings))
    check_readable(knee, names)
    found, groups = [], 0
    for test, place in zip(tests, rows_of_tests(poses, tests), strict=True):
        _, counted = _seen(test, place.start)
        weight = np.ones(len(counted)) if test.weight is None else test.weight
        for name, sizes in test.readings.items():
            like_poses = counts_like_poses(name)
            seen = _from_partners(test, sizes) if like_poses else sizes
            rows = np.flatnonzero(np.isfinite(seen) & (weight > 0))
            sd = test.sd_of(name) / np.sqrt(weight[rows])
            sd *= test.scatter if like_poses else 1.0
            rest = counted[rows] if like_poses else np.full(len(rows), -1)
            kind = np.full(len(rows), names.index(name))
            own = test.groups[rows] if like_poses else np.full(len(rows), -1)
            group = np.where(own < 0, -1, own + groups)
            groups += 1 + int(own.max(initial=-1))
            found.append((kind, place.start + rows, rest, seen[rows], sd, group))
    if not found:
        return None
    return Readings(knee, selection, names, *map(np.concatenate, zip(*found, strict=True)))


def rows_of_tests(poses: int, tests: Sequence[MeasuredTest]) -> list[slice]:
    """Load cases of each test's rows, after so many poses."""
    found, first = [], poses
    for test in tests:
        found.append(slice(first, first + len(test.flexion_deg)))
        first += len(test.flexion_deg) + len(_unloaded(test))
    return found


def _unloaded(test: MeasuredTest) -> np.ndarray:
    """Flexions whose unloaded pose is counted from, degrees."""
    return np.unique(test.flexion_deg) if test.counts_from_rest else np.empty(0)


def _seen(test: MeasuredTest, first: int) -> tuple[np.ndarray, np.ndarray]:
    """What a test's rows, of which one stands `first`, observed, and what each is counted from."""
    bare, rows = _unloaded(test), len(test.flexion_deg)
    partner, seen = test.partner, _from_partners(test, test.observed)
    counted = np.where(partner >= 0, first + partner, -1)
    if len(bare):
        counted = first + rows + np.searchsorted(bare, test.flexion_deg)
    if test.counted_from == "opposite":
        counted[partner == np.arange(rows)] = -1
    if test.weight is not None:
        seen[test.weight == 0] = np.nan
    return seen, counted


def _from_partners(test: MeasuredTest, observed: np.ndarray) -> np.ndarray:
    """What was observed, counted from the rows that a test counts from: zero in those themselves,
    NaN in one that a single other is counted from."""
    seen, partner = observed.copy(), test.partner
    paired = partner >= 0
    seen[paired] -= observed[partner[paired]]
    if test.counted_from == "opposite":
        seen[partner == np.arange(len(partner))] = np.nan
    return seen


def _spread(test: MeasuredTest, stated: np.ndarray) -> np.ndarray:
    """Times the coordinates' noise that a test's rows have, `(5,)`."""
    spread = np.ones(5)
    for unit, sd in (("mm", test.sd_mm), ("deg", test.sd_deg)):
        if sd is None:
            continue
        own = np.array([COORDINATES[name].unit == unit for name in FREE_COORDINATES])
        if np.isnan(stated[own]).any():
            raise UnsuitableData(
                f"{test.name}: sd_{unit} {sd:g}, but noise_{unit} is not stated: expected "
                f"noise_{unit} of the whole too, against which it is weighed"
            )
        spread[own] = np.where(np.isinf(stated[own]), 1.0, sd / stated[own])
    return spread * test.scatter


def synthetic_motion(
    knee: Knee,
    truth: dict[str, float],
    flexion_deg: np.ndarray,
    *,
    noise_mm: float = 0.0,
    noise_deg: float = 0.0,
    seed: int = 0,
    loads: Sequence[Load] = (),
) -> np.ndarray:
    """Balanced poses of a knee with known parameters, plus normal noise.

    Args:
        knee: any knee.
        truth: parameter -> value.
        flexion_deg: prescribed angles, `(n,)`.
        noise_mm: standard deviation of the noise on displacements.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.
        loads: on the tibia, each one for all poses or one per pose.

    Returns:
        `(n, 6)` in the order of `kneejax.geometry.COLUMNS`.

    Raises:
        UnsuitableData: where the knee with these parameters has no balance.
        Implausible: no knee has these parameters.
    """
    motion = balance_one(knee.replace(truth), LoadCases.at(flexion_deg, tuple(loads)))
    poses, balanced = motion.table[0], motion.converged[0]
    if not balanced.all():
        angles = ", ".join(f"{f:g}" for f in np.asarray(flexion_deg)[~balanced])
        raise UnsuitableData(f"the knee that makes the data has no balance at {angles} degrees")
    scatter = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm])
    noise = np.random.default_rng(seed).standard_normal((len(flexion_deg), 5))
    return np.column_stack([flexion_deg, poses + scatter * noise])
