"""How exact to be: maps of tunnel positions, how far a tunnel may be off, and uncertain knees."""

__all__ = ["Intervals", "TunnelMap", "intervals", "on_knee", "tolerances", "tunnel_map"]

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.planning._reconstruction import reconstruction_of
from kneejax.planning._surgery import (
    CHOICES,
    TUNNELS,
    Outcome,
    Surgery,
    criteria_names,
    criteria_of,
    excess,
    missed,
)
from kneejax.statics import Progress, Status, converged

#: Steps by which the distance is mended, and where it is near enough, mm.
_STEPS, _NEAR_ENOUGH_MM = 6, 0.01
#: Farther off than this nobody asks, mm.
_FARTHEST_MM = 10.0
#: Farthest that a balance is predicted from that of another place, mm.
_NEAR_MM = 3.0


class Tolerance(NamedTuple):
    """The way in which a tunnel may be off least."""

    bone: str
    bundle: str
    lachman_deg: float  # of the test whose laxity leaves the band first
    direction: np.ndarray  # `(2,)`, unit vector in the footprint's coordinates
    expected_mm: float  # distance to the edge by the derivative
    found_mm: float  # at which the laxity is at the edge, evaluated there; NaN where still inside
    checked_mm: float  # the farthest distance that was evaluated
    slope: float  # change of the laxity per mm, mm


