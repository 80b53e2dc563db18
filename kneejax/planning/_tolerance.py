"""How far off a tunnel may be before the laxity leaves its band, from exact derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.planning._surgery import CHOICES, Outcome, Surgery

#: Steps by which the distance is mended, and where it is near enough, mm.
_STEPS, _NEAR_ENOUGH_MM = 6, 0.01
#: Farther off than this nobody asks, mm.
_FARTHEST_MM = 10.0
#: Farthest that a balance is predicted from that of another place, mm.
_NEAR_MM = 3.0


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """The way in which a tunnel may be off least.

    Attributes:
        bone: of the tunnel.
        bundle: likewise.
        lachman_deg: of the test whose laxity leaves the band first.
        direction: `(2,)`, unit vector in the footprint's coordinates.
        expected_mm: distance to the edge by the derivative.
        found_mm: distance at which the laxity is at the edge of the band, evaluated there; NaN
            where it is still inside `checked_mm` away.
        checked_mm: the farthest distance that was evaluated.
        slope: change of the laxity per mm, mm.
    """

    bone: str
    bundle: str
    lachman_deg: float
    direction: np.ndarray
    expected_mm: float
    found_mm: float
    checked_mm: float
    slope: float


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
        for bone, first in ((TIBIA, 0), (FEMUR, 2)):
            columns = len(CHOICES) * bundle + first + np.arange(2)
            by = slopes[:, columns]
            steep = np.linalg.norm(by, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                # Both edges of the band: the laxity may grow or shrink.
                ways = np.stack([(band - off) / steep, (band + off) / steep], axis=1)
            ways = np.where(np.isfinite(ways), np.maximum(ways, 0.0), np.inf)
            test, edge = np.unravel_index(np.argmin(ways), ways.shape)
            sign = 1.0 if edge == 0 else -1.0
            direction = sign * by[test] / max(steep[test], 1e-12)
            line = _Line(surgery, outcome, columns, direction, int(test), sign)
            expected = float(ways[test, edge])
            reached, checked = line.to_edge(expected, float(steep[test]))
            found.append(
                Tolerance(
                    bone, name, surgery.protocol.lachman_deg[test], direction, expected, reached,
                    checked, float(steep[test]),
                )
            )  # fmt: skip
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class _Line:
    """A tunnel moved along a direction, and the edge of the band that is looked for."""

    surgery: Surgery
    outcome: Outcome
    columns: np.ndarray
    direction: np.ndarray
    test: int
    sign: float

    def excess(self, outcome: Outcome) -> float:
        """By how much the laxity of one variant is outside of the band, mm."""
        own = self.surgery.laxity(self.surgery.before)[0, self.test]
        return self.sign * (outcome.laxity_mm[0, self.test] - own) - self.surgery.limits.band_mm

    def at(self, distance: float, near: Outcome | None) -> Outcome:
        """The outcome there, predicted from a near one."""
        choices = self.outcome.choices[0].copy()
        choices[self.columns] += distance * self.direction
        return self.surgery.try_out(choices, slopes=True, near=near and near.near)

    def to_edge(self, expected: float, steep: float) -> tuple[float, float]:
        """The distance at which the laxity is at the edge (NaN if farther than asked), and the
        farthest that was evaluated."""
        last, left, known = 0.0, self.excess(self.outcome), self.outcome
        distance, farthest = min(expected, _FARTHEST_MM), 0.0
        for _ in range(_STEPS):
            there = self.at(distance, known if abs(distance - last) <= _NEAR_MM else None)
            now, farthest = self.excess(there), max(farthest, distance)
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
