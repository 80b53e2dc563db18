"""Forces and strains of a knee's parts, and poses of its other bones, beside those of the tibia."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import OTHER_COLUMNS, State
from kneejax.inference.fit._cut import without
from kneejax.inference.fit._observed import Observations, without_mean
from kneejax.mechanics import Knee
from kneejax.numerics import compiled, on_all_cores, safe_sqrt
from kneejax.parameters import Selection, UnknownParameter, fibre_rows
from kneejax.quantities import nearest_name
from kneejax.statics import LoadCases, Slopes, Vary, in_lanes

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
        at, slope = self._at_cases(cases, found, np.unique(np.r_[self.case, zero]))
        own, rest = ((slice(None), rows, self.name) for rows in (self.case, zero))
        value = at[own] - np.where(counts, at[rest], 0.0)
        slope = slope[own] - np.where(counts[:, None], slope[rest], 0.0)
        error = np.where(counted, value - self.target, 0.0)
        slope = np.where(counted[:, None], slope, 0.0)
        for group in np.unique(self.group[self.group >= 0]):
            own = counted & (self.group == group)
            without_mean(error, slope, np.where(own, self.sd**-2.0, 0.0))
        return error, slope

    def _at_cases(self, cases: Observations, found: Slopes, rows: np.ndarray):
        """All that can be read at some load cases, `(fits, cases, names)`, and by the values; NaN
        at the others."""
        fits, size = found.values.shape
        shape = fits, len(cases.load_cases), len(self.names)
        value, slope = np.full(shape, np.nan), np.full((*shape, size), np.nan)
        asked = tuple(_asked(self.knee, name) for name in self.names)
        for number, names in enumerate(cases.cuts):
            own = rows[cases.cut[rows] == number]
            if len(own):
                knee, vary = without(self.knee, self.selection, names)
                there = cases.load_cases.of(knee).take(own).plain()
                pair = _read_all(asked, vary, knee, len(self.selection), there, found.at(own))
                value[:, own], slope[:, own] = pair
        return value, slope


def _asked(knee: Knee, name: str) -> _Asked:
    """What is to be computed of a ligament, a contact or a bone; raises of a name that there is
    not."""
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
    """What is read of all variants at all load cases, `(variants, load_cases, names)`, and by the
    values."""
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
