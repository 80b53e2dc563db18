"""Measured poses, tests under load, and what was read of parts, as load cases of one fit."""

__all__ = ["check_readable", "observations", "rows_of_tests", "synthetic_motion"]

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments import MeasuredTest, counts_like_poses
from kneejax.geometry import COORDINATES, FREE_COORDINATES, OTHER_COLUMNS, State
from kneejax.inference.fit._cut import without
from kneejax.inference.fit._observed import Observations, without_mean
from kneejax.mechanics import NAMED_LOADS, Knee, Load, Pull, load_of, pull_of
from kneejax.numerics import compiled, on_all_cores, safe_sqrt
from kneejax.parameters import Selection, UnknownParameter, UnsuitableData, fibre_rows
from kneejax.quantities import nearest_name
from kneejax.statics import LoadCases, Slopes, Vary, balance_one, in_lanes


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
    """Constant loads, pulls of lines and loads that grow, `(count,)` each, zero elsewhere."""
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
) -> "Readings | None":
    """What tests read of ligaments and contacts, in the order of tests, names and rows; None
    without any."""
    names = tuple(dict.fromkeys(name for test in tests for name in test.readings))
    check_readable(knee, names)
    found, groups = [], 0
    for test, place in zip(tests, rows_of_tests(poses, tests), strict=True):
        _, counted = _seen(test, place.start)
        weight = np.ones(len(counted)) if test.weight is None else test.weight
        none = np.full(len(counted), -1)
        for name, sizes in test.readings.items():
            seen, sd, rest, own = sizes, test.sd_of(name), none, none
            if counts_like_poses(name):
                seen, sd = _from_partners(test, sizes), sd * test.scatter
                rest, own = counted, test.groups
            rows = np.flatnonzero(np.isfinite(seen) & (weight > 0))
            sd, own = sd / np.sqrt(weight[rows]), own[rows]
            kind = np.full(len(rows), names.index(name))
            group = np.where(own < 0, -1, own + groups)
            groups += 1 + int(own.max(initial=-1))
            found.append((kind, place.start + rows, rest[rows], seen[rows], sd, group))
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
    """What was observed, less that of the row it is counted from, NaN in one of a pair."""
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


#: Lanes of a call, as of the derivatives of balances.
_LANES = 128
#: What is read: its kind, and the rows of the fibres, the row of the contact, or none of a
#: coordinate, whose kind is its column.
_Asked = tuple[str, tuple[int, ...]]


