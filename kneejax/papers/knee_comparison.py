"""Knees side by side: one ligament changed at a time under varus and valgus moments.

The study of paper 4: how far each variant holds the load, how its rotation, its peak contact
pressure and the place of that differ from the unchanged knee's, and scores by its Table 5.
"""

import dataclasses
import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import State
from kneejax.inference import versions
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.papers.varus_valgus import DIRECTIONS, VarusValgus, VarusValgusRamp, peak_pressure
from kneejax.parameters import UnsuitableData, fibre_rows
from kneejax.statics import balance_many, in_lanes

#: What is changed of a ligament, or of all menisci with horns: in words, unit of a change's value.
CHANGED = {
    "prestretch": ("prestretch", ""), "youngs_modulus": ("Young's modulus", "MPa"),
    "attachment": ("attachment", ""), "horn_stiffness": ("horn stiffness", "N/mm"),
}  # fmt: skip
#: Values of an attachment's change: which ends are halved.
HALVES = {1.0: "femoral half", 2.0: "tibial half", 3.0: "both halves"}
#: Outcomes, and the upper limits of the scores 0.5, 1, 1.5, 2 and 2.5 in the outcome's unit.
LIMITS = {"convergence_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
          "rmse_deg": (0.2, 0.5, 0.9, 1.4, 2.0), "pressure_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
          "displacement_mm": (0.2, 0.5, 1.25, 2.5, 4.0)}  # fmt: skip
#: What a balance leaves open counts as no difference.
NOUGHT = 1e-6


def _fibres(knee: Knee) -> tuple[Any, ...]:
    """What a change moves: four arrays of all fibres, and the stiffness of each pair of horns."""
    own = knee.ligaments
    horns = (contact.ring.horn_stiffness for contact in knee.contacts if contact.ring is not None)
    return (own.stiffness, own.slack_length, own.femoral_attachment, own.tibial_attachment, *horns)


def with_fibres(knee: Knee, fibres: tuple[Any, ...]) -> Knee:
    """The knee with other numbers of its fibres and horns, as `changes_of` has them."""
    return eqx.tree_at(_fibres, knee, fibres)


@dataclasses.dataclass(frozen=True)
class Change:
    """A ligament, or the menisci, that differ from the unchanged knee's."""

    ligament: str  # its name, or that of a group of fibres; `menisci`
    quantity: str  # a key of `CHANGED`
    value: float  # how much is added: of stretch; MPa; N/mm a horn; or a key of `HALVES`

    @property
    def parameter(self) -> str:
        """Name of what is changed, e.g. `MCL.prestretch`."""
        return f"{self.ligament}.{self.quantity}"

    @property
    def label(self) -> str:
        """The value in words or with its unit."""
        if self.quantity == "attachment":
            return HALVES[self.value]
        return f"{self.value:+g} {CHANGED[self.quantity][1]}".strip()


