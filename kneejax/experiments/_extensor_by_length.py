"""Extension by a quadriceps of given length.

In the balance stands the cable of a motor (`kneejax.mechanics.Cable`), as through time. It
stretches by what its pull differs from what it expects; a balance whose pull is what was expected
has the given length itself, and a few balances lead there, each expecting the pull of the last.
"""

__all__ = ["DrivenExtensor", "extension_by_length", "leg_raise_by_length"]

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments._extensor import Extensor, at_rest, described, held_leg, pulled_at
from kneejax.experiments._extensor_mechanism import Shank, needs_patella, weight_of
from kneejax.experiments._motion import Motion, again, apart_mm, expected, followed
from kneejax.mechanics import Cable, Knee, Load, add_lane_axis
from kneejax.numerics import Named, WrongValue, compiled, lanes_for, traced
from kneejax.statics import Equilibrium, Guess, LoadCases, differentiable, solve_equilibrium

#: N; a cable that is slack still pulls a rounding of 0.05.
SLACK_N = 0.1
#: A cable expects the pull of the last balance: so often at most, until it changes by less, N.
_MOST_TIMES, _SAME_N = 8, 1e-7
#: How much a length changes from balance to balance on the way, mm, and how far a balance may lie
#: from where it is expected, mm (rotations at 30 mm): one branch is smooth.
_STRIDE_MM, _MISSED_MM = 0.25, 2.0


class OnCable(NamedTuple):
    """Balances under a quadriceps of given length."""

    equilibrium: Equilibrium  # poses of all bones; NaN where a search failed
    pull: Array  # of the cable, `(lanes,)`, N, which comes to what the heads have at rest


def _drawn(knee: Knee, load_cases: LoadCases, length: Array, expected: Array) -> Knee:
    """A knee of three bones in lanes whose quadriceps hangs on a cable of that length, mm, under
    the pull that is expected, N, `(lanes,)` each."""
    lanes = load_cases.load(add_lane_axis(knee))
    assert lanes.muscles is not None
    muscles = dataclasses.replace(lanes.muscles, cable=Cable(length, expected))
    return dataclasses.replace(lanes, muscles=muscles)


def _balanced(knee: Knee, load_cases: LoadCases, length: np.ndarray, near: OnCable) -> OnCable:
    """Balances near others, of quadriceps that are as long as they are told to be."""
    # Filled up: another number of lanes is no other program.
    rows = np.minimum(np.arange(lanes_for(len(length))), len(length) - 1)
    load_cases, long = load_cases.of(knee).take(rows), jnp.asarray(length)[rows]
    found = jax.tree.map(lambda x: x[..., rows], near)
    for _ in range(_MOST_TIMES):
        equilibrium, pull = found
        lanes = _drawn(knee, load_cases, long, pull)
        guess = Guess(equilibrium.q, equilibrium.contact_points)
        again = solve_equilibrium(lanes, load_cases.prescribed, guess)
        comes = _pull(lanes, again)
        found = OnCable(again, jnp.where(jnp.isfinite(comes), comes, pull))
        if not (jnp.abs(found.pull - pull) > _SAME_N).any():
            break
    return jax.tree.map(lambda x: x[..., : len(length)], found)


def _drawn_to(
    knee: Knee, load_cases: LoadCases, rest: np.ndarray, longer: np.ndarray, start: OnCable
) -> OnCable:
    """Balances of quadriceps that are drawn from where they are at rest, `rest`, in strides, to be
    so much longer, or shorter where it is negative, `(lanes,)`, mm.

    Each lane has strides of its own and depends on no other.
    """
    free = load_cases.of(knee).free
    before, here, lost = start, start, np.zeros(len(longer), bool)
    for k in range(int(np.ceil(np.abs(longer).max(initial=0.0) / _STRIDE_MM))):
        way = np.sign(longer) * np.minimum((k + 1) * _STRIDE_MM, np.abs(longer))
        last = np.sign(longer) * np.minimum(k * _STRIDE_MM, np.abs(longer))
        part = np.abs(way - last) / _STRIDE_MM if k else np.zeros(len(longer))
        q = here.equilibrium.q + part * (here.equilibrium.q - before.equilibrium.q)
        pull = jnp.maximum(here.pull + part * (here.pull - before.pull), 0.0)
        near = OnCable(dataclasses.replace(here.equilibrium, q=q), pull)
        before, here = here, _balanced(knee, load_cases, rest + way, near)
        away = apart_mm(free, np.asarray(here.equilibrium.q).T, np.asarray(q).T)
        lost |= (way != last) & ~(away <= _MISSED_MM)
    q, pull = (jnp.where(lost, jnp.nan, x) for x in (here.equilibrium.q, here.pull))
    return OnCable(dataclasses.replace(here.equilibrium, q=q), pull)


