"""A study: a knee, a motion, and what is to be found out. Checked whole before anything moves."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, PlainValidator, PrivateAttr, ValidationInfo
from pydantic import Field as described

from kneejax._ranges import RANGES
from kneejax.files import bundled_knees, named_document
from kneejax.files.reading import Field
from kneejax.studies._checked import (
    Choice,
    Flag,
    Interval,
    Intervals,
    LoadName,
    Mistakes,
    OrObject,
    Parameter,
    Part,
    Seed,
    Text,
    Values,
    by_name,
    distinct,
    entries,
    folder_of,
    found_in,
    plain,
    reads,
    whole,
)
from kneejax.studies._lab_tests import StudyTest
from kneejax.studies._poses import UNITS, Measured, Synthetic, given_poses, measured_poses
from kneejax.studies._reading import check_fields, check_with_knee, given_prior, objects_of

if TYPE_CHECKING:
    from kneejax.experiments import MeasuredTest
    from kneejax.inference.calibration import CalibrationProblem
    from kneejax.mechanics import Knee, Load
    from kneejax.parameters import Selection
    from kneejax.statics import Status
else:
    Knee = MeasuredTest = Any

#: Weights of squared errors per degree^2 and per mm^2 where nobody says so: those of paper 1.
_WEIGHTS = {"deg": 8.0, "mm": 1.0}
Procedure = Literal["I", "II", "III", "S"]
Fault = Literal[
    "outside_region", "overstretched", "way_flipped", "past_wrap", "wrap_inside", "unstable",
    "dislocated",
]  # fmt: skip
#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = get_args(Fault)


class StudyStage(Part):
    """A part of the search of procedure S: what is free in it, and which data count."""

    parameters: Annotated[
        tuple[Parameter, ...], entries("names", empty=True), AfterValidator(distinct)
    ] = described((), description="names or wildcards that are free; all if empty")
    data: Annotated[tuple[Text, ...], entries("names", empty=True), AfterValidator(distinct)] = (
        described((), description="`poses` and names of tests that count; all if empty")
    )


def _knee(value: Any, info: ValidationInfo) -> Any:
    """A knee as it is; of a name the bundled one, or the whole path of a file."""
    field, known = Field("", "", value), bundled_knees()
    if value is None or isinstance(value, list | dict | float | int):
        raise field.problem("a text, or a knee, as kneejax.load_knee gives")
    if not isinstance(value, str):
        return value
    name = field.text()
    if name in known:
        return name
    path = folder_of(info) / name
    if not os.path.isfile(path):
        expected = f"a bundled knee ({', '.join(known) or 'none'}) or a knee file; not at {path}"
        raise field.problem(expected, known)
    return os.path.abspath(path)  # results are read elsewhere


def _weights(value: Any) -> dict[str, float]:
    """Of all five coordinates; one of a coordinate counts before one of its unit."""
    known = ("mm", "deg", *UNITS)
    kind = f"a mapping with the fields {', '.join(known)}"
    given = by_name(lambda f, _: f.number(RANGES["weight"]), kind, known).func(value)
    weights = {
        name: given.get(name, given.get(unit, _WEIGHTS[unit])) for name, unit in UNITS.items()
    }
    if not any(weights.values()):
        raise Field("", "", value).problem("a weight above 0 for at least one coordinate")
    return weights


def _sizes(field: Field, name: str) -> list[float]:
    many = isinstance(field.value, list)
    return [*field.numbers(allowed=RANGES[name])] if many else [field.number(RANGES[name])]


def _load_name(field: Field, _: Any) -> str:
    known = get_args(LoadName)
    if field.value not in known:
        from kneejax.mechanics import load_called, load_opposite_to

        meant = load_opposite_to(str(field.value))
        near = f"{meant} of the opposite sign" if meant else load_called(field.value) or known
        raise field.problem(f"one of {', '.join(known)}", near)
    return field.value


def _frame_offset(field: Field) -> list[Any]:
    if isinstance(field.value, bool):
        return [*UNITS] if field.value else []
    if not isinstance(field.value, list | tuple):
        raise field.problem(f"true, false, or a list of {', '.join(UNITS)}")
    return [*field.value]


def _offset(field: Field) -> str:
    if field.value == "flexion":
        raise field.problem(
            f"one of {', '.join(UNITS)}; flexion is prescribed as it was measured, so it can have "
            "no offset: correct the measured column instead"
        )
    return field.choice(UNITS)


def _noise(name: str):
    def read(field: Field) -> float | None:
        noise = None if field.value is None else field.number(RANGES[name])
        if noise == 0:
            raise field.problem("a standard deviation above 0; leave it out to have it estimated")
        return noise

    return reads(read)


class Study(Part):
    """What is asked of a knee and a motion: all that a study file says.

    Everything is checked when a study is made: names are those of the knee, numbers are in their
    ranges, bounds hold the start. `kneejax.read_study` makes one from a file. What a file names (a
    knee, a table) may be named in Python too, or be given: a `Knee`, poses `(n, 6)`, a
    `MeasuredTest`. A study that is made has these objects, whatever it was made of.

    Raises:
        InputProblem: a field is not what it should be; `InputProblems` where several are.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, or a method that is not installed.

    Warns:
        DoubtfulValue: a stiffness, or a prior of one, that is nearer to that of one fibre than to
            that of the structure drawn as several fibres that it is said of.

    Example:
        >>> poses = [[30.0, 0.0, 2.0, 1.0, 0.0, 0.5], [60.0, 1.0, 4.0, 2.0, -1.0, 0.5]]
        >>> study = Study(title="Two poses", knee="four_ligament", parameters=["*.stiffness"],
        ...               measured=poses)
        >>> study.knee.name, study.limits["ACL.stiffness"], study.frame_offset
        ('four_ligament', (300.0, 10000.0), ())
    """

    title: Text = described(description="for reports")
    knee: Annotated[Knee, PlainValidator(_knee)] = described(
        repr=False, description="a bundled knee or a knee file, with the values that stay fixed"
    )
    parameters: Annotated[
        tuple[Parameter, ...], entries("names"), AfterValidator(distinct)
    ] = described(description="names or wildcards of what is free")
    measured: Annotated[np.ndarray | None, OrObject(Measured, given_poses)] = described(
        None, description="measured poses, degrees and mm; not beside synthetic ones"
    )
    synthetic: Synthetic | None = described(
        None, description="poses to be made; needed no more than measured ones where tests are"
    )
    tests: Annotated[
        tuple[Annotated[MeasuredTest, OrObject(StudyTest, lambda f: f.value)], ...],
        entries("tests", empty=True),
    ] = described((), description="under load that were made, each by a name of its own")
    patella: Flag | None = described(
        None, description="whether the knee is that of three bones, where its file has one"
    )
    start: Values = described(
        default_factory=dict,
        description="name or wildcard -> value where the search begins; the knee's own otherwise",
    )
    bounds: Intervals = described(
        default_factory=dict,
        description="name, `*.quantity` or quantity -> lower and upper bound; a name counts before "
        "a wildcard, that before a quantity, and usual bounds hold for the rest",
    )
    weights: Annotated[dict[str, float], PlainValidator(lambda x: _weights(plain(x)))] = described(
        default_factory=lambda: _weights({}),
        description="free coordinate, or `mm` or `deg` -> weight of its squared error, per mm^2 or "
        "per degree^2; those of paper 1 otherwise",
    )
    prior: Annotated[dict[str, float], PlainValidator(given_prior)] = described(
        default_factory=dict,
        description="name, `*.quantity` or quantity -> standard deviation of a normal prior around "
        "the start, or the prior.yaml of a cohort; needs noise_mm and noise_deg",
    )
    procedures: Annotated[
        tuple[Annotated[Procedure, Choice()], ...],
        entries("names", empty=True),
        AfterValidator(distinct),
    ] = described(
        (),
        description="the first is the answer, others are there to compare; `S` alone where there "
        "are stages",
    )
    stages: Annotated[tuple[StudyStage, ...], entries("stages", empty=True)] = described(
        (), description="of procedure S, in turn"
    )
    starts: Annotated[int, whole(1, 1000)] = described(
        1,
        description="of procedure III: the knee's own, then draws from the prior, or between the "
        "bounds where there is none",
    )
    seed: Seed = described(0, description="of the further starts")
    noise_mm: Annotated[float | None, _noise("noise_mm")] = described(
        None,
        description="standard deviation of measured displacements; estimated where it is not "
        "known, while synthetic poses know their own",
    )
    noise_deg: Annotated[float | None, _noise("noise_deg")] = described(
        None, description="of measured rotations; likewise"
    )
    frame_offset: Annotated[
        tuple[Annotated[str, reads(_offset)], ...], reads(_frame_offset), AfterValidator(distinct)
    ] = described(
        (),
        description="free coordinates whose constant offset between measured and model frames is "
        "free too; true for all five",
    )
    method: Annotated[Literal["least_squares", "lbfgsb"], Choice()] = described(
        "least_squares", description="of the search; `lbfgsb` needs jaxopt and takes long"
    )
    cycles: Annotated[int, whole(1, 1000)] = described(
        1, description="how often procedures I and II may go through their two steps"
    )
    failures: Annotated[
        tuple[Annotated[Fault, Choice()], ...],
        entries("names", empty=True),
        AfterValidator(distinct),
    ] = described(
        (),
        description="statuses for which a pose counts for nothing and a command ends with exit "
        "status 1; the package's choice if empty",
    )
    loads: Annotated[
        dict[str, list[float]],
        by_name(_sizes, f"a mapping from one of {', '.join(get_args(LoadName))} to its sizes",
                _load_name),
    ] = described(
        default_factory=dict,
        description="load -> its size at each pose, or one for all, in the unit of its name",
    )  # fmt: skip
    flexion_limits_deg: Interval | None = described(
        None, alias="flexion_deg", description="between which measured poses count"
    )
    set: Values = described(
        default_factory=dict, description="parameter -> value of the knee that stays fixed"
    )
    #: What a file says of what is kept as objects, and where it stands.
    _origin: dict[str, Any] = PrivateAttr(default_factory=dict)
    _file: str = PrivateAttr("study")

    def __init__(self, **fields: Any):
        """Check everything; what is given is kept in one form."""
        self._fill(fields, Mistakes("study"))

    def _fill(
        self,
        fields: dict[str, Any],
        mistakes: Mistakes,
        folder: Path = Path(),
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        """Check fields by themselves, then read what they name, then check them with the knee."""
        fields, context = plain(fields), {"folder": folder}
        for problem in found_in(self, fields, context):
            mistakes.keep(problem)
        if not mistakes:
            check_fields(self, mistakes)
        mistakes.check()
        said, objects = objects_of(self, fields, mistakes)
        mistakes.check()
        for problem in found_in(self, self.given() | objects, context):
            mistakes.keep(problem)
        mistakes.check()
        self._origin, self._file = {**(origin or {}), **said}, mistakes.file
        check_with_knee(self, mistakes)
        mistakes.check()

    def replace(self, **changes: Any) -> Study:
        """The same study with other values, checked anew."""
        other = Study.__new__(Study)
        other._fill(self.given() | changes, Mistakes(self.file), origin=self._origin)
        return other

    @property
    def file(self) -> str:
        """Where the study stands, for errors; `study` of one made in Python."""
        return self._file

    @functools.cached_property
    def selection(self) -> Selection:
        """The free parameters."""
        from kneejax.parameters import select

        return select(self.knee, self.parameters)

    @functools.cached_property
    def knee_at_start(self) -> Knee:
        """The knee where a search begins."""
        from kneejax.parameters import with_values

        return with_values(self.knee, dict(self.start))

    @functools.cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Free parameter -> lower and upper bound, in its own unit."""
        from kneejax.parameters import stated_bounds

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
        from kneejax.mechanics import load_of

        sizes = {name: np.asarray(numbers) for name, numbers in self.loads.items()}
        return (load_of(**sizes),) if sizes else ()

    @property
    def noise(self) -> tuple[float | None, float | None]:
        """Standard deviations in mm and degrees: as stated, or as synthetic poses are made."""
        made = self.synthetic
        mm, deg = (0.0, 0.0) if made is None else (made.noise_mm, made.noise_deg)
        return self.noise_mm or mm or None, self.noise_deg or deg or None

    @property
    def weight_vector(self) -> np.ndarray:
        """Weights in the order of the free coordinates, `(5,)`, per degree^2 and per mm^2."""
        return np.array([self.weights[name] for name in UNITS])

    @property
    def counted_failures(self) -> tuple[Status, ...]:
        """Statuses of balances that count for nothing."""
        from kneejax.statics import failures_of

        return failures_of(self.failures)

    @property
    def knee_name(self) -> str:
        """Name or file of the knee, as the study states it."""
        return str(self._origin.get("knee", self.knee.name))

    def problem(self, *, nameless: bool = False) -> CalibrationProblem:
        """The study as arrays: what `kneejax.calibrate` solves; synthetic poses take a motion.

        Args:
            nameless: whether the knee loses its name and side, which steer compiling alone: knees
                that differ in nothing else share their programs.

        Raises:
            UnsuitableData: the knee that should make the data does not balance, or data that tell
                nothing of what is free.
        """
        import dataclasses

        from kneejax.inference import Stage
        from kneejax.inference.calibration import CalibrationProblem
        from kneejax.inference.intervals import stated_noise
        from kneejax.parameters import select

        knee = self.knee_at_start
        if nameless:
            knee = dataclasses.replace(knee, name="knee", side="right")
        return CalibrationProblem.of(
            knee,
            select(knee, self.parameters),
            measured_poses(self),
            bounds=self.bounds,
            weights=self.weight_vector,
            stated=stated_noise(*self.noise),
            offsets=self.frame_offset,
            loads=self.acting,
            tests=self.tests,
            prior=self.prior,
            procedures=self.procedures,
            stages=tuple(Stage(one.parameters, one.data) for one in self.stages),
            starts=self.starts,
            seed=self.seed,
            method=self.method,
            cycles=self.cycles,
            truth=self.truth,
            title=self.title,
            settings=self.settings(),
        )

    def settings(self) -> dict[str, Any]:
        """Everything needed to run the study again, as plain numbers and words."""
        elsewhere = {"knee", "patella", "measured", "tests", "flexion_limits_deg", "set"}
        mm, deg = self.noise
        named = [{"name": test.name} for test in self.tests]
        origin = {"measured": None, "tests": named, "flexion_deg": None, "overrides": {}}
        return plain(self.model_dump(exclude=elsewhere) | origin | self._origin) | {
            "noise_mm": mm, "noise_deg": deg, "knee": self.knee_name,
            "path": os.path.abspath(self.file) if os.path.isfile(self.file) else self.file,
        }  # fmt: skip


