"""Paper 2's octagon: grafts in eight places on the tibia, and what its Table 4 claims of them."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax import planning
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.papers.claims import Finding, in_words
from kneejax.report.look import Table

#: The motion of section 4.3, in steps of our own, and the test of 4.2.
EXTENSION_DEG, LACHMAN_DEG, FORCE_N = np.arange(80.0, -1.0, -2.5), 20.0, 100.0
#: Pretension of hamstring grafts at the flexion of the test, N; the paper prints none.
TENSION_N = 80.0
#: Totals of Table 4 at positions 1 to 8, and the ligaments whose distance varies most there.
TOTALS = (5.019, 14.948, 22.068, 21.867, 14.230, 9.620, 10.131, 4.870)
TELLING = ("pACL", "aDMCL", "pDMCL")
#: A second graft adds little where it changes the laxity by less than this part.
LITTLE = 0.2


@dataclasses.dataclass(frozen=True)
class Octagon:
    """Grafts by which the claims on insertions and bundles are judged.

    Attributes:
        ligaments: names; the moved bundle is `graft`.
        moved: aACL with its own resting length in the eight corners, all else intact.
        planned: a hamstring graft in the place of both bundles in the eight corners.
        one: laxity with one hamstring graft from end to end of aACL, mm.
        two: the same with a second one, as stiff and as tight, from end to end of pACL, mm.
    """

    ligaments: tuple[str, ...]
    moved: planning.Outcome
    planned: planning.Outcome
    one: float
    two: float

    @property
    def table(self) -> Table:
        """Table 4, of the moved bundle and of a graft under its tension."""
        others = [name for name in self.ligaments if name not in ("pACL", "graft")]
        columns = [f"{name}_distance" for name in ("graft", "pACL", *others)]
        rows = []
        for graft, outcome in {"moved": self.moved, "hamstring": self.planned}.items():
            names = self.ligaments if graft == "moved" else (*others, "graft")
            for k, distance in enumerate(outcome.distance):
                by = dict(zip(names, distance, strict=True))
                each = [by["graft"], by.get("pACL", float("nan")), *(by[name] for name in others)]
                rows.append([graft, k + 1, *each, outcome.total[k]])
        return Table.plain(["graft", "position", *columns, "total"], rows)


def octagon_study(knee: Knee) -> Octagon:
    """Put the paper's graft in the corners of its octagon, as `kneejax plan acl` places grafts.

    Args:
        knee: with the ten bundles of Table 1.

    Raises:
        MissingPackage: dtaidistance is not installed.
    """

    def surgery(ligament: str, bundles: int, stiffness_N: float) -> planning.Surgery:
        plan = planning.reconstruction_of(knee, ligament, bundles, stiffness_N, np.inf)
        tibia, femur = (planning.footprint_of(knee, ligament, bone) for bone in (TIBIA, FEMUR))
        replaced = (plan.torn,) if bundles == 1 else tuple((name,) for name in plan.torn)
        through = planning.Protocol(EXTENSION_DEG, (LACHMAN_DEG,), FORCE_N)
        # Limits of a search for an optimum; none is made.
        free = planning.Limits(np.inf, np.inf, (1.0, 1000.0))
        known = plan, tibia, femur, replaced, LACHMAN_DEG, through
        return planning.Surgery(*known, planning.WINDOW, free)

    own, row = knee.ligaments, knee.ligaments.names.index("aACL")
    bundle = surgery("aACL", 1, float(own.stiffness[row]))
    corners = np.zeros((8, 5))
    corners[:, :2], corners[:, 4] = planning.octagon(), TENSION_N
    slack = np.full((8, 1), float(own.slack_length[row]))
    graft = planning.GRAFTS["hamstring"].stiffness_N
    single, double = (surgery("ACL", n, n * graft) for n in (1, 2))
    places = np.hstack([single.tibia.fibres, single.femur.fibres, np.full((2, 1), TENSION_N)])
    return Octagon(bundle.ligaments, bundle.try_out(corners, slack_mm=slack),
                   single.try_out(corners), float(single.try_out(places[0]).laxity_mm[0, 0]),
                   float(double.try_out(places.ravel()).laxity_mm[0, 0]))  # fmt: skip


def insertions(found: Octagon | None) -> dict[str, Finding]:
    """Claims 2.9 and 2.12 to 2.14; without the package that compares curves none can be judged."""
    if found is None:
        missing = Finding(None, "-", "needs dtaidistance: pip install 'kneejax[planning]'")
        return dict.fromkeys(("2.9", "2.12", "2.13", "2.14"), missing)

    def fits(totals: np.ndarray) -> bool:
        """Whether one of the sixteen ways to number the corners gives the paper's order."""
        ways = (np.roll(x, by) for x in (totals, totals[::-1]) for by in range(8))
        orders = ([*np.argsort(x) + 1] for x in ways)
        known = bool(np.isfinite(totals).all())
        return known and any(x[:2] == [8, 1] and {*x[-2:]} == {3, 4} for x in orders)

    def listed(totals: np.ndarray) -> str:
        return ", ".join(f"{x:.2f}" if np.isfinite(x) else "no balance" for x in totals)

    moved, planned = found.moved.total, found.planned.total
    own, theirs, retensioned = (
        float(np.max(x) / np.min(x)) for x in (moved, np.array(TOTALS), planned)
    )
    spread = np.ptp(found.moved.distance, axis=0)
    widest = np.argsort(-np.nan_to_num(spread))[: len(TELLING)]
    names = [found.ligaments[k].replace("graft", "aACL") for k in widest]
    return {
        "2.9": Finding(
            fits(moved),
            f"from front and medial through the lateral side: {listed(moved)}. A hamstring graft "
            f"in place of both bundles, under 80 N: {listed(planned)}",
            numbers={"fits": "does" if fits(planned) else "does not"},
        ),
        "2.12": Finding(0.5 * theirs < own < 2.0 * theirs,
                        f"{own:.1f} times; of the retensioned graft {retensioned:.1f}",
                        numbers={"corner": np.argmin(moved) + 1}),
        "2.13": Finding(set(names) == set(TELLING),
                        in_words(dict(zip(names, spread[widest], strict=True)), "{} {:.2f}")),
        "2.14": Finding(abs(found.two - found.one) < LITTLE * found.one,
                        f"{found.one:.2f} mm with one, {found.two:.2f} mm with both"),
    }  # fmt: skip
