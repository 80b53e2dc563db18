"""Paper 2: Lachman tests of ten bundles with and without the ACL, and grafts in eight places.

Its sections 4.2 and 4.3, and Table 4.
"""

import dataclasses
import importlib.util
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax import planning
from kneejax.experiments import lab_tests, load_curves, mechanics_of
from kneejax.files import load_knee
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.parameters import cut, select
from kneejax.report.look import BLACK, BLUE, ORANGE, VERMILLION, Answer, Table, styled
from kneejax.report.panels import figure_legend, grid
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KNEE = "ten_bundle"
FULL_N, FLEXION_DEG, STEPS = 100.0, 20.0, 10
#: State of the ACL -> bundles that are cut, colour and label of the figure.
STATES = {
    "two bundles": ((), BLUE, "both bundles of the ACL"),
    "one bundle": (("pACL",), ORANGE, "anterior bundle alone"),
    "deficient": (("ACL",), VERMILLION, "without an ACL"),
}
COLLATERALS = ("aMCL", "iMCL", "pMCL", "aDMCL", "pDMCL", "LCL")
#: Printed: displacement of the patient's deficient knee under the full load, and with one bundle,
#: mm (4.2, 4.3); rises of peak force.
MEASURED_MM, ONE_BUNDLE_MM = 8.0, 2.7
RISES = {"LCL": 0.11, "aDMCL": 0.67}
#: What is added to the reference strain of every collateral bundle to reach the measured
#: displacement: the paper's measurement is one number, so one is fitted, between two of these.
PRESTRAINS = (0.0, 0.04, 0.08, 0.12, 0.16)
#: Refinements between the two neighbours, and what is near enough, mm.
MOST_STEPS, NEAR_ENOUGH_MM = 4, 0.02
#: Changes of the resting length of both ACL bundles, about a millimetre.
LENGTH_CHANGES = (-0.03, 0.03)
#: How near a displacement has to come, as the paper's own calibration does, mm; what is asked of a
#: number of one patient on another person's bones, as a part of it; what is little or much.
NEAR_MM, NEAR_PART, LITTLE = 0.15, 0.25, 0.2
#: Below this a bundle is slack, N.
TAUT_N = 1.0
#: Motion with a graft, in steps of our own, degrees; pretension of hamstring grafts, N, which the
#: paper does not print.
EXTENSION_DEG, TENSION_N = np.arange(80.0, -1.0, -2.5), 80.0
#: Totals of Table 4 at positions 1 to 8, and the ligaments whose distance varies most there.
TOTALS = (5.019, 14.948, 22.068, 21.867, 14.230, 9.620, 10.131, 4.870)
TELLING = ("pACL", "aDMCL", "pDMCL")
#: A knee without an ACL may give way or dislocate, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY, Status.DISLOCATED)


@dataclasses.dataclass(frozen=True)
class Lachman:
    """One Lachman test."""

    moved: np.ndarray  # anterior at each load, mm, `(loads,)`; NaN beyond what the knee holds
    tension: dict[str, np.ndarray]  # bundle -> its tension, N, `(loads,)`
    neutral: float  # where the tibia is without the load, mm along the same axis
    along: float  # N per mm that the tensions alone hold the unloaded tibia by across their lines
    status: Status  # the worst of all loads
    held_N: float  # the largest load that the knee holds

    @property
    def end(self) -> float:
        """Displacement under the full load, mm."""
        return float(self.moved[-1])

    def __str__(self) -> str:
        if np.isfinite(self.end):
            return f"{self.end:.1f} mm"
        return f"gives way beyond {self.held_N:.0f} N"


@dataclasses.dataclass(frozen=True)
class LachmanStudy:
    """Lachman tests by which the claims are judged."""

    load_N: np.ndarray  # of every test, `(loads,)`
    printed: dict[str, Lachman]  # key of `STATES` -> test with the printed strains
    calibrated: dict[str, Lachman]  # the same with the collaterals' calibrated strains
    deficient: dict[float, Lachman]  # added to the collaterals' strains -> test without the ACL
    prestrain: float  # with which `calibrated` was made
    longer: dict[float, Lachman]  # change of the ACL's resting lengths -> test with both bundles


