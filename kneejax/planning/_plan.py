"""A plan of a reconstruction, and the knee after it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.parameters import UnsuitableData
from kneejax.planning._footprints import octagon
from kneejax.planning._front import GENERATIONS
from kneejax.planning._optimum import MOST_EVALUATIONS, STARTS
from kneejax.planning._pretension import fix
from kneejax.planning._reconstruction import GraftType
from kneejax.planning._surgery import CHOICES, Outcome, Surgery

#: What an optimum may change: name -> columns of a bundle's choices.
FREE = {TIBIA: (0, 1), FEMUR: (2, 3), "tension": (4,)}


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
        one = np.isin(np.arange(len(CHOICES)), columns)
        return np.tile(one, len(self.surgery.plan.bundles))


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
    return _bare(plan, torn=False)


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
    choices = np.tile(plan.base, (9, 1))
    choices[1:, :2] = octagon(plan.octagon_mm)
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
    bare = {INTACT: intact_knee(plan), f"without {plan.ligament}": _bare(plan, torn=True)}
    values = zip(names, one.value(ends, slack), strict=True)
    return bare | {name: one.vary(one.knee, own) for name, own in values}


def _bare(plan: AclPlan, torn: bool) -> Knee:
    """Without a graft."""
    one = plan.surgery.plan
    ends, _ = plan.surgery.ends(plan.base[None])
    return one.vary(one.knee, one.value(ends, elastic=False, torn=torn)[0])


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
    ends, _ = surgery.ends(outcome.choices[:1])
    return surgery.plan.vary(surgery.plan.knee, surgery.plan.value(ends, slack)[0])
