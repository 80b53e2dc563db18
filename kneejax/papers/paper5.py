"""Paper 5: the moving axis and the hinge of ten men's knees, against its printed numbers."""

from typing import TYPE_CHECKING

import numpy as np

from kneejax.files import load_knee
from kneejax.joints import MEASURES, UnsuitableMotions
from kneejax.papers import paper5_study as study
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.papers.paper5_study import COMPARED, EOS, HINGE, MEAN, MOVING_AXIS, NAMES, SD
from kneejax.parameters import UnsuitableData
from kneejax.report.look import BLACK, BLUE, VERMILLION, Answer, Table, styled
from kneejax.report.panels import coordinate_panels, labelled, part_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Two standard errors of a printed mean, by its standard deviation.
_ERRORS = 2.0 / np.sqrt(study.SUBJECTS)
#: Half a unit of the last printed digit.
_HALF = 0.005


def reproduce(stages: Stages = silent) -> Answer:
    """Compute the joints and synthetic cohorts, and judge the claims."""
    from kneejax.report import comparison_tables, joint_comparison_figure

    try:
        with stages("cohorts"):
            found = study.paper5_study(load_knee(study.DONOR))
    except UnsuitableMotions as problem:
        raise UnsuitableData(str(problem)) from problem
    # Which synthetic cohort is drawn and written: the first of this correlation.
    shown = study.CORRELATIONS[1]
    cohort = found.cohorts[shown][0]
    means = {(motion, "printed"): table for motion, table in MEAN.items()}
    means |= {(MOVING_AXIS, f"ours, facets {x}"): table for x, table in found.moving_axis.items()}
    means[HINGE, "ours"] = found.hinge
    rows = [
        [*source, angle, *row]
        for source, table in means.items()
        for angle, row in zip(study.REACHED_DEG, table, strict=True)
    ]
    columns = ["motion", "source", "flexion_deg", *(x.column for x in MEASURES)]
    tables = {
        "means": Table(columns, rows),
        **{f"synthetic_{name}": one for name, one in comparison_tables(cohort).items()},
    }
    labelled = {f"{name}, SYNTHETIC": motion for name, motion in cohort.models.items()}
    figures = {
        "means": means_figure(found),
        "synthetic_cohort": joint_comparison_figure(cohort, cohort.flexion_deg, labelled),
    }
    settings = {
        "axis_points_of": study.DONOR, "facets_deg": study.FACETS, "drawn_axis_points": study.DRAWS,
        "midpoint_sd_mm": study.MIDPOINT_SD_MM, "centre_sd_mm": study.CENTRE_SD_MM,
        "sizes": study.SIZES, "assumed_correlations": study.CORRELATIONS,
        "cohorts_each": study.COHORTS, "shown_cohort": shown, "seed": study.SEED,
        "facet_centres_mm": found.facets, "epicondyles_mm": found.epicondyles,
    }  # fmt: skip
    words = {"donor": study.DONOR, "draws": study.DRAWS, "cohorts": study.COHORTS}
    return answered(5, claims(found), figures, tables, settings, (), words)


def claims(found: study.Paper5Study) -> tuple[Claim, ...]:
    """Judge what the printed numbers say about each other, the joints, and the statistics."""
    asterisks = int(sum(marked.sum() for marked in study.MARKED.values()))
    findings = _averages() | _statistics() | _models()
    findings |= _joints(found) | _moving_means(found) | _cohorts(found)
    return judged(5, findings, asterisks=asterisks)


def measures_row(values: np.ndarray, form: str = ".2f") -> str:
    """Five numbers with the names of their clinical measures, for a row of the report."""
    return in_words(zip(NAMES, values, strict=True), f"{{}} {{:{form}}}")


