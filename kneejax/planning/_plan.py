"""A plan, and the same carried out: octagon, maps, optimum, front, and how exact to be."""

__all__ = [
    "FREE", "PLANNED", "AclPlan", "PlanResult", "intact_knee", "knee_of_outcome", "operated_knees",
    "run_plan",
]

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.parameters import UnsuitableData
from kneejax.planning._followed import fix
from kneejax.planning._footprints import octagon
from kneejax.planning._front import GENERATIONS, Front, pareto_front
from kneejax.planning._map import Intervals, Tolerance, TunnelMap, intervals, tolerances, tunnel_map
from kneejax.planning._optimum import MOST_EVALUATIONS, STARTS, Optimum, optimise
from kneejax.planning._reconstruction import GraftType
from kneejax.planning._surgery import CHOICES, TUNNELS, Outcome, Surgery

#: What an optimum may change: name -> columns of a bundle's choices.
FREE = TUNNELS | {"tension": [4]}


@dataclasses.dataclass(frozen=True)
class AclPlan:
    """A reconstruction that is planned.

    Attributes:
        title: of the report.
        surgery: the knee, its grafts, what it is put through, and the limits.
        own: the knee as it was read, before grafts were put in.
        ligament: that is torn.
        graft: its type.
        base: choices of the plan itself, `(choices,)`, see `kneejax.planning.CHOICES`.
        octagon_mm: apothem of the octagon on the tibia.
        map_points: along each axis of a map; 0 for no maps.
        map_half_mm: bone -> how far maps reach from the middle of the footprint.
        free: what the optimum may change, of `FREE`; empty for no optimum.
        starts: of the optimum.
        evaluations: of the optimum, in all.
        population: of the search for a front of several criteria; 0 for no front.
        generations: of the same.
        drawn: knees as the uncertainty of a calibration leaves them possible; none by default.
        held: parameters that the calibration does not determine, so that no draw changes them.
        said: the plan as it was given, for the records.
        document: of the knee's file.
        file: that it was read from.
    """

    title: str
    surgery: Surgery
    own: Knee
    ligament: str
    graft: GraftType
    base: np.ndarray
    octagon_mm: float = 10.0
    map_points: int = 41
    map_half_mm: dict[str, float] = dataclasses.field(
        default_factory=lambda: {TIBIA: 11.0, FEMUR: 8.0}
    )
    free: tuple[str, ...] = tuple(FREE)
    starts: int = STARTS
    evaluations: int = MOST_EVALUATIONS
    population: int = 0
    generations: int = GENERATIONS
    drawn: tuple[Knee, ...] = ()
    held: tuple[str, ...] = ()
    said: dict[str, Any] = dataclasses.field(default_factory=dict)
    document: dict[str, Any] = dataclasses.field(default_factory=dict)
    file: str = ""

    @property
    def free_choices(self) -> np.ndarray:
        """Which choices are free, `(choices,)`."""
        columns = [column for name in self.free for column in FREE[name]]
        return np.tile(np.isin(range(len(CHOICES)), columns), len(self.surgery.plan.bundles))

    @property
    def corners(self) -> np.ndarray:
        """Choices with the first bundle's tibial tunnel in the octagon, `(8, choices)`."""
        every = np.tile(self.base, (8, 1))
        every[:, :2] = octagon(self.octagon_mm)
        return every


#: What the knees are called that have no graft, and the one with the graft where it is planned.
INTACT, PLANNED = "intact", "planned"


def intact_knee(plan: AclPlan) -> Knee:
    """A plan's knee before anything is torn, of the structure of `operated_knees`.

    Args:
        plan: checked.

    Example:
        >>> from kneejax.studies import read_plan
        >>> intact_knee(read_plan("ten_bundle")).ligaments.names[:2]
        ('aACL', 'pACL')
    """
    return _knees(plan.surgery, plan.base[None], elastic=False, torn=False)[0]