@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """What was read of ligaments and contacts, and where other bones were, a number each."""

    knee: Knee  # gives everything that is not free
    selection: Selection  # the free parameters
    # What can be read, `PART.KIND` of `kneejax.experiments.READINGS`, or the column of another
    # bone's coordinate.
    names: tuple[str, ...]
    name: np.ndarray  # which of these each number is of, `(r,)`
    case: np.ndarray  # its load case, `(r,)`
    neutral: np.ndarray  # load case from which it is counted, `(r,)`, -1 where it counts as it is
    target: np.ndarray  # what was read, `(r,)`, N, strain, degrees or mm
    sd: np.ndarray  # its standard deviation, `(r,)`
    # Numbers that are off by one unknown constant share a number, `(r,)`; -1 where there is none.
    group: np.ndarray

    def __len__(self) -> int:
        return len(self.target)

    def counted(self, cases: Observations) -> np.ndarray:
        """Of which numbers the load case counts, and the one that it is counted from, `(r,)`."""
        zero = np.where(self.neutral >= 0, self.neutral, self.case)
        return cases.used[self.case] & cases.used[zero]

    def error(self, cases: Observations, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Knee minus what was read, the best unknown constants taken out, `(fits, r)`, and by the
        values, `(fits, r, p)`; zero where the load case does not count."""
        counts, counted = self.neutral >= 0, self.counted(cases)
        zero = np.where(counts, self.neutral, self.case)
        shape = len(found.values), len(cases.load_cases), len(self.names)
        at, slope = np.full(shape, np.nan), np.full((*shape, found.values.shape[1]), np.nan)
        asked = tuple(_asked(self.knee, name) for name in self.names)
        rows = np.unique(np.r_[self.case, zero])
        for number, names in enumerate(cases.cuts):
            own = rows[cases.cut[rows] == number]
            if len(own):
                knee, vary = without(self.knee, self.selection, names)
                there = cases.load_cases.of(knee).take(own).plain()
                pair = _read_all(asked, vary, knee, len(self.selection), there, found.at(own))
                at[:, own], slope[:, own] = pair
        own, rest = ((slice(None), rows, self.name) for rows in (self.case, zero))
        value = at[own] - np.where(counts, at[rest], 0.0)
        slope = slope[own] - np.where(counts[:, None], slope[rest], 0.0)
        error = np.where(counted, value - self.target, 0.0)
        slope = np.where(counted[:, None], slope, 0.0)
        for group in np.unique(self.group[self.group >= 0]):
            own = counted & (self.group == group)
            without_mean(error, slope, np.where(own, self.sd**-2.0, 0.0))
        return error, slope


def _asked(knee: Knee, name: str) -> _Asked:
    """What is to be computed of a ligament, a contact or a bone; raises of an unknown name."""
    if name in OTHER_COLUMNS:
        bone = OTHER_COLUMNS[name].body
        if bone not in knee.bodies:
            raise UnknownParameter(
                f"knee {knee.name!r} has no {bone}, whose {name} was read: expected `{bone}: true` "
                "in the study, or a knee of three bones"
            )
        return name, ()
    part, _, kind = name.rpartition(".")
    if kind != "contact_N":
        return kind, tuple(fibre_rows(knee, part))
    if part not in knee.contact_names:
        near = nearest_name(part, knee.contact_names)
        known = ", ".join(knee.contact_names)
        end = f"; did you mean {near!r}?" if near else f": expected one of {known}"
        raise UnknownParameter(f"knee {knee.name!r} has no contact {part!r}{end}")
    return kind, (knee.contact_names.index(part),)


def check_readable(knee: Knee, names) -> None:
    """Refuse (`UnknownParameter`, with the nearest name) readings of what a knee does not have."""
    for name in names:
        _asked(knee, name)


def _read_all(asked, vary: Vary, knee: Knee, free: int, load_cases: LoadCases, found: Slopes):
    """Readings of all variants, `(variants, load_cases, names)`, and by the values."""
    fits, size = found.values.shape
    count = len(load_cases)
    in_nodes = [
        x.reshape(fits * count, *x.shape[2:])
        for x in (found.q, found.contact_points, found.jacobian)
    ]

    def some(first: int):
        rows = np.minimum(np.arange(first, first + _LANES), fits * count - 1)
        there = jax.tree.map(lambda x: np.asarray(x)[rows % count], load_cases)
        q, contact_points, moved = (np.moveaxis(x[rows], 0, -1) for x in in_nodes)
        values = found.values[rows // count, :free]
        at = values, there, q, contact_points, np.moveaxis(moved, -2, 0)
        return tuple(map(np.asarray, _read(asked, vary, knee, *at)))

    parts = on_all_cores(some, range(0, fits * count, _LANES))
    whole = (np.concatenate(x, axis=-1) for x in zip(*parts, strict=True))
    value, slope = (x[..., : fits * count] for x in whole)
    shape = fits, count, len(asked)
    return value.T.reshape(shape), np.moveaxis(slope, 0, -1).swapaxes(0, 1).reshape(*shape, size)


@compiled(static_argnums=(0, 1))
def _read(asked, vary: Vary, knee: Knee, values, load_cases: LoadCases, q, contact_points, moved):
    """Readings `(names, lanes)`, and in each direction of the values, `(p, names, lanes)`."""

    def at(values: Any, q: Array) -> Array:
        lanes = load_cases.load(in_lanes(knee, vary, values))
        state = State.of(load_cases.prescribed, q, load_cases.bodies)
        length = lanes.ligaments.length(state)
        springs = length / lanes.ligaments.slack_length - 1.0, lanes.ligaments.tension_at(length)
        return jnp.stack([_one(lanes, state, contact_points, springs, *each) for each in asked])

    read, push = jax.linearize(at, values, q)
    # Lanes do not touch each other. Values beyond the parameters are constants between frames.
    units = jnp.eye(len(moved), values.shape[1])[:, None]
    units = jnp.broadcast_to(units, (len(moved), *values.shape))
    return read, jax.vmap(push)(units, moved)


def _one(
    lanes: Knee, state: State, contact_points: Array, springs, kind: str, rows: tuple[int, ...]
):
    if kind in OTHER_COLUMNS:
        place = OTHER_COLUMNS[kind]
        return state.at([place.name])[0] * place.table_unit
    strain, tension = springs
    if kind == "strain":
        return jnp.mean(strain[jnp.array(rows)], axis=0)
    if kind == "tension_N":
        return jnp.sum(tension[jnp.array(rows)], axis=0)
    contact = lanes.contacts[rows[0]]
    there = state.between(contact.bodies)
    if contact.has_patch:
        patch = sum(one.has_patch for one in lanes.contacts[: rows[0]])
        force = contact.press(there, contact_points[patch]).wrench.force
    else:
        force = contact.wrench(there).force
    return safe_sqrt(sum(x * x for x in force))