def _with_derivatives(knee: Knee, load_cases: LoadCases, length: Array, found: OnCable) -> OnCable:
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
    lanes = _drawn(knee, load_cases, length, expected)
    equilibrium = differentiable(lanes, load_cases.prescribed, found.equilibrium)
    return equilibrium, _pull(lanes, equilibrium)


@compiled()
def _pull(lanes: Knee, equilibrium: Equilibrium) -> Array:
    """Of the cable, N."""
    assert lanes.muscles is not None and lanes.muscles.cable is not None
    return lanes.muscles.cable.pull(lanes.muscles.quadriceps_length(equilibrium.state))


#: Flexions at which a leg is held before its quadriceps is given a length, degrees.
_HELD_DEG = np.arange(0.0, 91.0, 5.0)


@dataclasses.dataclass(frozen=True)
class DrivenExtensor(Named):
    """A knee of three bones whose quadriceps has a given length.

    Attributes:
        longer_mm: than at rest, negative where it is shorter, `(poses,)`.
        found: poses and forces; its `quadriceps_N` is a result.
        slack: where a quadriceps of this length hangs loose, since a cable cannot push,
            `(poses,)`; at the very length of rest it does not.
    """

    longer_mm: np.ndarray
    found: Extensor
    slack: np.ndarray

    OVER = {"pose": {"longer_mm": "", "slack": ""}}

    def _named(self) -> dict[str, tuple]:
        return self.found._named() | super()._named()


def extension_by_length(
    knee: Knee, flexion_deg: ArrayLike, longer_mm: ArrayLike, loads: Sequence[Load] = ()
) -> DrivenExtensor:
    """Draw the quadriceps at held flexions: how hard it pulls is a result.

    Args:
        knee: of three bones (`KneeFile.with_patella`).
        flexion_deg: held angles, `(angles,)`.
        longer_mm: how much longer the quadriceps is than at rest at the same flexion, shorter
            where it is negative, `(lengths,)`.
        loads: on the tibia besides.

    Returns:
        Poses in rows of angles, for each all lengths in their order; NaN where a search failed.
        Stable is what is stable under the length, which holds more than a force does.
        Differentiable by every number of the knee and by the lengths, outside `jax.jit`.

    Raises:
        ValueError: the knee has no patella.

    Source: paper 3, Eq 20, at rest.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.experiments import extension_by_length
        >>> extension_by_length(kj.load_knee("four_ligament"), [30.0], [-1.0])
        Traceback (most recent call last):
        ValueError: four_ligament has no patella with a quadriceps: expected a knee read with its
        patella
    """
    needs_patella(knee)
    angles, lengths = (jnp.atleast_1d(jnp.asarray(x, float)) for x in (flexion_deg, longer_mm))
    flexion, longer = jnp.repeat(angles, len(lengths)), jnp.tile(lengths, len(angles))
    acting = (weight_of(), *loads)
    own, bent, more = jax.lax.stop_gradient((knee, flexion, longer))
    resting = followed(own, pulled_at(own, bent, at_rest(own), acting))
    rest = np.asarray(_length(resting))
    start = OnCable(resting.equilibrium, jnp.zeros(len(rest)))
    found = _drawn_to(own, LoadCases.at(bent, acting), rest, np.asarray(more), start)
    return _driven(knee, LoadCases.at(flexion, acting), longer, acting, resting, found)


def leg_raise_by_length(knee: Knee, longer_mm: ArrayLike, shank: Shank | Load) -> DrivenExtensor:
    """Give the quadriceps of a leg its length: where the leg comes to rest is a result.

    Args:
        knee: of three bones.
        longer_mm: how much longer the quadriceps is than that of the extended knee at rest,
            `(poses,)`.
        shank: what hangs on the tibia, or its weight as a load.

    Returns:
        Poses, flexion among them, and the pull; differentiable as `extension_by_length`.

    Raises:
        ValueError: the knee has no patella, or a length with which the quadriceps does not hold
            the leg between 0 and 90 degrees.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.experiments import leg_raise_by_length
        >>> knee = kj.load_knee("four_ligament")
        >>> leg_raise_by_length(knee, [10.0], kj.Shank.of_person(75.0, 1.75))
        Traceback (most recent call last):
        ValueError: four_ligament has no patella with a quadriceps: expected a knee read with its
        patella
    """
    needs_patella(knee)
    weight = shank.load() if isinstance(shank, Shank) else shank
    longer = jnp.atleast_1d(jnp.asarray(longer_mm, float))
    own, more = jax.lax.stop_gradient((knee, longer))
    resting = followed(own, pulled_at(own, jnp.zeros(1), at_rest(own), (weight,)))
    length = np.asarray(_length(resting) + more)
    begin, near = _between_held(own, weight, length, np.asarray(more))
    load_cases = LoadCases.at(begin, (weight,), flexion_is_free=True)
    found = _balanced(own, load_cases, length, near)
    return _driven(knee, load_cases, longer, (weight,), resting, found)


