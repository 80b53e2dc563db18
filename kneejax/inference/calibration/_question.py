"""What a calibration fits, between which bounds, and how it searches."""

__all__ = ["METHODS", "PROCEDURES", "USUAL_PROCEDURES", "CalibrationProblem", "Stage"]

import dataclasses
import fnmatch
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.fit import Noise, Problem
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, start_within, stated_bounds


@dataclasses.dataclass(frozen=True)
class Stage:
    """A part of a search: what is free in it, and which data count.

    Attributes:
        parameters: names or wildcards of those that are free, all others stay where they are;
            empty for all. Constants between frames are free in every stage.
        data: names of tests, and `poses`; empty for all.

    Example:
        >>> Stage(("*.reference_strain",), ("poses",)).frees("ACL.reference_strain")
        True
    """

    parameters: tuple[str, ...] = ()
    data: tuple[str, ...] = ()

    def frees(self, name: str) -> bool:
        """Whether a parameter of the search is free in this stage."""
        patterns = [form for own in self.parameters for form in (own, f"{own}.*")]
        return not patterns or any(fnmatch.fnmatchcase(name, form) for form in patterns)


_LENGTHS = Stage(("*.reference_strain", "*.slack_length"))
#: The procedures of paper 1, and one whose stages are a study's own.
PROCEDURES = {
    "I": (Stage(("*.stiffness",)), _LENGTHS),
    "II": (_LENGTHS, Stage(("*.stiffness",))),
    "III": (Stage(),),
    "S": (),
}
#: How a stage is searched: with the exact Jacobian, or with the gradient alone (jaxopt).
METHODS = ("least_squares", "lbfgsb")
#: Procedures where none are named.
USUAL_PROCEDURES = ("III",)
#: How often I and II go through their stages where nobody says: once, as paper 1 did.
USUAL_CYCLES = 1


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """What a calibration fits, between which bounds, and how it searches.

    Attributes:
        fitted: the problem of least squares.
        noise: of what was measured, by which squared errors weigh.
        start: values where the search begins, parameters, then constants between frames, `(p,)`.
        lower: bounds, `(p,)`.
        upper: bounds.
        procedures: any of `PROCEDURES`; the first is reported as the answer, and alone gets error
            bars.
        stages: of procedure `S`, in turn. Error bars are those of all data together.
        starts: number of starts of procedure III, besides the knee's own drawn from the prior, or
            between the bounds where there is none.
        seed: of those draws.
        method: one of `METHODS`; `lbfgsb` takes seconds for each step of a procedure.
        cycles: how often procedures I and II may go through their two steps.
        truth: values that made the data, where they were made.
        title: for the report.
        settings: recorded with the result.
    """

    fitted: Problem
    noise: Noise
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    procedures: tuple[str, ...]
    stages: tuple[Stage, ...] = ()
    starts: int = 1
    seed: int = 0
    method: str = "least_squares"
    cycles: int = USUAL_CYCLES
    truth: Mapping[str, float] = dataclasses.field(default_factory=dict)
    title: str = "Calibration"
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls,
        knee: Knee,
        selection: Selection,
        measured: np.ndarray,
        *,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        noise: Noise | None = None,
        offsets: tuple[str, ...] = (),
        loads: Sequence[Load] = (),
        tests: Sequence[MeasuredTest] = (),
        prior: Mapping[str, float] | None = None,
        **search: Any,
    ) -> "CalibrationProblem":
        """Lay out what is fitted; data and bounds are held against the knee.

        Args:
            knee: gives everything that is not free, and the start of what is.
            selection: the free parameters.
            measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; flexion
                is prescribed, the other five are compared. It may be empty where there are tests.
            bounds: by name; those of paper 1 for stiffness and reference strain by default.
            noise: of what was measured; estimated by default.
            offsets: free coordinates whose constant difference between measured and model frame is
                unknown too.
            loads: on the tibia while the poses were measured, each one for all or one per pose.
            tests: under load that were made; they count like poses, each by its deviation.
            prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around
                the start's value.
            **search: the attributes from `procedures` on.

        Raises:
            UnknownParameter: a prior of what is not free.
            UnsuitableData: bounds that exclude the start, numbers that are not finite, an unknown
                method, or a prior or readings where nobody states the noise.
        """
        usual = ("S",) if search.get("stages") else USUAL_PROCEDURES
        search["procedures"] = tuple(search.get("procedures", ())) or usual
        if search.get("method", "least_squares") not in METHODS:
            known = ", ".join(METHODS)
            raise UnsuitableData(f"unknown method {search['method']!r}: expected one of {known}")
        noise = noise or Noise.of()
        if prior or any(test.readings for test in tests):
            # What is not of a pose counts in a standard deviation of its own.
            noise = noise.as_stated()
            if noise.estimated:
                what = "prior" if prior else "readings"
                raise UnsuitableData(
                    f"{what}: expected noise_mm and noise_deg too, against which it counts"
                )
        weights = noise.first**-2.0
        fitted = Problem.of(knee, selection, measured, weights, offsets, loads, tests, noise.stated)
        lost = np.flatnonzero(~np.isfinite(fitted.measured).all(axis=-1))
        if len(lost):
            raise UnsuitableData(f"measured row {lost[0]} is not finite: leave it out")
        angles = len(np.unique(np.round(np.deg2rad(fitted.measured[:, 0]), 12)))
        if offsets and angles < 2:
            raise UnsuitableData(
                f"frame_offset: {', '.join(offsets)} with {angles} measured "
                f"pose{'s' * (angles != 1)}; expected two poses or more, since an unknown constant "
                "absorbs a single one"
            )
        lower, upper = stated_bounds(knee, selection, bounds or {})
        start = start_within(knee, selection, lower, upper)
        # A frame is rarely off by more than 10 mm or 10 degrees.
        wide = np.full(len(offsets), 10.0)
        start, lower, upper = np.r_[start, 0.0 * wide], np.r_[lower, -wide], np.r_[upper, wide]
        if prior:
            fitted = fitted.with_prior(start, prior)
        fitted = fitted.stepping(start)
        return cls(fitted, noise, start, lower, upper, **search)

    def weighing(self, noise: np.ndarray) -> "CalibrationProblem":
        """The same whose squares weigh by the noise that an answer left, `(5,)`, where it was
        estimated."""
        if not self.noise.weighs:
            return self
        return dataclasses.replace(self, fitted=self.fitted.weighing(np.asarray(noise, float)))


