"""The clinical measures of paper 5, and how well joint models predict measured motion in them: the
statistics of its Tables 1 to 5."""

__all__ = [
    "MEASURED", "MEASURES", "Comparison", "clinical_measures", "compare_motions",
    "poses_from_clinical",
]

import dataclasses
import itertools
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES, convert, table_units
from kneejax.joints._repeated_measures import (
    RepeatedMeasures,
    UnsuitableMotions,
    check_level,
    is_tested,
    repeated_measures,
)
from kneejax.numerics import Named

#: Name of the measured motion among the models.
MEASURED = "measured"
_FEWEST_POINTS = 3


@dataclasses.dataclass(frozen=True)
class ClinicalMeasure:
    """A measure as paper 5 names it, with the meaning of positive values, `mm` or `deg`."""

    name: str
    meaning: str
    unit: str

    @property
    def column(self) -> str:
        """Column of a table: `ML_mm`, ..., `IE_deg`."""
        return f"{self.name}_{self.unit}"


#: In paper 5's order. It prints no signs: they follow from its text and from its Table 3, whose
#: rows are one hinge only with ML lateral and CD distal.
MEASURES = (
    ClinicalMeasure("ML", "tibia lateral of the femur", "mm"),
    ClinicalMeasure("AP", "tibia anterior of the femur", "mm"),
    ClinicalMeasure("CD", "tibia distal of the femur", "mm"),
    ClinicalMeasure("AA", "adduction", "deg"),
    ClinicalMeasure("IE", "internal rotation", "deg"),
)
_PER_UNIT = table_units(COORDINATES)
_FLEXION, _AA, _IE, _ANTERIOR, _SUPERIOR, _LATERAL = range(len(COORDINATES))


def clinical_measures(table: ArrayLike) -> np.ndarray:
    """Express poses in the clinical measures of paper 5.

    The way from the femur's origin to the tibia's is projected onto the three axes of Grood and
    Suntay. Two of them are not orthogonal, so a projection is not the component along an axis,
    which the package's convention `grood-suntay` gives: at 3 degrees of adduction ML differs by
    2 mm.

    Args:
        table: shape `(..., 6)`, degrees and mm, in the package's convention and the order of
            `kneejax.geometry.COLUMNS`.

    Returns:
        Shape `(..., 5)`, mm and degrees, in the order of `MEASURES`: projections onto the femoral
        medial-lateral axis (ML, lateral positive), the floating (AP, anterior positive) and the
        tibial long axis (CD, distal positive), adduction (AA) and internal rotation (IE).

    Source: paper 5, section 2.4; Grood and Suntay (1983).

    Example:
        >>> clinical_measures([0.0, 2.0, 5.0, -3.0, -35.0, 4.0]).round(2).tolist()
        [4.0, -3.0, 34.84, 2.0, 5.0]
    """
    rows = np.moveaxis(np.asarray(table, float) / _PER_UNIT, -1, 0)
    seen = np.asarray(convert(rows, "femoral", "grood-suntay"))
    lean = np.sin(seen[_AA])  # cosine of the angle between the two axes that are not orthogonal
    lateral = seen[_LATERAL] + lean * seen[_SUPERIOR]
    distal = -(seen[_SUPERIOR] + lean * seen[_LATERAL])
    turns = np.rad2deg(seen[[_AA, _IE]])
    return np.stack([lateral, seen[_ANTERIOR], distal, *turns], axis=-1)


