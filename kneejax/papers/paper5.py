"""Paper 5: the moving axis and the hinge of ten men's knees, against its printed numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.files import load_knee
from kneejax.joints import MEASURES, UnsuitableMotions
from kneejax.papers import paper5_study as study
from kneejax.papers import paper5_tables as printed
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.papers.paper5_study import DONOR, Paper5Study
from kneejax.papers.paper5_tables import ANGLES, EOS, HINGE, MOVING_AXIS, NAMES, measures_row
from kneejax.parameters import UnsuitableData
from kneejax.report.look import BLACK, BLUE, VERMILLION, Answer, Table, styled
from kneejax.report.panels import coordinate_panels, part_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Two standard errors of a printed mean, by its standard deviation.
_ERRORS = 2.0 / np.sqrt(printed.SUBJECTS)


def reproduce(stages: Stages = silent) -> Answer:
    """Compute the joints and synthetic cohorts, and judge the claims.

    Args:
        stages: shows progress.

    Raises:
        UnsuitableData: pingouin, for the analysis of variance, is not installed.
    """
    from kneejax.report import comparison_tables, joint_comparison_figure

    try:
        with stages("cohorts"):
            found = study.paper5_study(load_knee(DONOR))
    except UnsuitableMotions as problem:
        raise UnsuitableData(str(problem)) from problem
    # Which synthetic cohort is drawn and written: the first of this correlation.
    shown = study.CORRELATIONS[1]
    cohort = found.cohorts[shown][0]
    means = {(motion, "printed"): table for motion, table in printed.MEAN.items()}
    means |= {(MOVING_AXIS, f"ours, facets {x}"): table for x, table in found.moving_axis.items()}
    means[HINGE, "ours"] = found.hinge
    rows = [
        [*source, angle, *row]
        for source, table in means.items()
        for angle, row in zip(printed.REACHED_DEG, table, strict=True)
    ]
    tables = {
        "means": Table.plain(
            ["motion", "source", "flexion_deg", *(x.column for x in MEASURES)], rows
        ),
        **{f"synthetic_{name}": one for name, one in comparison_tables(cohort).items()},
    }
    labelled = {f"{name}, SYNTHETIC": motion for name, motion in cohort.models.items()}
    figures = {
        "means": means_figure(found),
        "synthetic_cohort": joint_comparison_figure(cohort, cohort.flexion_deg, labelled),
    }
    settings = {
        "axis_points_of": DONOR, "facets_deg": study.FACETS, "drawn_axis_points": study.DRAWS,
        "midpoint_sd_mm": study.MIDPOINT_SD_MM, "centre_sd_mm": study.CENTRE_SD_MM,
        "sizes": study.SIZES, "assumed_correlations": study.CORRELATIONS,
        "cohorts_each": study.COHORTS, "shown_cohort": shown, "seed": found.seed,
        "facet_centres_mm": found.facets, "epicondyles_mm": found.epicondyles,
    }  # fmt: skip
    words = {"donor": DONOR, "draws": study.DRAWS, "cohorts": study.COHORTS}
    return answered(5, claims(found), figures, tables, settings, (), words)


def claims(found: Paper5Study) -> tuple[Claim, ...]:
    """Judge what the printed numbers say about each other, the joints, and the statistics."""
    asterisks = int(sum(marked.sum() for marked in printed.MARKED.values()))
    findings = printed.table_findings() | _joints(found) | _moving_means(found) | _cohorts(found)
    return judged(5, findings, asterisks=asterisks)


def _joints(found: Paper5Study) -> dict[str, Finding]:
    """Claims 5.12 to 5.14 and 5.20: the hinge, calibration poses, fixed axis, range of motion."""
    rows, eos = printed.MEAN[HINGE], printed.MEAN[EOS]
    off = np.abs(found.hinge - rows) / (_ERRORS * printed.SD[HINGE])
    ours = max(float(np.abs(one - eos)[[0, -1]].max()) for one in found.moving_axis.values())
    tables = np.abs((printed.MEAN[MOVING_AXIS] - eos)[[0, -1]]).max()
    axis, hinge, measured = (printed.RANGE[motion] for motion in (MOVING_AXIS, HINGE, EOS))
    closer = np.abs(axis - measured) < np.abs(hinge - measured)
    return {
        "5.12": Finding(
            off.max() <= 1.0,
            f"tilt {found.hinge_tilt_deg:.1f} degrees; farthest {off.max():.2f} times two standard "
            f"errors ({NAMES[int(np.argmax(off.max(axis=0)))]}); "
            f"at 90: {measures_row(found.hinge[-1])}",
        ),
        "5.13": Finding(
            ours <= 1e-9 and tables <= 0.01 + 1e-9, f"ours {ours:.0e}; printed {tables:.2f}"
        ),
        "5.14": Finding(found.stays_fixed < 1e-9, f"{found.stays_fixed:.0e} mm"),
        "5.20": Finding(closer.all() and (hinge < measured).sum() > 2,
                        f"EOS {measures_row(measured)}; moving axis {measures_row(axis)}; "
                        f"hinge {measures_row(hinge)}"),
    }


def _moving_means(found: Paper5Study) -> dict[str, Finding]:
    """Claims 5.15 to 5.19, one a measure: means at 20, 45 and 60 degrees."""
    rows = printed.MEAN[MOVING_AXIS][printed.COMPARED]
    errors = _ERRORS * printed.SD[MOVING_AXIS][printed.COMPARED]
    ours = found.moving_axis["contact"][printed.COMPARED]
    low, high = np.quantile(found.spread[:, printed.COMPARED], [0.025, 0.975], axis=0)
    near = (np.abs(ours - rows) <= errors).all(axis=0)
    within = ((rows >= low - errors) & (rows <= high + errors)).all(axis=0)
    findings = {}
    for j, one in enumerate(MEASURES):
        every = map(tuple, np.stack([ours[:, j], low[:, j], high[:, j]], axis=1))
        spans = in_words(dict(zip(ANGLES, every, strict=True)), "{} deg: {:.2f} ({:.2f} to {:.2f})")
        depends = "the answer depends on axis points that were not published"
        findings[f"5.{15 + j}"] = (
            Finding(None, f"{spans} {one.unit}", depends) if within[j] and not near[j] else
            Finding(near[j], f"{spans} {one.unit}")
        )  # fmt: skip
    return findings


def _cohorts(found: Paper5Study) -> dict[str, Finding]:
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
def means_figure(found: Paper5Study) -> Figure:
    """Draw the printed means of measurement, moving axis and hinge, and the joints made again.

    Returns:
        Five panels over flexion, the legend in the sixth. The band holds the middle 95 % of the
        axis points that were drawn.
    """
    x, room = printed.REACHED_DEG, {"bottom": 0.5, "top": 0.3, "apart": (0.5, 0.4)}
    figure, panels, beside = coordinate_panels(x, 6.3, **room)
    low, high = np.quantile(found.spread, [0.025, 0.975], axis=0)
    mean, sd, ours = printed.MEAN, printed.SD[EOS], found.moving_axis["contact"]
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
    handles, labels = axes.get_legend_handles_labels()
    part_legend(beside, dict(zip(labels, handles, strict=True)), (0.0, 0.82))
    return figure
