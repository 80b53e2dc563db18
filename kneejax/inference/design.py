"""What to measure next: which pose, under which load, tells most about the parameters."""

__all__ = ["Candidate", "Design", "design_tests", "usual_candidates"]

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.fit import table_of
from kneejax.inference.identification import Information
from kneejax.mechanics import NAMED_LOADS, RANGES, Knee, load_of, load_words
from kneejax.numerics import Named
from kneejax.parameters import Selection, UnsuitableData
from kneejax.statics import LoadCases, Slopes, Status, balance_with_slopes

#: Loads of the usual tests, of the size that laxity tests use: name of a load -> its size.
USUAL_LOADS: tuple[dict[str, float], ...] = (
    {}, {"anterior_N": 100.0}, {"anterior_N": -100.0}, {"internal_Nm": 3.0}, {"internal_Nm": -3.0},
    {"varus_Nm": 10.0}, {"varus_Nm": -10.0}, {"compression_N": 200.0},
)  # fmt: skip
#: Flexions of the usual tests, degrees.
USUAL_FLEXION_DEG = tuple(range(0, 121, 15))
#: What a choice of tests makes small: D the volume of the joint confidence region, A the mean
#: squared standard error in units of the parameters' scales.
CRITERIA = ("D", "A")
# Exchanges that gain less are rounding.
_GAIN = 1e-10


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One pose that could be measured: the knee held at a flexion, under a load on the tibia.

    Loads are those of `kneejax.mechanics.load_of`: along the axes of Grood and Suntay, at the
    tibia's origin, besides the loads of the knee.

    Attributes:
        name: of the load; candidates that share it are one row of a table or figure.
        flexion_deg: prescribed flexion.
        lateral_N: along the femur's transverse axis.
        anterior_N: along the floating axis.
        compression_N: along the tibia's long axis, towards the femur.
        varus_Nm: about the floating axis.
        internal_Nm: about the tibia's long axis.
        measured: which free coordinates are measured.

    Example:
        >>> print(Candidate("drawer", 90.0, anterior_N=-100.0))
        drawer at 90 degrees
    """

    name: str
    flexion_deg: float
    _: dataclasses.KW_ONLY
    lateral_N: float = 0.0
    anterior_N: float = 0.0
    compression_N: float = 0.0
    varus_Nm: float = 0.0
    internal_Nm: float = 0.0
    measured: tuple[str, ...] = FREE_COORDINATES

    def __post_init__(self) -> None:
        unknown = [name for name in self.measured if name not in FREE_COORDINATES]
        if unknown or not self.measured:
            what = f"unknown coordinate {unknown[0]!r}" if unknown else "nothing is measured"
            raise UnsuitableData(f"{self}: {what}; expected any of {', '.join(FREE_COORDINATES)}")
        for name, value in {"flexion_deg": self.flexion_deg, **self.loads}.items():
            if not RANGES[name].holds(value):
                expected = RANGES[name].expected(value)
                raise UnsuitableData(f"{self}: {name}: {value:g}: expected {expected}")

    def __str__(self) -> str:
        return f"{self.name} at {self.flexion_deg:g} degrees"

    @property
    def loads(self) -> dict[str, float]:
        """Name of a load -> its size."""
        return {name: getattr(self, name) for name in NAMED_LOADS}


def usual_candidates(flexion_deg: Sequence[float] = USUAL_FLEXION_DEG) -> tuple[Candidate, ...]:
    """The tests of a laxity rig: no load, drawers, torques, varus, valgus and compression.

    Args:
        flexion_deg: every load is tried at each.

    Returns:
        Every load of `USUAL_LOADS` at every flexion: 100 N anterior and posterior, 3 N m internal
        and external, 10 N m varus and valgus, 200 N of compression, or nothing.

    Example:
        >>> tests = usual_candidates()
        >>> len(tests), str(tests[27 + 2])
        (72, 'internal torque 3 N m at 30 degrees')
    """
    return tuple(
        Candidate(load_words(loads), float(angle), **loads)
        for loads in USUAL_LOADS
        for angle in flexion_deg
    )


def load_cases_of(candidates: Sequence[Candidate]) -> LoadCases:
    """The load cases at which a knee must be balanced to predict each candidate."""
    sizes = {name: np.array([test.loads[name] for test in candidates]) for name in NAMED_LOADS}
    return LoadCases.at([test.flexion_deg for test in candidates], [load_of(**sizes, name="test")])


@dataclasses.dataclass(frozen=True)
class Design(Named):
    """The tests to make next, and what each is expected to tell.

    Attributes:
        criterion: `D` or `A`.
        names: of the parameters.
        scale: of each parameter, in its own unit, `(p,)`.
        candidates: what there was to choose from.
        status: `Status` value of each, `(candidates,)`; only balanced, stable poses within the
            fitted surfaces are chosen from.
        chosen: rows of the candidates, in the order in which to make the tests.
        standard_errors: of the parameters, before (row 0) and after each chosen test,
            `(chosen + 1, p)`.
        criterion_values: before and after each chosen test, `(chosen + 1,)`, in units of the
            scales: for D the geometric mean of the half axes of the confidence ellipsoid, for A
            the root mean square of the standard errors. 1 is the prior.
        gains: of each candidate as the very next test, `(candidates,)`: for D information in bits,
            for A the part of the mean squared standard error that it takes away; NaN where left
            out.
        standard_errors_next: after each candidate as the very next test, `(candidates, p)`.
        departures: how far each chosen test's pose departs from its derivative when the parameters
            move by a standard deviation of what is known before, as a part of the change,
            `(chosen,)`.
        prior: standard deviations of a prior that was added to the data, `(p,)`, or None.
        prior_assumed: which of it was nobody's choice but needed, since the data alone leave
            combinations less certain than the scales, `(p,)`.
        freed: parameters on a bound at the fit, which count as free here.

    Source: Fedorov 1972, Theory of Optimal Experiments.
    """

    criterion: str
    names: tuple[str, ...]
    scale: np.ndarray
    candidates: tuple[Candidate, ...]
    status: np.ndarray
    chosen: tuple[int, ...]
    standard_errors: np.ndarray
    criterion_values: np.ndarray
    gains: np.ndarray
    standard_errors_next: np.ndarray
    departures: np.ndarray
    prior: np.ndarray | None
    prior_assumed: np.ndarray
    freed: tuple[str, ...]

    OVER = {
        "candidate": {"status": Status, "gains": "1"},
        "candidate parameter": {"standard_errors_next": ""},
        "tests_made": {"criterion_values": "1"}, "tests_made parameter": {"standard_errors": ""},
    }  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        made = ["none", *(str(self.candidates[row]) for row in self.chosen)]
        each = [str(one) for one in self.candidates]
        labels = {"candidate": each, "tests_made": made, "parameter": self.names}
        return super()._named() | {name: (name, values) for name, values in labels.items()}

    @property
    def tests(self) -> tuple[Candidate, ...]:
        """The chosen candidates, in order."""
        return tuple(self.candidates[row] for row in self.chosen)


def design_tests(
    selection: Selection,
    knee: Knee,
    known: Information,
    noise: np.ndarray,
    candidates: Sequence[Candidate] | None = None,
    *,
    count: int = 3,
    criterion: str = "D",
    prior: np.ndarray | None = None,
    repeat: bool = False,
) -> Design:
    """Choose the tests that tell most about a knee's parameters, on top of data that exist.

    Candidates are predicted with the parameters of the fit, to first order: what a test tells is
    the exact derivative of its pose with respect to the parameters.

    Args:
        selection: the parameters.
        knee: gives everything else.
        known: information of the data that exist, at the fit (`fit_information`). Parameters that
            ended on a bound count as free here.
        noise: standard deviation of what is measured, `(5,)` (`noise_of`).
        candidates: `usual_candidates()` by default.
        count: how many tests to choose.
        criterion: `D` or `A`.
        prior: standard deviations of what is known without the data, `(p,)`, infinite where
            nothing is. Where both leave a combination of parameters less certain than `known.scale`
            the choice would go after numbers without meaning: that scale is then taken for the
            parameters without a prior (`prior_assumed`).
        repeat: whether a test may be made several times.

    Returns:
        The `Design`.

    Raises:
        UnsuitableData: an unknown criterion, fewer candidates that balance than tests wanted, a
            prior without width, parameters that are not those of the information.

    Example:
        Of a study, `kj.identify(study, next_tests=3)` gathers what it needs. Candidates:

        >>> from kneejax.inference import usual_candidates
        >>> usual_candidates()[0].name
        'no load'
    """
    tests = tuple(usual_candidates() if candidates is None else candidates)
    noise = np.asarray(noise, float)
    prior = np.full(len(selection), np.inf) if prior is None else np.asarray(prior, float)
    check_tests(tests, count, criterion, repeat=repeat)
    _check(selection, known, noise, prior)
    load_cases = load_cases_of(tests)
    found = balance_with_slopes(knee, selection.apply, known.values[None], load_cases)
    usable = found.status[0] == Status.BALANCED
    if usable.sum() < (1 if repeat else count):
        raise UnsuitableData(
            f"{count} tests wanted, but the model predicts only {usable.sum()} of {len(tests)} "
            "candidates: ask for fewer, or give others"
        )
    slope = np.where(usable[:, None, None], table_of(found)[1][0], 0.0)
    told = told_by(tests, slope, noise, known.scale)
    base = known.matrix + np.diag((known.scale / prior) ** 2)
    assumed = np.isinf(prior) & (np.linalg.eigvalsh(base)[0] < 1.0)
    base, prior = base + np.diag(1.0 * assumed), np.where(assumed, known.scale, prior)
    chosen = choose(base, told, count, criterion, usable=usable, repeat=repeat)
    covariance = np.linalg.inv(base) * np.outer(known.scale, known.scale)
    bends = departures(selection, knee, known.values, covariance, noise, tests, chosen, found)
    steps = base + np.concatenate([np.zeros((1, *base.shape)), np.cumsum(told[list(chosen)], 0)])
    after, each = base + told, criterion_of(steps, criterion) / len(base)
    before, then = criterion_of(base, criterion), criterion_of(after, criterion)
    gains = (before - then) / (2 * np.log(2)) if criterion == "D" else 1.0 - then / before
    errors = np.where(usable[:, None], standard_errors(after) * known.scale, np.nan)
    return Design(
        criterion=criterion, names=known.names, scale=known.scale, candidates=tests,
        status=found.status[0], chosen=chosen, standard_errors=standard_errors(steps) * known.scale,
        criterion_values=np.exp(each / 2) if criterion == "D" else np.sqrt(each),
        gains=np.where(usable, gains, np.nan),
        standard_errors_next=errors, departures=bends,
        prior=prior if np.isfinite(prior).any() else None, prior_assumed=assumed,
        freed=tuple(n for n, on in zip(known.names, known.at_bound, strict=True) if on),
    )  # fmt: skip


def departures(
    selection: Selection, knee: Knee, values: np.ndarray, covariance: np.ndarray, noise: np.ndarray,
    candidates: Sequence[Candidate], chosen: Sequence[int], foreseen: Slopes,
) -> np.ndarray:  # fmt: skip
    """How wrong first derivatives are for each chosen test, as a part of the change that they give,
    `(chosen,)`: parameters move both ways by one standard deviation of `covariance`, `(p, p)`,
    along what the test tells most about. Infinite where that knee has no balance."""
    parts: dict[int, float] = {}
    (table,), (slope,) = table_of(foreseen)
    for row in set(chosen):
        jacobian = slope[row] / noise[:, None]
        sizes, directions = np.linalg.eigh(jacobian @ covariance @ jacobian.T)
        step = covariance @ jacobian.T @ directions[:, -1] / np.sqrt(sizes[-1])
        # As many load cases as there were candidates: one shape, one compilation.
        copies = [row] * len(candidates)
        alike, near = load_cases_of([candidates[k] for k in copies]), foreseen.at(copies)
        for side in (step, -step):
            moved = (values + side)[None]
            found = balance_with_slopes(knee, selection.apply, moved, alike, near)
            change, straight = (table_of(found)[0][0] - table[row]) / noise, jacobian @ side
            part = np.linalg.norm(change - straight) / np.linalg.norm(straight)
            parts[row] = max(parts.get(row, 0.0), float(np.nan_to_num(part, nan=np.inf)))
    return np.array([parts[row] for row in chosen])


def told_by(
    candidates: Sequence[Candidate], jacobian: np.ndarray, noise: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """Information of each candidate, `(candidates, p, p)`, in units of the scales."""
    measured = np.array([[c in test.measured for c in FREE_COORDINATES] for test in candidates])
    rows = np.where(measured[:, :, None], jacobian, 0.0) / np.asarray(noise)[:, None] * scale
    return np.einsum("tci,tcj->tij", rows, rows)


def check_tests(
    candidates: Sequence[Candidate], count: int, criterion: str, *, repeat: bool = False
) -> None:
    """Refuse (`UnsuitableData`) what `design_tests` cannot choose, before anything is computed."""
    if criterion not in CRITERIA:
        raise UnsuitableData(f"unknown criterion {criterion!r}: expected D or A")
    if count < 1:
        raise UnsuitableData(f"{count} tests: expected at least 1")
    if not candidates:
        raise UnsuitableData("no candidates: expected at least one test to choose from")
    if count > len(candidates) and not repeat:
        raise UnsuitableData(
            f"{count} tests wanted, of {len(candidates)} candidates: ask for fewer, or give others"
        )


def _check(selection, known, noise, prior) -> None:
    if known.names != selection.names:
        raise UnsuitableData("the information is not that of the selected parameters")
    if noise.shape != (5,) or not (np.isfinite(noise) & (noise > 0)).all():
        raise UnsuitableData(f"noise {noise}: expected five standard deviations above 0")
    if prior.shape != known.scale.shape:
        raise UnsuitableData(f"prior of shape {prior.shape}: expected {known.scale.shape}")
    for name, width in zip(known.names, prior, strict=True):
        if not width > 0:
            raise UnsuitableData(f"{name}: prior of width {width:g}: expected above 0")


def choose(
    base: np.ndarray, told: np.ndarray, count: int, criterion: str = "D", *,
    usable: np.ndarray | None = None, repeat: bool = False,
) -> tuple[int, ...]:  # fmt: skip
    """Rows of the best `count` candidates, whose information is `told`, `(candidates, p, p)`, on
    top of `base`: one by one (greedy), then exchanged for others while the criterion falls
    (Fedorov), in the order in which each next one tells most; of those `usable`, several times with
    `repeat`."""
    usable = np.ones(len(told), bool) if usable is None else np.asarray(usable, bool)
    rows: list[int] = _greedy(base, told, count, criterion, usable, repeat)
    total = base + told[rows].sum(axis=0)
    best = float(criterion_of(total, criterion))
    improved = True
    while improved:
        improved = False
        for place in range(count):
            others = total - told[rows[place]]
            values = criterion_of(others + told, criterion)
            values[~usable] = np.inf
            if not repeat:
                values[rows] = np.inf
            candidate = int(np.argmin(values))
            if values[candidate] < best - _GAIN * max(1.0, abs(best)):
                rows[place], best = candidate, float(values[candidate])
                total, improved = others + told[candidate], True
    own, order = told[rows], np.ones(count, bool)
    return tuple(rows[i] for i in _greedy(base, own, count, criterion, order, False))


def criterion_of(information: np.ndarray, criterion: str) -> np.ndarray:
    """What is made small: minus the log determinant (D) or the trace of the inverse (A)."""
    if criterion == "D":
        return -np.linalg.slogdet(information)[1]
    return np.trace(np.linalg.inv(information), axis1=-2, axis2=-1)


def standard_errors(information: np.ndarray) -> np.ndarray:
    """Standard errors that regular information promises, `(..., p)`."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def _greedy(base, told, count, criterion, usable, repeat) -> list[int]:
    rows, total, free = [], base, usable.copy()
    for _ in range(count):
        values = np.where(free, criterion_of(total + told, criterion), np.inf)
        rows.append(int(np.argmin(values)))
        total = total + told[rows[-1]]
        free[rows[-1]] = repeat
    return rows