@dataclasses.dataclass(frozen=True)
class Octagon:
    """Grafts by which the claims on insertions and bundles are judged."""

    ligaments: tuple[str, ...]  # names; the moved bundle is `graft`
    moved: planning.Outcome  # aACL with its resting length in the eight corners, all else intact
    planned: planning.Outcome  # a hamstring graft in the place of both bundles in the eight corners
    one: float  # laxity with one hamstring graft from end to end of aACL, mm
    two: float  # the same with a second one, as stiff and as tight, from end to end of pACL, mm

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
        return Table(["graft", "position", *columns, "total"], rows)


def reproduce(stages: Stages = silent) -> Answer:
    """Make the tests, place the grafts, and judge the claims."""
    knee, grafts = load_knee(KNEE), None
    with stages("Lachman tests"):
        found = lachman_study(knee)
    if importlib.util.find_spec("dtaidistance"):
        with stages("grafts in eight places"):
            grafts = octagon_study(knee)
    names = (f"{name}_N" for name in found.printed["two bundles"].tension)
    rows, doubts = [], []
    for kind, tests in {"table_1": found.printed, "calibrated": found.calibrated}.items():
        for state, test in tests.items():
            loaded = zip(found.load_N, test.moved, *test.tension.values(), strict=True)
            rows += [[kind, state, *row] for row in loaded]
            if (status := test.status) not in _ANSWERS:
                strains = "Table 1" if kind == "table_1" else kind
                doubts.append(f"{strains}, {state}: {status.word} ({status.sentence}).")
    settings = {
        "knee": KNEE, "added_to_collateral_strains": list(PRESTRAINS),
        "calibrated_at": found.prestrain, "changes_of_resting_length": list(LENGTH_CHANGES),
    }  # fmt: skip
    header = ["strains", "acl", "anterior_N", "anterior_mm", *names]
    tables = {"lachman": Table(header, rows)} | ({"octagon": grafts.table} if grafts else {})
    figures = {"lachman": lachman_figure(found)}
    return answered(2, claims(found, grafts), figures, tables, settings, doubts, {"knee": KNEE})


def lachman_study(knee: Knee) -> LachmanStudy:
    """Make the Lachman tests of a knee with the ten bundles of Table 1."""

    def states(one: Knee) -> dict[str, Lachman]:
        return {name: lachman(cut(one, gone)) for name, (gone, *_) in STATES.items()}

    def changed(names: Sequence[str], change: Callable) -> Knee:
        selection = select(knee, tuple(names))
        return selection.apply(knee, change(selection.read(knee)))

    def strained(by: float) -> Knee:
        return changed([f"{name}.reference_strain" for name in COLLATERALS], lambda x: x + by)

    def longer(by: float) -> Knee:
        return changed(["aACL.slack_length", "pACL.slack_length"], lambda x: x * (1.0 + by))

    printed = states(knee)
    deficient = {0.0: printed["deficient"]}
    deficient |= {by: lachman(cut(strained(by), ("ACL",))) for by in PRESTRAINS[1:]}
    lengthened = {by: lachman(longer(by)) for by in LENGTH_CHANGES}
    for _ in range(MOST_STEPS):
        best = fitted({by: one.end for by, one in deficient.items()})
        if best in deficient:
            break
        deficient[best] = lachman(cut(strained(best), ("ACL",)))
    loads = FULL_N * np.linspace(0.0, 1.0, STEPS + 1)
    return LachmanStudy(loads, printed, states(strained(best)), deficient, best, lengthened)


def fitted(ends: dict[float, float]) -> float:
    """What to add to strains for the measured displacement, from displacements in mm (NaN where the
    load is not held): one that is near enough, else between two neighbours, else the nearest."""
    held = [(by, ends[by]) for by in sorted(ends) if np.isfinite(ends[by])]
    nearest = min(held, key=lambda one: abs(one[1] - MEASURED_MM), default=(max(ends), np.nan))
    if abs(nearest[1] - MEASURED_MM) < NEAR_ENOUGH_MM:
        return nearest[0]
    for (low, far), (high, near) in zip(held, held[1:], strict=False):
        if (far - MEASURED_MM) * (near - MEASURED_MM) <= 0.0 and far != near:
            return low + (high - low) * (far - MEASURED_MM) / (far - near)
    return nearest[0]