def changes_of(knee: Knee, settings: "OneAtATime") -> tuple[tuple[Change, ...], tuple[Array, ...]]:
    """Every change of every ligament, and what `with_fibres` takes, the unchanged knee's first.

    A prestretch adds to the reference strain of all fibres of a ligament. A change of Young's
    modulus scales their stiffnesses by `1 + change / reference_modulus_MPa`. An attachment is
    halved as in paper 4, on the femur to the most proximal half of the fibres' ends, on the tibia
    or fibula to the most distal half: the other fibres end at the nearest of those, as taut at
    the reference pose as before. A single line has no halves. Horns of menisci change together;
    what would leave them no stiffness is left out.
    """
    own, length = knee.ligaments, np.asarray(knee.reference_length())

    def one(ligament: str) -> Iterator[tuple[Change, Knee]]:
        rows = fibre_rows(knee, ligament)
        for value in settings.prestretch:
            slack = np.array(own.slack_length)
            slack[rows] = length[rows] / (length[rows] / slack[rows] + value)
            yield Change(ligament, "prestretch", value), with_ligaments(knee, slack_length=slack)
        for value in settings.modulus_MPa:
            stiffness = np.array(own.stiffness)
            stiffness[rows] *= 1.0 + value / settings.reference_modulus_MPa
            softer = with_ligaments(knee, stiffness=stiffness)
            yield Change(ligament, "youngs_modulus", value), softer
        for value in HALVES if len(rows) > 1 else ():
            femoral, tibial = np.array(own.femoral_attachment), np.array(own.tibial_attachment)
            if value != 2.0:
                femoral[rows] = _gathered(femoral[rows], femoral[rows][:, 1])
            if value != 1.0:
                tibial[rows] = _gathered(tibial[rows], -tibial[rows][:, 1])
            moved = with_ligaments(knee, femoral_attachment=femoral, tibial_attachment=tibial)
            slack = np.asarray(own.slack_length) * np.asarray(moved.reference_length()) / length
            yield Change(ligament, "attachment", value), with_ligaments(moved, slack_length=slack)

    found = [pair for ligament in settings.ligaments for pair in one(ligament)]
    *fibres, horns = *_fibres(knee)[:4], np.array(_fibres(knee)[4:], float)
    for value in settings.horn_N_per_mm if len(horns) else ():
        if (horns + value > 0.0).all():
            softer = with_fibres(knee, (*fibres, *(horns + value)))
            found.append((Change("menisci", "horn_stiffness", value), softer))
    variants = (_fibres(variant) for variant in (knee, *(variant for _, variant in found)))
    return tuple(change for change, _ in found), jax.tree.map(lambda *x: jnp.stack(x), *variants)


def with_ligaments(knee: Knee, **fibres: Any) -> Knee:
    """The knee with other arrays of its ligaments."""
    arrays = {name: jnp.asarray(x) for name, x in fibres.items()}
    return dataclasses.replace(knee, ligaments=dataclasses.replace(knee.ligaments, **arrays))