@compiled()
def _length(motion: Motion) -> Array:
    """Of the quadriceps, mm."""
    return add_lane_axis(motion.knee.muscles).quadriceps_length(motion.equilibrium.state)


def _between_held(
    knee: Knee, weight: Load, length: np.ndarray, longer: np.ndarray
) -> tuple[np.ndarray, OnCable]:
    """Flexions, and where a leg of such lengths is expected: between legs that are held."""
    motion, pull, _ = held_leg(knee, jnp.asarray(_HELD_DEG), weight)
    rest, every = float(at_rest(knee)), np.asarray(_length(motion))
    good = np.asarray(motion.equilibrium.converged) & (np.asarray(pull) > rest)
    rows = np.flatnonzero(good)
    rows = rows[np.argsort(every[rows])]
    known = every[rows]
    least, most = (known[0], known[-1]) if len(rows) > 1 else (np.inf, -np.inf)
    wrong = ~((length >= least) & (length <= most))
    if wrong.any():
        low, high = (x - (length[0] - longer[0]) for x in (least, most))
        raise WrongValue(
            "longer_mm",
            f"a quadriceps that is {longer[wrong][0]:g} mm longer than at rest",
            f"between {low:.4g} and {high:.4g} mm, with which it holds the leg of {knee.name}",
        )
    above = np.clip(np.searchsorted(known, length), 1, len(known) - 1)
    low, high = rows[above - 1], rows[above]
    part = (length - every[low]) / (every[high] - every[low])

    def between(x) -> Array:
        x = np.asarray(x)
        return jnp.asarray(x[..., low] + part * (x[..., high] - x[..., low]))

    begin, equilibrium = between(_HELD_DEG), motion.equilibrium
    q = jnp.concatenate([jnp.deg2rad(begin)[None], between(equilibrium.q)])
    near = dataclasses.replace(equilibrium, q=q, contact_points=between(equilibrium.contact_points))
    return np.asarray(begin), OnCable(near, between(pull) - rest)


def _driven(
    knee: Knee, load_cases: LoadCases, longer: Array, acting: tuple[Load, ...], resting: Motion,
    found: OnCable,
) -> DrivenExtensor:  # fmt: skip
    """What is told of balances: as under a quadriceps that pulls as much at the same flexion."""
    if traced(knee, load_cases, longer):
        still = again(knee, resting.load_cases, resting.equilibrium, resting.reached)
        found = _with_derivatives(knee, load_cases, _length(still) + longer, found)
    is_held = load_cases.begin is None
    flexion = jnp.rad2deg(load_cases.flexion if is_held else found.equilibrium.q[0])
    own, bent, (equilibrium, cable) = jax.lax.stop_gradient((knee, flexion, found))
    first = len(equilibrium.q) - len(LoadCases.at(0.0).of(own).free)
    pull = jnp.where(jnp.isfinite(equilibrium.q[0]), cable, 0.0) + at_rest(own)
    bent = jnp.where(jnp.isfinite(bent), bent, 0.0)
    expectation = equilibrium.q[first:], equilibrium.contact_points
    motion = near = expected(own, pulled_at(own, bent, pull, acting), *expectation)
    if traced(knee, flexion, found):
        load_cases = pulled_at(knee, flexion, found.pull + at_rest(knee), acting)
        motion = again(knee, load_cases, near.equilibrium, near.reached)
    holds = jnp.isfinite(equilibrium.q[0]) & near.equilibrium.converged
    status = jnp.where(holds, equilibrium.status, jnp.maximum(equilibrium.status, near.status))
    motion = dataclasses.replace(motion, status=status, stable=equilibrium.stable)
    total = jnp.where(holds, found.pull + at_rest(knee), jnp.nan)
    told = described(motion, total, np.zeros(len(longer), bool), acting[0])
    own_longer = np.asarray(jax.lax.stop_gradient(longer))
    slack = np.asarray(holds & (cable < SLACK_N)) & (own_longer > 0.0)
    return DrivenExtensor(own_longer, told, slack)
