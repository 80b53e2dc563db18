"""Operated knees followed from one graft to the next."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import CLINICAL, COORDINATES, FEMORAL, State, convert
from kneejax.mechanics import Knee, load_of
from kneejax.numerics import lanes_for
from kneejax.planning._reconstruction import Operated, Reconstruction
from kneejax.statics import (
    LoadCases,
    Progress,
    Slopes,
    balance_lines,
    balance_many,
    balance_with_slopes,
    converged,
)


class Poses(NamedTuple):
    """Balanced poses of variants at load cases."""

    q: np.ndarray  # free coordinates, `(v, s, free)`; NaN where forces do not balance
    status: np.ndarray  # `Status` values, `(v, s)`
    near: Slopes | None  # with derivatives, to predict others from; None where none were asked for


def balanced(
    plan: Reconstruction,
    values: np.ndarray,
    load_cases: LoadCases,
    *,
    slopes: bool = False,
    near: Slopes | None = None,
    grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> Poses:
    """Poses of variants `(v, numbers)` at load cases, with derivatives where `slopes`; from `near`
    ones, which have derivatives, where these are known.

    Variants that are near each other stand in a `grid` of rows and columns: each is then predicted
    from its neighbour, which takes two fifths of the time.
    """
    if slopes:
        found = near = balance_with_slopes(plan.knee, plan.vary, values, load_cases, near)
        q, status = found.q, found.status
    elif grid is None:
        near = None
        found = balance_many(plan.knee, plan.vary, values, load_cases, progress=progress)
        q, status = found.q, found.status
    else:
        near, (rows, columns) = None, grid
        along = functools.partial(balance_lines, plan.knee, plan.vary)
        lines, row, column = values.reshape(rows, columns, -1), rows // 2, columns // 2
        spine = along(lines[None, :, column], load_cases, np.array([row])).at(0)
        begin = np.full(rows, column)
        found = along(lines, load_cases, begin, near=spine, progress=progress)
        q, status = (x.reshape(-1, *x.shape[2:]) for x in (found.q, found.status))
    return Poses(np.where(converged(status)[..., None], q, np.nan), status, near)


#: Nodes whose readings are computed in one call.
_CHUNK = 8192


@dataclasses.dataclass(frozen=True)
class Protocol:
    """What a knee is put through.

    Attributes:
        extension_deg: flexions of the motion, in order, `(angles,)`.
        lachman_deg: flexions of the tests.
        force_N: anterior force of the tests.
        steps: in which it grows.

    Example:
        >>> protocol = Protocol(np.array([80.0, 0.0]), (20.0,), 100.0, steps=2)
        >>> protocol.flexion_deg.tolist(), protocol.force.tolist()
        ([80.0, 0.0, 20.0, 20.0, 20.0], [0.0, 0.0, 0.0, 50.0, 100.0])
    """

    extension_deg: np.ndarray
    lachman_deg: tuple[float, ...]
    force_N: float
    steps: int = 1

    @functools.cached_property
    def flexion_deg(self) -> np.ndarray:
        """Of all load cases: the motion, then each test from no load to the full one."""
        tests = np.repeat(self.lachman_deg, self.steps + 1)
        return np.r_[self.extension_deg, tests]

    @functools.cached_property
    def force(self) -> np.ndarray:
        """Anterior force at each load case, N."""
        grows = self.force_N * np.linspace(0.0, 1.0, self.steps + 1)
        nothing = np.zeros(len(self.extension_deg))
        return np.r_[nothing, np.tile(grows, len(self.lachman_deg))]

    @property
    def motion(self) -> slice:
        """Load cases of the motion."""
        return slice(0, len(self.extension_deg))

    @property
    def ends_of_tests(self) -> np.ndarray:
        """Load cases of each test without load, and under the full one, `(2, tests)`."""
        each = self.steps + 1
        first = len(self.extension_deg) + each * np.arange(len(self.lachman_deg))
        return np.stack([first, first + self.steps])

    @functools.cached_property
    def load_cases(self) -> LoadCases:
        """Where knees are balanced."""
        return LoadCases.at(self.flexion_deg, [load_of(anterior_N=self.force)])


@dataclasses.dataclass(frozen=True)
class Followed:
    """Balances of variants; arrays begin with variant and load case.

    Attributes:
        length_mm: of each fibre, `(v, s, fibres)`.
        strain: likewise.
        tension_N: likewise.
        anterior_mm: of the tibia along the floating axis of Grood and Suntay, `(v, s)`.
        status: `Status` values, `(v, s)`.
        slopes: of each of these by the numbers of the variants, by name,
            `(v, s, fibres or 1, numbers)`; None where none were asked for.
        near: balances to predict others from; likewise.
    """

    length_mm: np.ndarray
    strain: np.ndarray
    tension_N: np.ndarray
    anterior_mm: np.ndarray
    status: np.ndarray
    slopes: dict[str, np.ndarray] | None = None
    near: Slopes | None = None

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(v, s)`."""
        return converged(self.status)


