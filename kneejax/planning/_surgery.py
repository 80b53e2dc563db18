"""A planned reconstruction, what a choice of tunnels and tension does to the knee, and limits."""

__all__ = ["CHOICES", "Limits", "Near", "Outcome", "Surgery", "best_of", "criteria_of", "missed"]

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.numerics import Named
from kneejax.planning._followed import Fixed, Followed, Protocol, fix, follow
from kneejax.planning._footprints import Footprint, offsets, warped_distances
from kneejax.planning._reconstruction import BUNDLE_NUMBERS, Reconstruction
from kneejax.statics import Progress, Slopes, Status, converged

#: Choices of a bundle, in this order; lengths in mm from the middle of the footprint, tension in N.
CHOICES = ("tibia_first", "tibia_second", "femur_first", "femur_second", "tension")
#: Bone -> which of them place the tunnel there.
TUNNELS = {TIBIA: [0, 1], FEMUR: [2, 3]}

_ANY_LENGTH_MM = 1000.0
#: By how much a constraint may be missed, as a part of its limit.
TOLERANCE = 1e-4
#: Of the polygons that stand for ellipses: within 0.001 of them.
_SIDES = 64


@dataclasses.dataclass(frozen=True)
class Limits:
    """What a reconstruction must keep.

    Attributes:
        graft_N: largest force of a bundle.
        band_mm: how far the laxity may be from the intact knee's.
        tension_N: smallest and largest pretension.

    Example:
        >>> limits = Limits(graft_N=400.0, band_mm=2.0, tension_N=(20.0, 150.0))
        >>> limits.graft_N
        400.0
    """

    graft_N: float
    band_mm: float
    tension_N: tuple[float, float]


class Near(NamedTuple):
    """Balances of some choices, from which those of near ones are predicted."""

    fixed: Slopes
    followed: Slopes


