"""A quadriceps of given length: its pull is the multiplier of that length, and a result.

In the balance stands the cable of a motor (`kneejax.mechanics.Cable`), as through time. It
stretches by what its pull differs from what it expects; a balance whose pull is what was expected
has the given length itself, and a few balances lead there, each expecting the pull of the last.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import scales
from kneejax.mechanics import Cable, Knee, add_lane_axis
from kneejax.numerics import compiled, lanes_for
from kneejax.statics import Equilibrium, Guess, LoadCases, differentiable, solve_equilibrium

#: N; a cable that is slack still pulls a rounding of 0.05.
SLACK_N = 0.1
#: A cable expects the pull of the last balance: so often at most, until it changes by less, N.
_MOST_TIMES, _SAME_N = 8, 1e-7
#: How much a length changes from balance to balance on the way, mm, and how far a balance may lie
#: from where it is expected, mm (rotations at 30 mm): one branch is smooth.
_STRIDE_MM, _MISSED_MM = 0.25, 2.0


class OnCable(NamedTuple):
    """Balances under a quadriceps of given length.

    Attributes:
        equilibrium: poses of all bones; NaN where a search failed.
        pull: of the cable, `(lanes,)`, N, which comes to what the heads have at rest.
    """

    equilibrium: Equilibrium
    pull: Array


def drawn(knee: Knee, load_cases: LoadCases, length: Array, expected: Array) -> Knee:
    """A knee in lanes whose quadriceps hangs on a cable.

    Args:
        knee: of three bones.
        load_cases: what is prescribed and acts besides.
        length: of the quadriceps, `(lanes,)`, mm.
        expected: pull at which the cable has that length, `(lanes,)`, N.
    """
    lanes = load_cases.load(add_lane_axis(knee))
    assert lanes.muscles is not None
    muscles = dataclasses.replace(lanes.muscles, cable=Cable(length, expected))
    return dataclasses.replace(lanes, muscles=muscles)


def balanced(knee: Knee, load_cases: LoadCases, length: np.ndarray, near: OnCable) -> OnCable:
    """Balances near others, of quadriceps that are as long as they are told to be."""
    # Filled up: another number of lanes is no other program.
    rows = np.minimum(np.arange(lanes_for(len(length))), len(length) - 1)
    load_cases, long = load_cases.of(knee).take(rows), jnp.asarray(length)[rows]
    found = jax.tree.map(lambda x: x[..., rows], near)
    for _ in range(_MOST_TIMES):
        equilibrium, pull = found
        lanes = drawn(knee, load_cases, long, pull)
        guess = Guess(equilibrium.q, equilibrium.contact_points)
        again = solve_equilibrium(lanes, load_cases.prescribed, guess)
        comes = _pull(lanes, again)
        found = OnCable(again, jnp.where(jnp.isfinite(comes), comes, pull))
        if not (jnp.abs(found.pull - pull) > _SAME_N).any():
            break
    return jax.tree.map(lambda x: x[..., : len(length)], found)


def drawn_to(
    knee: Knee, load_cases: LoadCases, rest: np.ndarray, longer: np.ndarray, start: OnCable
) -> OnCable:
    """Balances of quadriceps that are drawn from where they are at rest, in strides.

    Each lane has strides of its own and depends on no other.

    Args:
        knee: of three bones.
        load_cases: what is prescribed and acts besides.
        rest: length at the start, `(lanes,)`, mm.
        longer: by how much it is to be longer, or shorter where it is negative, `(lanes,)`, mm.
        start: the balances there.
    """
    units = np.array(scales(load_cases.of(knee).free))[:, None]
    before, here, lost = start, start, np.zeros(len(longer), bool)
    for k in range(int(np.ceil(np.abs(longer).max(initial=0.0) / _STRIDE_MM))):
        way = np.sign(longer) * np.minimum((k + 1) * _STRIDE_MM, np.abs(longer))
        last = np.sign(longer) * np.minimum(k * _STRIDE_MM, np.abs(longer))
        part = np.abs(way - last) / _STRIDE_MM if k else np.zeros(len(longer))
        ahead = jax.tree.map(
            lambda new, old, part=part: new + part * (new - old),
            (here.equilibrium.q, here.pull), (before.equilibrium.q, before.pull),
        )  # fmt: skip
        near = OnCable(
            dataclasses.replace(here.equilibrium, q=ahead[0]), jnp.maximum(ahead[1], 0.0)
        )
        before, here = here, balanced(knee, load_cases, rest + way, near)
        away = np.abs(np.asarray(here.equilibrium.q - ahead[0]) / units).max(axis=0)
        lost |= (way != last) & ~(away <= _MISSED_MM)
    equilibrium = dataclasses.replace(
        here.equilibrium, q=jnp.where(lost, jnp.nan, here.equilibrium.q)
    )
    return OnCable(equilibrium, jnp.where(lost, jnp.nan, here.pull))


def with_derivatives(knee: Knee, load_cases: LoadCases, length: Array, found: OnCable) -> OnCable:
    """The same balances as a function of the knee, of what is prescribed and of the length.

    The pull is where the one that comes out is the one that was expected: from there a step by the
    slope at the root has the first derivative of that, and two have the second as well.
    """
    still = jax.lax.stop_gradient(found)
    known = jax.lax.stop_gradient((knee, load_cases, length))
    more = (jnp.ones_like(still.pull),)
    _, comes = jax.jvp(lambda x: _followed(*known, still, x)[1], (still.pull,), more)
    pull = still.pull
    for _ in range(2):
        left = _followed(knee, load_cases, length, still, pull)[1] - pull
        pull = pull + left / (1.0 - jax.lax.stop_gradient(comes))
    return OnCable(_followed(knee, load_cases, length, still, pull)[0], pull)


@compiled()
def _followed(
    knee: Knee, load_cases: LoadCases, length: Array, found: OnCable, expected: Array
) -> tuple[Equilibrium, Array]:
    lanes = drawn(knee, load_cases, length, expected)
    equilibrium = differentiable(lanes, load_cases.prescribed, found.equilibrium)
    return equilibrium, _pull(lanes, equilibrium)


@compiled()
def _pull(lanes: Knee, equilibrium: Equilibrium) -> Array:
    """Of the cable, N."""
    assert lanes.muscles is not None and lanes.muscles.cable is not None
    return lanes.muscles.cable.pull(lanes.muscles.quadriceps_length(equilibrium.state))
