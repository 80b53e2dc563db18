"""What grafts are made of: stiffness and strength as they were measured.

Wilson's and Woo's numbers were compared with their abstracts, Shani's with a table that quotes them
(Int J Sports Phys Ther 18, 2023, 493: 370 to 466 N/mm and 1450 to 2186 N, with a bone block).
"""

from __future__ import annotations

import dataclasses

#: Length to which a measured stiffness belongs, mm: between the tunnels' mouths a graft is about as
#: long as the ligament that it replaces. A longer free length makes it softer in proportion.
FREE_LENGTH_MM = 30.0
#: Strain at which the toe of the law ends, as of the ligaments of papers 1 to 3.
TRANSITION_STRAIN = 0.06
#: Rounding of the law's corners, in strain; a force errs by at most 0.03 N.
TRANSITION_WIDTH = 0.0001


@dataclasses.dataclass(frozen=True)
class GraftType:
    """A kind of graft.

    Attributes:
        name: in plans and tables.
        says: what it is, in a phrase.
        stiffness_N_per_mm: of the whole graft.
        failure_N: load at which it failed.
        source: who measured both.

    Example:
        >>> GRAFTS["hamstring"].stiffness_N
        7140.0
    """

    name: str
    says: str
    stiffness_N_per_mm: float
    failure_N: float
    source: str

    @property
    def stiffness_N(self) -> float:
        """N per unit strain, at `FREE_LENGTH_MM`."""
        return self.stiffness_N_per_mm * FREE_LENGTH_MM


#: Name -> graft. Means of human tissue; single grafts differ by a quarter and more.
GRAFTS = {
    graft.name: graft
    for graft in (
        GraftType(
            "hamstring", "semitendinosus and gracilis, each looped once: four strands", 238.0,
            2422.0, "Wilson et al., American Journal of Sports Medicine 27 (1999), matched pairs",
        ),
        GraftType(
            "patellar_tendon", "middle third of the patellar tendon with its bone blocks", 210.0,
            1784.0, "Wilson et al., American Journal of Sports Medicine 27 (1999), matched pairs",
        ),
        GraftType(
            "quadriceps_tendon", "full thickness of the quadriceps tendon with a bone block",
            466.0, 2186.0, "Shani et al., Arthroscopy 32 (2016), as quoted by others",
        ),
        GraftType(
            "native", "the anterior cruciate ligament of young adults, for comparison", 242.0,
            2160.0, "Woo et al., American Journal of Sports Medicine 19 (1991)",
        ),
    )
}  # fmt: skip