@dataclasses.dataclass(frozen=True)
class Outcome(Named):
    """What choices do; arrays begin with the variant.

    Attributes:
        choices: `(v, 5 bundles)`, see `CHOICES`.
        slack_mm: zero-load lengths of the grafts, `(v, bundles)`.
        distance: of each strain curve from the intact knee's, `(v, ligaments)`, see
            `Surgery.ligaments`; NaN where the knee has no balance somewhere.
        laxity_mm: how far the full force draws the tibia forwards, `(v, tests)`.
        graft_N: tension of the grafts at all load cases, `(v, s, bundles)`.
        isometry_mm: by how much each graft's length changes through the motion, `(v, bundles)`.
        status: the worst of all balances, `Status` values, `(v,)`.
        followed: all that was read.
        slopes: derivatives of `total`, `laxity_mm`, `graft_N` and of the `strain` of
            `Surgery.strain` by the choices, by name; None where none were asked for.
        near: None likewise.
    """

    choices: np.ndarray
    slack_mm: np.ndarray
    distance: np.ndarray
    laxity_mm: np.ndarray
    graft_N: np.ndarray
    isometry_mm: np.ndarray
    status: np.ndarray
    followed: Followed
    slopes: dict[str, np.ndarray] | None = None
    near: Near | None = None

    OVER = {
        "variant choice": {"choices": ""}, "variant bundle": {"slack_mm": "", "isometry_mm": ""},
        "variant ligament": {"distance": "1"}, "variant test": {"laxity_mm": ""},
        "variant load_case bundle": {"graft_N": ""}, "variant": {"peak_N": "", "status": Status},
    }  # fmt: skip

    @property
    def total(self) -> np.ndarray:
        """Distance of all strain curves together, `(v,)`."""
        return self.distance.sum(axis=1)

    @property
    def peak_N(self) -> np.ndarray:
        """Largest force of any bundle, through the motion and under the tests, `(v,)`."""
        return self.graft_N.max(axis=(1, 2))

    def taken(self, rows: Sequence[int] | np.ndarray) -> "Outcome":
        """Some of the variants, with derivatives and balances where there are any."""
        some = np.asarray(rows)

        def of(found: Outcome | Followed) -> dict[str, np.ndarray]:
            return {k: x[some] for k, x in vars(found).items() if isinstance(x, np.ndarray)}

        followed = dataclasses.replace(self.followed, **of(self.followed), slopes=None, near=None)
        return dataclasses.replace(
            self, **of(self), followed=followed,
            slopes=self.slopes and {name: x[some] for name, x in self.slopes.items()},
            near=self.near and Near(self.near.fixed.take(some), self.near.followed.take(some)),
        )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Surgery:
    """A reconstruction that is planned on one knee.

    Attributes:
        plan: the knee and its grafts.
        tibia: insertion there.
        femur: likewise.
        replaced: of each bundle, the torn fibres whose strain it should have.
        fixation_deg: flexion at which the grafts are fixed.
        protocol: what knees are put through.
        window: of the alignment of strain curves, in load cases.
        limits: what must be kept.
    """

    plan: Reconstruction
    tibia: Footprint
    femur: Footprint
    replaced: tuple[tuple[str, ...], ...]
    fixation_deg: float
    protocol: Protocol
    window: int
    limits: Limits

    @property
    def ligaments(self) -> tuple[str, ...]:
        """Whose strain curves are compared: all that are not torn, then the grafts."""
        return *self.plan.others, *self.plan.bundles

    def footprint(self, bone: str) -> Footprint:
        """The insertion on a bone."""
        return {TIBIA: self.tibia, FEMUR: self.femur}[bone]

    @functools.cached_property
    def before(self) -> Followed:
        """The intact knee, and that without the ligament: two variants."""
        ends, _ = self.ends(np.zeros((1, len(CHOICES) * len(self.plan.bundles))))
        values = [self.plan.value(ends, elastic=False, torn=torn) for torn in (False, True)]
        return follow(self.plan, np.vstack(values), self.protocol)

    @functools.cached_property
    def intact_strain(self) -> np.ndarray:
        """Strain that each ligament should have through the motion, `(angles, ligaments)`."""
        strain = self.before.strain[0, self.protocol.motion]
        own = strain[:, self.plan.rows(self.plan.others)]
        of_grafts = [strain[:, self.plan.rows(names)].mean(axis=1) for names in self.replaced]
        return np.column_stack([own, *of_grafts])

    def strain(self, followed: Followed) -> np.ndarray:
        """Strain of each ligament through the motion, `(v, angles, ligaments)`."""
        return followed.strain[:, self.protocol.motion][..., self.plan.rows(self.ligaments)]

    def laxity(self, followed: Followed) -> np.ndarray:
        """How far the full force draws the tibia forwards, `(v, tests)`, mm."""
        begin, end = self.protocol.ends_of_tests
        return followed.anterior_mm[:, end] - followed.anterior_mm[:, begin]

    def ends(self, choices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where tunnels are.

        Args:
            choices: `(v, 5 bundles)`.

        Returns:
            Femoral and tibial points `(v, bundles, 6)`, mm, and their derivative by the bundle's
            four coordinates, `(v, bundles, 6, 4)`.
        """
        each = choices.reshape(-1, len(CHOICES))
        tibial, by_tibia = self.tibia.place(each[:, TUNNELS[TIBIA]])
        femoral, by_femur = self.femur.place(each[:, TUNNELS[FEMUR]])
        slope = np.zeros((len(each), 6, 4))
        slope[:, :3, 2:], slope[:, 3:, :2] = by_femur, by_tibia
        shape = len(choices), len(self.plan.bundles)
        return np.hstack([femoral, tibial]).reshape(*shape, 6), slope.reshape(*shape, 6, 4)

    def try_out(
        self, choices: np.ndarray, *, slopes: bool = False, near: Near | None = None,
        grid: tuple[int, int] | None = None, progress: Progress | None = None,
        slack_mm: np.ndarray | None = None,
    ) -> Outcome:  # fmt: skip
        """Fix grafts and put the knees through the protocol.

        Args:
            choices: `(v, 5 bundles)`, see `CHOICES`.
            slopes: whether derivatives by the choices are wanted.
            near: balances of near choices.
            grid: rows and columns in which the choices stand, if they are near each other.
            progress: called now and then with balances done and asked for.
            slack_mm: zero-load lengths of grafts that are given in place of tensions,
                `(v, bundles)`; then there are no derivatives.
        """
        choices = np.atleast_2d(np.asarray(choices, float))
        ends, ends_slope = self.ends(choices)
        tension = choices.reshape(*ends.shape[:2], -1)[..., 4]
        if slack_mm is not None:
            fixed, slopes = Fixed(slack_mm, None, np.zeros(len(choices), int), None), False
        else:
            fixed = fix(
                self.plan, ends, tension, self.fixation_deg, slopes=slopes,
                near=near and near.fixed, grid=grid,
            )  # fmt: skip
        # A graft that was not fixed is slack: its variant does not count.
        known = np.isfinite(fixed.slack_mm)
        slack = np.where(known, fixed.slack_mm, _ANY_LENGTH_MM)
        followed = follow(
            self.plan, self.plan.value(ends, slack), self.protocol, slopes=slopes,
            near=near and near.followed, grid=grid, progress=progress,
        )  # fmt: skip
        grafts, motion = self.plan.rows(self.plan.bundles), self.protocol.motion
        strain = self.strain(followed)
        curves = zip(np.moveaxis(strain, -1, 0), self.intact_strain.T, strict=True)
        distance = np.stack([warped_distances(*pair, self.window) for pair in curves], axis=1)
        length = followed.length_mm[:, motion][..., grafts]
        # Of grafts that were not fixed nothing is known.
        counts = np.where(known.all(axis=1), 1.0, np.nan)[:, None]
        # Where a Lachman test gives way, the motion stands all the same.
        moves = np.array(converged(followed.status[:, motion].max(axis=1)))
        distance[~moves | np.isnan(counts[:, 0])] = np.nan
        by = found_near = None
        if slopes:
            assert fixed.slope is not None and fixed.near is not None and followed.near is not None
            by = self._slopes(followed, ends_slope, fixed.slope)
            found_near = Near(fixed.near, followed.near)
        return Outcome(
            choices, fixed.slack_mm, distance, self.laxity(followed) * counts,
            followed.tension_N[..., grafts] * counts[..., None],
            np.ptp(length, axis=1) * counts, np.maximum(fixed.status, followed.status.max(axis=1)),
            followed, by, found_near,
        )  # fmt: skip

    def _slopes(
        self, followed: Followed, ends_slope: np.ndarray, slack_slope: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Derivatives by the choices, from those of each bundle's ends by its coordinates,
        `(v, bundles, 6, 4)`, and of the slack lengths by the numbers of the knee under tension,
        `(v, bundles, numbers)`."""
        by, (count, bundles) = followed.slopes, ends_slope.shape[:2]
        assert by is not None
        # Of a fixed knee's numbers by the choices, and of those of the knee under tension.
        turn = np.zeros((count, slack_slope.shape[-1], len(CHOICES) * bundles))
        pulling = np.zeros_like(turn)
        for k in range(bundles):
            row, column = 1 + BUNDLE_NUMBERS * k, len(CHOICES) * k
            turn[:, row : row + 6, column : column + 4] = ends_slope[:, k]
            pulling[:, row + 8, column + 4] = 1.0
        turn[:, 7::BUNDLE_NUMBERS] = slack_slope @ (turn + pulling)
        grafts, rows = self.plan.rows(self.plan.bundles), self.plan.rows(self.ligaments)
        strain = self.strain(followed)
        by_strain = by["strain"][:, self.protocol.motion][:, :, rows] @ turn[:, None]
        total = np.full(turn.shape[::2], np.nan)
        for v in np.flatnonzero(np.isfinite(strain).all(axis=(1, 2))):
            offset, by_offset = offsets(strain[v], by_strain[v], self.intact_strain, self.window)
            total[v] = np.sign(offset) @ by_offset
        begin, end = self.protocol.ends_of_tests
        drawn = by["anterior_mm"][:, end, 0] - by["anterior_mm"][:, begin, 0]
        pull = by["tension_N"][:, :, grafts] @ turn[:, None]
        return {"total": total, "strain": by_strain, "laxity_mm": drawn @ turn, "graft_N": pull}


def missed(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """By how much each variant misses its worst limit, as a part of that, `(v,)`.

    Args:
        surgery: with its limits.
        outcome: of any choices.

    Returns:
        0 where all limits are kept; infinite where the knee has no balance somewhere.
    """
    return np.maximum(excess(surgery, outcome), 0.0)


def excess(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """As `missed`, but negative where all limits are kept: by how much there is room, `(v,)`."""
    each = outcome.choices.reshape(len(outcome.choices), -1, len(CHOICES))
    inside = (
        1.0 - surgery.footprint(bone).outside(each[..., own]) ** 2 for bone, own in TUNNELS.items()
    )
    worst = -np.hstack([*inside, limits_room(surgery, outcome)]).min(axis=1)
    known = np.isfinite(outcome.total) & converged(outcome.status) & np.isfinite(worst)
    return np.where(known, worst, np.inf)


def criteria_names(surgery: Surgery) -> tuple[str, ...]:
    """Of the criteria of `criteria_of`."""
    tests = [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    return *tests, "graft_peak_N", "strain_distance"


def criteria_of(outcome: Outcome) -> np.ndarray:
    """What is to be small, `(v, criteria)`: laxity at each test, mm, largest graft force, N, and
    strain distance."""
    return np.column_stack([outcome.laxity_mm, outcome.peak_N, outcome.total])


def best_of(surgery: Surgery, outcome: Outcome) -> int:
    """The variant of the least strain distance among those that keep all limits; where none does,
    the one that misses them least."""
    return int(ranked(missed(surgery, outcome), outcome.total)[0])


def ranked(far: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Rows of variants, the best first as `best_of` has it, by `missed` and strain distance."""
    kept = far <= TOLERANCE
    return np.argsort(np.where(kept, total, np.inf) if kept.any() else far, kind="stable")


def bounds(surgery: Surgery) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest of each choice."""
    wide = np.r_[surgery.tibia.semi_axes_mm, surgery.femur.semi_axes_mm]
    (low, high), bundles = surgery.limits.tension_N, len(surgery.plan.bundles)
    return np.tile(np.r_[-wide, low], bundles), np.tile(np.r_[wide, high], bundles)


def limits_room(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """What is left of the limits of graft forces and laxity, as a part of each, `(v, limits)`:
    negative where it is missed."""
    count, limits = len(outcome.choices), surgery.limits
    graft = 1.0 - outcome.graft_N.reshape(count, -1) / limits.graft_N
    off = (outcome.laxity_mm - surgery.laxity(surgery.before)[0]) / limits.band_mm
    return np.hstack([graft, 1.0 - off, 1.0 + off])


def polygons(surgery: Surgery) -> tuple[np.ndarray, np.ndarray]:
    """The footprints as polygons within their ellipses, `sides @ choices <= inside`: a limit that
    is curved would be missed a little by every step of a linear model along it."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bundles = len(surgery.plan.bundles)
    sides = np.zeros((bundles, 2, _SIDES, bundles, len(CHOICES)))
    for bundle in range(bundles):
        for k, (bone, own) in enumerate(TUNNELS.items()):
            axes = np.array(surgery.footprint(bone).semi_axes_mm)
            sides[bundle, k, :, bundle][:, own] = normals / axes
    sides = sides.reshape(-1, bundles * len(CHOICES))
    return sides, np.full(len(sides), np.cos(np.pi / _SIDES))