def poses_from_clinical(flexion_deg: ArrayLike, measures: ArrayLike) -> np.ndarray:
    """The poses that clinical measures describe: the inverse of `clinical_measures`.

    Args:
        flexion_deg: shape `(...)`.
        measures: shape `(..., 5)`, mm and degrees, in the order of `MEASURES`.

    Returns:
        Shape `(..., 6)`, degrees and mm, in the package's convention.

    Example:
        >>> poses_from_clinical(0.0, [4.0, -3.0, 35.0, 0.0, 5.0]).round(6).tolist()
        [0.0, 0.0, 5.0, -3.0, -35.0, 4.0]
    """
    lateral, anterior, distal, adduction, rotation = np.moveaxis(np.asarray(measures, float), -1, 0)
    flexion, turns = np.deg2rad(np.asarray(flexion_deg, float)), np.deg2rad([adduction, rotation])
    lean = np.sin(turns[0])
    along = (lateral + lean * distal) / (1.0 - lean * lean)
    up = -(distal + lean * lateral) / (1.0 - lean * lean)
    rows = np.stack(np.broadcast_arrays(flexion, *turns, anterior, up, along))
    table = np.moveaxis(np.asarray(convert(rows, "grood-suntay", "femoral")), 0, -1)
    return table * _PER_UNIT


@dataclasses.dataclass(frozen=True)
class Summary:
    """One motion over the subjects (paper 5, Tables 1 to 3), `(conditions, 5)`, mm and degrees, in
    the order of `MEASURES`."""

    motion: str  # `measured` or a model
    # Each flexion; `average` over all and, where some are left out, `average compared`; `min`,
    # `max` and `ROM` of each subject's own motion.
    conditions: tuple[str, ...]
    mean: np.ndarray
    sd: np.ndarray  # that of an average is, as in the paper, the mean of its rows'


@dataclasses.dataclass(frozen=True)
class Difference:
    """One motion minus another (paper 5, Table 4), `(conditions, 5)`, mm and degrees."""

    first: str  # `measured` or a model
    second: str  # a model
    conditions: tuple[str, ...]  # each compared flexion, then `average`
    mean: np.ndarray
    standard_error: np.ndarray  # that of the average is of the subjects' own averages


@dataclasses.dataclass(frozen=True)
class Prediction:
    """How well a model predicts measured values (paper 5, Table 5), each number `(5,)`."""

    model: str
    points: int  # how many values each number is of: subjects times compared flexions
    # Of the straight line, with an intercept, that predicts measured from modelled values of all
    # subjects and compared flexions together. NaN where the model does not move.
    r2: np.ndarray
    adjusted_r2: np.ndarray  # `1 - (1 - r2) (points - 1) / (points - 2)`: one predictor
    rmse: np.ndarray  # of measured - modelled, mm and degrees, which no line adjusts


@dataclasses.dataclass(frozen=True)
class Comparison(Named):
    """Models held against measured motion.

    Attributes:
        flexion_deg: shape `(n,)`; means where subjects were flexed a little differently.
        compared: shape `(n,)`: false where a model was calibrated, so that it predicts nothing.
        measured: shape `(subjects, n, 5)`, mm and degrees, in the order of `MEASURES`.
        models: name -> likewise; NaN where a model has no pose.
        summaries: of the measured motion and of each model.
        differences: of measured and models, then of models among each other.
        predictions: one per model.
        tests: one per measure and compared flexion, measure by measure; None where a model has no
            pose. Empty where there is no analysis of variance.
        alpha: level of the tests.
    """

    flexion_deg: np.ndarray
    compared: np.ndarray
    measured: np.ndarray
    models: dict[str, np.ndarray]
    summaries: tuple[Summary, ...]
    differences: tuple[Difference, ...]
    predictions: tuple[Prediction, ...]
    tests: tuple[RepeatedMeasures | None, ...]
    alpha: float

    OVER = {"flexion_deg": {"flexion_deg": "", "compared": ""}}

    def _named(self) -> dict[str, tuple]:
        over = "motion subject flexion_deg measure"
        return super()._named() | {
            "motion": ("motion", [*self.motions]), "values": (over, [*self.motions.values()]),
            "measure": ("measure", [one.name for one in MEASURES]),
            "measure_unit": ("measure", [one.unit for one in MEASURES]),
        }  # fmt: skip

    @property
    def motions(self) -> dict[str, np.ndarray]:
        """The measured motion, then the models."""
        return {MEASURED: self.measured, **self.models}

    @property
    def missing(self) -> dict[str, int]:
        """Model -> how many of its poses are, where any is."""
        gaps = {k: int(np.isnan(x).any(axis=-1).sum()) for k, x in self.models.items()}
        return {name: count for name, count in gaps.items() if count}

    @property
    def undefined(self) -> int:
        """Tests without an answer: motions are the same distance apart in all subjects."""
        return sum(test is not None and bool(np.isnan(test.f)) for test in self.tests)

    def test(self, measure: str, flexion: int) -> RepeatedMeasures | None:
        """The test of a measure at one of the compared flexions.

        Args:
            measure: name of one of `MEASURES`.
            flexion: number of a compared flexion, from 0.

        Returns:
            The test; None without one, or where a model has no pose.
        """
        row = [one.name for one in MEASURES].index(measure)
        return self.tests[row * int(self.compared.sum()) + flexion] if self.tests else None


