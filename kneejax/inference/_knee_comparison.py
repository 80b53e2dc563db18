"""Knees side by side: one ligament changed at a time under varus and valgus moments.

The study of paper 4: how far each variant holds the load, how its rotation, its peak contact
pressure and the place of that differ from the unchanged knee's, and scores by its Table 5.
"""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from kneejax.experiments import (
    BODY_WEIGHT_N,
    DIRECTIONS,
    VarusValgus,
    VarusValgusRamp,
    peak_pressure,
    varus_valgus,
)
from kneejax.geometry import Pose
from kneejax.inference._calibrate import versions
from kneejax.inference._fibre_changes import Change, Fibres, changes_of, with_fibres
from kneejax.inference._knee_scores import LIMITS, score
from kneejax.inference._parameters import UnsuitableData
from kneejax.mechanics import Knee

Progress = Callable[[int, int], None]


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
                f"full_Nm is {self.full_Nm:g}; expected at least {self.least_Nm:g}, which is least_Nm "
                "and has to be above 0"
            )
        for name in ("body_weight_N", "axial_steps", "moment_steps"):
            if not getattr(self, name) > 0:
                raise UnsuitableData(f"{name} is {getattr(self, name):g}; expected more than 0")

    def ramp(self, direction: str) -> VarusValgusRamp:
        """The loads in a direction."""
        return VarusValgusRamp.towards(
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
        peak_MPa: peak pressure of each contact.
        unchanged_peak_MPa: likewise, of the unchanged knee.
        center_mm: its place in the tibia's frame, `(contacts, 3)`.
        unchanged_center_mm: likewise, of the unchanged knee.
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
    unchanged_peak_MPa: np.ndarray
    center_mm: np.ndarray
    unchanged_center_mm: np.ndarray
    pressure_percent: float
    displacement_mm: float
    ending: str


@dataclasses.dataclass(frozen=True)
class Influence:
    """How much a parameter matters for an outcome.

    Attributes:
        parameter: e.g. `MCL.prestretch`.
        outcome: a key of `LIMITS`.
        average: direction -> mean over the values.
        scores: direction -> score of that mean.
    """

    parameter: str
    outcome: str
    average: dict[str, float]
    scores: dict[str, float]

    @property
    def score(self) -> float:
        """Mean of the directions' scores; NaN where one is unknown."""
        return float(np.mean(list(self.scores.values())))


@dataclasses.dataclass(frozen=True)
class KneeStudy:
    """One knee's answers.

    Attributes:
        name: of the knee.
        contacts: their names.
        changes: in the order of the variants after the first, which is the unchanged knee.
        runs: direction -> all variants on the ramp.
        outcomes: one a change and direction.
        influences: one a parameter and outcome.
        doubts: sentences on what limits the answers.
        seconds: spent.
    """

    name: str
    contacts: tuple[str, ...]
    changes: tuple[Change, ...]
    runs: dict[str, VarusValgus]
    outcomes: tuple[Outcome, ...]
    influences: tuple[Influence, ...]
    doubts: tuple[str, ...]
    seconds: float

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what is changed, in order."""
        return tuple(dict.fromkeys(change.parameter for change in self.changes))

    def influence(self, parameter: str, outcome: str) -> Influence | None:
        """That of a parameter on an outcome; None if the knee has not got the parameter."""
        for one in self.influences:
            if (one.parameter, one.outcome) == (parameter, outcome):
                return one
        return None


@dataclasses.dataclass(frozen=True)
class KneeComparison:
    """Knees side by side.

    Attributes:
        knees: one a knee.
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
    knees: Sequence[Knee], settings: OneAtATime | None = None, progress: Progress | None = None
) -> KneeComparison:
    """Change one ligament at a time in several knees, under varus and valgus moments.

    Args:
        knees: each with the ligaments of the settings.
        settings: paper 4's by default.
        progress: called with how many balances are done, and of how many.

    Returns:
        Outcomes and scores of every knee.

    Raises:
        UnknownParameter: a knee lacks a ligament.
        UnsuitableData: no knees, or two of one name.

    Source: paper 4, sections 2.2 to 2.4.
    """
    settings = settings or OneAtATime()
    names = [knee.name for knee in knees]
    if not names or len(set(names)) < len(names):
        given = ", ".join(names) or "none"
        raise UnsuitableData(f"knees are {given}; expected one or more, each once")
    # All are looked at before the first is computed.
    work = [(knee, *_changes(knee, settings)) for knee in knees]
    total = sum(len(changes) + 1 for _, changes, _ in work) * len(DIRECTIONS)
    steps, done, studies = settings.axial_steps + settings.moment_steps, 0, []
    for knee, changes, fibres in work:
        shown = _from(progress, done * steps, total * steps)
        studies.append(study_knee(knee, changes, fibres, settings, shown))
        done += (len(changes) + 1) * len(DIRECTIONS)
    return KneeComparison(tuple(studies), settings, versions())


def _changes(knee: Knee, settings: OneAtATime) -> tuple[tuple[Change, ...], Fibres]:
    return changes_of(
        knee,
        settings.ligaments,
        settings.prestretch,
        settings.modulus_MPa,
        settings.reference_modulus_MPa,
    )