def lachman(knee: Knee) -> Lachman:
    """The Lachman test of a knee."""
    (test,) = lab_tests("lachman", [FLEXION_DEG], force_N=FULL_N, steps=STEPS)
    (curves,) = load_curves(knee, test)
    (rows,) = curves.nodes
    mechanics = mechanics_of(curves)
    moved = np.asarray(curves.displacement_by_load)[0]
    known = np.isfinite(moved)
    tension = np.where(known[:, None], np.asarray(mechanics.tension)[rows], np.nan)
    along = np.sum(np.asarray(mechanics.tension)[rows[0]] / np.asarray(mechanics.length)[rows[0]])
    held = FULL_N * float(np.max(np.asarray(curves.part)[known], initial=0.0))
    status = Status(int(np.asarray(curves.status(mechanics)).max()))
    named = dict(zip(knee.ligaments.names, tension.T, strict=True))
    neutral = float(np.asarray(curves.neutral)[0])
    return Lachman(moved, named, neutral, float(along), status, held)


def octagon_study(knee: Knee) -> Octagon:
    """Put the paper's graft in the corners of its octagon, as `kneejax plan acl` places grafts."""

    def surgery(ligament: str, bundles: int, stiffness_N: float) -> planning.Surgery:
        plan = planning.reconstruction_of(knee, ligament, bundles, stiffness_N, np.inf)
        tibia, femur = (planning.footprint_of(knee, ligament, bone) for bone in (TIBIA, FEMUR))
        replaced = (plan.torn,) if bundles == 1 else tuple((name,) for name in plan.torn)
        through = planning.Protocol(EXTENSION_DEG, (FLEXION_DEG,), FULL_N)
        # Limits of a search for an optimum; none is made.
        free = planning.Limits(np.inf, np.inf, (1.0, 1000.0))
        known = plan, tibia, femur, replaced, FLEXION_DEG, through
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


def claims(found: LachmanStudy, grafts: Octagon | None = None) -> tuple[Claim, ...]:
    """Judge the claims of paper 2."""
    rises = {f"2.{5 + k}": _rise(found, name) for k, name in enumerate(RISES)}
    return judged(2, _displacement(found) | rises | _length(found) | insertions(grafts))


def _displacement(found: LachmanStudy) -> dict[str, Finding]:
    """Claims 2.1 to 2.4 and 2.7: displacement under 100 N, and what resists it without the ACL."""
    test, before = found.calibrated["deficient"], found.printed["deficient"]
    scanned = in_words(sorted(found.deficient.items()), "{:.3g}: {}")
    pulls = [sum(float(t[0]) for t in one.tension.values()) for one in (before, test)]
    one, two = (found.calibrated[state].end for state in ("one bundle", "two bundles"))
    both = {"printed": found.printed, "calibrated": found.calibrated}
    apart = {kind: (x["two bundles"].end, x["deficient"]) for kind, x in both.items()}
    known = np.flatnonzero(np.isfinite(test.moved))
    last = known[-1] if known.size else 0
    rises = {name: float(t[last] - t[0]) for name, t in test.tension.items()}
    order = sorted(rises, key=lambda name: -np.nan_to_num(rises[name]))
    return {
        "2.1": Finding(
            abs(test.end - MEASURED_MM) < NEAR_MM,
            f"{found.prestrain:.3f} added: {test}. Scanned: {scanned}",
            numbers={"pull": pulls[1], "pull_before": pulls[0], "needed": FULL_N / MEASURED_MM,
                     "along": test.along, "along_before": before.along},
        ),
        "2.2": Finding(abs(one - ONE_BUNDLE_MM) < NEAR_PART * ONE_BUNDLE_MM,
                       f"{found.calibrated['one bundle']}; with the printed strains "
                       f"{found.printed['one bundle']}"),
        "2.3": Finding(abs(one - two) < LITTLE * one,
                       f"{one:.1f} mm with one, {two:.1f} mm with both"),
        "2.4": Finding(all(not np.isfinite(b.end) or b.end > 2.0 * a for a, b in apart.values()),
                       in_words(apart, "{}: {:.1f} mm, without {}", "; ")),
        "2.7": Finding(set(order[:2]) == set(RISES),
                       in_words({name: rises[name] for name in order[:4]}, "{} {:+.0f} N")),
    }  # fmt: skip


