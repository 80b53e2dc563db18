"""Knees side by side: one ligament changed at a time under varus and valgus moments.

The study of paper 4: how far each variant holds the load, how its rotation, its peak contact
pressure and the place of that differ from the unchanged knee's, and scores by its Table 5.
"""

from __future__ import annotations

import dataclasses
import math
import time
import warnings
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import State
from kneejax.inference import versions
from kneejax.mechanics import Knee
from kneejax.papers.fibre_changes import HORNS, Change, changes_of, with_fibres
from kneejax.papers.varus_valgus import (
    BODY_WEIGHT_N,
    DIRECTIONS,
    VarusValgus,
    VarusValgusRamp,
    peak_pressure,
    varus_valgus,
)
from kneejax.parameters import UnsuitableData, fibre_rows
from kneejax.statics import in_lanes

#: Outcomes, and the upper limits of the scores 0.5, 1, 1.5, 2 and 2.5 in the outcome's unit.
LIMITS = {"convergence_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
          "rmse_deg": (0.2, 0.5, 0.9, 1.4, 2.0), "pressure_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
          "displacement_mm": (0.2, 0.5, 1.25, 2.5, 4.0)}  # fmt: skip
#: What a balance leaves open counts as no difference.
NOUGHT = 1e-6


def score(outcome: str, difference: float) -> float:
    """Score of an average difference to the unchanged knee.

    Args:
        outcome: a key of `LIMITS`.
        difference: not negative; below `NOUGHT` it counts as none.

    Returns:
        0 to 3 in halves; NaN for NaN.

    Source: paper 4, Table 5.

    Example:
        >>> [score("rmse_deg", x) for x in (0.0, 0.2, 0.21, 2.0, 2.01)]
        [0.0, 0.5, 1.0, 2.5, 3.0]
    """
    if math.isnan(difference):
        return math.nan
    if difference < NOUGHT:
        return 0.0
    return 0.5 + 0.5 * sum(difference > limit for limit in LIMITS[outcome])


@dataclasses.dataclass(frozen=True)
class OneAtATime:
    """Settings of the study; the defaults are paper 4's.

    Attributes:
        ligaments: names that every knee must have, of ligaments or groups.
        prestretch: added to the reference strain.
        modulus_MPa: added to Young's modulus.
        reference_modulus_MPa: modulus that the knees' own stiffnesses stand for. A line has a
            stiffness and no cross-section, so a change of modulus is taken as a change of stiffness
            in proportion. 345 MPa was measured on fascicles of the ACL, PCL and LCL (Butler, Kay
            and Stouffer 1986); with it, 100 MPa are 29 per cent.
        horn_N_per_mm: added to each horn of menisci; 180 become 18 springs of 1, 5 and 20 N/mm.
        full_Nm: moment that is aimed at.
        body_weight_N: half of it is the axial load.
        axial_steps: of the ramp.
        moment_steps: likewise.
        least_Nm: a variant that does not get so far is left out where pressures are compared.
    """

    ligaments: tuple[str, ...] = ("ACL", "PCL", "MCL", "LCL")
    prestretch: tuple[float, ...] = (-0.1, -0.075, -0.05, -0.025, 0.025, 0.05, 0.075, 0.1)
    modulus_MPa: tuple[float, ...] = (-100.0, -75.0, -50.0, -25.0, 25.0, 50.0, 75.0, 100.0)
    reference_modulus_MPa: float = 345.0
    horn_N_per_mm: tuple[float, ...] = (-162.0, -90.0, 180.0)
    full_Nm: float = 40.0
    body_weight_N: float = BODY_WEIGHT_N
    axial_steps: int = 4
    moment_steps: int = 80
    least_Nm: float = 10.0

    def __post_init__(self):
        lowest = -min(self.modulus_MPa, default=0.0)
        if self.reference_modulus_MPa <= lowest:
            raise UnsuitableData(
                f"reference_modulus_MPa is {self.reference_modulus_MPa:g}; expected more than "
                f"{lowest:g}, which a change takes away"
            )
        if not self.full_Nm >= self.least_Nm > 0:
            raise UnsuitableData(
                f"full_Nm is {self.full_Nm:g}; expected at least least_Nm, which is "
                f"{self.least_Nm:g} and has to be above 0"
            )
        for name in ("body_weight_N", "axial_steps", "moment_steps"):
            if not getattr(self, name) > 0:
                raise UnsuitableData(f"{name} is {getattr(self, name):g}; expected more than 0")

    def ramp(self, direction: str) -> VarusValgusRamp:
        """The loads in a direction."""
        return VarusValgusRamp(
            direction, self.full_Nm, self.body_weight_N, self.axial_steps, self.moment_steps
        )


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a change did in one direction; contacts in the order of the knee's.

    Attributes:
        change: of one ligament.
        direction: `varus` or `valgus`.
        moment_reached_Nm: last moment held, positive in varus.
        convergence_percent: difference in the last time held, of paper 4's time.
        rmse_deg: of the varus rotation over the moments that both knees hold; NaN without one.
        compared_at_Nm: moment at which pressures are compared; NaN where they are not.
        peak_MPa: peak pressure of each contact, of this and of the unchanged knee,
            `(2, contacts)`.
        center_mm: its place in the tibia's frame, likewise, `(2, contacts, 3)`.
        pressure_percent: difference of the peak pressures, mean of the contacts. A contact that
            the unchanged knee does not have counts nowhere.
        displacement_mm: of the places, mean of the contacts that both knees have.
        ending: what ended the ramp, as in `VarusValgus.ending`.
    """

    change: Change
    direction: str
    moment_reached_Nm: float
    convergence_percent: float
    rmse_deg: float
    compared_at_Nm: float
    peak_MPa: np.ndarray
    center_mm: np.ndarray
    pressure_percent: float
    displacement_mm: float
    ending: str


@dataclasses.dataclass(frozen=True)
class KneeStudy:
    """One knee's answers.

    Attributes:
        name: of the knee.
        contacts: their names.
        changes: in the order of the variants after the first, which is the unchanged knee.
        runs: direction -> all variants on the ramp.
        tension_N: direction -> ligament -> tension in the unchanged knee at its last step.
        outcomes: one per change and direction.
        doubts: sentences on what limits the answers.
        seconds: spent.
    """

    name: str
    contacts: tuple[str, ...]
    changes: tuple[Change, ...]
    runs: dict[str, VarusValgus]
    tension_N: dict[str, dict[str, float]]
    outcomes: tuple[Outcome, ...]
    doubts: tuple[str, ...]
    seconds: float

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what is changed, in order."""
        return tuple(dict.fromkeys(change.parameter for change in self.changes))

    def outcomes_of(self, parameter: str, direction: str) -> list[Outcome]:
        """Those of one parameter's changes in one direction."""
        asked = parameter, direction
        return [one for one in self.outcomes if (one.change.parameter, one.direction) == asked]

    def averages(self, parameter: str, outcome: str) -> dict[str, float]:
        """Direction -> mean of an outcome, a key of `LIMITS`, over the values of a parameter; NaN
        where nothing is known."""
        values = {x: [getattr(one, outcome) for one in self.outcomes_of(parameter, x)]
                  for x in DIRECTIONS}  # fmt: skip
        return {direction: float(_mean_known(np.array(x))) for direction, x in values.items()}

    def scores(self, parameter: str, outcome: str) -> dict[str, float]:
        """Direction -> score of that mean."""
        averages = self.averages(parameter, outcome)
        return {direction: score(outcome, average) for direction, average in averages.items()}

    def score(self, parameter: str, outcome: str) -> float:
        """Mean of the directions' scores; NaN where one is unknown."""
        return float(np.mean([*self.scores(parameter, outcome).values()]))