def tolerances(surgery: Surgery, outcome: Outcome) -> tuple[Tolerance, ...]:
    """How far each tunnel may be off, everything else as it is.

    Args:
        surgery: with its band.
        outcome: of one variant, with derivatives.

    Returns:
        One for each bone and bundle: the direction in which the laxity leaves the band first by
        its derivatives, and the distance there, evaluated again until the laxity is at the edge.
    """
    assert outcome.slopes is not None
    own, band = surgery.laxity(surgery.before)[0], surgery.limits.band_mm
    off, slopes = outcome.laxity_mm[0] - own, outcome.slopes["laxity_mm"][0]
    found = []
    for bundle, name in enumerate(surgery.plan.bundles):
        for bone, place in TUNNELS.items():
            columns = len(CHOICES) * bundle + np.array(place)
            by = slopes[:, columns]
            steep = np.linalg.norm(by, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                # Both edges of the band: the laxity may grow or shrink.
                ways = np.stack([band - off, band + off], axis=1) / steep[:, None]
            ways = np.where(np.isfinite(ways), np.maximum(ways, 0.0), np.inf)
            test, edge = np.unravel_index(np.argmin(ways), ways.shape)
            sign = 1.0 if edge == 0 else -1.0
            direction = sign * by[test] / max(steep[test], 1e-12)
            away = np.zeros(slopes.shape[1])
            away[columns] = direction

            def outside(one: Outcome, test=test, sign=sign) -> float:
                return sign * (one.laxity_mm[0, test] - own[test]) - band

            expected, slope = float(ways[test, edge]), float(steep[test])
            reached, checked = _to_edge(surgery, outcome, away, outside, expected, slope)
            found.append(Tolerance(
                bone, name, surgery.protocol.lachman_deg[test], direction, expected, reached,
                checked, slope,
            ))  # fmt: skip
    return tuple(found)


def _to_edge(
    surgery: Surgery, outcome: Outcome, away: np.ndarray, outside: Callable[[Outcome], float],
    expected: float, steep: float,
) -> tuple[float, float]:
    """The distance along `away` at which the laxity is at the edge of the band (NaN if farther than
    asked), and the farthest that was evaluated; `outside` says by how much it is beyond, mm."""
    last, left, known = 0.0, outside(outcome), outcome
    distance, farthest = min(expected, _FARTHEST_MM), 0.0
    for _ in range(_STEPS):
        near = known.near if abs(distance - last) <= _NEAR_MM else None
        there = surgery.try_out(outcome.choices[0] + distance * away, slopes=True, near=near)
        now, farthest = outside(there), max(farthest, distance)
        if not np.isfinite(now):
            distance = 0.5 * (last + distance)
            continue
        if abs(now) < _NEAR_ENOUGH_MM * steep:
            return distance, farthest
        change = (now - left) / (distance - last) if distance != last else steep
        last, left, known = distance, now, there
        if change <= 0.0 or (distance >= _FARTHEST_MM and now < 0.0):
            return np.nan, farthest
        distance = float(np.clip(distance - now / change, 0.0, _FARTHEST_MM))
    return np.nan, farthest


@dataclasses.dataclass(frozen=True)
class TunnelMap(Named):
    """A tunnel moved over a grid, everything else kept.

    Attributes:
        bone: on which.
        bundle: whose tunnel.
        names: of the two coordinates.
        first: values of the first, `(n,)`, mm from the middle of the footprint.
        second: of the second, `(m,)`.
        base: choices that are kept.
        total: distance of all strain curves, `(m, n)`; NaN where the knee has no balance.
        laxity_mm: `(tests, m, n)`.
        peak_N: largest force of a graft, `(m, n)`.
        isometry_mm: of the bundle's graft, `(m, n)`.
        excess: by how much the worst limit is missed, as a part of it, `(m, n)`; negative where all
            are kept.
        off_bone_mm: distance from the bone's mesh, `(m, n)`; 0 without a mesh.
        status: `Status` values, `(m, n)`.
        lachman_deg: flexions of the tests.
    """

    bone: str
    bundle: str
    names: tuple[str, str]
    first: np.ndarray
    second: np.ndarray
    base: np.ndarray
    total: np.ndarray
    laxity_mm: np.ndarray
    peak_N: np.ndarray
    isometry_mm: np.ndarray
    excess: np.ndarray
    off_bone_mm: np.ndarray
    status: np.ndarray
    lachman_deg: tuple[float, ...]

    @property
    def least(self) -> tuple[float, float, float] | None:
        """Coordinates and strain distance of the best point that keeps all limits; None where no
        point does."""
        kept = np.where(self.excess <= 0.0, self.total, np.inf)
        if not np.isfinite(kept).any():
            return None
        row, column = np.unravel_index(np.argmin(kept), kept.shape)
        return float(self.first[column]), float(self.second[row]), float(kept[row, column])

    def _named(self) -> dict[str, tuple]:
        axes = (f"{self.names[1]}_mm", f"{self.names[0]}_mm")
        return {
            axes[0]: (axes[:1], self.second), axes[1]: (axes[1:], self.first),
            "strain_distance": (axes, self.total, "1"),
            "graft_peak_N": (axes, self.peak_N),
            "graft_length_change_mm": (axes, self.isometry_mm),
            "limits_missed_by": (axes, self.excess, "1"),
            "distance_from_bone_mm": (axes, self.off_bone_mm),
            "status": (axes, self.status.astype(np.int8)),
            **{f"laxity_{angle:g}_deg_mm": (axes, moved)
               for angle, moved in zip(self.lachman_deg, self.laxity_mm, strict=True)},
        }  # fmt: skip

    def _about(self) -> dict[str, Any]:
        return {"bone": self.bone, "bundle": self.bundle}


def tunnel_map(
    surgery: Surgery, base: np.ndarray, bone: str, first: np.ndarray, second: np.ndarray, *,
    bundle: int = 0, progress: Progress | None = None,
) -> TunnelMap:  # fmt: skip
    """Move a tunnel over a grid.

    Args:
        surgery: the reconstruction.
        base: choices that are kept, `(choices,)`.
        bone: `femur` or `tibia`.
        first: values of the first coordinate, `(n,)`, mm.
        second: of the second, `(m,)`.
        bundle: whose tunnel.
        progress: called now and then with balances done and asked for.
    """
    columns = len(CHOICES) * bundle + np.array(TUNNELS[bone])
    grid = np.tile(np.asarray(base, float), (len(second), len(first), 1))
    grid[..., columns] = np.stack(np.meshgrid(first, second), axis=-1)
    shape, flat = grid.shape[:2], grid.reshape(-1, grid.shape[-1])
    found = surgery.try_out(flat, grid=shape, progress=progress)
    footprint = surgery.footprint(bone)
    every = (
        found.total, found.peak_N, found.isometry_mm[:, bundle], excess(surgery, found),
        footprint.off_bone(flat[:, columns]), found.status,
    )  # fmt: skip
    total, peak, isometry, far, off, status = (x.reshape(shape) for x in every)
    return TunnelMap(
        bone, surgery.plan.bundles[bundle], footprint.names, first, second, np.asarray(base),
        total, np.moveaxis(found.laxity_mm, 0, -1).reshape(-1, *shape), peak, isometry, far, off,
        status, surgery.protocol.lachman_deg,
    )  # fmt: skip


#: Parts of the draws below each end of an interval, and below its middle.
_PARTS = (0.025, 0.5, 0.975)


@dataclasses.dataclass(frozen=True)
class Intervals:
    """Numbers of knees over draws of the knee.

    Attributes:
        draws: how many knees were drawn.
        quantities: their names: laxity at each test, mm, largest graft force, N, strain distance.
        knees: `intact`, `deficient`, then the choices by name.
        limits: 2.5, 50 and 97.5 % of the draws that balance, `(knees, quantities, 3)`; NaN where
            a knee has no such number.
        known: draws that have the number, `(knees, quantities)`.
        kept: part of the draws in which all limits are kept, `(knees,)`; NaN without a graft.
    """

    draws: int
    quantities: tuple[str, ...]
    knees: tuple[str, ...]
    limits: np.ndarray
    known: np.ndarray
    kept: np.ndarray


def intervals(
    surgery: Surgery, knees: Sequence[Knee], choices: Mapping[str, np.ndarray],
    progress: Progress | None = None,
) -> Intervals:  # fmt: skip
    """Carry out the same surgery on knees that are drawn.

    Args:
        surgery: on the knee itself; its tunnels stay where they are on the bones.
        knees: drawn, of the same structure.
        choices: name -> what is done, `(choices,)`.
        progress: called with draws done and asked for.
    """
    quantities, tests = criteria_names(surgery), len(surgery.protocol.lachman_deg)
    names = ("intact", "deficient", *choices)
    every = np.full((len(knees), len(names), len(quantities)), np.nan)
    within = np.full((len(knees), len(names)), np.nan)
    for row, knee in enumerate(knees):
        own = on_knee(surgery, knee)
        before = own.before
        every[row, :2, :tests] = own.laxity(before)
        found = own.try_out(np.stack(list(choices.values())))
        sound = converged(found.status) | (found.status == Status.GIVES_WAY)
        every[row, 2:] = np.where(sound[:, None], criteria_of(found), np.nan)
        within[row, 2:] = missed(own, found) <= 0.0
        if progress is not None:
            progress(row + 1, len(knees))
    known = np.isfinite(every).sum(axis=0)
    limits = np.full((len(names), len(quantities), 3), np.nan)
    for place in zip(*np.nonzero(known), strict=True):
        own = every[(slice(None), *place)]
        limits[place] = np.quantile(own[np.isfinite(own)], _PARTS)
    return Intervals(len(knees), quantities, names, limits, known, within.mean(axis=0))


def on_knee(surgery: Surgery, knee: Knee) -> Surgery:
    """The same surgery on another knee of the same structure, grafts at the same places.

    Args:
        surgery: any.
        knee: without grafts.
    """
    plan = surgery.plan
    other = reconstruction_of(
        knee, plan.ligament, len(plan.bundles), sum(plan.stiffness_N), sum(plan.failure_N)
    )
    return dataclasses.replace(surgery, plan=other)
