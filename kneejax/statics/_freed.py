"""Coordinates that are prescribed or freed in a loaded knee.

A displacement is tested like a load: the knee is bent and loaded first, then the machine takes hold
of a coordinate where it is and moves it to where it is wanted, along a straight line. A flexion
that is to be free is supported where the knee was loaded, and the support is taken away.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import State
from kneejax.mechanics import Knee, Support
from kneejax.numerics import compiled
from kneejax.statics._balance import force_along
from kneejax.statics._batch import LANES, follow_in_chunks
from kneejax.statics._continuation import Behind
from kneejax.statics._equilibria import Equilibria
from kneejax.statics._load_cases import Case, LoadCases, Variants, in_rows
from kneejax.statics._status import SOFT, Status, gives_way


def freed(variants: Variants, load_cases: LoadCases, before: Equilibria) -> Equilibria:
    """Move balances of the same variants at `load_cases.loaded()` to these load cases, with forces
    and stiffness; where there is none before, there is none. `reached` is the part of the way that
    the knee followed."""
    free, knee = load_cases.free, variants.knee
    found = Equilibria.nothing(before.status.shape, load_cases, knee.patch_count, True)
    found.status[:], found.fault[:] = before.status, before.fault
    found.steps[:], found.reached[:] = before.steps, before.reached
    node = np.nonzero(before.converged)
    count = len(node[0])
    if not count:
        return found
    wanted = jax.tree.map(lambda x: np.asarray(x)[node[1]], load_cases.plain())
    numbers = {leaf: x[node[0]] for leaf, x in variants.numbers.items()}
    q, contact_points = (np.moveaxis(x[node], 0, -1) for x in (before.q, before.contact_points))
    released = tuple(name for name in free if name in wanted.loaded().prescribed)
    own, force = _at_rest(knee, numbers, wanted, q, contact_points, released)
    at = dict(zip((*wanted.prescribed, *free), own, strict=True))
    ends, begins = (
        dataclasses.replace(wanted, supports=tuple(map(Support, forces, released)))
        for forces in (np.zeros_like(force), force)
    )
    begins = dataclasses.replace(
        begins,
        prescribed={name: at[name] for name in wanted.prescribed},
        loads=jax.tree.map(np.asarray, wanted.loaded().loads),
    )
    rows = np.stack([in_rows((numbers, place), 1) for place in (begins, ends)])
    like = Case(*jax.tree.map(lambda x: np.zeros(x.shape[1:]), (numbers, begins)))
    own = np.stack([at[name] for name in free])
    behind = Behind.at(rows[0].T, own, contact_points, np.ones(count, int))
    softness = np.full(count, np.nan)

    def note(path: np.ndarray, place: np.ndarray, record: dict) -> None:
        # The balance that is known is found once more in its new coordinates: how stiff they are.
        at_rest = place == 0
        softness[path[at_rest]] = record["softness"][at_rest]
        over = ~at_rest | (record["status"] >= Status.TOO_DEEP)
        record = {name: x[..., over] for name, x in record.items()}
        record["way"] = np.where(at_rest[over], 0.0, record["way"])
        found.note(tuple(x[path[over]] for x in node), record)

    both = np.full(count, 2)
    follow_in_chunks(knee, like, lambda path, place: rows[place, path], both, behind, 1, note)
    lost = ~found.converged[node]
    soft = found.softness[node] < SOFT * softness
    blocked = gives_way(lost, found.reached[node], soft, found.fault[node])
    found.status[node] = np.where(blocked, int(Status.GIVES_WAY), found.status[node])
    return found


def _at_rest(
    knee: Knee, numbers, wanted: LoadCases, q, contact_points, released: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """All coordinates where nodes begin, in the order of prescribed and free ones, and the forces
    that support those to be freed; as many nodes a call as there are lanes."""
    parts, count = [], q.shape[-1]
    for first in range(0, count, LANES):
        rows = np.minimum(np.arange(first, first + LANES), count - 1)
        case = jax.tree.map(lambda x, rows=rows: np.moveaxis(x[rows], 0, -1), (numbers, wanted))
        parts.append(
            _beginning(knee, Case(*case), q[..., rows], contact_points[..., rows], released)
        )
    own, force = (np.concatenate(x, axis=-1)[:, :count] for x in zip(*parts, strict=True))
    return own, force


@compiled(static_argnums=(4,))
def _beginning(knee: Knee, case: Case, q, contact_points, released) -> tuple[Array, Array]:
    before = case.load_cases.loaded()
    state = State.of(before.prescribed, q, case.load_cases.bodies)
    own = state.at((*case.load_cases.prescribed, *case.load_cases.free))
    if not released:
        return own, jnp.zeros((0, q.shape[-1]))
    knees = Case(case.numbers, before).knees(knee)
    return own, force_along(knees, state, contact_points, released)
