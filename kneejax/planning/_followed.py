"""Operated knees: grafts fixed under a tension, and followed through flexions and tests.

While it is tightened, a graft pulls with the tension that the surgeon gives it, whatever its
length: the knee is balanced with that. There the graft's length is known, and with its law its
slack length, in closed form. Fixed with that length, it pulls at the same pose with the same force:
no second search.
"""

__all__ = ["Followed", "Protocol", "fix", "fixed_knee", "follow", "slack_length"]

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments import passive_flexion
from kneejax.geometry import CLINICAL, COORDINATES, FEMORAL, State, convert
from kneejax.mechanics import Knee, ligament_law, load_of
from kneejax.numerics import filled
from kneejax.planning._reconstruction import (
    BUNDLE_NUMBERS,
    TRANSITION_STRAIN,
    TRANSITION_WIDTH,
    Operated,
    Reconstruction,
)
from kneejax.statics import (
    LoadCases,
    Progress,
    Slopes,
    balance_lines,
    balance_many,
    balance_with_slopes,
    converged,
)

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
        return np.r_[self.extension_deg, np.repeat(self.lachman_deg, self.steps + 1)]

    @functools.cached_property
    def force(self) -> np.ndarray:
        """Anterior force at each load case, N."""
        grows = self.force_N * np.linspace(0.0, 1.0, self.steps + 1)
        return np.r_[np.zeros(len(self.extension_deg)), np.tile(grows, len(self.lachman_deg))]

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
        loads = [load_of(anterior_N=self.force)] if self.lachman_deg else []
        return LoadCases.at(self.flexion_deg, loads)


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
    plan: Reconstruction, values: np.ndarray, protocol: Protocol, *, slopes: bool = False,
    near: Slopes | None = None, grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> Followed:  # fmt: skip
    """Put variants through a protocol.

    Args:
        plan: the knee and its grafts.
        values: numbers of the variants, `(v, numbers)`.
        protocol: flexions and loads.
        slopes: whether derivatives are wanted.
        near: of near variants, to begin from.
        grid: rows and columns in which the variants stand, where neighbours are near each other:
            each is then predicted from its neighbour, which takes two fifths of the time.
        progress: called now and then with balances done and asked for.

    Returns:
        What was read; NaN where a knee has no balance.
    """
    load_cases, shape = protocol.load_cases, (len(values), len(protocol.flexion_deg))
    if slopes:
        found = balance_with_slopes(plan.knee, plan.vary, values, load_cases, near)
    elif grid is None:
        found = balance_many(plan.knee, plan.vary, values, load_cases, progress=progress)
    else:
        rows, columns = grid
        along = functools.partial(balance_lines, plan.knee, plan.vary)
        lines, row, column = values.reshape(rows, columns, -1), rows // 2, columns // 2
        spine = along(lines[None, :, column], load_cases, np.array([row])).at(0)
        begin = np.full(rows, column)
        found = along(lines, load_cases, begin, near=spine, progress=progress)
    status = found.status.reshape(shape)
    q = np.where(converged(status)[..., None], found.q.reshape(*shape, -1), np.nan)
    flexion = np.tile(np.deg2rad(protocol.flexion_deg), shape[0])
    nodes = np.repeat(values, shape[1], axis=0), q.reshape(status.size, -1), flexion
    parts = []
    for first in range(0, status.size, _CHUNK):
        rows = filled(np.arange(first, min(first + _CHUNK, status.size)))
        parts.append(_read(plan.vary, slopes, plan.knee, *(x[rows] for x in nodes)))
    read = jax.tree.map(
        lambda *x: np.concatenate(x)[: status.size].reshape(*shape, *x[0].shape[1:]), *parts
    )
    by = read.pop("by", {})
    for numbers in read.values():
        numbers[~converged(status)] = np.nan
    if not isinstance(found, Slopes):
        return Followed(**read, status=status)
    by_value = {name: own + by_pose @ found.jacobian for name, (own, by_pose) in by.items()}
    return Followed(**read, status=status, slopes=by_value, near=found)


@functools.partial(jax.jit, static_argnums=(0, 1))
def _read(vary: Operated, slopes: bool, knee: Knee, values, q, flexion):
    """What is read of balances; with `slopes` its derivatives by value and pose as well, `by`."""

    def one(value: Array, q: Array, flexion: Array) -> dict[str, Array]:
        ligaments = vary(knee, value).ligaments
        length = ligaments.length(State.of({"flexion": flexion}, q, knee.bodies))
        every = convert(jnp.concatenate([flexion[None], q]), FEMORAL, CLINICAL)
        return {
            "length_mm": length,
            "strain": length / ligaments.slack_length - 1.0,
            "tension_N": ligaments.tension_at(length),
            "anterior_mm": every[list(COORDINATES).index("anterior")],
        }

    def both(*at: Array):
        by = jax.jacfwd(one, (0, 1))(*at)
        return one(*at) | {"by": {k: tuple(map(jnp.atleast_2d, x)) for k, x in by.items()}}

    return jax.vmap(both if slopes else one)(values, q, flexion)


