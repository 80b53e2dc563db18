"""A study: a knee, a motion, and what is to be found out. Checked whole before anything moves."""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.files import knee_with, said_of
from kneejax.files.reading import Field
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import METHODS, Stage, procedures_of
from kneejax.mechanics import Knee, Load, load_of
from kneejax.numerics import check_installed
from kneejax.parameters import QUANTITIES, Selection, select, start_within, stated, stated_bounds
from kneejax.statics import Status, failures_of
from kneejax.studies._study_fields import Synthetic, checked, plain


@dataclasses.dataclass(frozen=True, eq=False)
class Study:
    """What is asked of a knee and a motion: all that a study file says, as objects.

    Everything is checked when a study is made: names are those of the knee, numbers are in their
    ranges, bounds hold the start. `kneejax.read_study` makes one from a file, and `kneejax.run`
    runs it.

    Attributes:
        title: for reports.
        knee: with the values that stay fixed.
        parameters: names or wildcards of what is free.
        measured: measured poses, `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and
            mm; None for synthetic ones.
        synthetic: poses to be made; at most one of the two is given, and neither needs to be where
            there are tests.
        tests: under load that were made (`kneejax.MeasuredTest`), each by a name of its own.
        start: name or wildcard -> value where the search begins; the knee's own otherwise.
        bounds: name, `*.quantity` or quantity -> lower and upper bound; a name counts before a
            wildcard, that before a quantity, and usual bounds hold for the rest. What is said of a
            place (`ACL.femoral_attachment`), here and in `prior`, holds for each coordinate.
        weights: free coordinate, or `mm` or `deg` -> weight of its squared error, per mm^2 or per
            degree^2; those of paper 1 otherwise. Later: one for each free coordinate.
        procedures: of `I`, `II`, `III`, `S`; the first is the answer, others are there to compare.
            `S` alone where there are stages, unless others are named.
        stages: of procedure S, in turn: `parameters` that are free and `data` that count in each,
            `poses` or names of tests (`kneejax.Stage`, or a mapping); all where left out.
        starts: number of starts of procedure III: the knee's own, then draws from the prior, or
            between the bounds where there is none.
        seed: of the further starts.
        prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around the
            start, of a calibration. Needs `noise_mm` and `noise_deg`; of weights then counts only
            which are zero.
        noise_mm: standard deviation of the measurement's displacements; None where it is not known
            and must be estimated. Synthetic poses know their own.
        noise_deg: of its rotations; likewise.
        frame_offset: free coordinates whose constant offset between measured and model frames is
            free too; True for all five.
        method: `least_squares` or `lbfgsb`.
        failures: words of statuses for which a pose counts for nothing and a command ends with
            exit status 1; empty for the package's choice.
        loads: name of a load (`kneejax.mechanics.NAMED_LOADS`) -> its size at each pose, or one
            for all, in the unit of its name. Poses were measured, or are made, under them.
        origin: what else a file says, recorded with results: `knee`, `patella`, `measured`,
            `tests`, `flexion_deg`, `overrides`.
        file: where the study stands, for errors.

    Raises:
        InputProblem: a field is not what it should be.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, or a method that is not installed.

    Example:
        >>> import kneejax as kj
        >>> poses = [[30.0, 0.0, 2.0, 1.0, 0.0, 0.5], [60.0, 1.0, 4.0, 2.0, -1.0, 0.5]]
        >>> study = Study("Two poses", kj.load_knee("four_ligament"), ["*.stiffness"], poses)
        >>> study.limits["ACL.stiffness"], study.frame_offset
        ((300.0, 10000.0), ())
    """

    title: str
    knee: Knee = dataclasses.field(repr=False)
    parameters: Sequence[str]
    measured: np.ndarray | None = None
    synthetic: Synthetic | None = None
    tests: Sequence[MeasuredTest] = ()
    start: Mapping[str, float] = dataclasses.field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    procedures: Sequence[str] = ()
    stages: Sequence[Stage] = ()
    starts: int = 1
    seed: int = 0
    prior: Mapping[str, float] = dataclasses.field(default_factory=dict)
    noise_mm: float | None = None
    noise_deg: float | None = None
    frame_offset: bool | Sequence[str] = ()
    method: str = next(iter(METHODS))
    failures: Sequence[str] = ()
    loads: Mapping[str, float | Sequence[float]] = dataclasses.field(default_factory=dict)
    origin: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    file: str = "study"

    def __post_init__(self) -> None:
        """Check everything; what is given is kept in one form."""
        given = {f.name: plain(getattr(self, f.name)) for f in dataclasses.fields(self)}
        if given["procedures"] == []:
            given["procedures"] = list(procedures_of((), self.stages))
        place = Field(self.file, "", given)
        for name, value in checked(place).items():
            object.__setattr__(self, name, value)
        for name, sizes in self.loads.items():
            if len(sizes) not in (1, len(self.flexion_deg)):
                place = Field(self.file, f"loads.{name}", f"{len(sizes)} sizes")
                raise place.problem(f"one for all poses, or {len(self.flexion_deg)}, one for each")
        if ("S" in self.procedures) != bool(self.stages):
            expected = "S among procedures and stages, or neither"
            raise place["procedures"].problem(expected)
        if self.starts > 1 and "III" not in self.procedures:
            raise place["starts"].problem("1: only procedure III has several starts")
        with said_of(self.file):
            bounded = [name for name in self.bounds if name not in QUANTITIES]
            for name in (*self.truth, *self.start, *bounded):
                select(self.knee, [name])
            # Of these, too, a value may lead to a knee that there is not.
            knee_with(self.knee, self.truth, self.file)
            knee, selection = self.knee_at_start, self.selection
            start_within(knee, selection, *stated_bounds(knee, selection, self.bounds))
            stated(selection, self.prior, "prior")
            if self.prior and None in self.noise:
                expected = "noise_mm and noise_deg too, against which a prior counts"
                raise Field(self.file, "prior", ", ".join(self.prior)).problem(expected)
            for number, stage in enumerate(self.stages):
                for name in stage.parameters:
                    if not any(Stage((name,)).frees(own) for own in self.selection.names):
                        own = Field(self.file, f"stages[{number}].parameters", name)
                        raise own.problem("of the parameters that the study frees")
            if self.method == "lbfgsb":
                check_installed("jaxopt", "lbfgsb")

    @functools.cached_property
    def selection(self) -> Selection:
        """The free parameters."""
        return select(self.knee, tuple(self.parameters))

    @functools.cached_property
    def knee_at_start(self) -> Knee:
        """The knee where a search begins."""
        return knee_with(self.knee, self.start, self.file)

    @functools.cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Free parameter -> lower and upper bound, in its own unit."""
        lower, upper = stated_bounds(self.knee_at_start, self.selection, self.bounds)
        pairs = zip(lower.tolist(), upper.tolist(), strict=True)
        return dict(zip(self.selection.names, pairs, strict=True))

    @property
    def truth(self) -> dict[str, float]:
        """Parameter -> value that makes synthetic poses; empty for measured ones."""
        return dict(self.synthetic.parameters) if self.synthetic else {}

    @property
    def flexion_deg(self) -> np.ndarray:
        """Of the poses, `(n,)`, degrees; those of tests are not among them."""
        if self.synthetic is not None:
            return self.synthetic.flexion_deg
        return np.empty(0) if self.measured is None else self.measured[:, 0]

    @property
    def acting(self) -> tuple[Load, ...]:
        """The loads at the poses; none where none acts."""
        sizes = {name: np.asarray(numbers) for name, numbers in self.loads.items()}
        return (load_of(**sizes),) if sizes else ()

    @property
    def noise(self) -> tuple[float | None, float | None]:
        """Standard deviations in mm and degrees: as stated, or as synthetic poses are made."""
        made = self.synthetic or Synthetic({}, np.empty(0))
        pairs = ((self.noise_mm, made.noise_mm), (self.noise_deg, made.noise_deg))
        mm, deg = ((own or None) if stated is None else stated for stated, own in pairs)
        return mm, deg

    @property
    def weight_vector(self) -> np.ndarray:
        """Weights in the order of the free coordinates, `(5,)`, per degree^2 and per mm^2."""
        return np.array([self.weights[name] for name in FREE_COORDINATES])

    @property
    def counted_failures(self) -> tuple[Status, ...]:
        """Statuses of balances that count for nothing."""
        return failures_of(self.failures)

    @property
    def knee_name(self) -> str:
        """Name or file of the knee, as the study states it."""
        return str(self.origin.get("knee", self.knee.name))

    def settings(self) -> dict[str, Any]:
        """Everything needed to run the study again, as plain numbers and words."""
        mm, deg = self.noise
        elsewhere = {
            "origin", "file", "measured", "tests", "noise_mm", "noise_deg", "flexion_deg",
        }  # fmt: skip
        names = [f.name for f in dataclasses.fields(self) if f.name not in elsewhere]
        kept = {name: plain(getattr(self, name)) for name in names}
        named = [{"name": test.name} for test in self.tests]
        origin = {"measured": None, "tests": named, "flexion_deg": None, "overrides": {}}
        origin |= dict(self.origin)
        return kept | {
            "noise_mm": mm, "noise_deg": deg, **plain(origin), "knee": self.knee_name,
            "path": os.path.abspath(self.file) if os.path.isfile(self.file) else self.file,
        }  # fmt: skip