#: Names that a study file may hold.
STUDY_FIELDS = tuple(field.alias or name for name, field in Study.model_fields.items())


def read_study(name_or_path: str | os.PathLike[str]) -> Study:
    """Read a study, its knee and its measured poses.

    Args:
        name_or_path: name of a bundled study, or a study file; paths in it are relative to its
            folder.

    Returns:
        The study, checked whole.

    Raises:
        InputProblem: the file or one that it names cannot be read, or a field is missing,
            unknown or out of range; `InputProblems` where several are.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, or a method that is not installed.

    Example:
        >>> study = read_study("paper1")
        >>> study.knee.name, study.parameters
        ('four_ligament', ('*.stiffness', '*.reference_strain'))
    """
    return study_of(*named_document("studies", name_or_path))


def study_of(document: Field, folder: Path) -> Study:
    """Make a study of what a file says.

    Args:
        document: everything that the file says.
        folder: to which paths in it are relative.

    Returns:
        The study, checked whole; it raises as `read_study` does.
    """
    mistakes, fields = Mistakes(document.file), document.value
    if isinstance(fields, dict):
        fields = dict(fields)
        for name in [name for name, value in fields.items() if value is None or value == []]:
            if name in STUDY_FIELDS:
                problem = document[name].problem("a value, or this field left out")
                needed = Study.model_fields.get(name)
                if not (needed and needed.is_required()):
                    mistakes.keep(problem)
                    del fields[name]
    study = Study.__new__(Study)
    study._fill(fields, mistakes, folder)
    return study