def follow(
    plan: Reconstruction,
    values: np.ndarray,
    protocol: Protocol,
    *,
    slopes: bool = False,
    near: Slopes | None = None,
    grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> Followed:
    """Put variants through a protocol.

    Args:
        plan: the knee and its grafts.
        values: numbers of the variants, `(v, numbers)`.
        protocol: flexions and loads.
        slopes: whether derivatives are wanted.
        near: of near variants, to begin from.
        grid: rows and columns in which the variants stand, see `balanced`.
        progress: called now and then with balances done and asked for.

    Returns:
        What was read; NaN where a knee has no balance.
    """
    q, status, near = balanced(
        plan, values, protocol.load_cases, slopes=slopes, near=near, grid=grid, progress=progress
    )
    count, size = q.shape[:2]
    flexion, nodes, parts = np.deg2rad(protocol.flexion_deg), np.arange(count * size), []
    for first in range(0, len(nodes), _CHUNK):
        own = nodes[first : first + _CHUNK]
        rows = own[np.minimum(np.arange(lanes_for(len(own))), len(own) - 1)]
        here = values[rows // size], flexion[rows % size], q.reshape(-1, q.shape[-1])[rows]
        reader = _read_with_slopes if slopes else _read
        found, kept = reader(plan.vary, plan.knee, *here), slice(0, len(own))
        parts.append(jax.tree.map(lambda x, kept=kept: np.asarray(x)[kept], found))
    read = jax.tree.map(
        lambda *x: np.concatenate(x).reshape(count, size, *x[0].shape[1:]), *parts
    )
    by_value = None
    if near is not None:
        by_value = {
            name: own + by_pose @ near.jacobian for name, (own, by_pose) in read.pop("by").items()
        }
    return Followed(**read, status=status, slopes=by_value, near=near)


def _one(vary: Operated, knee: Knee, value: Array, flexion: Array, q: Array) -> dict[str, Array]:
    """What is read of one balance."""
    ligaments = vary(knee, value).ligaments
    length = ligaments.length(State.of({"flexion": flexion}, q, knee.bodies))
    every = convert(jnp.concatenate([flexion[None], q]), FEMORAL, CLINICAL)
    return {
        "length_mm": length,
        "strain": length / ligaments.slack_length - 1.0,
        "tension_N": ligaments.tension_at(length),
        "anterior_mm": every[list(COORDINATES).index("anterior")],
    }


@functools.partial(jax.jit, static_argnums=0)
def _read(vary: Operated, knee: Knee, values, flexion, q):
    return jax.vmap(lambda *x: _one(vary, knee, *x))(values, flexion, q)


@functools.partial(jax.jit, static_argnums=0)
def _read_with_slopes(vary: Operated, knee: Knee, values, flexion, q):
    def both(value: Array, flexion: Array, q: Array):
        found = _one(vary, knee, value, flexion, q)
        slopes = jax.jacfwd(lambda x, p: _one(vary, knee, x, flexion, p), (0, 1))(value, q)
        by = {name: tuple(map(jnp.atleast_2d, pair)) for name, pair in slopes.items()}
        return found | {"by": by}

    return jax.vmap(both)(values, flexion, q)
