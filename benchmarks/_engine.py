"""Motions of many knees: lanes are knees, angles follow each other by continuation.

The first pass gives every pose a handful of steps from a quadratic prediction, with the tangent of
the angle before; the poses that did not make it are gathered and searched again, with more steps
and then in smaller strides. So no lane waits for the slowest knee of its chunk.
"""

from __future__ import annotations

import concurrent.futures
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.mechanics import Knee, add_lane_axis, ligament_law
from kneejax.statics import EnergyNewton, Guess, compiled, first_guess, settle

#: Searches of a pose that is predicted, and of one that was lost.
QUICK = EnergyNewton(atol=1e-7, most_steps=8, least_share=0.15)
PATIENT = EnergyNewton(atol=1e-7, most_steps=24, least_share=0.08)
#: Poses on the way of the last search at most: what is farther is likely to have no balance.
_LONGEST_WAY = 6


def random_knees(knee: Knee, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness from 300 to 9300 N and slack lengths for +-0.03 around the knee's reference
    strains, both `(ligaments, count)`."""
    draw = np.random.default_rng(seed)
    size = (len(knee.ligaments.names), count)
    stiffness = draw.uniform(300.0, 9300.0, size)
    strain = np.asarray(knee.reference_strain())[:, None] + draw.uniform(-0.03, 0.03, size)
    length = np.asarray(knee.reference_length())[:, None]
    return stiffness, np.asarray(ligament_law.slack_length_from_strain(length, strain))


def in_lanes(knee: Knee, stiffness: Array, slack_length: Array) -> Knee:
    """The knee with a lane axis: one lane a knee where numbers vary, length one elsewhere."""
    return eqx.tree_at(
        lambda k: (k.ligaments.stiffness, k.ligaments.slack_length),
        add_lane_axis(knee),
        (jnp.asarray(stiffness), jnp.asarray(slack_length)),
    )


@compiled()
def march(knee: Knee, ligaments, own: Guess, angles: Array):
    """Poses of a chunk of knees at all angles, predicted from angle to angle: the first pass.

    Predicted is how far a knee is from the own motion: a parabola through three angles where it
    has them. A knee that was lost keeps its distance and is tried again at every angle.

    Args:
        knee: gives all numbers but the ligaments'.
        ligaments: stiffness and slack length, `(ligaments, lanes)`.
        own: the knee's own motion, one lane an angle.
        angles: rad.

    Returns:
        Coordinates, meeting points, stability and steps, the first axis an angle.
    """
    lanes = in_lanes(knee, *ligaments).for_many_poses()

    def pose(before, here):
        away, known, tangent = before
        flexion, own = here
        past = [
            jax.tree.map(lambda a, b, c: jnp.where(
                known > 2, 2 * a - 3 * b + c, jnp.where(known > 1, a - b, 0.0)), *away)
        ]
        q, meeting = (o[..., None] + a + p for o, a, p in zip(own, away[0], *past, strict=True))
        flexion = jnp.broadcast_to(flexion, known.shape)
        found = settle(lanes, flexion, Guess(q, meeting, tangent), search=QUICK)
        good = found.converged
        now = tuple(
            jnp.where(good, x - o[..., None], a)
            for x, o, a in zip((found.q, found.meeting), own, away[0], strict=True)
        )
        known = jnp.where(good, known + 1, 0)
        tangent = jnp.where(good, found.tangent, 0.0)
        return ((now, *away[:2]), known, tangent), (
            found.q, found.meeting, found.stable, found.steps
        )

    size = ligaments[0].shape[1]
    zero = tuple(jnp.zeros((*x.shape[:-1], size)) for x in (own.q, own.meeting))
    begin = ((zero,) * 3, jnp.zeros(size, int), jnp.zeros((5, 5, size)))
    over_angles = tuple(jnp.moveaxis(x, -1, 0) for x in (own.q, own.meeting))
    return lax.scan(pose, begin, (angles, over_angles))[1]


@compiled()
def search(knee: Knee, ligaments, flexion, guess: Guess, start, count):
    """Poses of a chunk, one lane each, marching from a guess."""
    found = settle(in_lanes(knee, *ligaments), flexion, guess, start, count, PATIENT)
    return Guess(found.q, found.meeting), found.stable, found.steps


class Engine:
    """Motions of many knees that differ in stiffness and slack length.

    Attributes:
        angles: degrees.
        chunk: lanes of a call.
        threads: calls at a time.
    """

    def __init__(self, knee: Knee, angles, chunk: int = 128, threads: int = 2):
        self.knee, self.chunk, self.threads = knee, chunk, threads
        self.angles = np.deg2rad(angles)
        own = [
            np.repeat(np.asarray(x)[:, None], chunk, axis=1)
            for x in (knee.ligaments.stiffness, knee.ligaments.slack_length)
        ]
        flexion = np.resize(self.angles, chunk)
        zero = jnp.full(chunk, knee.reference_pose.flexion)
        guess = first_guess(add_lane_axis(knee), zero)
        found, _, _ = search(knee, own, flexion, guess, zero, self._count(self.angles[-1]))
        #: The knee's own motion: where searches begin that have nothing better.
        self.own = jax.tree.map(lambda x: np.asarray(x)[..., : len(self.angles)], found)

    def _count(self, way: float, degrees: float = 5.0) -> int:
        return int(np.ceil(np.abs(way) / np.deg2rad(degrees))) + 1

    def first_pass(self, rows: np.ndarray, stiffness, slack_length):
        """Poses `(angles, 5, knees)`, meeting points, stability and steps of some knees."""
        full = np.resize(rows, self.chunk)  # a short chunk repeats its knees
        ligaments = (stiffness[:, full], slack_length[:, full])
        found = march(self.knee, ligaments, self.own, self.angles)
        return tuple(np.asarray(x)[..., : len(rows)] for x in found)

    def pass_again(self, lanes, stiffness, slack_length, q, meeting, from_near: bool):
        """Search again for single poses, from the same knee's nearest known pose."""
        angle, near, row = (np.resize(x, self.chunk) for x in lanes)
        known = np.isfinite(q[near, 0, row])
        near = np.where(known, near, angle)
        # Either from the near pose itself in strides, or as far from the own motion as that is.
        to = near if from_near else angle
        poses = np.where(known, q[near, :, row].T - self.own.q[:, near], 0.0)
        points = np.where(
            known,
            np.moveaxis(meeting[near, :, :, row], 0, -1) - self.own.meeting[..., near],
            0.0,
        )
        guess = Guess(self.own.q[:, to] + poses, self.own.meeting[..., to] + points)
        here, start = self.angles[angle], self.angles[to]
        ligaments = (stiffness[:, row], slack_length[:, row])
        count = min(self._count(np.abs(here - start).max(), 2.0), _LONGEST_WAY)
        found, stable, steps = search(self.knee, ligaments, here, guess, start, count)
        size = len(lanes[0])
        return (
            np.asarray(found.q)[:, :size],
            np.asarray(found.meeting)[..., :size],
            np.asarray(stable)[:size],
            np.asarray(steps)[:size],
        )

    def _lost(self, good: np.ndarray) -> np.ndarray:
        """Lost poses: angle, nearest angle that is known, knee; those with a short way first."""
        angle, row = np.nonzero(~good)
        way = np.abs(np.arange(len(good))[:, None] - angle)
        way = np.where(good[:, row], way, len(good))
        order = np.argsort(way.min(axis=0), kind="stable")
        return np.stack([angle, way.argmin(axis=0), row])[:, order]

    def solve(self, stiffness, slack_length) -> dict:
        """All passes over all knees: `q` `(angles, 5, knees)`, `stable`, `steps`, seconds."""
        begun = time.perf_counter()
        count = stiffness.shape[1]
        with concurrent.futures.ThreadPoolExecutor(self.threads) as pool:
            chunks = np.split(np.arange(count), range(self.chunk, count, self.chunk))
            done = pool.map(lambda c: self.first_pass(c, stiffness, slack_length), chunks)
            parts = zip(*done, strict=True)
            q, meeting, stable, steps = (np.concatenate(x, axis=-1) for x in parts)
            seconds, converged = [time.perf_counter() - begun], [np.isfinite(q[:, 0]).mean()]
            for from_near in (False, True):
                lost = self._lost(np.isfinite(q[:, 0]))
                lots = [lost[:, i : i + self.chunk] for i in range(0, lost.shape[1], self.chunk)]
                again = pool.map(
                    lambda lot, near=from_near: self.pass_again(
                        lot, stiffness, slack_length, q, meeting, near
                    ),
                    lots,
                )
                for (angle, _, row), (found, points, held, taken) in zip(
                    lots, list(again), strict=True
                ):
                    q[angle, :, row], stable[angle, row] = found.T, held
                    meeting[angle, :, :, row] = np.moveaxis(points, -1, 0)
                    steps[angle, row] += taken
                seconds.append(time.perf_counter() - begun)
                converged.append(np.isfinite(q[:, 0]).mean())
        return {
            "q": q, "stable": stable, "steps": steps,
            "converged": [float(x) for x in converged], "seconds": seconds,
        }  # fmt: skip
