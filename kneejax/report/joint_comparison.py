"""Simple joints against measured motion, as an answer with tables and figure."""

__all__ = ["comparison_answer", "comparison_tables", "joint_comparison_figure"]

import itertools
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from kneejax.inference import versions
from kneejax.joints import FEWEST_SUBJECTS, MEASURED, MEASURES, Comparison
from kneejax.report.look.colours import BLACK, GREY, PARTS, VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import WIDTH, Figure, styled, verbatim
from kneejax.report.look.tables import NONE, Column, Table, runs
from kneejax.report.panels import grid

_NAMES = {"ML": "Medial-lateral", "AP": "Anterior-posterior", "CD": "Distraction",
          "AA": "Adduction", "IE": "Internal rotation"}  # fmt: skip
_MOST_COLUMNS = 4
_DENSE = 20


@styled
def joint_comparison_figure(
    found: Comparison, flexion_deg: np.ndarray, curves: Mapping[str, np.ndarray],
    subject_flexion_deg: np.ndarray | None = None,
) -> Figure:
    """Draw measured points and modelled curves: a row per clinical measure, a column per model.

    Args:
        found: the comparison.
        flexion_deg: of the curves, shape `(m,)`.
        curves: model -> measures over them, shape `(subjects or 1, m, 5)`; NaN leaves a gap. At
            most four models are drawn, the first ones.
        subject_flexion_deg: where each subject was flexed, shape `(subjects, n)`, if not all alike.

    Returns:
        The figure; points that models were calibrated on are filled.
    """
    names = list(curves)[:_MOST_COLUMNS]
    subjects, shown = len(found.measured), subject_flexion_deg
    if shown is None:
        shown = found.flexion_deg[None].repeat(subjects, axis=0)
    # One column would leave the page half empty, four need all of it.
    width = {1: 0.55, 2: 0.85}.get(len(names), 1.0) * WIDTH
    figure, panels = grid(len(MEASURES), len(names), 8.4, width=width, left=0.78, right=0.08,
                          top=0.63, bottom=0.46, apart=(0.1, 0.17), sharex=True, sharey="row")
    kept, dots = ~found.compared, {"marker": "o", "linestyle": "none", "markeredgewidth": 0.8,
                                   "markersize": 3.6 if found.flexion_deg.size <= _DENSE else 2.2}
    colors = [BLACK] if subjects == 1 else [PARTS[i % len(PARTS)] for i in range(subjects)]
    for (row, column), axes in np.ndenumerate(panels):
        name, measure = names[column], MEASURES[row]
        modelled, measured = curves[name][..., row], found.measured[..., row]
        for i, color in enumerate(colors):
            if i < len(modelled):
                line = VERMILLION if subjects == 1 else color if len(modelled) > 1 else GREY
                axes.plot(flexion_deg, modelled[i], color=line, linewidth=1.2)
            axes.plot(shown[i], measured[i], markerfacecolor="none", color=color, **dots)
            axes.plot(shown[i, kept], measured[i, kept], color=color, **dots)
        if row == 0:
            title = textwrap.wrap(name.replace("_", " "), 20 if len(names) > 2 else 30)
            axes.set_title(verbatim("\n".join(title[:2])))
        if column == 0:
            axes.set_ylabel(f"{_NAMES[measure.name]}\n{measure.name}, {measure.unit}")
    for axes in panels[-1]:
        axes.set_xlabel("Flexion, deg")
    figure.align_ylabels(panels[:, 0])
    dot = {"marker": "o", "linestyle": "none", "markersize": 4, "color": BLACK}
    handles = [Line2D([], [], color=VERMILLION if subjects == 1 else GREY, label="model"),
               Line2D([], [], markerfacecolor="none", label="measured", **dot)]  # fmt: skip
    if not found.compared.all():
        handles.append(Line2D([], [], label="measured, calibrated on", **dot))
    figure.legend(handles=handles, loc="upper left", ncols=3, bbox_to_anchor=(0.0, 1.0),
                  handlelength=1.6, columnspacing=1.2)  # fmt: skip
    return figure


#: More flexions than these are not listed on a screen.
_MOST_ROWS = 12
_MOST_LISTED = 6
_TEST_COLUMNS = ("measure", "unit", "flexion_deg", "smallest_shapiro_p", "f", "df_between",
                 "df_error", "epsilon", "p", "first", "second", "difference", "standard_error",
                 "p_bonferroni", "lower", "upper", "significant")  # fmt: skip


