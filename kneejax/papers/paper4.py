"""Paper 4: sensitivities of several knees to one ligament at a time, against its findings."""

import dataclasses
from collections.abc import Mapping, Sequence, Sized
from functools import partial

import numpy as np

from kneejax.files import load_knee
from kneejax.mechanics import Knee
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.papers.knee_comparison import (
    LIMITS,
    KneeComparison,
    KneeStudy,
    compare_knees,
    with_ligaments,
)
from kneejax.papers.knee_comparison_report import comparison_answer, ramp_figure, score_figure
from kneejax.papers.varus_valgus import VALGUS, VARUS
from kneejax.report.look import Answer

#: Bundled models, and the one around which synthetic knees are drawn, with their seeds.
KNEES = ("four_ligament", "lenhart2015_reduced", "lenhart2015", "average_knee")
DRAWN_AROUND, SEEDS = "lenhart2015_reduced", (1, 2)
_CURVES = ("MCL.prestretch", "LCL.prestretch", "MCL.youngs_modulus")

_, ROTATION, PRESSURE, PLACE = LIMITS
_NAMES = dict(zip(LIMITS, ("convergence", "rotation", "pressure", "place"), strict=True))
_SMALL, _MEDIUM, _SIMILAR, _MATTERS = 1.0, 2.0, 0.75, 1.5
#: Part of the tension in the other direction below which a ligament counts as slack.
_SLACK = 0.1
#: Standard deviations of synthetic knees: of attachments in each direction, mm; of reference
#: strains; of the logarithms of stiffnesses and of the cartilage's modulus.
ATTACHMENT_MM, STRAIN, LOG_STIFFNESS = 2.0, 0.02, 0.2


def reproduce(stages: Stages = silent) -> Answer:
    """Compare four bundled and two synthetic knees, and judge the findings."""
    knees = {name: load_knee(name) for name in KNEES}
    drawn = {f"made_up_{seed}": synthetic_knee(knees[DRAWN_AROUND], seed) for seed in SEEDS}
    with stages("knees") as show:
        found = compare_knees(knees | drawn, progress=partial(show, "knees"))
    figures = {"scores": score_figure(found)}
    figures |= {name.replace(".", "-"): ramp_figure(found, name) for name in _CURVES}
    settings = dataclasses.asdict(found.settings) | {
        "knees": list(KNEES), "made_up_around": DRAWN_AROUND, "made_up_seeds": list(SEEDS)
    }  # fmt: skip
    words = {
        "axial_N": found.settings.body_weight_N / 2, "full_Nm": found.settings.full_Nm,
        "reference_modulus_MPa": found.settings.reference_modulus_MPa, "knees": ", ".join(KNEES),
        "drawn": len(SEEDS), "drawn_around": DRAWN_AROUND,
    }  # fmt: skip
    answer = comparison_answer(found)
    return answered(4, claims(found), figures, answer.tables, settings, found.doubts,
                    words, answer.document)  # fmt: skip


def synthetic_knee(knee: Knee, seed: int) -> Knee:
    """A knee that differs from another as persons might, by a seeded draw, independent for every
    fibre. The ends of fibres around obstacles stay, so that none begins inside one, and so do the
    surfaces. Such a knee is synthetic: it is neither measured, calibrated nor validated."""
    draw, own, count = np.random.default_rng(seed), knee.ligaments, len(knee.ligaments.names)
    strain = np.asarray(knee.reference_strain()) + STRAIN * draw.standard_normal(count)
    bent = [row for course in own.courses for row in course.rows]
    straight = ~np.isin(np.arange(count), bent)[:, None]
    femoral, tibial = (
        ends + ATTACHMENT_MM * straight * draw.standard_normal((count, 3))
        for ends in map(np.asarray, (own.femoral_attachment, own.tibial_attachment))
    )
    stiffness = np.asarray(own.stiffness) * np.exp(LOG_STIFFNESS * draw.standard_normal(count))
    ends = {"femoral_attachment": femoral, "tibial_attachment": tibial}
    knee = with_ligaments(knee, stiffness=stiffness, **ends)
    knee = with_ligaments(knee, slack_length=knee.reference_length() / (1.0 + strain))
    softer = np.exp(LOG_STIFFNESS * draw.standard_normal())
    contacts = (dataclasses.replace(x, youngs_modulus=x.youngs_modulus * softer)
                for x in knee.contacts)  # fmt: skip
    return dataclasses.replace(knee, contacts=tuple(contacts))