def _rise(found: LachmanStudy, name: str) -> Finding:
    """Claims 2.5 and 2.6: peak tension over the loads that both knees hold."""
    tests = [found.calibrated[state] for state in ("two bundles", "deficient")]
    known = np.all([np.isfinite(one.moved) for one in tests], axis=0)
    before, after = (float(np.max(one.tension[name][known], initial=0.0)) for one in tests)
    ours, printed = f"{before:.0f} N to {after:.0f} N", RISES[name]
    if not before > TAUT_N:
        reason = (
            f"it is slack even with {found.prestrain:.3f} added to its strain: towards 20 degrees "
            "its way between these attachments becomes shorter than its resting length"
        )
        return Finding(False, ours, reason)
    rise = after / before - 1.0
    return Finding(0.5 * printed < rise < 2.0 * printed, f"{ours}, {rise:+.0%}")


def _length(found: LachmanStudy) -> dict[str, Finding]:
    """Claim 2.8: resting length of the ACL's bundles."""
    own, rest = found.printed["two bundles"].end, found.printed["two bundles"].neutral
    parts = {by: one.end / own - 1.0 for by, one in found.longer.items()}
    known = [abs(x) for x in parts.values() if np.isfinite(x)]
    holds = len(known) == len(parts) and min(known) > LITTLE
    away = {by: x.neutral - rest for by, x in found.longer.items()}
    placed = {by: (away[by] + x.end) / own - 1.0 for by, x in found.longer.items()}
    ours = in_words({by: (x, parts[by]) for by, x in found.longer.items()}, "{:+.0%}: {} ({:+.0%})")
    numbers = {"moved": in_words(away, "{:+.0%}: {:+.2f} mm"),
               "placed": in_words(placed, "{:+.0%}: {:+.0%}"), "own": own}  # fmt: skip
    return {"2.8": Finding(holds, f"{own:.2f} mm; {ours}", numbers=numbers)}


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
                        in_words(zip(names, spread[widest], strict=True), "{} {:.2f}")),
        "2.14": Finding(abs(found.two - found.one) < LITTLE * found.one,
                        f"{found.one:.2f} mm with one, {found.two:.2f} mm with both"),
    }  # fmt: skip


@styled
def lachman_figure(found: LachmanStudy) -> "Figure":
    """Draw displacement over force in the Lachman test, as Figure 3 of paper 2 does, at rest: with
    the printed strains and the calibrated ones. Where a curve ends early the knee gives way."""
    figure, panels = grid(1, 2, 3.4, bottom=0.92, apart=(0.2, 0.0), sharey=True)
    load, larger = found.load_N, f"Collateral strains larger by {found.prestrain:.3f}"
    kinds = {"Strains of Table 1": found.printed, larger: found.calibrated}
    for axes, (title, tests) in zip(panels[0], kinds.items(), strict=True):
        for name, (_, color, label) in STATES.items():
            moved = tests[name].moved
            axes.plot(load, moved, "o-", color=color, markersize=2.5, label=label)
            known = np.flatnonzero(np.isfinite(moved))
            if 0 < known.size < load.size:
                axes.plot(load[known[-1]], moved[known[-1]], "x", color=color, markersize=7)
        for size, color in ((MEASURED_MM, VERMILLION), (ONE_BUNDLE_MM, ORANGE)):
            axes.plot(100.0, size, "s", color=color, markerfacecolor="none", zorder=5)
        axes.set(title=title, xlabel="Anterior force, N")
    axes = panels[0, 0]
    axes.set_ylabel("Anterior displacement, mm")
    axes.set_ylim(bottom=0.0)
    axes.plot([], [], "s", color=BLACK, markerfacecolor="none", label="printed, same colours")
    figure_legend(figure, ncols=4, fontsize=8)
    return figure
