"""A motion that follows its parameters as a hand moves them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import COLUMNS
from kneejax.inference.fit import DEFAULT_WEIGHTS, Problem, check_finite, table_of
from kneejax.inference.sensitivity._parameter_map import Condition, worst_condition
from kneejax.mechanics import Knee
from kneejax.parameters import UnknownParameter, UnsuitableData, select, unphysiological
from kneejax.statics import Slopes, converged

#: The longest way in one step: part of a stiffness's own value, and of any strain.
_STRIDES = {"stiffness": 0.5, "reference_strain": 0.04}
_OTHER_STRIDE = 0.05
#: Second difference over flexion of the distance from the knee's own motion beyond which a curve
#: is torn, degrees or mm.
_KINK = 5.0


@dataclasses.dataclass(frozen=True)
class Moved:
    """A motion after a parameter was moved.

    Attributes:
        values: parameter -> value.
        table: poses `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; NaN where
            there is no balance.
        status: `Status` values, `(n,)`.
        unphysiological: balanced, but farther from the baseline motion than any knee moves,
            `(n,)`.
        jacobian: exact derivative of the free coordinates (degrees, mm) with respect to the
            parameters, `(5, n, p)`; NaN where there is no balance.
        objective: weighted sum of squared errors; NaN where a pose that counts has no balance.
        condition: the worst over the poses.
    """

    values: dict[str, float]
    table: np.ndarray
    status: np.ndarray
    unphysiological: np.ndarray
    jacobian: np.ndarray
    objective: float
    condition: Condition


class LiveMotion:
    """A knee whose balanced poses follow its parameters at once.

    A move begins at the linear prediction of the last poses, which their exact Jacobian gives for
    nothing. A long way is taken in strides, as if the hand had gone all of it. Where a pose gets
    lost, or a curve is torn, which may be another branch, the knee is followed from its reference
    as in `passive_flexion`, which takes ten times as long. What stays lost begins the next move at
    its last balance.

    Attributes:
        selection: the parameters.
        now: the motion where they stand.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.inference import LiveMotion
        >>> knee = kj.load_knee("four_ligament")
        >>> measured = kj.passive_flexion(knee, [0.0, 30.0]).to_table()
        >>> live = LiveMotion(knee, measured)  # doctest: +SKIP
        >>> live.move("ACL.stiffness", 3000.0).objective  # doctest: +SKIP
    """

    def __init__(
        self,
        knee: Knee,
        measured: np.ndarray,
        parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain"),
        *,
        weights: np.ndarray | None = None,
    ):
        """Balance the knee itself.

        Args:
            knee: gives the values to begin with, and everything that is not moved.
            measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm.
            parameters: those that can be moved: names, with `*` for every ligament.
            weights: `(5,)`; by default 8 per degree^2 and 1 per mm^2 (paper 1).

        Raises:
            UnknownParameter: a name that the knee does not have.
            UnsuitableData: a measurement of another shape or not finite, or a knee that balances
                at no measured flexion.
        """
        measured = np.asarray(measured, float)
        if measured.ndim != 2 or measured.shape[1] != len(COLUMNS) or not len(measured):
            raise UnsuitableData(
                f"measured poses of shape {measured.shape}: expected rows of {', '.join(COLUMNS)}"
            )
        check_finite(measured)
        self.selection = select(knee, parameters)
        weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
        problem = Problem.of(knee, self.selection, measured, weights)
        self._values = np.asarray(self.selection.read(knee))
        found = problem.begin(self._values[None])
        balanced = found.converged[0]
        if not balanced.any():
            raise UnsuitableData("no measured flexion has a balance with the knee's own parameters")
        self._problem = problem.with_used(balanced)
        self._own, self._last = problem.table(found).T, found
        self._strides = np.array(
            [_stride(self.selection.quantity(i), v) for i, v in enumerate(self._values)]
        )
        self.now = self._described(found)

    def move(self, name: str, value: float) -> Moved:
        """Set one parameter and balance every pose again.

        Raises:
            UnknownParameter: a name that is not among the selected.
            UnsuitableData: a value that is not finite.
        """
        return self.move_to({name: value})

    def move_to(self, values: Mapping[str, float]) -> Moved:
        """Set several parameters at once; see `move`."""
        goal = self._values.copy()
        for name, value in values.items():
            if name not in self.selection.names:
                raise UnknownParameter(f"{name!r} cannot be moved: selected are {self.selection}")
            if not np.isfinite(value):
                raise UnsuitableData(f"{name}: {value} is not finite")
            goal[self.selection.names.index(name)] = value
        begin = self._values
        count = max(int(np.ceil(np.max(np.abs(goal - begin) / self._strides))), 1)
        for part in np.arange(1, count + 1) / count:
            here = goal if part == 1 else begin + part * (goal - begin)
            found = self._problem.balance(here[None], self._last)
            if part == 1 and self._doubtful(found, count > 1):
                found = _joined(self._problem.begin(goal[None]), found)
            # What is lost begins the next stride at its last balance.
            self._last = _joined(found, self._last)
        self._values = goal
        self.now = self._described(found)
        return self.now

    def _doubtful(self, found: Slopes, far: bool) -> bool:
        """Whether a pose is newly lost, or has left its neighbours in flexion: another branch."""
        order = np.argsort(self._problem.measured[:, 0], kind="stable")
        away = self._problem.table(found).T[order] - self._own[order]
        kinks = np.abs(np.diff(away, 2, axis=0))
        lost = ~found.converged[0]
        news = lost if far else lost & converged(self.now.status)
        return bool(news.any() or (kinks > _KINK).any())

    def _described(self, found: Slopes) -> Moved:
        problem, table = self._problem, self._problem.table(found)
        status = found.status[0]
        strange = unphysiological(table.T, self._own)
        error = problem.error(found)[:, problem.used]
        named = zip(self.selection.names, self._values, strict=True)
        return Moved(
            {name: float(value) for name, value in named},
            np.column_stack([problem.measured[:, 0], table.T]),
            status,
            strange,
            np.moveaxis(table_of(found)[1][0], 0, 1),
            float(problem.weights @ (error**2).sum(axis=1)),
            Condition(int(worst_condition(status[problem.used], strange[problem.used]))),
        )


def _stride(quantity: str, value: float) -> float:
    part = _STRIDES.get(quantity, _OTHER_STRIDE)
    return part if quantity == "reference_strain" else part * abs(value)


def _joined(first: Slopes, second: Slopes) -> Slopes:
    """Pose by pose, the first where it is balanced and the second elsewhere.

    Values are those of the first: what comes of the second is where its search ended.
    """
    good, fields = first.converged, {}
    for field in dataclasses.fields(first):
        one, other = getattr(first, field.name), getattr(second, field.name)
        here = good.reshape(*good.shape, *(1,) * max(one.ndim - 2, 0))
        own = field.name in ("values", "knee")
        fields[field.name] = one if own else np.where(here, one, other)
    return Slopes(**fields)
