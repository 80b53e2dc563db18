"""What is fitted to what: a knee, what is free of it, and the load cases that were observed."""

__all__ = ["Problem", "Progress", "best_offsets", "form_of", "named", "without_offsets"]

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import COORDINATES, FREE_COORDINATES, State
from kneejax.inference.fit._cut import Passage, balances_of, state_of, without
from kneejax.inference.fit._observations import observations, readings_of, rows_of_tests
from kneejax.inference.fit._observed import TABLE_UNITS, Balance, Observations
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, stated
from kneejax.statics import Own, Slopes

#: Called now and then, from any thread: what is computed, how much of it is done and asked for;
#: 0 and 0 where that cannot be counted.
Progress = Callable[[str, int, int], None]


@dataclasses.dataclass(frozen=True)
class Problem:
    """A question of least squares; values are parameters, then constants between frames.

    Attributes:
        knee: start of everything that is not free.
        selection: the free parameters.
        cases: what was observed; its noise weighs.
        offsets: free coordinates with an unknown constant difference to the measurement.
        tests: under load whose rows the cases hold, after the poses; of a knee in motion `stepping`
            chooses the steps first.
        own: of several knees of one structure the numbers in which they differ.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> table = np.zeros((2, 6))
        >>> problem = Problem.of(knee, kj.select(knee, ["ACL.stiffness"]), table, np.ones(5))
        >>> problem.size, problem.weights.tolist()
        (1, [1.0, 1.0, 1.0, 1.0, 1.0])
    """

    knee: Knee
    selection: Selection
    cases: Observations
    offsets: tuple[str, ...] = ()
    tests: tuple[MeasuredTest, ...] = ()
    own: Own | None = None

    @classmethod
    def of(
        cls,
        knee: Knee,
        selection: Selection,
        measured: np.ndarray,
        weights: np.ndarray,
        offsets: tuple[str, ...] = (),
        loads: Sequence[Load] = (),
        tests: Sequence[MeasuredTest] = (),
        known: np.ndarray | None = None,
    ) -> "Problem":
        """A problem from measured poses and tests.

        Args:
            knee: start of everything that is not free.
            selection: the free parameters.
            measured: `(n, 6)`, degrees and mm; NaN where a coordinate was not observed.
            weights: `(5,)`, per degree^2 and per mm^2.
            offsets: names of free coordinates.
            loads: on the tibia at the poses (`observations`).
            tests: under load that were made beside them.
            known: standard deviations that are known, NaN elsewhere, `(5,)`.
        """
        with np.errstate(divide="ignore"):
            noise = 1.0 / np.sqrt(weights)
        cases = observations(measured, noise, loads, tests, known)
        poses = len(np.reshape(measured, (-1, 6)))
        cases = dataclasses.replace(cases, readings=readings_of(knee, selection, poses, tests))
        return cls(knee, selection, cases, offsets, tuple(tests))

    def stepping(self, values: np.ndarray) -> "Problem":
        """The same with steps of motions through time that are short enough at values, `(p,)`.

        Raises:
            UnsuitableData: a motion ends early.
        """
        passages, every = [], self.cases.load_cases.of(self.knee)
        for test, place in zip(self.tests, self.rows_of_tests(), strict=True):
            if test.frames is not None:
                rows = np.arange(place.start, place.stop)
                varied = without(self.knee, self.selection, test.cut)
                there = jax.tree.map(np.asarray, every.take(rows).plain())
                own = values[: len(self.selection)]
                try:
                    passages.append(Passage.of(*varied, own, test.frames, rows, there))
                except UnsuitableData as problem:
                    raise UnsuitableData(f"{test.name}: {problem}") from None
        cases = dataclasses.replace(self.cases, passages=tuple(passages))
        return dataclasses.replace(self, cases=cases)

    @property
    def restless(self) -> dict[str, float]:
        """Test of a knee in motion -> `Passage.restless` at the values that chose its steps."""
        moved = [test.name for test in self.tests if test.frames is not None]
        return dict(zip(moved, (one.restless for one in self.cases.passages), strict=True))

    @property
    def steps(self) -> int:
        """Of all motions through time together."""
        return sum(len(passage.grid.time_s) for passage in self.cases.passages)

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.selection) + len(self.offsets)

    @property
    def weights(self) -> np.ndarray:
        """Of squared errors, `(5,)`, per degree^2 and per mm^2."""
        return self.cases.noise**-2.0

    @property
    def used(self) -> np.ndarray:
        """Load cases that count: those where the start's model balances, `(cases,)`."""
        return self.cases.used

    @property
    def counted_numbers(self) -> int:
        """How many observed numbers have a weight."""
        unweighed = self.cases.seen[:, self.weights == 0].sum()
        return self.cases.numbers - int(unweighed)

    @property
    def measured(self) -> np.ndarray:
        """Measured poses, degrees and mm, `(n, 6)`; without what tests observed."""
        table = np.column_stack([np.rad2deg(self.cases.load_cases.flexion), self.cases.target])
        return table[self.cases.posed]

    def rows_of_tests(self) -> list[slice]:
        """Load cases of each test's rows."""
        return rows_of_tests(int(self.cases.posed.sum()), self.tests)

    def with_used(self, rows: np.ndarray) -> "Problem":
        """The same with only some load cases that count, `(cases,)`, and what they count from."""
        rows = rows & np.where(self.cases.neutral < 0, True, rows[self.cases.neutral])
        return dataclasses.replace(self, cases=dataclasses.replace(self.cases, used=rows))

    def balanced_by(self, first: Slopes) -> "Problem":
        """The same with the load cases alone at which the start balances.

        Raises:
            UnsuitableData: there is none.
        """
        if not first.converged[0].any():
            raise UnsuitableData(
                "nothing that was measured has a balance with the start's parameters"
            )
        return self.with_used(first.converged[0])

    def with_data(self, names: Sequence[str]) -> "Problem":
        """The same with some of the data alone: names of tests, and `poses`; all without any."""
        if not names:
            return self
        rows = self.cases.posed & ("poses" in names)
        ends = [place.start for place in self.rows_of_tests()[1:]] + [len(rows)]
        for test, place, end in zip(self.tests, self.rows_of_tests(), ends, strict=True):
            rows[place.start : end] = test.name in names
        return self.with_used(rows & self.used)

    def with_prior(self, means: np.ndarray, prior: Mapping[str, float]) -> "Problem":
        """The same with what is known beforehand: means of the values, `(p,)`, and name,
        `*.quantity` or quantity -> standard deviation; others have none.

        Raises:
            UnknownParameter: a name that is not free.
        """
        said = stated(self.selection, prior, "prior")
        sd = [np.inf if one is None else float(one) for one in said]
        believed = means, np.r_[sd, np.full(len(self.offsets), np.inf)]
        return dataclasses.replace(self, cases=dataclasses.replace(self.cases, prior=believed))

    def knee_at(self, values: np.ndarray) -> Knee:
        """The knee with these parameters."""
        return self.selection.apply(self.knee, values[: len(self.selection)])

    def begin(self, values: np.ndarray) -> Slopes:
        """Balances at values `(fits, p)`, each followed from the knee's reference pose."""
        return self.balance(np.asarray(values, float))

    @property
    def balance(self) -> Balance:
        """Balances at values, from near ones, which say of several knees whose they are."""
        of_parameters = balances_of(self.knee, self.selection, self.cases, self.own)
        return with_offsets(of_parameters, self.offsets, self.cases.posed)

    def state(self, found: Slopes) -> State:
        """Where the bones are in one fit, in the model's frame, `(cases,)`."""
        own = without_offsets(found, self.offsets, self.cases.posed)
        return state_of(self.knee, self.cases, own)

    def error(self, found: Slopes) -> np.ndarray:
        """Model plus constants minus measurement of one fit, `(5, cases)`, degrees and mm; zero
        where nothing was observed or a case does not count."""
        return self.cases.error(found)[0][0].T

    def squares(self, found: Slopes) -> np.ndarray:
        """Sum of squares of each coordinate in one fit, `(5,)`, degree^2 and mm^2; of tests with a
        noise of their own in units of the poses' variance."""
        return ((self.error(found) / self.cases.spread.T) ** 2).sum(axis=1)

    def weighing(self, noise: np.ndarray) -> "Problem":
        """The same with another noise, `(5,)`, degrees and mm, by which squares weigh."""
        return dataclasses.replace(self, cases=dataclasses.replace(self.cases, noise=noise))

    def rmse(self, found: Slopes) -> tuple[float, float]:
        """Root mean square errors of one fit, of all displacements and of all rotations, mm and
        degrees; 0 where none were observed."""
        seen, error = self.cases.seen, self.error(found).T
        both = []
        for unit in (TABLE_UNITS == 1.0, TABLE_UNITS != 1.0):
            count = max(int(seen[:, unit].sum()), 1)
            both.append(float(np.sqrt((error[:, unit] ** 2).sum() / count)))
        return both[0], both[1]

    def residual(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals of one fit, and by the values."""
        residual, slope = self.cases.residual(found)
        return residual[0], slope[0]

    def objective(self, found: Slopes) -> float:
        """Weighted sum of squares of one fit, with what a prior says of the values."""
        residual, _ = self.residual(found)
        return float(residual @ residual)


def named(selection: Selection, offsets: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Names and units of parameters, then of constants between frames."""
    parameters = [(name, selection.unit(i)) for i, name in enumerate(selection.names)]
    return parameters + [(name, COORDINATES[name].unit) for name in offsets]


def with_offsets(balance: Balance, offsets: Sequence[str], posed: np.ndarray) -> Balance:
    """A balance whose last values are constants added to coordinates of the load cases `posed`,
    degrees and mm: they have bounds and can be held, which those of `Observations.offsets` have
    not."""

    def shifted(values: np.ndarray, near: Slopes | None = None) -> Slopes:
        size = values.shape[1] - len(offsets)
        found = balance(values[:, :size], near and without_offsets(near, offsets, posed))
        return add_offsets(found, values[:, size:], offsets, posed)

    return shifted if offsets else balance


def add_offsets(
    found: Slopes, shifts: np.ndarray, offsets: Sequence[str], posed: np.ndarray
) -> Slopes:
    """Balances with constants `(fits, offsets)` added, degrees and mm, as their last values."""
    q, more = np.array(found.q), np.zeros((*found.q.shape, len(offsets)))
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] += shifts[:, [k]] * posed / TABLE_UNITS[row]
        more[..., row, k] = posed / TABLE_UNITS[row]
    return dataclasses.replace(
        found,
        values=np.hstack([found.values, shifts]),
        q=q,
        jacobian=np.concatenate([found.jacobian, more], axis=-1),
    )