def compare_motions(
    flexion_deg: ArrayLike,
    measured: ArrayLike,
    models: Mapping[str, ArrayLike],
    *,
    calibrated_at_deg: Sequence[float] = (),
    anova: bool | None = None,
    alpha: float = 0.01,
) -> Comparison:
    """Hold models against measured motion, as paper 5 does.

    Args:
        flexion_deg: shape `(n,)`, the conditions.
        measured: shape `(subjects, n, 5)`, mm and degrees, in the order of `MEASURES`.
        models: name -> what it says for the same subjects and flexions, likewise; NaN where it
            has no pose.
        calibrated_at_deg: the flexions at which models were calibrated: in the summaries, but not
            compared.
        anova: whether to test: by default if there are three subjects or more. True with fewer
            is an error.
        alpha: level of the tests and of their confidence intervals.

    Returns:
        The `Comparison`.

    Raises:
        UnsuitableMotions: shapes differ, a flexion or measured value is missing, a name is taken,
            a flexion of calibration is none of the conditions, too little is left to compare, the
            level is none, or the tests need more subjects or a package.

    Source: paper 5, sections 2.6 and 3.

    Example:
        >>> flexion = [0.0, 30.0, 60.0]
        >>> measured = np.arange(15.0).reshape(1, 3, 5)
        >>> found = compare_motions(flexion, measured, {"model": measured + 0.5})
        >>> list(found.models), found.compared.tolist()
        (['model'], [True, True, True])
        >>> found.summaries[0].motion, found.summaries[0].conditions
        ('measured', ('0', '30', '60', 'average', 'min', 'max', 'ROM'))
        >>> found.differences[0].second, found.differences[0].mean[-1].tolist()
        ('model', [-0.5, -0.5, -0.5, -0.5, -0.5])
        >>> found.predictions[0].rmse.tolist(), found.predictions[0].r2.round(3).tolist()
        ([0.5, 0.5, 0.5, 0.5, 0.5], [1.0, 1.0, 1.0, 1.0, 1.0])
    """
    flexion = np.atleast_1d(np.asarray(flexion_deg, float))
    seen = np.asarray(measured, float)
    given = {name: np.asarray(one, float) for name, one in models.items()}
    if not given:
        raise UnsuitableMotions("no model to compare: expected at least one")
    motions = {MEASURED: seen, **given}
    for name, one in motions.items():
        expected = (len(seen), len(flexion), len(MEASURES))
        if one.shape != expected:
            raise UnsuitableMotions(
                f"{name} has the shape {one.shape}: expected (subjects, flexions, measures), "
                f"{expected}"
            )
    if MEASURED in given:
        raise UnsuitableMotions(f"a model is called {MEASURED}: expected another name")
    for what, values in (("flexion", flexion), ("measured value", seen)):
        if not np.isfinite(values).all():
            raise UnsuitableMotions(f"a {what} is missing: expected finite numbers")
    compared = np.ones(len(flexion), bool)
    for angle in calibrated_at_deg:
        own = np.isclose(flexion, angle, atol=1e-6)
        if not own.any():
            known = ", ".join(f"{x:g}" for x in flexion)
            raise UnsuitableMotions(
                f"calibrated at {angle:g} degrees, which was not measured: expected some of {known}"
            )
        compared &= ~own
    subjects, points = len(seen), len(seen) * int(compared.sum())
    if points < _FEWEST_POINTS:
        raise UnsuitableMotions(
            f"{points} values to compare (subjects: {subjects}, flexions beside those of the "
            f"calibration: {int(compared.sum())}): expected at least {_FEWEST_POINTS}"
        )
    check_level(alpha)
    return Comparison(
        flexion, compared, seen, given,
        tuple(_summary(name, one, flexion, compared) for name, one in motions.items()),
        tuple(_difference(*pair, motions, flexion, compared)
              for pair in itertools.combinations(motions, 2)),
        tuple(_prediction(name, one, seen, compared) for name, one in given.items()),
        _tests(motions, compared, alpha) if is_tested(subjects, anova) else (), alpha,
    )  # fmt: skip