def _gathered(ends: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Ends `(n, 3)`, those of the lower half moved to the nearest of the higher half."""
    order = np.argsort(-height, kind="stable")
    kept = ends[order[: -(-len(ends) // 2)]]
    away = np.linalg.norm(ends[:, None] - kept[None], axis=-1)
    # Those that are kept are nearest to themselves.
    return kept[np.argmin(away, axis=1)]


def score(outcome: str, difference: float) -> float:
    """Score, 0 to 3, of an average difference to the unchanged knee (paper 4, Table 5)."""
    if math.isnan(difference):
        return math.nan
    if difference < NOUGHT:
        return 0.0
    return 0.5 + 0.5 * sum(difference > limit for limit in LIMITS[outcome])


@dataclasses.dataclass(frozen=True)
class OneAtATime:
    """Settings of the study; the defaults are paper 4's."""

    ligaments: tuple[str, ...] = ("ACL", "PCL", "MCL", "LCL")  # or groups, which every knee has
    #: Added to the reference strain; to Young's modulus.
    prestretch: tuple[float, ...] = (-0.1, -0.075, -0.05, -0.025, 0.025, 0.05, 0.075, 0.1)
    modulus_MPa: tuple[float, ...] = (-100.0, -75.0, -50.0, -25.0, 25.0, 50.0, 75.0, 100.0)
    #: Modulus that the knees' own stiffnesses stand for. A line has a stiffness and no cross-
    #: section, so a change of modulus is taken as a change of stiffness in proportion. 345 MPa was
    #: measured on fascicles of the ACL, PCL and LCL (Butler, Kay and Stouffer 1986); with it, 100
    #: MPa are 29 per cent.
    reference_modulus_MPa: float = 345.0
    horn_N_per_mm: tuple[float, ...] = (-162.0, -90.0, 180.0)  # 180: 18 springs; 1, 5, 20 N/mm each
    full_Nm: float = 40.0  # moment that is aimed at
    #: Half of it is the axial load; of the mean mass, 66.2 kg, of paper 4's subjects (its Table 1).
    body_weight_N: float = 649.2
    axial_steps: int = 4  # of the ramp
    moment_steps: int = 80  # likewise
    least_Nm: float = 10.0  # what does not get so far is left out where pressures are compared

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
        steps = self.axial_steps, self.moment_steps
        return VarusValgusRamp(direction, self.full_Nm, self.body_weight_N, *steps)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a change did in one direction; contacts in the order of the knee's."""

    change: Change  # of one ligament
    direction: str  # `varus` or `valgus`
    moment_reached_Nm: float  # last moment held, positive in varus
    convergence_percent: float  # difference in the last time held, of paper 4's time
    rmse_deg: float  # of the varus rotation over the moments that both knees hold; NaN without one
    compared_at_Nm: float  # moment at which pressures are compared; NaN where they are not
    peak_MPa: np.ndarray  # of each contact, of this and of the unchanged knee, `(2, contacts)`
    center_mm: np.ndarray  # its place in the tibia's frame, likewise, `(2, contacts, 3)`
    pressure_percent: float  # difference of the peaks, mean of the unchanged knee's contacts
    displacement_mm: float  # of the places, mean of the contacts that both knees have
    ending: str  # what ended the ramp, as in `VarusValgus.ending`


@dataclasses.dataclass(frozen=True)
class KneeStudy:
    """One knee's answers."""

    name: str  # of the knee
    contacts: tuple[str, ...]  # their names
    changes: tuple[Change, ...]  # of the variants after the first, the unchanged knee
    runs: dict[str, VarusValgus]  # direction -> all variants on the ramp
    tension_N: dict[str, dict[str, float]]  # direction -> ligament, unchanged, at its last step
    outcomes: tuple[Outcome, ...]  # one per change and direction
    doubts: tuple[str, ...]  # sentences on what limits the answers
    seconds: float  # spent

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what is changed, in order."""
        return tuple(dict.fromkeys(change.parameter for change in self.changes))

    def outcomes_of(self, parameter: str, direction: str) -> list[Outcome]:
        """Those of one parameter's changes in one direction."""
        asked = parameter, direction
        return [one for one in self.outcomes if (one.change.parameter, one.direction) == asked]

    def averages(self, parameter: str, outcome: str) -> dict[str, float]:
        """Direction -> mean of an outcome over the values of a parameter; NaN if unknown."""
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
    """Knees side by side."""

    knees: tuple[KneeStudy, ...]  # one per knee
    settings: OneAtATime  # of the study
    versions: dict[str, str]  # package -> version

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
    knees: Mapping[str, Knee], settings: OneAtATime | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> KneeComparison:  # fmt: skip
    """Change one ligament at a time, and menisci, in several knees under varus and valgus moments
    (paper 4, sections 2.2 to 2.4); `progress` sees balances done and all."""
    settings = settings or OneAtATime()
    if not knees:
        raise UnsuitableData("no knees; expected one or more")
    # All are looked at before the first is computed.
    work = {name: changes_of(knee, settings) for name, knee in knees.items()}
    ramps = {direction: settings.ramp(direction) for direction in DIRECTIONS}
    steps = sum(map(len, ramps.values()))
    total = sum((len(changes) + 1) * steps for changes, _ in work.values())
    studies, done = [], 0
    for name, (changes, fibres) in work.items():
        begun, runs, outcomes = time.perf_counter(), {}, []
        for direction, ramp in ramps.items():
            shown = progress and (lambda more, _, before=done: progress(before + more, total))
            found = balance_many(knees[name], with_fibres, fibres, ramp.load_cases, progress=shown)
            run = runs[direction] = VarusValgus(ramp, found)
            done += (len(changes) + 1) * len(ramp)
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
    own, lanes = np.array([0, *rows]), add_lane_axis(knee)
    if any(change.quantity == "horn_stiffness" for change in changes.values()):
        lanes = in_lanes(knee, with_fibres, jax.tree.map(lambda x: x[own], fibres))
    q, points = (
        jnp.asarray(np.moveaxis(x[own, step], 0, -1))
        for x in (run.balances.q, run.balances.contact_points)
    )
    pose = State.of({"flexion": np.deg2rad(run.ramp.flexion_deg)}, q).tibia
    peak, center = map(np.array, peak_pressure(lanes, pose, points))
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