def _averages() -> dict[str, Finding]:
    """Claims 5.1 to 5.3: averages and differences are those of their rows."""
    apart, spans = {}, {"0 to 90": slice(None), "20 to 60": COMPARED}
    for motion, averages in study.AVERAGE.items():
        for (kind, tables), rows in zip({"mean": MEAN, "SD": SD}.items(), averages, strict=True):
            for (angles, span), row in zip(spans.items(), rows, strict=True):
                off = np.abs(tables[motion][span].mean(axis=0) - row)
                where = f"{motion}, {kind} of {NAMES[off.argmax()]}, {angles} degrees"
                apart[where] = float(off.max())
    worst = max(apart, key=apart.__getitem__)
    rows = {
        pair: MEAN[pair[0]][COMPARED] - MEAN[pair[1]][COMPARED] - table[:3]
        for pair, table in study.DIFFERENCE.items()
    }
    means = {
        pair: (table[:3].mean(axis=0) - table[3])[None] for pair, table in study.DIFFERENCE.items()
    }
    averaged = _off(means, 2.0 * _HALF, "5.2")
    reason = (averaged.reason or "").replace(f" at {study.ANGLES[0]} degrees", "")
    return {
        "5.1": Finding(apart[worst] <= 2.0 * _HALF + 1e-9,
                       f"largest difference {apart[worst]:.3f} ({worst})"),
        "5.2": _off(rows, 3.0 * _HALF, "the supplementary table"),
        "5.3": averaged._replace(reason=reason),
    }  # fmt: skip


def _off(off: dict[tuple[str, str], np.ndarray], limit: float, other: str) -> Finding:
    """What differs by more than rounding can do."""
    count = sum(x.size for x in off.values())
    beyond = [
        f"{pair[0]} - {pair[1]}, {NAMES[j]} at {study.ANGLES[i]} degrees by {abs(x[i, j]):.3f}"
        for pair, x in off.items()
        for i, j in np.argwhere(np.abs(x) > limit + 1e-9)
    ]
    largest = max(float(np.abs(x).max()) for x in off.values())
    reason = f"beyond rounding: {'; '.join(beyond)} (compare {other})" if beyond else ""
    ours = f"{count - len(beyond)} of {count} agree; largest difference {largest:.3f}"
    return Finding(not beyond, ours, reason)


def _statistics() -> dict[str, Finding]:
    """Claims 5.4 to 5.7: p, intervals, asterisks, R2."""
    from scipy import stats

    mean, error, p, low, high = np.moveaxis(study.POST_HOC, -1, 0)
    ours = np.minimum(1.0, 3.0 * 2.0 * stats.t.sf(np.abs(mean / error), study.SUBJECTS - 1))
    half = stats.t.isf(study.ALPHA / 6.0, study.SUBJECTS - 1) * error
    bounds = np.abs(np.stack([mean - half - low, mean + half - high])).max()
    off = np.abs(ours - p).max()
    small = p <= study.ALPHA
    marked = np.stack([study.MARKED[pair].T for pair in study.PAIRS], axis=-1)
    wrong = int((small != marked).sum())
    points, adjusted = 3 * study.SUBJECTS, 0
    for model, r2 in study.R2.items():
        least, most = (1.0 - (1.0 - r2 + x) * (points - 1) / (points - 2) for x in (_HALF, -_HALF))
        printed = study.ADJUSTED_R2[model]
        adjusted += int(((least - _HALF <= printed) & (printed <= most + _HALF)).sum())
    pooled = {model: pooled_r2(model) for model in study.R2}
    apart = max(float(np.abs(pooled[model] - r2).max()) for model, r2 in study.R2.items())
    return {
        "5.4": Finding(off <= 0.005 and bounds <= 0.02,
                       f"largest difference of p {off:.4f}, of a bound {bounds:.3f}"),
        "5.5": Finding(wrong == 0, f"{int(small.sum())} p up to 0.01; {45 - wrong} of 45 agree"),
        "5.6": Finding(adjusted == 10, f"{adjusted} of 10 agree"),
        "5.7": Finding(
            apart <= 0.03,
            in_words({model: measures_row(r2) for model, r2 in pooled.items()}, "{} {}", "; "),
            f"largest difference {apart:.3f}",
        ),
    }  # fmt: skip