@dataclasses.dataclass(frozen=True, eq=False)
class SeveralKnees:
    """Calibrations of one form, each of a knee of its own; a single one is the plainest case."""

    members: tuple[CalibrationProblem, ...]  # alike (`kneejax.inference.fit.form_of`)
    whole: Problem  # what is fitted of all, with what was observed a fit each

    @classmethod
    def of(cls, members: Sequence[CalibrationProblem]) -> "SeveralKnees":
        """Calibrations of one form."""
        problems = [one.fitted for one in members]
        first = problems[0]
        if len(problems) == 1:
            return cls(tuple(members), first)
        leaves = [jax.tree.leaves(one.knee) for one in problems]
        stacks = (np.stack([np.asarray(x) for x in each]) for each in zip(*leaves, strict=True))
        own = {place: x for place, x in enumerate(stacks) if (x != x[:1]).any()}
        target = np.stack([one.cases.target for one in problems])
        prior = first.cases.prior
        if prior is not None:
            prior = np.stack([one.cases.prior[0] for one in problems if one.cases.prior]), prior[1]
        cases = dataclasses.replace(first.cases, target=target, prior=prior)
        return cls(tuple(members), dataclasses.replace(first, cases=cases, own=own or None))

    def take(self, rows: Sequence[int]) -> "SeveralKnees":
        """Some of the knees. Balances of all go on saying whose they are."""
        whole = dataclasses.replace(self.whole, cases=self.whole.cases.take(list(rows)))
        return SeveralKnees(tuple(self.members[row] for row in rows), whole)

    def each(self, change: Callable[..., Problem], given: Any) -> "SeveralKnees":
        """The same with what is fitted changed by a method of `Problem`."""
        members = (
            dataclasses.replace(one, fitted=change(one.fitted, given)) for one in self.members
        )
        return SeveralKnees(tuple(members), change(self.whole, given))

    def weighing(self, noise: Sequence[np.ndarray]) -> "SeveralKnees":
        """The same with a noise each, `(5,)`, where it is known and was to be estimated."""
        every = zip(self.members, noise, strict=True)
        members = tuple(one if np.isnan(own).any() else one.weighing(own) for one, own in every)
        now = np.stack([one.fitted.cases.noise for one in members])
        return SeveralKnees(members, self.whole.weighing(now if len(now) > 1 else now[0]))
