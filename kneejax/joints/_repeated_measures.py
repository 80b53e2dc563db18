"""Statistics of paired motions, by SciPy and pingouin: normality, one ANOVA, its post hoc pairs."""

__all__ = ["FEWEST_SUBJECTS", "UnsuitableMotions", "is_tested", "repeated_measures"]

import dataclasses
import itertools
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Subjects below which neither Shapiro-Wilk nor the analysis of variance is defined.
FEWEST_SUBJECTS = 3


class UnsuitableMotions(ValueError):
    """Motions that cannot be compared as asked; one sentence says why and what would do."""


@dataclasses.dataclass(frozen=True)
class Pair:
    """A post hoc comparison of two groups of paired values: mean of first - second."""

    first: str
    second: str
    difference: float
    standard_error: float
    p: float  # of the paired t-test, Bonferroni-adjusted: times the number of pairs, at most 1
    lower: float  # of the confidence interval, which is Bonferroni-adjusted too
    upper: float


@dataclasses.dataclass(frozen=True)
class RepeatedMeasures:
    """A one-way repeated-measures analysis of variance; `f`, `epsilon` and both `p` are NaN where
    all groups differ by the same in all subjects."""

    normality: dict[str, float]  # group -> p of Shapiro-Wilk; small where values are not normal
    f: float  # variance between groups over that of the error
    df: tuple[int, int]  # degrees of freedom of both, before the correction
    # Greenhouse and Geisser's: 1 where groups are equally correlated, 1 / (groups - 1) at worst.
    epsilon: float
    p: float  # with both degrees of freedom multiplied by epsilon
    p_uncorrected: float
    pairs: tuple[Pair, ...]  # each group against each later one


def is_tested(subjects: int, anova: bool | None = None) -> bool:
    """Whether motions of so many subjects are tested; to be asked before long work.

    Args:
        subjects: how many.
        anova: whether tests are wanted; by default if there are three subjects or more.

    Returns:
        Whether they are.

    Raises:
        UnsuitableMotions: they are, with fewer than three subjects or without pingouin.

    Example:
        >>> is_tested(2), is_tested(10, anova=False)
        (False, False)
    """
    if not (subjects >= FEWEST_SUBJECTS if anova is None else anova):
        return False
    if subjects < FEWEST_SUBJECTS:
        raise UnsuitableMotions(
            f"repeated measures of {subjects} subject{'s' * (subjects != 1)}: expected at least "
            f"{FEWEST_SUBJECTS}; without an analysis of variance, means and errors are still given"
        )
    _pingouin()
    return True


def repeated_measures(groups: Mapping[str, np.ndarray], alpha: float = 0.01) -> RepeatedMeasures:
    """Compare groups of values of the same subjects.

    Args:
        groups: name -> values, shape `(subjects,)`, in one order of subjects; at least two groups.
        alpha: confidence intervals hold all pairs at once with probability 1 - alpha.

    Returns:
        The `RepeatedMeasures`.

    Raises:
        UnsuitableMotions: fewer than two groups or three subjects, groups of different lengths, a
            value that is not finite, a level that is none, or pingouin is not installed.

    Source: paper 5, section 2.6: Shapiro-Wilk, Greenhouse-Geisser, Bonferroni with alpha 0.01.
    Here the first and the last are SciPy's (`shapiro`, `ttest_rel`), the analysis is pingouin's
    (`rm_anova`).
    """
    groups = {name: np.asarray(values, float) for name, values in groups.items()}
    if len(groups) < 2:
        raise UnsuitableMotions(f"{len(groups)} group to compare: expected at least two")
    shapes = {values.shape for values in groups.values()}
    if len(shapes) > 1 or len(shape := shapes.pop()) != 1:
        found = ", ".join(f"{name} {values.shape}" for name, values in groups.items())
        raise UnsuitableMotions(f"groups of the shapes {found}: expected (subjects,), all alike")
    is_tested(*shape, anova=True)
    for name, values in groups.items():
        if not np.isfinite(values).all():
            raise UnsuitableMotions(f"a value of {name} is missing: expected finite numbers")
    check_level(alpha)
    pingouin = _pingouin()
    import pandas
    from scipy import stats

    subjects, count = len(next(iter(groups.values()))), len(groups)
    df = count - 1, (count - 1) * (subjects - 1)
    with warnings.catch_warnings():
        # Values without any spread: the numbers say so (inf and NaN). pandas 3 announces 4.
        warnings.simplefilter("ignore")
        normality = {name: float(stats.shapiro(x).pvalue) for name, x in groups.items()}
        pairs = _pairs(groups, alpha)
        values = np.stack(list(groups.values()))
        of_groups, of_subjects = values.mean(axis=1, keepdims=True), values.mean(axis=0)
        error = values - of_groups - of_subjects + values.mean()
        # Subjects that differ by constants of their own alone leave no error to judge by.
        if not np.abs(error).max() > 1e-12 * np.abs(values).max():
            nan = float("nan")
            return RepeatedMeasures(normality, nan, df, nan, nan, nan, pairs)
        table = pingouin.rm_anova(pandas.DataFrame(dict(groups)), correction=True, detailed=True)
    between = table.iloc[0]
    f, epsilon, p = (float(between[name]) for name in ("F", "eps", "p_unc"))
    # Two groups cannot violate sphericity, and pingouin corrects nothing.
    corrected = float(between.get("p_GG_corr", p))
    return RepeatedMeasures(normality, f, df, epsilon, corrected, p, pairs)


def check_level(alpha: float) -> None:
    """Refuse a level of tests that is no probability, between 0 and 1."""
    if not 0.0 < alpha < 1.0:
        raise UnsuitableMotions(f"alpha is {alpha:g}: expected a number between 0 and 1")


def _pairs(groups: Mapping[str, np.ndarray], alpha: float) -> tuple[Pair, ...]:
    from scipy import stats

    chosen = list(itertools.combinations(groups, 2))
    answer = []
    for pair in chosen:
        first, second = (groups[name] for name in pair)
        apart, test = first - second, stats.ttest_rel(first, second)
        interval = test.confidence_interval(1.0 - alpha / len(chosen))
        p = np.minimum(1.0, len(chosen) * test.pvalue)  # NaN, of no spread, stays NaN
        numbers = apart.mean(), stats.sem(apart), p, interval.low, interval.high
        answer.append(Pair(*pair, *map(float, numbers)))
    return tuple(answer)


def _pingouin() -> Any:
    """pingouin, which only this question needs; pandas comes with it."""
    try:
        import pingouin
    except ImportError as problem:
        raise UnsuitableMotions(
            "the analysis of variance needs pingouin, which is not installed: "
            "pip install 'kneejax[statistics]'"
        ) from problem
    return pingouin