def operated_knees(plan: AclPlan) -> dict[str, Knee]:
    """A plan's knee intact, without its ligament, and with the graft fixed where it is planned and
    in the corners of the octagon.

    Args:
        plan: checked.

    Returns:
        What each is called -> the knee; all of one structure, so that one program serves them.

    Raises:
        UnsuitableData: no knee holds the tension of fixation with the graft in some place.
    """
    surgery, one = plan.surgery, plan.surgery.plan
    choices = np.vstack([plan.base, plan.corners])
    names = [PLANNED, *(f"octagon {corner}" for corner in range(1, 9))]
    ends, _ = surgery.ends(choices)
    tension = choices.reshape(*ends.shape[:2], -1)[..., 4]
    slack = fix(one, ends, tension, surgery.fixation_deg).slack_mm
    lost = [name for name, own in zip(names, slack, strict=True) if not np.isfinite(own).all()]
    if lost:
        raise UnsuitableData(
            f"{plan.file}: fixation: the knee holds no graft under its tension at "
            f"{', '.join(lost)}: expected a tension under which it balances"
        )
    (torn,) = _knees(surgery, plan.base[None], elastic=False)
    bare = {INTACT: intact_knee(plan), f"without {plan.ligament}": torn}
    return bare | dict(zip(names, _knees(surgery, choices, slack), strict=True))


def _knees(surgery: Surgery, choices: np.ndarray, slack_mm=1.0, **acts: bool) -> list[Knee]:
    """With grafts of given lengths; `acts` as `Reconstruction.value` has it."""
    plan, (ends, _) = surgery.plan, surgery.ends(choices)
    return [plan.vary(plan.knee, own) for own in plan.value(ends, slack_mm, **acts)]


def knee_of_outcome(surgery: Surgery, outcome: Outcome) -> Knee:
    """The knee that was tried out, its grafts fixed at the lengths that were found.

    Args:
        surgery: that tried it out.
        outcome: whose first variant is meant.

    Returns:
        A knee in which the torn ligament does not act.

    Raises:
        UnsuitableData: no graft was fixed, since the knee had no balance under the tension.
    """
    slack = outcome.slack_mm[:1]
    if not np.isfinite(slack).all():
        raise UnsuitableData("the graft has no zero-load length: expected a knee that holds it")
    return _knees(surgery, outcome.choices[:1], slack)[0]


#: Called with a stage's name, balances done and asked for.
Show = Callable[[str, int, int], None]
_TENSIONS = 9


@dataclasses.dataclass(frozen=True)
class PlanResult(Named):
    """What a plan found.

    Attributes:
        plan: that was carried out.
        planned: the plan's own choices, with derivatives.
        octagon: the first bundle's tibial tunnel in the eight corners.
        tension: the plan's tunnels under other tensions.
        maps: of the first bundle's tunnels on tibia and femur; empty where none were asked for.
        optimum: None where none was asked for.
        front: choices that are best in some balance of several criteria; None likewise.
        intervals: what the uncertainty of the knee leaves open; None where no knees were drawn.
        tolerances: how far tunnels may be off, of the optimum, or of the plan where there is none.
        seconds: stage -> time.
    """

    plan: AclPlan
    planned: Outcome
    octagon: Outcome
    tension: Outcome
    maps: tuple[TunnelMap, ...]
    optimum: Optimum | None
    front: Front | None
    intervals: Intervals | None
    tolerances: tuple[Tolerance, ...]
    seconds: dict[str, float]

    def _named(self) -> dict[str, tuple]:
        parts = {"plan": self.planned, "octagon": self.octagon, "tension": self.tension}
        if self.optimum is not None:
            parts["optimum"] = self.optimum.outcome
        each = [part._named() for part in parts.values()]
        whole = {
            name: (over, np.concatenate([np.asarray(one[name][1]) for one in each]), unit)
            for name, (over, _, unit) in each[0].items()
        }
        count = [len(part.choices) for part in parts.values()]
        surgery, through = self.plan.surgery, self.plan.surgery.protocol
        return whole | {
            "variant": ("variant", np.repeat([*parts], count)),
            "ligament": ("ligament", surgery.ligaments),
            "bundle": ("bundle", surgery.plan.bundles),
            "choice": ("choice", [f"{x} {y}" for x in surgery.plan.bundles for y in CHOICES]),
            "test": ("test", through.lachman_deg, "deg"),
            "load_case_flexion_deg": ("load_case", through.flexion_deg),
            "load_case_anterior_N": ("load_case", through.force),
        }

    @property
    def best(self) -> Outcome:
        """The optimum, or the plan itself."""
        return self.planned if self.optimum is None else self.optimum.outcome

    @property
    def has_front(self) -> bool:
        """Whether a front was asked for and has points."""
        return self.front is not None and len(self.front.criteria) > 0