def comparison_answer(
    found: Comparison, curves: Mapping[str, np.ndarray] | None = None,
    curve_flexion_deg: np.ndarray | None = None, subject_flexion_deg: np.ndarray | None = None, *,
    doubts: Sequence[str] = (), settings: Mapping[str, Any] | None = None,
) -> Answer:
    """How far models are from what was measured.

    Args:
        found: the comparison.
        curves: model -> measures over the flexions of curves, `(subjects or 1, m, 5)`; nothing is
            drawn without.
        curve_flexion_deg: those flexions, `(m,)`.
        subject_flexion_deg: where each subject was flexed, `(subjects, n)`.
        doubts: on the models' poses.
        settings: everything needed to run it again, for result.json.

    Returns:
        The answer; its tables are summary, differences, predictions and, where there are any,
        tests (paper 5, Tables 1 to 5 and supplement).
    """
    count, drawings = len(found.measured), {}
    if curves is not None:
        drawings["joints"] = Drawing(joint_comparison_figure, found, curve_flexion_deg, curves,
                                     subject_flexion_deg)  # fmt: skip
    notes, doubts = [*comparison_notes(found)], [*doubts, *comparison_doubts(found)]
    errors = []
    for one in found.predictions:
        both = [f"{_text(a)} ({_text(b)})" for a, b in zip(one.r2, one.adjusted_r2, strict=True)]
        errors += [[f"{one.model}: RMSE", *map(_text, one.rmse)], [f"{one.model}: R2", *both]]
    return Answer(
        title=f"{', '.join(found.models)}: against measured motion",
        asked=f"{count} subject{'s' * (count != 1)}, {len(found.flexion_deg)} flexions, "
        f"{int(found.compared.sum())} of them compared; "
        f"{', '.join(f'{one.name}: {one.meaning}' for one in MEASURES)}.",
        sentence=_closest(found), tables=comparison_tables(found), drawings=drawings,
        main=[_people("R2 (adjusted), and root mean square error (RMSE)", errors)], doubts=doubts,
        sections=[Section("Measured minus modelled", tables=[*_differences(found)], printed=True),
                  Section("Each motion", tables=[*_motions(found)], printed=True),
                  Section("How the numbers were made", notes, printed=True)],
        document=_document(found, settings or {}, notes, doubts),
    )


def comparison_tables(found: Comparison) -> dict[str, Table]:
    """All numbers: summary (paper 5, Tables 1 to 3), differences (4), predictions (5) and tests.

    Args:
        found: the comparison.
    """
    # Of each measure the mean, and beside it its spread.
    summary = [[one.motion, condition, *np.ravel([one.mean[i], one.sd[i]], "F")]
               for one in found.summaries for i, condition in enumerate(one.conditions)]
    differences = [
        [one.first, one.second, condition, *np.ravel([one.mean[i], one.standard_error[i]], "F")]
        for one in found.differences for i, condition in enumerate(one.conditions)
    ]  # fmt: skip
    predictions = [
        [one.model, measure.name, measure.unit, one.points, *numbers]
        for one in found.predictions
        for measure, *numbers in zip(MEASURES, one.r2, one.adjusted_r2, one.rmse, strict=True)
    ]
    with_sd, with_se = ([f"{one.column}_{x}" for one in MEASURES for x in ("mean", spread)]
                        for spread in ("sd", "se"))  # fmt: skip
    of_models = ("model", "measure", "unit", "points", "r2", "adjusted_r2", "rmse")
    made = {"summary": Table(("motion", "condition", *with_sd), summary),
            "differences": Table(("first", "second", "condition", *with_se), differences),
            "predictions": Table(of_models, predictions)}  # fmt: skip
    places = itertools.product(MEASURES, found.flexion_deg[found.compared])
    # A row per measure, flexion and pair of motions.
    tests = [
        [measure.name, measure.unit, angle, min(test.normality.values()), test.f, *test.df,
         test.epsilon, test.p, pair.first, pair.second, pair.difference, pair.standard_error,
         pair.p, pair.lower, pair.upper, pair.p <= found.alpha]
        for (measure, angle), test in zip(places, found.tests, strict=False) if test is not None
        for pair in test.pairs
    ]  # fmt: skip
    return made | ({"tests": Table(_TEST_COLUMNS, tests)} if found.tests else {})


def comparison_notes(found: Comparison) -> Iterator[str]:
    """Sentences on which poses the numbers are of, and what they mean."""
    subjects = len(found.measured)
    if not found.compared.all():
        order = np.argsort(found.flexion_deg, kind="stable")
        flexion, rows = found.flexion_deg[order], np.flatnonzero(~found.compared[order])
        # Of many, neighbours as a range.
        ends = (flexion[[*ends]] for ends in runs(rows, int(len(rows) > _MOST_LISTED)))
        said = (f"{a:g}" if a == b else f"{a:.1f} to {b:.1f}" for a, b in ends)
        yield prose("joints.left_out", angles=", ".join(said))
    yield prose("joints.r2")
    if found.tests:
        yield prose("joints.tests", alpha=found.alpha, interval=100.0 * (1.0 - found.alpha))
    elif subjects < FEWEST_SUBJECTS:
        one = "One subject" if subjects == 1 else f"{subjects} subjects"
        yield prose("joints.untested", subjects=one, fewest=FEWEST_SUBJECTS)


