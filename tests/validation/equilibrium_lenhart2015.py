"""A recorded knee left to itself, with the wrench that muscles and patella gave it put back.

The recorded simulation balances a knee with muscles, patella, iliotibial band and gravity; a knee
of ligaments and contact alone does not stand there. What the recorded ligament and contact forces
leave unbalanced is therefore applied as a load. A share of it can instead be given by what it comes
from: the fibres of the patellar tendon, whose upper ends stay where the patella was recorded.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax import Knee, Pose, Status
from kneejax.geometry import FEMUR_AND_TIBIA, FREE_COORDINATES, TIBIA, State
from kneejax.mechanics import Ligaments, Load, Wrench, add_lane_axis
from kneejax.numerics import compiled
from kneejax.statics import EnergyNewton, Equilibrium, Guess, balance, solve_equilibrium

if TYPE_CHECKING:
    from recorded_lenhart2015 import Record

#: How far away the search starts, and how near it has to come back.
START_MM, START_DEG, RETURN_MM, RETURN_DEG = 2.0, 2.0, 0.5, 0.5
#: A turn counts as the way, mm, that it moves a point so far from the axis.
ARM_MM = 30.0
_UNITS = np.array([1.0 / ARM_MM, 1.0 / ARM_MM, 1.0, 1.0, 1.0])
_FIELDS = (
    "femoral_attachment", "tibial_attachment", "stiffness", "slack_length", "transition_strain",
    "transition_width",
)  # fmt: skip


def tendon_fibres(record: Record) -> dict[str, dict]:
    """The fibres from the patella to the tibia."""
    return {
        name: fibre
        for name, fibre in record.points.items()
        if fibre["bodies"][0].startswith("patella") and fibre["bodies"][1].startswith("tibia")
    }


def patellar_tendon(record: Record, rows, transition_width: float) -> Ligaments:
    """The tendon's fibres, their upper ends fixed in the femur where the patella was recorded.

    Args:
        record: what was recorded.
        rows: of the record, one a lane.
        transition_width: of the fibres' law.
    """
    fibres = tendon_fibres(record)
    patella = Pose.from_table(record.patella[rows]).placement
    upper = [jnp.stack(patella.apply(tuple(fibre["ends"][0]))) for fibre in fibres.values()]
    count = len(fibres)
    lanes = add_lane_axis(
        Ligaments(
            np.zeros((count, 3)),
            [fibre["ends"][1] for fibre in fibres.values()],
            *(
                [fibre[field] for fibre in fibres.values()]
                for field in ("stiffness", "slack_length", "transition_strain")
            ),
            [transition_width] * count,
            list(fibres),
        )
    )
    return eqx.tree_at(lambda x: x.femoral_attachment, lanes, jnp.stack(upper))


def standing(knee: Knee, record: Record, rows, tendon_share: float) -> Knee:
    """The knee with what the record's ligaments and contact leave unbalanced, one lane a row.

    Ligament forces were recorded at some instants only and are computed at recorded poses, which
    the comparison of fibres allows. Loads keep their direction in the femur.

    Args:
        knee: without loads, contacts as sums over points.
        record: what was recorded.
        rows: of the record.
        tendon_share: 0 if all of the wrench is a load, 1 if the patellar tendon's fibres give
            their part of it.
    """
    tibia = record.poses(rows).placement
    tendon = patellar_tendon(record, rows, float(knee.ligaments.transition_width.min()))
    tendon = eqx.tree_at(lambda x: x.stiffness, tendon, tendon.stiffness * tendon_share)
    lanes, nothing = add_lane_axis(knee), np.zeros((3, len(rows)))
    both = _together(lanes.ligaments, tendon, len(rows))
    alone = dataclasses.replace(lanes, ligaments=both, loads=(_load(nothing, nothing),))
    *_, pull = _balance(alone, record.poses(rows))
    push = [
        np.asarray(mine) + np.asarray(theirs)
        for mine, theirs in zip(
            (*pull.force, *pull.moment),
            (*tibia.turn(tuple(record.force[rows].T)), *tibia.turn(tuple(record.moment[rows].T))),
            strict=True,
        )
    ]
    return dataclasses.replace(alone, loads=(_load(-np.stack(push[:3]), -np.stack(push[3:])),))


def _load(force: np.ndarray, moment: np.ndarray) -> Load:
    numbers = jnp.asarray(force), jnp.asarray(moment), jnp.zeros((3, 1))
    return eqx.tree_at(lambda x: (x.force, x.moment, x.point), Load(name="unbalanced"), numbers)


def _together(first: Ligaments, more: Ligaments, lanes: int) -> Ligaments:
    parts = (
        [jnp.broadcast_to(x, (*x.shape[:-1], lanes)) for x in (getattr(first, f), getattr(more, f))]
        for f in _FIELDS
    )
    names = (*first.names, *more.names)
    return Ligaments(*(jnp.concatenate(pair) for pair in parts), names, first.courses)


@dataclasses.dataclass(frozen=True)
class Footing:
    """How firmly recorded poses are held; instants are rows. Turns in mm at `ARM_MM`.

    Attributes:
        stiffness: symmetric, `(n, 5, 5)`, N/mm.
        residual: what is unbalanced there, `(n, 5)`, N: the error of our contact.
    """

    stiffness: np.ndarray
    residual: np.ndarray

    @property
    def eigenvalues(self) -> np.ndarray:
        """Ascending, `(n, 5)`, N/mm."""
        return np.linalg.eigvalsh(self.stiffness)

    @property
    def softest(self) -> np.ndarray:
        """Direction of the smallest eigenvalue, `(n, 5)`."""
        return np.linalg.eigh(self.stiffness)[1][..., 0]

    @property
    def stable(self) -> np.ndarray:
        """Whether a small push is resisted."""
        return self.eigenvalues[:, 0] > 0

    @property
    def drift(self) -> tuple[np.ndarray, np.ndarray]:
        """How far, to first order, balance lies from the pose: degrees and mm, `(n,)` each."""
        way = -np.linalg.solve(self.stiffness, self.residual[..., None])[..., 0] * _UNITS
        return _sizes(way.T)

    @property
    def holds(self) -> np.ndarray:
        """Whether the pose is stable, and balance to first order within the criterion of it."""
        turned, moved = self.drift
        return self.stable & (turned <= RETURN_DEG) & (moved <= RETURN_MM)


def footing(knee: Knee, poses: Pose) -> Footing:
    """Stiffness and unbalanced force at poses, before anything is searched."""
    residual, tangent = (np.asarray(x) for x in _balance(knee, poses)[:2])
    scaled = np.moveaxis(tangent * _UNITS[:, None, None] * _UNITS[None, :, None], -1, 0)
    return Footing(0.5 * (scaled + scaled.swapaxes(1, 2)), (residual * _UNITS[:, None]).T)


@compiled()
def _balance(knee: Knee, poses: Pose):
    held, q = {"flexion": poses.flexion}, State({TIBIA: poses}).at(FREE_COORDINATES)
    found = balance(knee, held, q)
    pulls = knee.ligaments.pull(State({TIBIA: poses}))[0].between[FEMUR_AND_TIBIA]
    return found.residual, found.tangent, Wrench.total(pulls)


def without_elasticity(held: Footing, knee: Knee, poses: Pose, names) -> Footing:
    """The footing if straight fibres pulled with their force whatever their length.

    What is left of their stiffness is that of a line of constant tension: its direction.

    Args:
        held: footing of the knee.
        knee: one lane a pose.
        poses: where.
        names: of the fibres.
    """
    rows = np.array([knee.ligaments.names.index(name) for name in names])
    fibres = Ligaments(*(getattr(knee.ligaments, field)[rows] for field in _FIELDS), names)

    q = State({TIBIA: poses}).at(FREE_COORDINATES)

    def length(q):
        return fibres.length(State.of({"flexion": poses.flexion}, q))

    def along(k: int):
        push = jnp.zeros_like(q).at[k].set(_UNITS[k])
        return jax.jvp(length, (q,), (push,))[1]

    slope = np.stack([np.asarray(along(k)) for k in range(5)])
    here = length(q)
    elastic = np.asarray(jax.jvp(fibres.tension_at, (here,), (jnp.ones_like(here),))[1])
    own = np.einsum("iml,ml,jml->lij", slope, elastic, slope)
    return dataclasses.replace(held, stiffness=held.stiffness - own)


@dataclasses.dataclass(frozen=True)
class Returned:
    """Where searches ended that began near recorded poses; instants are rows.

    Attributes:
        equilibrium: what the library says.
        turned: angle from the recorded pose, degrees; NaN where nothing was found.
        moved: likewise, mm.
    """

    equilibrium: Equilibrium
    turned: np.ndarray
    moved: np.ndarray

    @property
    def status(self) -> np.ndarray:
        """`Status` values."""
        return np.asarray(self.equilibrium.status)

    @property
    def back(self) -> np.ndarray:
        """Where the recorded pose was found again, balanced and stable."""
        near = (self.turned <= RETURN_DEG) & (self.moved <= RETURN_MM)
        return near & (self.status == Status.BALANCED)

    @property
    def elsewhere(self) -> np.ndarray:
        """Where another stable balance was found."""
        return ~self.back & (self.status == Status.BALANCED)


def search_from_away(
    knee: Knee, poses: Pose, seed: int = 0, search: EnergyNewton | None = None
) -> Returned:
    """Find the balance from 2 mm and 2 degrees away, in directions drawn at random.

    Args:
        knee: one lane a pose.
        poses: recorded.
        seed: of the directions.
        search: as in `solve_equilibrium`.
    """
    q = State({TIBIA: poses}).at(FREE_COORDINATES)
    away = np.random.default_rng(seed).normal(size=(5, len(poses.flexion)))
    away[:2] *= np.deg2rad(START_DEG) / np.linalg.norm(away[:2], axis=0)
    away[2:] *= START_MM / np.linalg.norm(away[2:], axis=0)
    equilibrium = _equilibrium(knee, poses.flexion, q + away, search or EnergyNewton())
    return Returned(equilibrium, *_sizes(np.asarray(equilibrium.q - q)))


@compiled(static_argnums=(3,))
def _equilibrium(knee: Knee, flexion, start, search: EnergyNewton) -> Equilibrium:
    guess = Guess(start, jnp.zeros((0, 2, start.shape[1])))
    return solve_equilibrium(knee, {"flexion": flexion}, guess, search)


def _sizes(way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn in degrees and shift in mm of `(5, n)` rad and mm."""
    return np.rad2deg(np.linalg.norm(way[:2], axis=0)), np.linalg.norm(way[2:], axis=0)