def claims(found: KneeComparison) -> tuple[Claim, ...]:
    """Judge the findings of the abstract, section 3 and section 4."""
    share = max(found.settings.modulus_MPa, default=0.0) / found.settings.reference_modulus_MPa
    findings = _prestretch(found) | _modulus(found) | _across_parameters(found)
    return judged(4, findings, modulus_share=share)


def _prestretch(found: KneeComparison) -> dict[str, Finding]:
    """Claims 4.1 and 4.3 to 4.7."""
    parameters = _of(found, "prestretch")
    ranges = {}
    for knee in found.knees:
        means = [np.nanmean([knee.score(x, o) for o in LIMITS]) for x in _of(knee, "prestretch")]
        ranges[knee.name] = float(np.ptp(means))
    counts = {o: sum(_span(found, x, o) > _SIMILAR for x in parameters) for o in LIMITS}
    return {
        "4.1": _matters(found, "prestretch"),
        "4.3": Finding(min(ranges.values()) >= 0.5,
                       in_words({name: _short(x) for name, x in ranges.items()}, "{} {}")),
        "4.4": Finding(
            min(counts.values()) >= 2,
            "ligaments: " + in_words({_NAMES[o]: x for o, x in counts.items()}, "{} {}"),
        ),
        "4.5": _alike(found, "MCL.prestretch", (PRESSURE, ROTATION)),
        "4.6": _one_direction(found, "LCL", VARUS, VALGUS),
        "4.7": _one_direction(found, "MCL", VALGUS, VARUS),
    }


def _modulus(found: KneeComparison) -> dict[str, Finding]:
    """Claims 4.2 and 4.8 to 4.10."""
    spans = {name.split(".")[0]: _span(found, name, PLACE) for name in _of(found, "youngs_modulus")}
    pairs = [(knee, name) for knee in found.knees for name in _of(knee, "youngs_modulus")]
    above = [
        f"{knee.name} {name.split('.')[0]} {_short(knee.score(name, PRESSURE))}"
        for knee, name in pairs
        if knee.score(name, PRESSURE) > _MEDIUM
    ]
    return {
        "4.2": _matters(found, "youngs_modulus"),
        "4.8": Finding(
            max(spans.values()) > _SIMILAR,
            in_words({name: _short(span) for name, span in spans.items()}, "{} spans {}"),
        ),
        "4.9": _alike(found, "MCL.youngs_modulus", (ROTATION, PRESSURE, PLACE)),
        "4.10": Finding(len(above) <= 1, _counted(above, pairs, "pairs above 2")),
    }


def _across_parameters(found: KneeComparison) -> dict[str, Finding]:
    """Claims 4.11 to 4.15 and 4.17."""
    pairs = [(knee, name) for knee in found.knees for name in _of(knee, "attachment")]
    above = [
        f"{knee.name} {name.split('.')[0]}"
        for knee, name in pairs
        if max(knee.score(name, o) for o in LIMITS) > _MEDIUM
    ]
    lines = [knee.name for knee in found.knees if not _of(knee, "attachment")]
    without = f" Ligaments of one line have no halves: all of {', '.join(lines)}." if lines else ""
    spans = {name: [_span(found, name, o) for o in LIMITS] for name in found.parameters}
    ends = [name for name, each in spans.items() if each[0] > _SIMILAR]
    specific = [name for name, each in spans.items() if max(_known(each)) > _SIMILAR]
    sides = (VALGUS, "LCL"), (VARUS, "LCL"), (VARUS, "MCL"), (VALGUS, "MCL")
    pulls = {knee.name: tuple(knee.tension_N[way][x] for way, x in sides) for knee in found.knees}
    slack = sum(a < _SLACK * b and c < _SLACK * d for a, b, c, d in pulls.values())
    shown = "{} LCL {:.0f} N in valgus, {:.0f} in varus, MCL {:.0f} in varus, {:.0f} in valgus"
    return {
        "4.11": Finding(len(above) <= len(pairs) / 8 if pairs else None,
                        _counted(above, pairs, "pairs above 2"), numbers={"lines": without}),
        "4.12": Finding(bool(ends), _counted(ends, spans, "parameters")),
        "4.13": Finding(len(specific) > len(spans) / 2,
                        f"{len(specific)} of {len(spans)} parameters"),
        "4.14": Finding(slack > len(found.knees) / 2, in_words(pulls, shown, "; ")),
        "4.15": _go_together(found),
        "4.17": _horns(found),
    }  # fmt: skip