def run_plan(plan: AclPlan, show: Show | None = None) -> PlanResult:
    """Carry out a plan.

    Args:
        plan: checked.
        show: called now and then with what is done.

    Raises:
        UnsuitableData: the intact knee does not move through the plan's flexions, or no knee holds
            the tension of fixation.
    """
    show = show or (lambda *_: None)
    surgery, seconds = plan.surgery, {}

    def timed(stage: str, work: Callable):
        show(stage, 0, 0)
        began = time.perf_counter()
        found = work()
        seconds[stage] = time.perf_counter() - began
        return found

    before = timed("intact knee", lambda: surgery.before)
    if not before.converged[0].all():
        lost = surgery.protocol.flexion_deg[~before.converged[0]]
        angles = ", ".join(f"{x:g}" for x in np.unique(lost))
        raise UnsuitableData(
            f"{plan.file}: knee: {plan.own.name} has no balance at {angles} degrees, intact: "
            "expected one that balances through the plan"
        )
    planned = timed("planned tunnels", lambda: surgery.try_out(plan.base, slopes=True))
    if not np.isfinite(planned.slack_mm).all():
        tension = plan.base[len(CHOICES) - 1 :: len(CHOICES)].tolist()
        raise UnsuitableData(
            f"{plan.file}: fixation.tension_N: {tension}: expected a tension under which the knee "
            f"balances at {surgery.fixation_deg:g} degrees; without one no zero-load length follows"
        )
    around = timed("octagon", lambda: surgery.try_out(plan.corners))
    tightened = np.tile(plan.base, (_TENSIONS, 1))
    tensions = np.linspace(*surgery.limits.tension_N, _TENSIONS)
    tightened[:, len(CHOICES) - 1 :: len(CHOICES)] = tensions[:, None]
    by_tension = timed("tension", lambda: surgery.try_out(tightened))
    best, done = planned, {"planned": plan.base}
    optimum = front = left_open = None
    if plan.free:
        optimum = timed("optimum", lambda: optimise(
            surgery, plan.base, plan.free_choices, most=plan.evaluations, starts=plan.starts,
        ))  # fmt: skip
        best = optimum.outcome
        done["optimum"] = best.choices[0]
    allowed = timed("tolerance", lambda: tolerances(surgery, best))
    if plan.population and plan.free:
        front = timed("front", lambda: pareto_front(
            surgery, plan.base, plan.free_choices, known=best.choices, population=plan.population,
            generations=plan.generations, progress=partial(show, "front"),
        ))  # fmt: skip
    if plan.drawn:
        left_open = timed("intervals", lambda: intervals(surgery, plan.drawn, done))
    maps = []
    for bone in (TIBIA, FEMUR) if plan.map_points else ():
        half, stage = plan.map_half_mm[bone], f"map of the {bone}"
        along = np.linspace(-half, half, plan.map_points)
        moved = partial(tunnel_map, surgery, plan.base, bone, along, along)
        maps.append(timed(stage, partial(moved, progress=partial(show, stage))))
    return PlanResult(
        plan, planned, around, by_tension, tuple(maps), optimum, front, left_open, allowed, seconds
    )