def _from(progress: Progress | None, before: int, total: int) -> Progress | None:
    return None if progress is None else lambda done, _: progress(before + done, total)


def study_knee(
    knee: Knee,
    changes: tuple[Change, ...],
    fibres: Fibres,
    settings: OneAtATime,
    progress: Progress | None = None,
) -> KneeStudy:
    """One knee of `compare_knees`.

    Args:
        knee: unchanged.
        changes: what is changed.
        fibres: with a leading axis; those of the unchanged knee first.
        settings: of the study.
        progress: as there.
    """
    begun = time.perf_counter()
    base = Fibres(*(x[0] for x in fibres))
    steps, runs, outcomes = settings.axial_steps + settings.moment_steps, {}, []
    for place, direction in enumerate(DIRECTIONS):
        shown = _from(progress, place * len(fibres.stiffness) * steps, 0)
        ramp = settings.ramp(direction)
        runs[direction] = varus_valgus(knee, ramp, with_fibres, base, fibres, shown)
        for parameter in dict.fromkeys(change.parameter for change in changes):
            rows = [i for i, c in enumerate(changes, 1) if c.parameter == parameter]
            some = [changes[i - 1] for i in rows]
            outcomes += _outcomes(knee, runs[direction], direction, some, rows, settings)
    return KneeStudy(
        knee.name,
        knee.contact_names,
        changes,
        runs,
        tuple(outcomes),
        _influences(outcomes),
        _doubts(runs, outcomes, settings),
        time.perf_counter() - begun,
    )


def _outcomes(
    knee: Knee,
    run: VarusValgus,
    direction: str,
    changes: list[Change],
    rows: list[int],
    settings: OneAtATime,
) -> list[Outcome]:
    """Of the changes of one parameter, which are compared at one moment."""
    both = run.held[rows] & run.held[0] & run.ramp.loaded
    apart = np.where(both, run.adduction_deg[rows] - run.adduction_deg[0], 0.0)
    count = both.sum(axis=1)
    rmse = np.where(count, np.sqrt((apart**2).sum(axis=1) / np.maximum(count, 1)), np.nan)
    late = 100.0 * np.abs(run.time_reached[rows] / run.time_reached[0] - 1.0)
    step, far = _common_step(run, rows, settings.least_Nm)
    peak, center = _peaks(knee, run, [0, *rows], step, [bool(far.any()), *far])
    percent, moved = _compared(peak, center)
    return [
        Outcome(
            change,
            direction,
            float(run.moment_reached_Nm[rows[i]]),
            float(late[i]),
            float(rmse[i]),
            float(run.ramp.moment_Nm[step]) if far[i] else float("nan"),
            peak[i + 1],
            peak[0],
            center[i + 1],
            center[0],
            float(percent[i]),
            float(moved[i]),
            run.ending[rows[i]],
        )
        for i, change in enumerate(changes)
    ]


def _common_step(run: VarusValgus, rows: list[int], least_Nm: float) -> tuple[int, np.ndarray]:
    """The last step that the knee and all variants hold that get far enough, and which do."""
    enough = np.abs(run.moment_reached_Nm) >= least_Nm
    far = enough[rows] & enough[0]
    reached = [run.reached[0], *run.reached[rows][far]]
    return int(max(min(reached) - 1, 0)), far


def _peaks(knee: Knee, run: VarusValgus, variants: list[int], step: int, far: list[bool]):
    """Peak pressure `(variants, contacts)` and its place at a step; NaN for those not so far."""
    found = run.balances
    q, meeting = found.q[variants, step].T, np.moveaxis(found.meeting[variants, step], 0, -1)
    pose = Pose.from_state(np.deg2rad(run.ramp.flexion_deg), jnp.asarray(q))
    # Only ligaments are changed: the contacts are the knee's own.
    peaks = peak_pressure(knee, pose, jnp.asarray(meeting))
    known = np.array(far)
    pressure = np.where(known[:, None], np.asarray(peaks.pressure), np.nan)
    return pressure, np.where(known[:, None, None], np.asarray(peaks.center), np.nan)


def _compared(peak: np.ndarray, center: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Difference of pressure in per cent and of place in mm to the first row, contacts averaged."""
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = np.where(peak[0] > 0, 100.0 * np.abs(peak[1:] / peak[0] - 1.0), np.nan)
    moved = np.linalg.norm(center[1:] - center[0], axis=-1)
    return _mean_known(percent), _mean_known(moved)


def _mean_known(x: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a mean of nothing is NaN
        return np.nanmean(x, axis=-1)


def _influences(outcomes: list[Outcome]) -> tuple[Influence, ...]:
    answer = []
    for parameter in dict.fromkeys(one.change.parameter for one in outcomes):
        own = [one for one in outcomes if one.change.parameter == parameter]
        for name in LIMITS:
            average = {
                direction: float(
                    _mean_known(
                        np.array([getattr(o, name) for o in own if o.direction == direction])
                    )
                )
                for direction in DIRECTIONS
            }
            scores = {direction: score(name, mean) for direction, mean in average.items()}
            answer.append(Influence(parameter, name, average, scores))
    return tuple(answer)


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