def _summary(name: str, one: np.ndarray, flexion: np.ndarray, compared: np.ndarray) -> Summary:
    each, low, high = _mean_and_sd(one), one.min(axis=1), one.max(axis=1)
    averages = {"average": each.mean(axis=1)}
    if not compared.all():
        averages["average compared"] = each[:, compared].mean(axis=1)
    ranges = _mean_and_sd(np.stack([low, high, high - low], axis=1))
    mean, sd = np.concatenate([each, np.stack([*averages.values()], axis=1), ranges], axis=1)
    conditions = *(f"{angle:g}" for angle in flexion), *averages, "min", "max", "ROM"
    return Summary(name, conditions, mean, sd)


def _mean_and_sd(values: np.ndarray) -> np.ndarray:
    """Over the first axis, of what is known; NaN where nothing, or for the sd a single one, is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.stack([np.nanmean(values, axis=0), np.nanstd(values, axis=0, ddof=1)])


def _difference(
    first: str, second: str, motions: Mapping[str, np.ndarray], flexion: np.ndarray,
    compared: np.ndarray,
) -> Difference:  # fmt: skip
    apart = (motions[first] - motions[second])[:, compared]
    apart = np.concatenate([apart, apart.mean(axis=1, keepdims=True)], axis=1)
    conditions = *(f"{angle:g}" for angle in flexion[compared]), "average"
    mean, sd = _mean_and_sd(apart)
    known = np.maximum(np.isfinite(apart).sum(axis=0), 1)
    return Difference(first, second, conditions, mean, sd / np.sqrt(known))


def _prediction(
    name: str, one: np.ndarray, measured: np.ndarray, compared: np.ndarray
) -> Prediction:
    x, y = (part[:, compared].reshape(-1, len(MEASURES)) for part in (one, measured))
    known = np.isfinite(x).all(axis=1)
    x, y, count = x[known], y[known], int(known.sum())
    r2, adjusted, rmse = np.full((3, len(MEASURES)), np.nan)
    for k in range(len(MEASURES)) if count >= _FEWEST_POINTS else ():
        if min(np.ptp(x[:, k]), np.ptp(y[:, k])) >= 1e-9:
            r2[k] = np.corrcoef(x[:, k], y[:, k])[0, 1] ** 2
    if count > 2:
        adjusted = 1.0 - (1.0 - r2) * (count - 1) / (count - 2)
    if count:
        rmse = np.sqrt(((y - x) ** 2).mean(axis=0))
    return Prediction(name, count, r2, adjusted, rmse)


def _tests(
    motions: Mapping[str, np.ndarray], compared: np.ndarray, alpha: float
) -> tuple[RepeatedMeasures | None, ...]:
    """One analysis a measure and flexion, like the paper's fifteen."""
    answer = []
    for measure, i in itertools.product(range(len(MEASURES)), np.flatnonzero(compared)):
        groups = {name: one[:, i, measure] for name, one in motions.items()}
        whole = all(np.isfinite(x).all() for x in groups.values())
        answer.append(repeated_measures(groups, alpha) if whole else None)
    return tuple(answer)