def without_offsets(found: Slopes, offsets: Sequence[str], posed: np.ndarray) -> Slopes:
    """The reverse of `add_offsets`."""
    q, size = np.array(found.q), found.values.shape[1] - len(offsets)
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] -= found.values[:, [size + k]] * posed / TABLE_UNITS[row]
    return dataclasses.replace(
        found, values=found.values[:, :size], q=q, jacobian=found.jacobian[..., :size]
    )


def best_offsets(data: Observations, fit: Slopes) -> list[float]:
    """The best constant of each of `data.offsets`, to be added to the model's coordinate in the
    balances of one variant, degrees or mm."""
    target = data.target.reshape(len(data.load_cases), 5)
    error = (data.observed(fit)[0][0] - target)[data.used & data.posed]
    return [-float(error[:, FREE_COORDINATES.index(name)].mean()) for name in data.offsets]


#: Of load cases what knees that stand side by side must have in common, beside what is observed.
_ALIKE = ("noise", "used", "clinical", "neutral", "group", "spread")


def form_of(problem: Problem) -> bytes | None:
    """What problems have in common that may stand side by side; None for one that may not: where
    ligaments were cut, forces were read, or the knee moved."""
    cases = problem.cases
    if any(cases.cuts) or cases.readings is not None or cases.passages:
        return None
    plain = dataclasses.replace(problem.knee, name="", side="right")
    leaves, tree = jax.tree.flatten(plain)
    load_cases, kinds = jax.tree.flatten(cases.load_cases)
    known = None if cases.prior is None else cases.prior[1]
    arrays = [
        *jax.tree.leaves(problem.knee.reference_pose), *load_cases, ~np.isnan(cases.target), known,
        *(getattr(cases, name) for name in _ALIKE),
    ]  # fmt: skip
    words = [
        str(tree), [np.shape(leaf) for leaf in leaves], str(kinds), problem.selection.names,
        problem.offsets, [test.name for test in problem.tests],
        [None if x is None else [np.shape(x), str(np.asarray(x).dtype)] for x in arrays],
    ]  # fmt: skip
    found = hashlib.sha256(json.dumps(words).encode())
    for x in arrays:
        found.update(b"" if x is None else np.ascontiguousarray(x).tobytes())
    return found.digest()