def comparison_doubts(found: Comparison) -> Iterator[str]:
    """Sentences on what is missing in the tables."""
    for name, gaps in found.missing.items():
        count = found.models[name][..., 0].size
        yield prose("joints.gaps", name=name, gaps=gaps, count=count)
    if found.undefined:
        yield prose("joints.undefined", lost=found.undefined, count=len(found.tests))


def _closest(found: Comparison) -> str:
    """The model with the least error in most measures, and its errors."""
    errors = np.array([one.rmse for one in found.predictions])
    if not np.isfinite(errors).any():
        return "No model has a pose to compare."
    best = np.where(np.isfinite(errors), errors, np.inf).argmin(axis=0)
    wins = np.bincount(best, minlength=len(errors))
    one = found.predictions[int(wins.argmax())]
    sizes = zip(MEASURES, one.rmse, strict=True)
    rmse = ", ".join(f"{m.name} {_text(x)} {m.unit}" for m, x in sizes)
    closest = f"{one.model} has the least RMSE in {wins.max()} of {len(MEASURES)} measures"
    return f"{closest if len(errors) > 1 else f'RMSE of {one.model}'}: {rmse}."


def _people(title: str, rows: Sequence[Sequence[str]]) -> Table:
    """A row a condition, of which flexions are numbers; a column a measure."""
    rows = [[f"{one} deg" if one[0].isdigit() or one[0] == "-" else one, *cells]
            for one, *cells in rows]  # fmt: skip
    measures = [Column(x.column, f"{x.name}, {x.unit}", str, words=False) for x in MEASURES]
    return Table([Column("condition", " "), *measures], rows, title)


def _motions(found: Comparison) -> Iterator[Table]:
    spread = ": mean (standard deviation)" if len(found.measured) > 1 else ""
    for one in found.summaries:
        # The last rows are averages and ranges.
        first = next(i for i, name in enumerate(one.conditions) if name == "average")
        rows = [[one.conditions[i], *_with_spread(one.mean[i], one.sd[i], "{} ({})")]
                for i in range(first if first > _MOST_ROWS else 0, len(one.conditions))]
        yield _people(one.motion + spread, rows)


def _differences(found: Comparison) -> Iterator[Table]:
    """Measured minus modelled; where motions are tested, also models among each other."""
    spread = ": mean +- standard error" if len(found.measured) > 1 else ""
    for one in found.differences:
        if one.first != MEASURED and not found.tests:
            continue
        last, rows = len(one.conditions) - 1, []
        for i in range(last if last > _MOST_ROWS else 0, last + 1):
            cells = _with_spread(one.mean[i], one.standard_error[i], "{} +- {}")
            for k, measure in enumerate(MEASURES):
                test = found.test(measure.name, i) if i < last else None
                p = {(x.first, x.second): x.p for x in (test.pairs if test is not None else ())}
                cells[k] += "*" if p.get((one.first, one.second), 1.0) <= found.alpha else " "
            rows.append([one.conditions[i], *cells])
        yield _people(f"{one.first} - {one.second}{spread}", rows)


def _with_spread(mean: np.ndarray, spread: np.ndarray, words: str) -> list[str]:
    return [_text(a) if np.isnan(b) else words.format(_text(a), _text(b))
            for a, b in zip(mean, spread, strict=True)]  # fmt: skip


def _text(value: float) -> str:
    return NONE if np.isnan(value) else f"{value:.2f}"


def _document(found: Comparison, settings, notes, doubts) -> dict[str, Any]:
    def named(values) -> dict[str, Any]:
        return dict(zip((one.name for one in MEASURES), values, strict=True))

    return {
        "subjects": len(found.measured), "flexion_deg": found.flexion_deg,
        "compared": found.compared, "models": list(found.models),
        "predictions": {
            one.model: {"points": one.points, "r2": named(one.r2),
                        "adjusted_r2": named(one.adjusted_r2), "rmse": named(one.rmse)}
            for one in found.predictions
        },
        "average_differences": {
            f"{one.first} - {one.second}": named(
                {"mean": mean, "standard_error": error}
                for mean, error in zip(one.mean[-1], one.standard_error[-1], strict=True)
            )
            for one in found.differences
        },
        "tested": bool(found.tests), "alpha": found.alpha,
        "measures": {one.name: f"{one.meaning}, {one.unit}" for one in MEASURES}, "notes": notes,
        "doubts": doubts, "settings": settings, "versions": versions(),
    }  # fmt: skip
