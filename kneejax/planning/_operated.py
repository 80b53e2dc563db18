"""The knees that a plan speaks of, as knees: intact, torn, with the graft in each place."""

from __future__ import annotations

import numpy as np

from kneejax.mechanics import Knee
from kneejax.parameters import UnsuitableData
from kneejax.planning._footprints import octagon
from kneejax.planning._plan import AclPlan
from kneejax.planning._pretension import fix
from kneejax.planning._surgery import Outcome, Surgery

#: What the knees are called that have no graft, and the one with the graft where it is planned.
INTACT, PLANNED = "intact", "planned"


def intact_knee(plan: AclPlan) -> Knee:
    """A plan's knee before anything is torn, of the structure of `operated_knees`.

    Args:
        plan: checked.
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
