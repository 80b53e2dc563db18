"""A plan as data: the reconstruction, what is asked about it, and where it came from."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.planning._front import GENERATIONS
from kneejax.planning._grafts import GRAFTS, GraftType
from kneejax.planning._optimum import MOST_EVALUATIONS, STARTS
from kneejax.planning._surgery import CHOICES, Surgery

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


def graft_types() -> tuple[GraftType, ...]:
    """All grafts that a plan may name, with the sources of their numbers.

    Example:
        >>> [graft.name for graft in graft_types()][:2]
        ['hamstring', 'patellar_tendon']
    """
    return tuple(GRAFTS.values())
