"""A study: a knee, a motion, and what is to be found out. Checked whole before anything moves."""

__all__ = ["Study", "check_study_file", "read_study", "study_of"]

import dataclasses
import functools
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import PrivateAttr

from kneejax.files import InputProblem, named_document
from kneejax.files.reading import Mistakes, fill, plain, wrong
from kneejax.quantities import FIBRE_QUANTITIES
from kneejax.studies._fields import UNITS, misspelt
from kneejax.studies._lab_tests import check_tests
from kneejax.studies._reading import check_fields, objects_of
from kneejax.studies._schema import STUDY_FIELDS, StudyFields

if TYPE_CHECKING:
    from kneejax.inference.calibration import CalibrationProblem
    from kneejax.inference.fit import Noise
    from kneejax.mechanics import Knee, Load
    from kneejax.parameters import Selection
    from kneejax.statics import Status

#: Free numbers beyond which a study is doubted.
_MANY = 40


class Study(StudyFields):
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

    #: What a file says of what is kept as objects, and where it stands.
    _origin: dict[str, Any] = PrivateAttr(default_factory=dict)
    _file: str = PrivateAttr("study")

    def __init__(self, **fields: Any):
        """Check everything; what is given is kept in one form."""
        self._fill(fields, Mistakes("study"))

    def _fill(self, fields: dict[str, Any], mistakes: Mistakes, folder: Path = Path(),
              origin: Mapping[str, Any] | None = None) -> None:  # fmt: skip
        """Check fields by themselves, then read what they name, then check them with the knee."""
        fields = plain(fields)
        self._fill_alone(fields, mistakes, folder)
        said, objects = objects_of(self, fields, mistakes)
        mistakes.check()
        with mistakes.gathered():
            fill(self, self.given() | objects, {"folder": folder})
        mistakes.check()
        self._origin, self._file = {**(origin or {}), **said}, mistakes.file
        _check_with_knee(self, mistakes)
        mistakes.check()

    def _fill_alone(self, fields: dict[str, Any], mistakes: Mistakes, folder: Path) -> None:
        """Check fields by themselves and with each other; nothing that they name is read."""
        with mistakes.gathered():
            fill(self, fields, {"folder": folder})
        if not mistakes:
            check_fields(self, mistakes)
        mistakes.check()

    def replace(self, **changes: Any) -> "Study":
        """The same study with other values, checked anew."""
        other = Study.__new__(Study)
        origin = {name: said for name, said in self._origin.items() if name not in changes}
        other._fill(self.given() | changes, Mistakes(self.file), origin=origin)
        return other

    @property
    def file(self) -> str:
        """Where the study stands, for errors; `study` of one made in Python."""
        return self._file

    @functools.cached_property
    def selection(self) -> "Selection":
        """The free parameters."""
        from kneejax.parameters import select

        return select(self.knee, self.parameters)

    @functools.cached_property
    def knee_at_start(self) -> "Knee":
        """The knee where a search begins."""
        return self.knee.replace(self.start)

    @functools.cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Free parameter -> lower and upper bound, in its own unit."""
        from kneejax.parameters import stated_bounds

        lower, upper = stated_bounds(self.knee_at_start, self.selection, self.bounds)
        pairs = zip(lower.tolist(), upper.tolist(), strict=True)
        return dict(zip(self.selection.names, pairs, strict=True))

    @functools.cached_property
    def believed(self) -> dict[str, float]:
        """The prior: as stated, and of attachments of a knee file that are free without one."""
        from kneejax.parameters import digitised

        sd, counts = self.attachment_sd_mm, None not in self.noise
        sd = sd if os.path.isabs(self.knee_name) else 0.0
        return self.prior | digitised(self.selection, self.prior, sd, counts=counts)

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
    def acting(self) -> "tuple[Load, ...]":
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
    def scatter(self) -> "Noise":
        """The noise of what was measured, with the weights that the study gives."""
        from kneejax.inference.fit import Noise

        return Noise.of(*self.noise, [self.weights.get(name, np.nan) for name in UNITS])

    @property
    def first_weights(self) -> np.ndarray:
        """Of squared errors, `(5,)`, per degree^2 and per mm^2: as given, one over the squared
        noise, or those of paper 1 where no noise is stated."""
        return self.scatter.first**-2.0

    @property
    def counted_failures(self) -> "tuple[Status, ...]":
        """Statuses of balances that count for nothing."""
        from kneejax.statics import failures_of

        return failures_of(self.failures)

    @property
    def knee_name(self) -> str:
        """Name or file of the knee, as the study states it."""
        return str(self._origin.get("knee", self.knee.name))

    def poses(self) -> np.ndarray:
        """The poses that the knee is compared with; synthetic ones take a motion of the knee.

        Returns:
            Shape `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; no row where
            a study has only tests.

        Raises:
            UnsuitableData: the knee that should make the data does not balance.
        """
        made = self.synthetic
        if made is None:
            return np.empty((0, 6)) if self.measured is None else self.measured
        from kneejax.inference import synthetic_motion

        return synthetic_motion(self.knee, made.parameters, made.flexion_deg,
                                noise_mm=made.noise_mm, noise_deg=made.noise_deg, loads=self.acting,
                                seed=made.seed)  # fmt: skip

    def problem(self, *, nameless: bool = False) -> "CalibrationProblem":
        """The study as arrays: what `kneejax.calibrate` solves; synthetic poses take a motion.

        Args:
            nameless: whether the knee loses its name and side, which steer compiling alone: knees
                that differ in nothing else share their programs.

        Raises:
            UnsuitableData: the knee that should make the data does not balance, more is free than
                was read, or data that tell nothing of what is free.

        Warns:
            DoubtfulValue: more than 40 numbers are free.
        """
        from kneejax.inference.calibration import CalibrationProblem
        from kneejax.parameters import select

        knee = self.knee_at_start
        if nameless:
            knee = dataclasses.replace(knee, name="knee", side="right")
        selection = select(knee, self.parameters)
        _check_free(self, selection)
        return CalibrationProblem.of(
            knee, selection, self.poses(), bounds=self.bounds, noise=self.scatter,
            offsets=self.frame_offset, loads=self.acting, tests=self.tests, prior=self.believed,
            procedures=self.procedures, stages=self.stages, starts=self.starts, seed=self.seed,
            method=self.method, cycles=self.cycles, truth=self.truth, title=self.title,
            settings=self.settings())  # fmt: skip

    def settings(self) -> dict[str, Any]:
        """Everything needed to run the study again, as plain numbers and words."""
        elsewhere = {"knee", "patella", "measured", "tests", "flexion_limits_deg", "set"}
        mm, deg = self.noise
        named = [{"name": test.name} for test in self.tests]
        origin = {"measured": None, "tests": named, "flexion_deg": None, "overrides": {}}
        return plain(self.model_dump(exclude=elsewhere) | origin | self._origin) | {
            "noise_mm": mm, "noise_deg": deg, "knee": self.knee_name,
            "path": os.path.abspath(self.file) if os.path.isfile(self.file) else self.file}


def _check_free(study: Study, selection: "Selection") -> None:
    """Not more numbers are free than were read, but for those with a prior; many are doubted."""
    from kneejax.parameters import DoubtfulValue, UnsuitableData, stated

    counted = study.scatter.counted
    read = len(study.flexion_deg) * int(counted.sum())
    for test in study.tests:
        for one in (test.observed[:, counted], *test.readings.values()):
            read += int(np.isfinite(one).sum())
    believed = sum(one is not None for one in stated(selection, study.believed, "prior"))
    free = len(selection) + len(study.frame_offset)
    groups = [f"{name} ({len(fibres)} fibres)" for name, fibres in study.knee.groups]
    instead = f"; free structures rather than fibres: {', '.join(groups)}" if groups else ""
    if free - believed > read:
        raise UnsuitableData(f"parameters: {free} free numbers for {read} readings: expected as "
                             f"many readings at least, or a prior{instead}")
    if free > _MANY:
        warnings.warn(f"parameters: {free} free numbers: data seldom tell more than {_MANY} apart, "
                      f"and each takes its time{instead}", DoubtfulValue, 3)


def _check_with_knee(study: Study, mistakes: Mistakes) -> None:
    """Names, bounds and data that must suit the knee."""
    from kneejax import parameters
    from kneejax.numerics import check_installed

    count = len(study.flexion_deg)
    for name, sizes in study.loads.items():
        if len(sizes) not in (1, count):
            expected = f"one for all poses, or {count}, one for each"
            mistakes.keep(InputProblem("", f"loads.{name}", f"{len(sizes)} sizes", expected))
    noise = {"mm": study.noise_mm, "deg": study.noise_deg}
    check_tests(study.knee, study.tests, noise, study.synthetic is None, mistakes)
    if study.prior and None in study.noise:
        expected = "noise_mm and noise_deg too, against which a prior counts"
        mistakes.keep(InputProblem("", "prior", ", ".join(study.prior), expected))
    bounded = [name for name in study.bounds if name not in FIBRE_QUANTITIES]
    for name in dict.fromkeys((*study.parameters, *study.truth, *study.start, *bounded)):
        with mistakes.gathered():
            parameters.select(study.knee, [name])
    mistakes.check()
    with mistakes.gathered():  # of these, too, a value may be impossible
        study.knee.replace(study.truth)
    with mistakes.gathered():
        knee, selection = study.knee_at_start, study.selection
        parameters.start_within(knee, selection, *np.reshape([*study.limits.values()], (-1, 2)).T)
        deviations = parameters.stated(selection, study.prior, "prior")
        for name, sd in zip(selection.names, deviations, strict=True):
            if sd is not None:
                parameters.doubt_prior(knee, name, sd)
        for number, stage in enumerate(study.stages):
            for name in stage.parameters:
                alone = dataclasses.replace(stage, parameters=(name,))
                if not any(map(alone.frees, selection.names)):
                    place = f"stages[{number}].parameters"
                    raise InputProblem("", place, name, "one of the study's free parameters")
    with mistakes.gathered():
        if study.method == "lbfgsb":
            check_installed("jaxopt", "lbfgsb")


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
    document, path = named_document("studies", name_or_path)
    return study_of(document, os.fspath(path), path.parent)


def check_study_file(name_or_path: str | os.PathLike[str]) -> None:
    """Refuse a study file for what its fields say, before JAX is imported to read what they name.

    Args:
        name_or_path: as of `read_study`.

    Raises:
        InputProblem: a field is missing, unknown or out of range, or a name is none of the knee's;
            `InputProblems` where several are.
    """
    document, path = named_document("studies", name_or_path)
    mistakes = Mistakes(os.fspath(path))
    study, fields = Study.__new__(Study), _without_empty(document, mistakes)
    study._fill_alone(plain(fields), mistakes, path.parent)
    if isinstance(study.knee, str):
        places = {name: f"parameters[{number}]" for number, name in enumerate(study.parameters)}
        for field in ("start", "bounds", "set"):
            places |= dict.fromkeys(getattr(study, field), field)
        for problem in misspelt(study.knee, places):
            mistakes.keep(problem, places[problem.value])
    mistakes.check()


def study_of(document: Any, file: str, folder: Path) -> Study:
    """Make a study of everything that a file says; it raises as `read_study` does.

    Args:
        document: what it says.
        file: where, for errors.
        folder: to which paths in it are relative.
    """
    mistakes, study = Mistakes(file), Study.__new__(Study)
    study._fill(_without_empty(document, mistakes), mistakes, folder)
    return study


def _without_empty(document: Any, mistakes: Mistakes) -> Any:
    """The fields of a file without those that are empty, which are mistakes."""
    if not isinstance(document, dict):
        return document
    needed = {name for name, field in Study.model_fields.items() if field.is_required()}
    empty = [name for name, value in document.items()
             if name in STUDY_FIELDS and name not in needed and (value is None or value == [])]
    for name in empty:
        mistakes.keep(wrong(document[name], "a value (or omit the field)", at=name))
    return {name: value for name, value in document.items() if name not in empty}
