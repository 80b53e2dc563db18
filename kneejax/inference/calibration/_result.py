"""What a calibration found out."""

__all__ = [
    "Calibration", "Ending", "Estimate", "Fault", "Fit", "FittedTest", "Iteration", "Misfit",
    "Motion", "versions",
]

import dataclasses
import enum
import importlib.metadata
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest, Mechanics
from kneejax.geometry import BY_COORDINATE, COLUMNS, FREE_COORDINATES
from kneejax.inference.intervals import IntervalKind
from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.statics import Status

_NUMBERS = ("value", "start", "lower", "upper", "standard_error", "low", "high", "at_bound",
            "slack")  # fmt: skip
_PACKAGES = ("kneejax", "jax", "jaxlib", "optimistix", "equinox", "lineax", "numpy", "jaxopt")


def versions() -> dict[str, str]:
    """Versions of everything that a number in a result depends on.

    Example:
        >>> "jax" in versions()
        True
    """
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


@dataclasses.dataclass(frozen=True)
class Estimate:
    """One identified parameter, or one constant between measured and model frames.

    Attributes:
        name: e.g. `ACL.stiffness`; of a constant its coordinate, e.g. `anterior`.
        unit: e.g. `N`; empty for strains.
        value: the estimate.
        start: where the search began.
        lower: bound.
        upper: bound.
        standard_error: of the estimate; NaN where it would not tell the limits.
        at_bound: whether the estimate lies on a bound.
        slack: part of the poses at which its ligament is slack, where the data limit it on one side
            at most; 0 otherwise.
        low: lower 95 % limit; NaN if the data give none.
        high: upper 95 % limit; NaN if the data give none.
        interval: which of these numbers mean something; None where nobody asked, as for procedures
            that are there to compare.
        reason: why a limit could not be computed; empty otherwise.
    """

    name: str
    unit: str
    value: float
    start: float
    lower: float
    upper: float
    standard_error: float
    at_bound: bool
    slack: float = 0.0
    low: float = np.nan
    high: float = np.nan
    interval: IntervalKind | None = None
    reason: str = ""


@dataclasses.dataclass(frozen=True)
class Motion:
    """Poses over flexion with what holds them; angles in degrees, lengths in mm, forces in N.

    Attributes:
        table: shape `(n, 6)` in the order of `kneejax.geometry.COLUMNS`; NaN rows failed.
        status: one `Status` value a row.
        ligament_forces: shape `(n, ligaments)`, N.
        contact_forces: shape `(n, contacts)`, N.
        knee: with which it was found; None without poses, as the next.
        mechanics: of all rows, from which is told what is wrong with them.
        other_bones: bone besides the tibia -> its poses, `(n, 6)` in the order of its coordinates.
    """

    table: np.ndarray
    status: np.ndarray
    ligament_forces: np.ndarray
    contact_forces: np.ndarray
    knee: Knee | None = None
    mechanics: Mechanics | None = None
    other_bones: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Iteration:
    """One accepted step of the search: stage (e.g. `I.1`), evaluations so far, objective.

    Example:
        >>> Iteration("III", 5, 26.5).objective
        26.5
    """

    stage: str
    evaluations: int
    objective: float


class Ending(enum.Enum):
    """Why a search ended.

    Example:
        >>> len(Ending) > 1
        True
    """

    CONVERGED = "converged"
    FLAT = "converged to within the noise"
    STOPPED = "stopped before it converged"


class Fault(enum.Enum):
    """Why a coordinate is poorly fitted.

    Example:
        >>> [one.name for one in Fault][:2]
        ['WORSE_THAN_START', 'BEYOND_NOISE']
    """

    WORSE_THAN_START = "worse than at the start"
    BEYOND_NOISE = "more than the stated noise"
    LARGE = "large"