class Fixed(NamedTuple):
    """Grafts that were fixed under a tension."""

    slack_mm: np.ndarray  # zero-load length of each bundle, `(variants, bundles)`; NaN unbalanced
    # Its derivative by the numbers of the variants under tension, `(variants, bundles, numbers)`,
    # and the balances, to predict others from; None where no slopes were asked for.
    slope: np.ndarray | None
    status: np.ndarray  # `Status` values of the balances at fixation, `(variants,)`
    near: Slopes | None


def slack_length(length_mm: ArrayLike, tension_N: ArrayLike, stiffness_N: ArrayLike) -> Array:
    """Zero-load length of a graft that carries a tension at a length.

    Args:
        length_mm: between its ends.
        tension_N: there, positive.
        stiffness_N: N per unit strain.

    Returns:
        mm, differentiable by all three.

    Example:
        >>> short = slack_length(30.0, 80.0, 7140.0)
        >>> tension = ligament_law.tension(30.0 / short - 1.0, 7140.0, 0.06, 0.0001)
        >>> round(float(tension), 9)
        80.0
    """
    return ligament_law.slack_length_from_force(
        length_mm, tension_N, stiffness_N, TRANSITION_STRAIN, TRANSITION_WIDTH
    )


def fix(
    plan: Reconstruction, ends: np.ndarray, tension_N: np.ndarray, flexion_deg: float, *,
    slopes: bool = False, near: Slopes | None = None, grid: tuple[int, int] | None = None,
) -> Fixed:  # fmt: skip
    """Fix the grafts of many variants, each under its own tension.

    Args:
        plan: the knee and its grafts.
        ends: femoral and tibial, `(variants, bundles, 6)`, mm.
        tension_N: of each bundle, `(variants, bundles)`.
        flexion_deg: at which they are fixed.
        slopes: whether derivatives are wanted.
        near: of near variants, to begin from.
        grid: rows and columns in which the variants stand, see `follow`.

    Returns:
        The fixed grafts.
    """
    values = plan.value(ends, tension_N=tension_N, elastic=False)
    at_fixation = Protocol(np.array([flexion_deg]), (), 0.0)
    pulled = follow(plan, values, at_fixation, slopes=slopes, near=near, grid=grid)
    grafts = plan.rows(plan.bundles)
    length = pulled.length_mm[:, 0, grafts]
    by_length = np.zeros((*length.shape, values.shape[1]))
    if pulled.slopes is not None:
        by_length = pulled.slopes["length_mm"][:, 0, grafts]
    by_tension, bundle = np.zeros_like(by_length), np.arange(len(grafts))
    by_tension[:, bundle, BUNDLE_NUMBERS * (1 + bundle)] = 1.0
    stiffness = np.array(plan.stiffness_N)
    slack, slope = map(np.asarray, _slack(length, tension_N, stiffness, by_length, by_tension))
    return Fixed(slack, slope if slopes else None, pulled.status[:, 0], pulled.near)


@jax.jit
def _slack(length, tension_N, stiffness_N, *by):
    """Slack lengths, and their derivatives from those of lengths and tensions by numbers."""

    def law(length: Array, tension_N: Array) -> Array:
        return slack_length(length, tension_N, stiffness_N)

    return jax.vmap(lambda *by: jax.jvp(law, (length, tension_N), by), -1, (None, -1))(*by)


def fixed_knee(
    plan: Reconstruction, ends: ArrayLike, tension_N: ArrayLike, flexion_deg: ArrayLike
) -> Knee:
    """The reconstructed knee of one variant, as JAX sees it: differentiable by all arguments.

    Args:
        plan: the knee and its grafts.
        ends: femoral and tibial, `(bundles, 6)`, mm.
        tension_N: of each bundle, `(bundles,)`.
        flexion_deg: at which the grafts are fixed.
    """
    ends, tension = jnp.asarray(ends, float), jnp.asarray(tension_N, float)
    stiffness, nothing = jnp.array(plan.stiffness_N), jnp.zeros(len(plan.bundles))

    def numbers(slack: Array, spring: Array, pull: Array) -> Array:
        each = jnp.stack([slack, spring, pull], axis=1)
        return jnp.concatenate([jnp.zeros(1), jnp.hstack([ends, each]).ravel()])

    tight = plan.vary(plan.knee, numbers(nothing + 1.0, nothing, tension))
    pose = passive_flexion(tight, jnp.atleast_1d(flexion_deg)).equilibrium.state
    at_fixation = jax.tree.map(lambda x: x[0], pose)
    length = tight.ligaments.length(at_fixation)[jnp.array(plan.vary.grafts)]
    slack = slack_length(length, tension, stiffness)
    return plan.vary(plan.knee, numbers(slack, stiffness, nothing))