@dataclasses.dataclass(frozen=True)
class KneeComparison:
    """Knees side by side.

    Attributes:
        knees: one per knee.
        settings: of the study.
        versions: package -> version.
    """

    knees: tuple[KneeStudy, ...]
    settings: OneAtATime
    versions: dict[str, str]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters of all knees together, quantity by quantity."""
        every = dict.fromkeys(name for knee in self.knees for name in knee.parameters)
        quantities = list(dict.fromkeys(name.split(".")[1] for name in every))
        return tuple(sorted(every, key=lambda name: quantities.index(name.split(".")[1])))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Those of all knees, with their names."""
        return tuple(f"{knee.name}: {doubt}" for knee in self.knees for doubt in knee.doubts)


def compare_knees(
    knees: Mapping[str, Knee],
    settings: OneAtATime | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> KneeComparison:
    """Change one ligament at a time, and menisci, in several knees under varus and valgus moments.

    Args:
        knees: name -> knee, each with the ligaments of the settings.
        settings: paper 4's by default.
        progress: called with how many balances are done, and of how many.

    Returns:
        Outcomes and scores of every knee.

    Raises:
        UnknownParameter: a knee lacks a ligament.
        UnsuitableData: no knees.

    Source: paper 4, sections 2.2 to 2.4.
    """
    settings = settings or OneAtATime()
    if not knees:
        raise UnsuitableData("no knees; expected one or more")
    # All are looked at before the first is computed.
    asked = (settings.ligaments, settings.prestretch, settings.modulus_MPa,
             settings.reference_modulus_MPa, settings.horn_N_per_mm)  # fmt: skip
    work = {name: changes_of(knee, *asked) for name, knee in knees.items()}
    ramps = {direction: settings.ramp(direction) for direction in DIRECTIONS}
    steps = sum(map(len, ramps.values()))
    total = sum((len(changes) + 1) * steps for changes, _ in work.values())
    studies, done = [], 0
    for name, (changes, fibres) in work.items():
        begun, runs, outcomes = time.perf_counter(), {}, []
        for direction, ramp in ramps.items():
            shown = progress and (lambda more, _, before=done: progress(before + more, total))
            run = varus_valgus(knees[name], ramp, with_fibres, fibres, shown)
            runs[direction], done = run, done + (len(changes) + 1) * len(ramp)
            for parameter in dict.fromkeys(change.parameter for change in changes):
                rows = {i: c for i, c in enumerate(changes, 1) if c.parameter == parameter}
                outcomes += _outcomes(knees[name], fibres, run, rows, settings.least_Nm)
        tensions = {x: _tensions(knees[name], run, settings.ligaments) for x, run in runs.items()}
        doubts, seconds = _doubts(runs, outcomes, settings), time.perf_counter() - begun
        parts = knees[name].contact_names, changes, runs, tensions, tuple(outcomes)
        studies.append(KneeStudy(name, *parts, doubts, seconds))
    return KneeComparison(tuple(studies), settings, versions())


def _tensions(knee: Knee, run: VarusValgus, ligaments: tuple[str, ...]) -> dict[str, float]:
    """Of each ligament at the last step that the unchanged knee holds, N."""
    step = max(int(run.reached[0]) - 1, 0)
    held = {"flexion": np.deg2rad(run.ramp.flexion_deg)}
    state = State.of(held, jnp.asarray(run.balances.q[0, step]))
    tension = np.asarray(knee.ligaments.tension(state))
    return {name: float(tension[fibre_rows(knee, name)].sum()) for name in ligaments}


def _outcomes(
    knee: Knee, fibres: tuple, run: VarusValgus, changes: dict[int, Change], least_Nm: float
) -> list[Outcome]:
    """Of the changes of one parameter, by variant, which are compared at one moment."""
    rows = list(changes)
    both = run.held[rows] & run.held[0] & run.ramp.loaded
    apart = np.where(both, run.adduction_deg[rows] - run.adduction_deg[0], 0.0)
    count = both.sum(axis=1)
    rmse = np.where(count, np.sqrt((apart**2).sum(axis=1) / np.maximum(count, 1)), np.nan)
    late = 100.0 * np.abs(run.time_reached[rows] / run.time_reached[0] - 1.0)
    step, far = common_step(run, rows, least_Nm)
    # Where only ligaments are changed the contacts are the knee's own.
    own, lanes = np.array([0, *rows]), None
    if any(change.quantity == HORNS for change in changes.values()):
        lanes = in_lanes(knee, with_fibres, jax.tree.map(lambda x: x[own], fibres))
    q, points = (
        jnp.asarray(np.moveaxis(x[own, step], 0, -1))
        for x in (run.balances.q, run.balances.contact_points)
    )
    pose = State.of({"flexion": np.deg2rad(run.ramp.flexion_deg)}, q).tibia
    peak, center = map(np.array, peak_pressure(knee, pose, points, lanes=lanes))
    unknown = ~np.r_[far.any(), far]
    peak[unknown] = center[unknown] = np.nan
    percent, moved = differences(peak, center)
    return [
        Outcome(
            change, run.ramp.direction, float(run.moment_reached_Nm[row]), float(late[i]),
            float(rmse[i]), float(run.ramp.moment_Nm[step]) if far[i] else math.nan,
            peak[[i + 1, 0]], center[[i + 1, 0]], float(percent[i]), float(moved[i]),
            run.ending[row],
        )
        for i, (row, change) in enumerate(changes.items())
    ]  # fmt: skip


def common_step(run: VarusValgus, rows: list[int], least_Nm: float) -> tuple[int, np.ndarray]:
    """The last step that the knee and all variants hold that get far enough, and which do."""
    enough = np.abs(run.moment_reached_Nm) >= least_Nm
    far = enough[rows] & enough[0]
    reached = [run.reached[0], *run.reached[rows][far]]
    return int(max(min(reached) - 1, 0)), far


def differences(peak: np.ndarray, center: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Difference of pressure in per cent and of place in mm to the first row, contacts averaged."""
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = np.where(peak[0] > 0, 100.0 * np.abs(peak[1:] / peak[0] - 1.0), np.nan)
    moved = np.linalg.norm(center[1:] - center[0], axis=-1)
    return _mean_known(percent), _mean_known(moved)


def _mean_known(x: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a mean of nothing is NaN
        return np.nanmean(x, axis=-1)


def _doubts(
    runs: dict[str, VarusValgus], outcomes: list[Outcome], settings: OneAtATime
) -> tuple[str, ...]:
    doubts = []
    for direction, run in runs.items():
        own = [one for one in outcomes if one.direction == direction]
        reached = abs(float(run.moment_reached_Nm[0]))
        if run.reached[0] < len(run.ramp):
            doubts.append(
                f"unchanged, it holds {reached:g} of {settings.full_Nm:g} N m in {direction} "
                f"({run.ending[0]} beyond); variants are compared up to there"
            )
        left_out = sum(abs(one.moment_reached_Nm) < settings.least_Nm for one in own)
        if left_out:
            doubts.append(
                f"{left_out} of {len(own)} variants do not hold {settings.least_Nm:g} N m in "
                f"{direction}: their pressures are left out"
            )
    return tuple(doubts)
