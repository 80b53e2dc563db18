"""A study moved by hand: its knee's motion, objective and coupling at any values."""

__all__ = ["ByHand"]

import os
from collections.abc import Mapping

import numpy as np

from kneejax.explorer.setting import Curves, Setting, Subject
from kneejax.explorer.solving import Solver
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import Condition, ParameterMap, sensitivity_map
from kneejax.inference.sensitivity import worst_condition
from kneejax.parameters import UnknownParameter, UnsuitableData, unphysiological
from kneejax.statics import converged
from kneejax.studies import Study, read_study

#: The longest way that one step goes from the motion before: part of a value, and of any strain.
_STRIDE, _STRAIN_STRIDE = 0.5, 0.04


class ByHand:
    """A study whose parameters are moved, and whose motion follows at once.

    A small move begins at the motion before. A long one, or one after which a pose is lost or a
    curve is torn, follows the knee from its reference pose, as `passive_flexion` does.

    Attributes:
        study: what is moved.
        measured: its poses, `(n, 6)`, degrees and mm.
        names: of its parameters.
        begin: parameter -> value where the study begins.
        values: parameter -> where it stands.
        now: the motion there.

    Example:
        >>> import kneejax as kj
        >>> from kneejax.explorer import ByHand
        >>> hand = ByHand("passive_flexion")  # doctest: +SKIP
        >>> hand.move({"ACL.stiffness": 3000.0}); hand.objective  # doctest: +SKIP
    """

    def __init__(
        self, study: Study | str | os.PathLike[str], at: Mapping[str, float] | None = None
    ):
        """Balance the knee where the study begins.

        Args:
            study: a study, or the name or file of one.
            at: parameter -> value, where it begins elsewhere.

        Raises:
            UnsuitableData: a study without poses, or one whose knee balances at none of them.
        """
        self.study = study if isinstance(study, Study) else read_study(study)
        self.measured = self.study.poses()
        if not len(self.measured):
            raise UnsuitableData(f"{self.study.title}: a study without poses has no curves to move")
        subject = Subject.of(self.study.knee_at_start, self.study.parameters)
        self.names = self.study.selection.names
        self._solver = Solver(subject, self.measured[:, 0], self.study.acting)
        own = dict(zip(subject.selection.names, subject.own.tolist(), strict=True))
        self.begin = {name: own[name] for name in self.names}
        self.values, self.now = dict(self.begin), self._solver.curves(Setting())
        self._own, self._used = self.now.table, converged(self.now.status)
        if not self._used.any():
            raise UnsuitableData("no measured flexion has a balance with the knee's own parameters")
        if at:
            self.move(at)

    def move(self, values: Mapping[str, float]) -> Curves:
        """Set parameters and balance every pose again.

        Args:
            values: parameter -> value; the others stay where they are.

        Returns:
            The motion.

        Raises:
            UnknownParameter: a name that is not among the study's.
            UnsuitableData: a value that is not finite.
        """
        for name, value in values.items():
            if name not in self.names:
                raise UnknownParameter(f"{name!r} cannot be moved: {self.study.selection}")
            if not np.isfinite(value):
                raise UnsuitableData(f"{name}: {value} is not finite")
        goal = self.values | {name: float(value) for name, value in values.items()}
        far = any(abs(goal[name] - x) > self._stride(name) for name, x in self.values.items())
        setting = Setting.of({k: x for k, x in goal.items() if x != self.begin[k]})
        self.now = self._solver.curves(setting, near=None if far else self.now)
        self.values = goal
        return self.now

    def _stride(self, name: str) -> float:
        if name.endswith("reference_strain"):
            return _STRAIN_STRIDE
        return _STRIDE * abs(self.begin[name])

    @property
    def error(self) -> np.ndarray:
        """Simulated minus measured free coordinates, `(n, 5)`, degrees and mm; without the
        constant offsets that the study leaves free."""
        error = self.now.table[:, 1:] - self.measured[:, 1:]
        free = [FREE_COORDINATES.index(name) for name in self.study.frame_offset]
        error[:, free] -= error[self._used][:, free].mean(axis=0)
        return error

    @property
    def objective(self) -> float:
        """Weighted sum of squared errors; NaN where a pose that counts has no balance."""
        return float(((self.error[self._used]) ** 2).sum(axis=0) @ self.study.first_weights)

    @property
    def unphysiological(self) -> np.ndarray:
        """Poses that are farther from where the study begins than any knee moves, `(n,)`."""
        return unphysiological(self.now.table[:, 1:], self._own[:, 1:])

    @property
    def condition(self) -> Condition:
        """The worst over the poses."""
        used = self._used
        return Condition(int(worst_condition(self.now.status[used], self.unphysiological[used])))

    @property
    def jacobian(self) -> np.ndarray:
        """Exact derivative of the free coordinates by the parameters, `(5, n, p)`."""
        order = [self._solver.names.index(name) for name in self.names]
        return np.stack([self.now.slopes[name][:, order] for name in FREE_COORDINATES])

    def coupling(self, pair: tuple[str, str]) -> tuple[float, float, np.ndarray]:
        """How far two parameters make up for each other here, to first order.

        Args:
            pair: of parameters.

        Returns:
            Correlation of their estimates alone, and with all others free; and an ellipse,
            `(2, k)`, within which a change of both moves the knee by less than one, in weighted
            squares.
        """
        names = [*pair, *(name for name in self.names if name not in pair)]
        unit = np.array([self._stride(name) or 1.0 for name in names])
        order = [self.names.index(name) for name in names]
        slopes = np.nan_to_num(self.jacobian[..., order]) * unit
        matrix = np.einsum("cni,c,cnj->ij", slopes, self.study.first_weights, slopes)
        sizes, ways = np.linalg.eigh(matrix[:2, :2])
        turn = np.linspace(0.0, 2.0 * np.pi, 73)
        circle = ways / np.sqrt(sizes.clip(1e-3)) @ np.stack([np.cos(turn), np.sin(turn)])
        here = np.array([[self.values[name]] for name in pair])
        return _correlation(matrix[:2, :2]), _correlation(matrix), here + unit[:2, None] * circle

    def map(self, pair: tuple[str, str], grid: tuple[int, int] = (25, 25)) -> ParameterMap:
        """The objective over two parameters, the others where they stand."""
        limits = {name: self.study.limits[name] for name in pair}
        return sensitivity_map(
            self.study.knee_at_start, self.measured, pair, grid=grid, at=self.values,
            bounds=limits, weights=self.study.first_weights, loads=self.study.acting,
            offsets=self.study.frame_offset,
        )  # fmt: skip


def _correlation(matrix: np.ndarray) -> float:
    """Of the first two estimates, from the inverse of their information."""
    sizes, ways = np.linalg.eigh(matrix)
    covariance = ways / sizes.clip(1e-9) @ ways.T
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))