def pooled_r2(model: str) -> np.ndarray:
    """R2 of Table 5 from Tables 1 to 4: means, spreads, and spreads of differences."""
    n = study.SUBJECTS
    x, y = (MEAN[name][COMPARED] for name in (model, EOS))
    sx, sy = (SD[name][COMPARED] for name in (model, EOS))
    within = (sx**2 + sy**2 - study.STANDARD_ERROR[(EOS, model)][:3] ** 2 * n) / 2.0

    def pooled(own: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        between = n * (a - a.mean(axis=0)) * (b - b.mean(axis=0))
        return ((n - 1) * own + between).sum(axis=0)

    return pooled(within, x, y) ** 2 / (pooled(sx**2, x, x) * pooled(sy**2, y, y))


def _models() -> dict[str, Finding]:
    """Claims 5.8 to 5.11: which model is nearer, how rotations go, whether the hinge is one."""
    higher = study.R2[MOVING_AXIS] > study.R2[HINGE]
    axis, other = (np.abs(study.DIFFERENCE[(EOS, model)][3]) for model in (MOVING_AXIS, HINGE))
    farther = [name for name, x, y in zip(NAMES, axis, other, strict=True) if not x < y]
    turns = {motion: table[-1, 3:] - table[0, 3:] for motion, table in MEAN.items()}
    eos = turns[EOS]
    follows = eos[0] < 0 < eos[1] and (turns[MOVING_AXIS] * eos > 0).all()
    # ML, AP and CD of a hinge follow from its turns: its femur's origin stays in the tibia.
    rows = MEAN[HINGE]
    off = {sign: np.abs(_same_point(rows, sign) - rows[:, :3]).max() for sign in (1.0, -1.0)}
    return {
        "5.8": Finding(higher.all(), f"{int(higher.sum())} of 5"),
        "5.9": Finding(
            not farther,
            f"moving axis {measures_row(axis)}; hinge {measures_row(other)}",
            farther and f"not {', '.join(farther)}, which the discussion calls overestimated" or "",
        ),
        "5.10": Finding(
            follows and (turns[HINGE] * eos < 0).all(),
            in_words({x: tuple(y) for x, y in turns.items()}, "{} AA {:+.2f}, IE {:+.2f}", "; "),
        ),
        "5.11": Finding(
            off[1.0] <= 0.2,
            f"within {off[1.0]:.2f} mm; with ML positive medially within {off[-1.0]:.2f} mm",
        ),
    }


def _same_point(rows: np.ndarray, sign: float) -> np.ndarray:
    """ML, AP, CD at the turns of each row, with the femur's origin fixed in the tibia as in row 0.

    Flexion is not needed: projections do not depend on it.
    """
    signed = rows * np.array([sign, 1.0, 1.0, 1.0, 1.0])
    adduction, rotation = np.deg2rad(rows[:, 3]), np.deg2rad(rows[:, 4])
    ca, sa, ci, si = np.cos(adduction), np.sin(adduction), np.cos(rotation), np.sin(rotation)
    # Axes of Grood and Suntay in the tibia: femoral lateral, floating, downwards.
    axes = np.zeros((len(rows), 3, 3))
    axes[:, 0] = np.stack([-ca * si, sa, ca * ci], axis=-1)
    axes[:, 1] = np.stack([ci, 0.0 * ci, si], axis=-1)
    axes[:, 2] = [0.0, -1.0, 0.0]
    point = np.linalg.solve(axes[0], signed[0, :3])
    return (axes @ point) * np.array([sign, 1.0, 1.0])


def _joints(found: study.Paper5Study) -> dict[str, Finding]:
    """Claims 5.12 to 5.14 and 5.20: the hinge, calibration poses, fixed axis, range of motion."""
    rows, eos = MEAN[HINGE], MEAN[EOS]
    off = np.abs(found.hinge - rows) / (_ERRORS * SD[HINGE])
    ours = max(float(np.abs(one - eos)[[0, -1]].max()) for one in found.moving_axis.values())
    tables = np.abs((MEAN[MOVING_AXIS] - eos)[[0, -1]]).max()
    axis, hinge, measured = (study.RANGE[motion] for motion in (MOVING_AXIS, HINGE, EOS))
    closer = np.abs(axis - measured) < np.abs(hinge - measured)
    return {
        "5.12": Finding(
            off.max() <= 1.0,
            f"tilt {found.hinge_tilt_deg:.1f} degrees; farthest {off.max():.2f} times two standard "
            f"errors ({NAMES[int(np.argmax(off.max(axis=0)))]}); "
            f"at 90: {measures_row(found.hinge[-1])}",
        ),
        "5.13": Finding(ours <= 1e-9 and tables <= 0.01 + 1e-9,
                        f"ours {ours:.0e}; printed {tables:.2f}"),
        "5.14": Finding(found.stays_fixed < 1e-9, f"{found.stays_fixed:.0e} mm"),
        "5.20": Finding(closer.all() and (hinge < measured).sum() > 2,
                        f"EOS {measures_row(measured)}; moving axis {measures_row(axis)}; "
                        f"hinge {measures_row(hinge)}"),
    }  # fmt: skip


def _moving_means(found: study.Paper5Study) -> dict[str, Finding]:
    """Claims 5.15 to 5.19, one a measure: means at 20, 45 and 60 degrees."""
    rows = MEAN[MOVING_AXIS][COMPARED]
    errors = _ERRORS * SD[MOVING_AXIS][COMPARED]
    ours = found.moving_axis["contact"][COMPARED]
    low, high = np.quantile(found.spread[:, COMPARED], [0.025, 0.975], axis=0)
    near = (np.abs(ours - rows) <= errors).all(axis=0)
    within = ((rows >= low - errors) & (rows <= high + errors)).all(axis=0)
    findings = {}
    for j, one in enumerate(MEASURES):
        every = zip(ours[:, j], low[:, j], high[:, j], strict=True)
        named = zip(study.ANGLES, every, strict=True)
        spans = in_words(named, "{} deg: {:.2f} ({:.2f} to {:.2f})") + f" {one.unit}"
        depends = "the answer depends on axis points that were not published"
        open_question = Finding(None, spans, depends)
        known = near[j] or not within[j]
        findings[f"5.{15 + j}"] = Finding(near[j], spans) if known else open_question
    return findings


def _cohorts(found: study.Paper5Study) -> dict[str, Finding]:
    """Claims 5.21 and 5.22: R2 and significance in synthetic cohorts, at each correlation."""
    share = {
        rho: np.mean([one.predictions[0].r2 > one.predictions[1].r2 for one in cohorts], axis=0)
        for rho, cohorts in found.cohorts.items()
    }
    always = all((x > 0.5).all() for x in share.values())
    never = (np.stack(list(share.values())) < 0.5).all(axis=0).any()
    # AP of both models against measured, in the first cohort.
    significant, epsilons = {}, {}
    for rho, (first, *_) in found.cohorts.items():
        tests = [first.test("AP", i) for i in range(int(first.compared.sum()))]
        pairs = [pair for x in tests if x for pair in x.pairs if pair.first == "measured"]
        significant[rho] = [x.p <= first.alpha and x.difference > 0.0 for x in pairs]
        own = [test.epsilon for test in first.tests if test is not None]
        epsilons[rho] = min(own), max(own)
    every = [all(x) for x in significant.values()]
    return {
        "5.21": Finding(True if always else False if never else None,
                        in_words({rho: measures_row(x, ".0%") for rho, x in share.items()},
                                 "correlation {:g}: {}", "; ")),
        "5.22": Finding(True if all(every) else None if any(every) else False,
                        in_words({rho: sum(x) for rho, x in significant.items()},
                                 "correlation {:g}: {} of 6", "; "),
                        numbers={"epsilons": in_words(epsilons, "{:g}: {:.2f} to {:.2f}", "; ")}),
    }


@styled
def means_figure(found: study.Paper5Study) -> "Figure":
    """Draw the printed means of measurement, moving axis and hinge, and the joints made again.

    The band holds the middle 95 % of the axis points that were drawn.
    """
    x = study.REACHED_DEG
    figure, panels, beside = coordinate_panels(x, 6.3, bottom=0.5, top=0.3, apart=(0.5, 0.4))
    low, high = np.quantile(found.spread, [0.025, 0.975], axis=0)
    mean, sd, ours = MEAN, SD[EOS], found.moving_axis["contact"]
    square = {"markersize": 4, "markeredgecolor": "white", "markeredgewidth": 0.5}
    for j, (measure, axes) in enumerate(zip(MEASURES, panels.values(), strict=True)):
        axes.set_title(f"{measure.name}: {measure.meaning}, {measure.unit}")
        axes.plot(x, ours[:, j], color=VERMILLION, label="moving axis, ours, stand-in axis points")
        axes.fill_between(
            x, low[:, j], high[:, j], color=VERMILLION, alpha=0.15, linewidth=0,
            label="the same, drawn axis points (95 %)",
        )  # fmt: skip
        axes.plot(x, found.hinge[:, j], "--", color=BLUE, label="hinge, ours, one number fitted")
        axes.errorbar(
            x, mean[EOS][:, j], sd[:, j], fmt="o", markersize=4, markerfacecolor="none",
            color=BLACK, capsize=2, linewidth=0.8, label="EOS, printed, mean +- SD of ten",
        )  # fmt: skip
        label = "moving axis, printed"
        axes.plot(x, mean[MOVING_AXIS][:, j], "D", color=VERMILLION, label=label, **square)
        axes.plot(x, mean[HINGE][:, j], "s", color=BLUE, label="hinge, printed", **square)
    part_legend(beside, labelled(axes), (0.0, 0.82))
    return figure
