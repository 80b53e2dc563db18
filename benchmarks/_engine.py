"""Motions of many knees: lanes are knees, angles follow each other by continuation.

The first pass gives every pose a handful of Newton steps from a quadratic prediction; the
poses that did not make it are gathered and searched again in smaller strides with a full budget.
So no lane waits for the slowest knee of its chunk.
"""

from __future__ import annotations

import concurrent.futures
import time
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee, add_lane_axis, ligament_law
from kneejax.statics import COMPILER_OPTIONS, Guess, first_guess, settle

#: Newton steps a pose may take when it is predicted, and when it is not.
QUICK, ROBUST = 7, 40
#: Poses on the way of a second search at most: what is farther is likely to have no balance.
_LONGEST_WAY = 6
compiled = partial(jax.jit, compiler_options=COMPILER_OPTIONS)


def random_knees(knee: Knee, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness from 300 to 9300 N and slack lengths for +-0.03 around the knee's reference
    strains, both `(ligaments, count)`."""
    draw = np.random.default_rng(seed)
    size = (len(knee.ligaments.names), count)
    stiffness = draw.uniform(300.0, 9300.0, size)
    strain = np.asarray(knee.reference_strain())[:, None] + draw.uniform(-0.03, 0.03, size)
    length = np.asarray(knee.reference_length())[:, None]
    return stiffness, np.asarray(ligament_law.slack_length_from_strain(length, strain))


def _predicted(known, own, now, before, older):
    past = np.where(known > 2, 2 * now - 3 * before + older, np.where(known > 1, now - before, 0.0))
    return own + now + past


def in_lanes(knee: Knee, stiffness: Array, slack_length: Array) -> Knee:
    """The knee with a lane axis: one lane a knee where numbers vary, length one elsewhere."""
    return eqx.tree_at(
        lambda k: (k.ligaments.stiffness, k.ligaments.slack_length),
        add_lane_axis(knee),
        (jnp.asarray(stiffness), jnp.asarray(slack_length)),
    )


@partial(compiled, static_argnums=6)
def search(knee: Knee, ligaments, flexion, guess: Guess, start, count, max_steps: int):
    """Poses of a chunk, one lane each, marching from a guess: the robust search."""
    found = settle(in_lanes(knee, *ligaments), flexion, guess, start, count, max_steps)
    return Guess(found.q, found.meeting), found.stable, found.steps


class Engine:
    """Motions of many knees that differ in stiffness and slack length.

    Attributes:
        angles: degrees.
        chunk: lanes of a call.
        threads: calls at a time.
    """

    def __init__(self, knee: Knee, angles, chunk: int = 1024, threads: int = 2):
        self.knee, self.chunk, self.threads = knee, chunk, threads
        self.angles = np.deg2rad(angles)
        own = [
            np.repeat(np.asarray(x)[:, None], chunk, axis=1)
            for x in (knee.ligaments.stiffness, knee.ligaments.slack_length)
        ]
        flexion = np.resize(self.angles, chunk)
        zero = jnp.full(chunk, knee.reference_pose.flexion)
        guess = jax.jit(first_guess)(add_lane_axis(knee), zero)
        found, _, _ = search(knee, own, flexion, guess, zero, self._count(self.angles[-1]), ROBUST)
        #: The knee's own motion: where searches begin that have nothing better.
        self.own = jax.tree.map(lambda x: np.asarray(x)[..., : len(self.angles)], found)

    def _count(self, way: float, degrees: float = 5.0) -> int:
        return int(np.ceil(np.abs(way) / np.deg2rad(degrees))) + 1

    def first_pass(self, rows: np.ndarray, stiffness, slack_length):
        """Poses `(angles, 5, knees)`, meeting points, stability and steps of some knees.

        Predicted is how far a knee is from the own motion: a parabola through three angles where
        it has them. A knee that was lost keeps its distance and is tried again at every angle.
        """
        full = np.resize(rows, self.chunk)  # a short chunk repeats its knees
        ligaments = (stiffness[:, full], slack_length[:, full])
        known, size = np.zeros(self.chunk, int), len(rows)
        zeros = jax.tree.map(lambda x: np.zeros((*x.shape[:-1], self.chunk)), self.own)
        now = before = older = zeros
        poses, others = [], []
        for k, angle in enumerate(self.angles):
            own = jax.tree.map(lambda x, k=k: x[..., k : k + 1], self.own)
            guess = jax.tree.map(partial(_predicted, known), own, now, before, older)
            flexion = np.full(self.chunk, angle)
            found, *rest = search(self.knee, ligaments, flexion, guess, flexion, 1, QUICK)
            found = jax.tree.map(np.asarray, found)
            good = np.isfinite(found.q[0])
            away = jax.tree.map(lambda x, o, n, g=good: np.where(g, x - o, n), found, own, now)
            now, before, older = away, now, before
            known = np.where(good, known + 1, 0)
            poses.append(jax.tree.map(lambda x: x[..., :size], found))
            others.append([np.asarray(x)[:size] for x in rest])
        q, meeting = np.stack([p.q for p in poses]), np.stack([p.meeting for p in poses])
        stable, steps = (np.stack(x) for x in zip(*others, strict=True))
        return q, meeting, stable, steps

    def second_pass(self, lanes, stiffness, slack_length, q, meeting):
        """Search again for single poses, marching from the same knee's nearest known pose."""
        angle, near, row = (np.resize(x, self.chunk) for x in lanes)
        known = np.isfinite(q[near, 0, row])
        near = np.where(known, near, angle)
        guess = Guess(
            np.where(known, q[near, :, row].T, self.own.q[:, angle]),
            np.where(
                known, np.moveaxis(meeting[near, :, :, row], 0, -1), self.own.meeting[..., angle]
            ),
        )
        here, start = self.angles[angle], self.angles[near]
        ligaments = (stiffness[:, row], slack_length[:, row])
        count = min(self._count(np.abs(here - start).max(), 2.0), _LONGEST_WAY)
        found, stable, steps = search(self.knee, ligaments, here, guess, start, count, ROBUST)
        size = len(lanes[0])
        return np.asarray(found.q)[:, :size], np.asarray(stable)[:size], np.asarray(steps)[:size]

    def _lost(self, good: np.ndarray) -> np.ndarray:
        """Lost poses: angle, nearest angle that is known, knee; those with a short way first."""
        angle, row = np.nonzero(~good)
        way = np.abs(np.arange(len(good))[:, None] - angle)
        way = np.where(good[:, row], way, len(good))
        order = np.argsort(way.min(axis=0), kind="stable")
        return np.stack([angle, way.argmin(axis=0), row])[:, order]

    def solve(self, stiffness, slack_length) -> dict:
        """Both passes over all knees: `q` `(angles, 5, knees)`, `stable`, `steps`, seconds."""
        begun = time.perf_counter()
        count = stiffness.shape[1]
        with concurrent.futures.ThreadPoolExecutor(self.threads) as pool:
            chunks = np.split(np.arange(count), range(self.chunk, count, self.chunk))
            done = pool.map(lambda c: self.first_pass(c, stiffness, slack_length), chunks)
            parts = zip(*done, strict=True)
            q, meeting, stable, steps = (np.concatenate(x, axis=-1) for x in parts)
            quick = time.perf_counter() - begun
            lost = self._lost(np.isfinite(q[:, 0]))
            lots = [lost[:, i : i + self.chunk] for i in range(0, lost.shape[1], self.chunk)]
            again = pool.map(
                lambda lot: self.second_pass(lot, stiffness, slack_length, q, meeting), lots
            )
            for (angle, _, row), (found, held, taken) in zip(lots, list(again), strict=True):
                q[angle, :, row], stable[angle, row] = found.T, held
                steps[angle, row] += taken
        return {
            "q": q, "stable": stable, "steps": steps,
            "first_pass_converged": 1.0 - lost.shape[1] / stable.size,
            "seconds_first_pass": quick, "seconds": time.perf_counter() - begun,
        }  # fmt: skip
