"""A plan carried out: the knee before, octagon, maps, optimum, front, and how exact to be."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.parameters import UnsuitableData
from kneejax.planning._footprints import octagon
from kneejax.planning._front import Front, pareto_front
from kneejax.planning._limits import Intervals, intervals
from kneejax.planning._maps import Tolerance, TunnelMap, over_tension, tolerances, tunnel_map
from kneejax.planning._optimum import Optimum, optimise
from kneejax.planning._plan import AclPlan
from kneejax.planning._surgery import CHOICES, Outcome

#: Called with a stage's name, balances done and asked for.
Show = Callable[[str, int, int], None]
_TENSIONS = 9


@dataclasses.dataclass(frozen=True)
class PlanResult:
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
    corners = np.tile(plan.base, (8, 1))
    corners[:, :2] = octagon(plan.octagon_mm)
    around = timed("octagon", lambda: surgery.try_out(corners))
    tensions = np.linspace(*surgery.limits.tension_N, _TENSIONS)
    by_tension = timed("tension", lambda: over_tension(surgery, plan.base, tensions))
    optimum = None
    if plan.free:
        optimum = timed(
            "optimum",
            lambda: optimise(surgery, plan.base, plan.free_choices, most=plan.evaluations,
                             starts=plan.starts),
        )  # fmt: skip
    best = planned if optimum is None else optimum.outcome
    allowed = timed("tolerance", lambda: tolerances(surgery, best))
    done = {"planned": plan.base} | ({} if optimum is None else {"optimum": best.choices[0]})
    front = None
    if plan.population and plan.free:
        known = best.choices if optimum is not None else None
        front = timed("front", lambda: _front(plan, known, show))
    open_ = None
    if plan.drawn:
        open_ = timed("intervals", lambda: intervals(surgery, plan.drawn, done))
    maps = [
        timed(f"map of the {bone}", lambda bone=bone: _map(plan, bone, show))
        for bone in ((TIBIA, FEMUR) if plan.map_points else ())
    ]
    return PlanResult(
        plan, planned, around, by_tension, tuple(maps), optimum, front, open_, allowed,
        seconds,
    )  # fmt: skip


def _front(plan: AclPlan, known: np.ndarray | None, show: Show) -> Front:
    return pareto_front(
        plan.surgery, plan.base, plan.free_choices, known=known, population=plan.population,
        generations=plan.generations, progress=lambda done, total: show("front", done, total),
    )  # fmt: skip


def _map(plan: AclPlan, bone: str, show: Show) -> TunnelMap:
    half = plan.map_half_mm[bone]
    along = np.linspace(-half, half, plan.map_points)

    def progress(done: int, total: int) -> None:
        show(f"map of the {bone}", done, total)

    return tunnel_map(plan.surgery, plan.base, bone, along, along, progress=progress)