def _horns(found: KneeComparison) -> Finding:
    """Claim 4.17: the stiffness of meniscal horns, of knees that have any."""
    scores = {knee.name: [knee.score(name, outcome) for outcome in LIMITS]
              for knee in found.knees for name in _of(knee, "horn_stiffness")}  # fmt: skip
    if not scores:
        return Finding(None, "-", "None of these knees has menisci with horns.")
    return Finding(
        max(x for each in scores.values() for x in each) <= _SMALL,
        "scores on convergence/rotation/pressure/place: " + _slashed(scores),
    )


def _matters(found: KneeComparison, quantity: str) -> Finding:
    """Claims 4.1 and 4.2: some ligament in some direction, in every knee, on all three outcomes."""
    best = {
        knee.name: [
            max(_known([x for p in _of(knee, quantity) for x in knee.scores(p, outcome).values()]))
            for outcome in (ROTATION, PRESSURE, PLACE)
        ]
        for knee in found.knees
    }
    return Finding(all(min(scores) >= _MATTERS for scores in best.values()),
                   "highest scores on rotation/pressure/place: " + _slashed(best))  # fmt: skip


def _alike(found: KneeComparison, parameter: str, outcomes: Sequence[str]) -> Finding:
    """Claims 4.5 and 4.9: the scores of the knees lie near each other."""
    spans = {o: _span(found, parameter, o) for o in outcomes}
    known = np.isfinite([*spans.values()]).all()
    return Finding(
        max(spans.values()) <= _SIMILAR if known else None,
        in_words({_NAMES[o]: _short(x) for o, x in spans.items()}, "{} spans {}"),
    )


def _one_direction(found: KneeComparison, ligament: str, more: str, less: str) -> Finding:
    """Claims 4.6 and 4.7: prestretch acts on rotation in one direction more."""
    parameter = f"{ligament}.prestretch"
    known = {knee.name: (knee.averages(parameter, ROTATION), knee.scores(parameter, ROTATION))
             for knee in found.knees if parameter in knee.parameters}  # fmt: skip
    shown = [
        f"{name} {_short(average[more])} deg ({_short(scores[more])}) against "
        f"{_short(average[less])} deg ({_short(scores[less])})"
        for name, (average, scores) in known.items()
    ]
    return Finding(all(average[more] > average[less] for average, _ in known.values()),
                   "; ".join(shown) + f"; scores in brackets, {more} first")  # fmt: skip


def _go_together(found: KneeComparison) -> Finding:
    """Claim 4.15: rank correlation of scores on rotation with those on pressure and place."""
    from scipy.stats import spearmanr

    outcomes = (ROTATION, PRESSURE, PLACE)
    rows = np.array(
        [[knee.score(x, o) for o in outcomes] for knee in found.knees for x in knee.parameters]
    )
    rows = rows[np.isfinite(rows).all(axis=1)]
    pressure, place = (
        float(spearmanr(rows[:, 0], rows[:, i])[0]) if len(rows) > 2 else np.nan for i in (1, 2)
    )
    return Finding(
        min(pressure, place) >= 0.5 if np.isfinite([pressure, place]).all() else None,
        f"{_short(pressure)} with pressure, {_short(place)} with place; {len(rows)} pairs of knee "
        "and parameter",
    )


def _of(found: KneeComparison | KneeStudy, quantity: str) -> list[str]:
    """Parameters of one quantity."""
    return [name for name in found.parameters if name.endswith(f".{quantity}")]


def _span(found: KneeComparison, parameter: str, outcome: str) -> float:
    """Largest less smallest score of the knees; NaN if fewer than two are known."""
    scores = _known([knee.score(parameter, outcome) for knee in found.knees])
    return float(np.ptp(scores)) if len(scores) > 1 else np.nan


def _known(numbers: Sequence[float]) -> list[float]:
    return [x for x in numbers if np.isfinite(x)] or [np.nan]


def _short(number: float) -> str:
    return "-" if np.isnan(number) else f"{number:.2f}".rstrip("0").rstrip(".")


def _slashed(scores: Mapping[str, Sequence[float]]) -> str:
    return in_words({x: "/".join(map(_short, each)) for x, each in scores.items()}, "{} {}", "; ")


def _counted(some: Sequence[str], every: Sized, what: str) -> str:
    return f"{len(some)} of {len(every)} {what}" + (f" ({', '.join(some)})" if some else "")
