"""Lachman tests of paper 2 on its ten bundles, intact, with one bundle of the ACL, and without."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from kneejax.experiments import lab_tests, load_curves, mechanics_of
from kneejax.mechanics import Knee
from kneejax.parameters import cut, select
from kneejax.statics import Status

FULL_N, FLEXION_DEG, STEPS = 100.0, 20.0, 10
#: Displacement of the patient's deficient knee under the full load, mm (paper 2, section 4.2).
MEASURED_MM = 8.0
COLLATERALS = ("aMCL", "iMCL", "pMCL", "aDMCL", "pDMCL", "LCL")
#: What is added to the reference strain of every collateral bundle to reach the measured
#: displacement: the paper's measurement is one number, so one is fitted, between two of these.
PRESTRAINS = (0.0, 0.04, 0.08, 0.12, 0.16)
#: Refinements between the two neighbours, and what is near enough, mm.
MOST_STEPS, NEAR_ENOUGH_MM = 4, 0.02
#: Changes of the resting length of both ACL bundles, about a millimetre.
LENGTH_CHANGES = (-0.03, 0.03)


@dataclasses.dataclass(frozen=True)
class Lachman:
    """One Lachman test.

    Attributes:
        moved: anterior displacement at each load, mm, `(loads,)`; NaN beyond what the knee holds.
        tension: bundle -> its tension, N, `(loads,)`.
        neutral: where the tibia is without the load, mm along the same axis.
        along: N per mm that the tensions alone hold the unloaded tibia by across their lines.
        status: the worst of all loads.
        held_N: the largest load that the knee holds.
    """

    moved: np.ndarray
    tension: dict[str, np.ndarray]
    neutral: float
    along: float
    status: Status
    held_N: float

    @property
    def end(self) -> float:
        """Displacement under the full load, mm."""
        return float(self.moved[-1])


@dataclasses.dataclass(frozen=True)
class Paper2Study:
    """What the claims are judged by.

    Attributes:
        load_N: of every test, `(loads,)`.
        printed: state of the ACL -> test with the printed numbers: `two bundles`, `one bundle`
            (anterior), `deficient`.
        calibrated: the same with the collaterals' calibrated strains.
        deficient: what was added to the collaterals' strains -> test without the ACL.
        prestrain: with which `calibrated` was made.
        longer: change of the ACL bundles' resting length -> test with both bundles.
    """

    load_N: np.ndarray
    printed: dict[str, Lachman]
    calibrated: dict[str, Lachman]
    deficient: dict[float, Lachman]
    prestrain: float
    longer: dict[float, Lachman]


#: State of the ACL -> bundles that are cut.
STATES = {"two bundles": (), "one bundle": ("pACL",), "deficient": ("ACL",)}


def paper2_study(knee: Knee) -> Paper2Study:
    """Make the Lachman tests that paper 2's claims are judged by.

    Args:
        knee: with the ten bundles of its Table 1 (`ten_bundle`).

    Returns:
        The `Paper2Study`.
    """
    def states(one: Knee) -> dict[str, Lachman]:
        return {name: lachman(cut(one, gone)) for name, gone in STATES.items()}

    printed = states(knee)
    deficient = {0.0: printed["deficient"]}
    for by in PRESTRAINS[1:]:
        deficient[by] = lachman(cut(_strained(knee, by), STATES["deficient"]))
    longer = {by: lachman(_longer(knee, by)) for by in LENGTH_CHANGES}
    for _ in range(MOST_STEPS):
        best = fitted({by: one.end for by, one in deficient.items()})
        if best in deficient:
            break
        deficient[best] = lachman(cut(_strained(knee, best), STATES["deficient"]))
    loads = FULL_N * np.linspace(0.0, 1.0, STEPS + 1)
    return Paper2Study(loads, printed, states(_strained(knee, best)), deficient, best, longer)


def fitted(ends: dict[float, float]) -> float:
    """What is added to strains so that the full load displaces by what was measured.

    Args:
        ends: what is added -> displacement, mm; NaN where the knee does not hold the load.

    Returns:
        One that is near enough; else between the two neighbours on either side of what was
        measured, on a straight line; the nearest one where there are none.

    Example:
        >>> round(fitted({0.0: float("nan"), 0.1: 10.0, 0.2: 6.0}), 3)
        0.15
    """
    held = [(by, ends[by]) for by in sorted(ends) if np.isfinite(ends[by])]
    nearest = min(held, key=lambda one: abs(one[1] - MEASURED_MM), default=(max(ends), np.nan))
    if abs(nearest[1] - MEASURED_MM) < NEAR_ENOUGH_MM:
        return nearest[0]
    for (low, far), (high, near) in zip(held, held[1:], strict=False):
        if (far - MEASURED_MM) * (near - MEASURED_MM) <= 0.0 and far != near:
            return low + (high - low) * (far - MEASURED_MM) / (far - near)
    return nearest[0]


def lachman(knee: Knee) -> Lachman:
    """The Lachman test of a knee."""
    (test,) = lab_tests("lachman", [FLEXION_DEG], force_N=FULL_N, steps=STEPS)
    (curves,) = load_curves(knee, test)
    (rows,) = curves.nodes
    mechanics = mechanics_of(curves)
    moved = np.asarray(curves.displacement_by_load)[0]
    known = np.isfinite(moved)
    tension = np.where(known[:, None], np.asarray(mechanics.tension)[rows], np.nan)
    along = np.sum(np.asarray(mechanics.tension)[rows[0]] / np.asarray(mechanics.length)[rows[0]])
    held = FULL_N * float(np.max(np.asarray(curves.part)[known], initial=0.0))
    status = Status(int(np.asarray(curves.status(mechanics)).max()))
    named = dict(zip(knee.ligaments.names, tension.T, strict=True))
    neutral = float(np.asarray(curves.neutral)[0])
    return Lachman(moved, named, neutral, float(along), status, held)


def _strained(knee: Knee, by: float) -> Knee:
    """The knee whose collaterals are more strained by so much."""
    names = tuple(f"{name}.reference_strain" for name in COLLATERALS)
    return _changed(knee, names, lambda x: x + by)


def _longer(knee: Knee, by: float) -> Knee:
    """The knee whose ACL bundles rest at a length larger by this part."""
    return _changed(knee, ("aACL.slack_length", "pACL.slack_length"), lambda x: x * (1.0 + by))


def _changed(knee: Knee, names: Sequence[str], change: Callable) -> Knee:
    selection = select(knee, tuple(names))
    return selection.apply(knee, change(selection.read(knee)))