@dataclasses.dataclass(frozen=True)
class Misfit:
    """A coordinate in which a fit is poor.

    Attributes:
        coordinate: which.
        fault: why.
        rmse: root mean square error of the fit, mm or degrees.
        against: what that is compared with: the start's error, the noise, or what is large.
        test: whose curves they are; empty for the poses.

    Example:
        >>> Misfit("anterior", list(Fault)[0], rmse=0.9, against=0.3).coordinate
        'anterior'
    """

    coordinate: str
    fault: Fault
    rmse: float
    against: float
    test: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class FittedTest:
    """A measured test beside the same test on a knee.

    Attributes:
        test: as it was measured.
        measured: of each row what was compared, counted as the test says, `(n, 5)`; NaN where
            nothing was.
        fitted: the same of the knee; the best of unknown constants is added.
        status: of the knee's balances, one `Status` value a row.
        readings: the knee's in the place of each of `test.readings`, `(n,)`, in its unit, the best
            of unknown constants added; NaN where nothing was compared.
        restless: of a motion that repeats itself, how far it is from where it was a period before,
            mm or degrees; 0 of all others.
    """

    test: MeasuredTest
    measured: np.ndarray
    fitted: np.ndarray
    status: np.ndarray
    readings: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    restless: float = 0.0

    @property
    def compared(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Coordinate, or name of what was read of a part -> its measured and fitted numbers, `(n,)`
        each, degrees, mm, N or strain; NaN where nothing was compared."""
        places = [(name, FREE_COORDINATES.index(name)) for name in self.test.coordinates]
        pairs = {name: (self.measured[:, k], self.fitted[:, k]) for name, k in places}
        return pairs | {
            name: (np.where(np.isfinite(own), self.test.readings[name], np.nan), own)
            for name, own in self.readings.items()
        }

    def rmse(self, name: str, flexion_deg: float | None = None) -> float:
        """Root mean square error in its own unit; NaN where nothing was measured.

        Args:
            name: one of `compared`, or a free coordinate.
            flexion_deg: of the curve whose rows count (`MeasuredTest.curve_deg`); all by default.
        """
        if name not in self.compared:
            return np.nan
        measured, fitted = self.compared[name]
        own = fitted - measured
        if flexion_deg is not None:
            own = own[self.test.curve_deg == flexion_deg]
        known = own[np.isfinite(own)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


@dataclasses.dataclass(frozen=True)
class Starts:
    """Where the searches from several starts ended, best first."""

    objectives: tuple[float, ...]  # `(starts,)`; infinite where a start found no balance
    values: np.ndarray  # parameters and offsets, `(starts, p)`
    elsewhere: np.ndarray  # ends that the data tell from the answer: another valley, `(starts,)`
    rivals: np.ndarray  # ends that they do not, though a parameter is outside the answer's limits


@dataclasses.dataclass(frozen=True)
class Fit:
    """The answer of one procedure.

    Attributes:
        procedure: `I`, `II` or `III`.
        estimates: one per parameter.
        objective: weighted sum of squares at the answer.
        partial_objectives: coordinate -> its unweighted sum of squares (mm^2 or degree^2).
        rmse: coordinate -> root mean square error (mm or degree).
        correlation: of the estimates, shape `(p, p)`; NaN rows for undetermined parameters.
        motion: the fitted motion.
        history: accepted steps.
        evaluations: `residual`, `jacobian`, `equilibria` and, per stage, the counts.
        success: whether the search converged.
        reason: why the search stopped before it converged, where its method can tell; empty
            otherwise.
        offsets: constants that are added to the model to compare it with the measurement.
        ending: why the search ended.
        starts: where several starts ended; None if there was one.
        tests: under load, each beside what the fitted knee does.
    """

    procedure: str
    estimates: tuple[Estimate, ...]
    objective: float
    partial_objectives: dict[str, float]
    rmse: dict[str, float]
    correlation: np.ndarray
    motion: Motion
    history: tuple[Iteration, ...]
    evaluations: dict[str, int]
    success: bool
    reason: str
    offsets: tuple[Estimate, ...] = ()
    ending: Ending = Ending.CONVERGED
    starts: Starts | None = None
    tests: tuple[FittedTest, ...] = ()


@dataclasses.dataclass(frozen=True)
class Calibration(Named):
    """A calibration: measurement, start, and the fits of one or more procedures.

    Attributes:
        title: for reports.
        knee: name of the knee.
        measured: poses, shape `(n, 6)`, degrees and mm; none where only tests were measured.
        start: motion of the start's parameters.
        start_rmse: coordinate -> root mean square error of the start.
        start_partial_objectives: likewise for the sums of squares.
        start_objective: weighted sum of squares of the start.
        fits: one per procedure; the first is the one that is reported as the answer.
        ligaments: names in the order of the columns of `Motion.ligament_forces`.
        contacts: names in the order of `Motion.contact_forces`.
        truth: parameter -> value that made synthetic data; empty for measured data.
        noise: coordinate -> standard deviation of the measurement (degrees, mm).
        noise_estimated: whether that was estimated from what the best fit leaves.
        misfits: coordinates in which the answer is a poor fit, and why.
        weights: of squared errors, `(5,)`, per degree^2 and per mm^2.
        left_out: load cases that count for nothing, since the start has no balance there.
        seconds: `total`, and its parts: `compile` (tracing and compiling that was waited for),
            `start` (balances of the start), `search`, `limits`, `other`; of a study `data` too,
            and of a command `imports` and `reading`. Writing is not among them.
        versions: package -> version.
        settings: everything needed to run it again.
        start_tests: tests under load, each beside what the start's knee does.

    Example:
        `kj.calibrate(study)` makes one, in seconds, and `fit` is its answer; what it holds:

        >>> import kneejax as kj
        >>> sorted(kj.Calibration.__dataclass_fields__)[:3]
        ['contacts', 'fits', 'knee']
    """

    title: str
    knee: str
    measured: np.ndarray
    start: Motion
    start_rmse: dict[str, float]
    start_partial_objectives: dict[str, float]
    start_objective: float
    fits: tuple[Fit, ...]
    ligaments: tuple[str, ...]
    contacts: tuple[str, ...]
    truth: dict[str, float]
    noise: dict[str, float]
    noise_estimated: bool
    misfits: tuple[Misfit, ...]
    weights: np.ndarray
    left_out: int
    seconds: dict[str, float]
    versions: dict[str, str]
    settings: dict[str, Any]
    start_tests: tuple[FittedTest, ...] = ()

    def _named(self) -> dict[str, tuple]:
        fits, own = self.fits, self.fits[0].estimates
        motions = [one.motion for one in fits]
        numbers = {x: ("procedure parameter", [[getattr(one, x) for one in fit.estimates]
                                               for fit in fits]) for x in _NUMBERS}  # fmt: skip
        return numbers | BY_COORDINATE | {
            "procedure": ("procedure", [fit.procedure for fit in fits]),
            "parameter": ("parameter", [one.name for one in own]),
            "parameter_unit": ("parameter", [one.unit for one in own]),
            "other_parameter": ("other_parameter", [one.name for one in own]),
            "ligament": ("ligament", self.ligaments), "contact": ("contact", self.contacts),
            "objective": ("procedure", [fit.objective for fit in fits]),
            "success": ("procedure", [fit.success for fit in fits]),
            "correlation": ("procedure parameter other_parameter", [x.correlation for x in fits]),
            "rmse": ("procedure coordinate",
                     [[fit.rmse.get(x, np.nan) for x in FREE_COORDINATES] for fit in fits]),
            "noise": ("coordinate", [self.noise.get(x, np.nan) for x in FREE_COORDINATES]),
            "column": ("column", COLUMNS), "measured": ("measurement column", self.measured),
            "fitted": ("procedure pose column", [one.table for one in motions]),
            "status": ("procedure pose", [one.status for one in motions], Status),
            "ligament_force_N": ("procedure pose ligament", [x.ligament_forces for x in motions]),
            "contact_force_N": ("procedure pose contact", [x.contact_forces for x in motions]),
        }  # fmt: skip

    @property
    def fit(self) -> Fit:
        """The fit that is reported as the answer."""
        return self.fits[0]

    def __getitem__(self, name: str) -> Estimate:
        """What the answer says of one parameter or frame offset.

        Args:
            name: e.g. `ACL.stiffness`, or `anterior` for an offset.

        Returns:
            The `Estimate`: `value`, `low` and `high`, `standard_error`, ...

        Raises:
            KeyError: nothing of this name was free.
        """
        every = {one.name: one for one in (*self.fit.estimates, *self.fit.offsets)}
        if name not in every:
            raise KeyError(f"{name!r} was not free: free were {', '.join(every)}")
        return every[name]
