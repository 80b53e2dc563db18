"""What a study names, read: its knee, its poses, the tables of its tests, a prior."""

import dataclasses
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import PlainValidator

from kneejax.files import InputProblem, reading
from kneejax.files.reading import Mistakes, Part, by_parameter, checked, choice, meaning, one_of
from kneejax.studies import _lab_tests
from kneejax.studies._fields import MIRROR, UNITS, Values
from kneejax.studies._lab_tests import COORDINATES, PATELLA, InTime, StudyTest, older_name
from kneejax.studies._schema import Measured, StudyFields, StudyStage

if TYPE_CHECKING:
    from kneejax.experiments import Frames, MeasuredTest
    from kneejax.files import LabTable
    from kneejax.mechanics import Knee

#: Words for the negative sense of a load or a coordinate.
_OTHER_SENSE = re.compile(r"posterior|medial|inferior|distal|distraction|valgus|abduction|external",
                          re.IGNORECASE)
#: Fields of a test that say what stands in a table of one's own.
_OF_OWN_TABLES = ("columns", "ignore", "convention", "mirror", "at_deg")


class PriorFile(Part):
    """The prior.yaml of a cohort."""

    start: Values = meaning("parameter -> mean")
    prior: Annotated[dict[str, float], PlainValidator(by_parameter(reading.deviation))] = meaning(
        "parameter -> standard deviation")
    stiffness_of: Annotated[str, one_of(["structure"])] | None = meaning(
        "of what a structure's stiffness is; its fibres' mean in older files", None)


def usual_procedures(study: StudyFields) -> tuple[str, ...]:
    """Procedures where none are named."""
    return ("S",) if study.stages else ("III",)


def check_fields(study: StudyFields, mistakes: Mistakes) -> None:
    """What fields say of each other."""

    def refuse(field: str, value: Any, expected: str) -> None:
        mistakes.keep(InputProblem("", field, value, expected))

    given = [name for name in ("measured", "synthetic") if getattr(study, name) is not None]
    if len(given) > 1 or not (given or study.tests):
        expected = "exactly one of measured, synthetic" + ", or tests" * (not given)
        refuse("measured", " and ".join(given) or "neither", expected)
    if study.flexion_limits_deg and study.synthetic:
        expected = "no limits beside synthetic poses, which have their own flexion_deg"
        refuse("flexion_deg", [*study.flexion_limits_deg], expected)
    procedures = study.procedures or usual_procedures(study)
    if ("S" in procedures) != bool(study.stages):
        refuse("procedures", [*procedures], "S among procedures and stages, or neither")
    if study.starts > 1 and "III" not in procedures:
        refuse("starts", study.starts, "1, since multistart needs procedure III")
    known = ["poses"] * bool(given) + [test.name for test in study.tests]
    for number, stage in enumerate(study.stages):
        for i, name in enumerate(stage.data):
            with mistakes.gathered(f"stages[{number}].data[{i}]"):
                choice(name, known)


def objects_of(
    study: StudyFields, fields: Mapping[str, Any], mistakes: Mistakes
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the study names, for its record, and the objects that stand for it."""
    from kneejax.files import load_knee

    said: dict[str, Any] = {}
    objects: dict[str, Any] = {"set": {}, "flexion_deg": None}
    knee = study.knee
    if isinstance(knee, str):
        said["knee"] = knee
        with mistakes.gathered():
            knee = load_knee(knee, patella=bool(study.patella))
    if study.flexion_limits_deg:
        said["flexion_deg"] = study.flexion_limits_deg
    if study.set:
        said["overrides"] = study.set
    if isinstance(study.measured, Measured):
        said["measured"] = study.measured.model_dump()
        with mistakes.gathered():
            objects["measured"], acted = _read_poses(study.measured, study.flexion_limits_deg)
            if acted and study.loads:
                expected = f"no loads beside those of the measured table ({', '.join(acted)})"
                raise InputProblem("", "loads", study.loads, expected)
            objects |= {"loads": acted} if acted else {}
    if study.patella is not None:
        said["patella"] = study.patella
    mistakes.check()
    with mistakes.gathered():
        objects["knee"] = knee = knee.replace(study.set)
    if any(isinstance(test, StudyTest) for test in study.tests):
        objects["tests"], said["tests"] = [], []
        for number, test in enumerate(study.tests):
            with mistakes.gathered(f"tests[{number}]"):
                if isinstance(test, StudyTest):
                    record = older_name(fields["tests"][number])
                    said["tests"].append(record | {"file": test.file})
                    test = measured_test_of(test, knee.pullable, knee.side)
                objects["tests"].append(test)
    if isinstance(study.prior, str):
        with mistakes.gathered():
            objects |= _prior_of_cohort(study, knee)
    if study.stages:
        from kneejax.inference import Stage

        objects["stages"] = [Stage(one.parameters, one.data) if isinstance(one, StudyStage) else one
                             for one in study.stages]  # fmt: skip
    if not study.procedures:
        objects["procedures"] = usual_procedures(study)
    return said, objects


def _read_poses(
    measured: Measured, limits: tuple[float, float] | None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Poses within limits of flexion, `(n, 6)`, degrees and mm, and loads that acted."""
    from kneejax.files import read_loads, read_poses

    table = read_poses(measured.file, measured.convention, measured.columns)
    loads = read_loads(measured.file, measured.columns)
    if measured.mirror:
        table = table * MIRROR
        # Of a left knee medial and lateral change sides; varus and inwards stay what they are.
        loads |= {"lateral_N": -loads["lateral_N"]} if "lateral_N" in loads else {}
    if limits is None:
        return table, loads
    lower, upper = limits
    # Limits include poses that a conversion moved by rounding.
    inside = (table[:, 0] >= lower - 1e-6) & (table[:, 0] <= upper + 1e-6)
    if not inside.any():
        expected = f"limits within {table[:, 0].min():g} and {table[:, 0].max():g}, as measured"
        raise InputProblem("", "flexion_deg", f"{lower:g} to {upper:g}", expected)
    return table[inside], {name: sizes[inside] for name, sizes in loads.items()}


def _prior_of_cohort(study: StudyFields, knee: "Knee") -> dict[str, Any]:
    """Start and prior of the free parameters, from what a cohort wrote; refuses a start that the
    study states too, and a file so old that a structure's stiffness is its fibres' mean."""
    from kneejax.parameters import MEANING, fibres_summed, select

    path = str(study.prior)
    ((mark, words),) = MEANING.items()
    file = checked(PriorFile, reading.load_yaml(path, "the prior.yaml of a cohort"), path)
    free = select(knee, study.parameters).names
    for name, value in study.start.items():
        if name in file.prior:
            expected = f"this start left out: {Path(path).name} says around what {name} lies"
            raise InputProblem("", f"start.{name}", value, expected)
    means, deviations = ({name: said[name] for name in free if name in said}
                         for said in (file.start, file.prior))  # fmt: skip
    for name in means | deviations:
        if file.stiffness_of is None and (count := fibres_summed(knee, name)) > 1:
            section = "start" if name in means else "prior"
            expected = (f"the sum over the structure's {count} fibres; this file is older and has "
                        "their mean: run its cohort again, or multiply values and deviations of "
                        f"structures by their numbers of fibres and add {mark}: {words}")
            raise InputProblem(path, f"{section}.{name}", getattr(file, section)[name], expected)
    return {"start": {**study.start, **means}, "prior": deviations}


def measured_test_of(
    test: StudyTest, lines: Sequence[str] = (), side: str = "right"
) -> "MeasuredTest":
    """The test that a study names, from its table, in which a column may be the added tension of
    `lines` (of constant tension, or muscles) that the knee has (`Knee.pullable`). Of the knee of a
    `left` side, and of a table that is mirrored, Z of the point of forces is to the right too."""
    from kneejax.experiments import MeasuredTest, against_load, weights_by_load

    table, counted_from = _table_of(test)
    if test.flexion_deg is not None:
        wanted = test.flexion_deg
        inside = np.isclose(table.flexion_deg[:, None], wanted, atol=1e-6)
        if not inside.any(axis=0).all():
            absent = wanted[~inside.any(axis=0)][0]
            measured = ", ".join(f"{x:g}" for x in np.unique(table.flexion_deg))
            expected = f"of the flexions that were measured, {measured}; not {absent:g}"
            raise test.wrong("flexion_deg", expected, wanted.tolist())
        table = table.take(inside.any(axis=1))
    flexion, loads, observed = table[:3]
    constant, point = dict(test.loads), test.point_mm
    for load in (x for x in constant if x in loads):
        expected = f"no {load} beside the column of it, which has the whole load"
        raise test.wrong(f"loads.{load}", expected, constant[load])
    if test.mirror or side == "left":
        point = point[0], point[1], 0.0 - point[2]
    if test.mirror:
        observed = observed * MIRROR[1:]
        for acting in (loads, constant):
            if "lateral_N" in acting:
                acting["lateral_N"] = -acting["lateral_N"]
        turned = dict(zip((f"patella_{name}" for name in PATELLA), MIRROR, strict=True))
        readings = {k: x * turned.get(k.rsplit("_", 1)[0], 1.0) for k, x in table.readings.items()}
        table = table._replace(readings=readings)
    if test.coordinates:
        table, observed = _that_count(test, table, observed)
    readings, named = dict(table.readings), {line: f"{line}.tension_N" for line in lines}
    tensions = {line: readings.pop(name) for line, name in named.items() if name in readings}
    for line, tension in tensions.items():
        if np.isnan(tension).any():
            place = f"file: {named[line]}, row {np.flatnonzero(np.isnan(tension))[0] + 1}"
            expected = "a tension in every row, since it acts on the knee"
            raise InputProblem("", place, "empty", expected)
    if test.weight and table.weight is not None:
        raise test.wrong("weight", "to omit this field: the table has a column weight")
    frames = None if test.in_time is None else _frames(test, test.in_time, table)
    own = {"axes", "sd_mm", "sd_deg", "sd_N", "sd_strain", "cut", "within_deg"}
    counted_from = test.counted_from or counted_from or "unloaded"
    made = MeasuredTest(test.name, flexion, loads, observed, counted_from=counted_from,
                        constant=constant, tensions=tensions, readings=readings,
                        weight=table.weight, frames=frames, point_mm=point,
                        **test.model_dump(include=own & test.model_fields_set))  # fmt: skip
    if test.weight:
        made = dataclasses.replace(made, weight=weights_by_load(made.loads[made.driven_by]))
    if (found := against_load(made)) is not None:
        raise _of_the_other_sense(test, found)
    return made


def _frames(test: StudyTest, said: InTime, table: "LabTable") -> "Frames":
    """The frames of a knee in motion."""
    if table.time_s is None:
        raise test.wrong("file", "a column time_s too, or columns: {time_s: ...}")
    from kneejax.dynamics import gravity_of
    from kneejax.experiments import Frames, leg_of_person
    from kneejax.numerics import WrongValue

    own = {"critical", "damping_N_s_per_mm", "period_s", "harmonics", "cycles_before"}
    asked = said.model_dump(include=own, exclude_none=True)
    if said.error_mm is not None:
        asked["most_mm"] = said.error_mm
    if said.femur_deg is not None:
        asked["gravity_m_s2"] = gravity_of(said.femur_deg)
    leg = leg_of_person(said.body_kg, said.height_m, said.ankle_kg)
    try:
        return Frames(table.time_s, table.flexion_deg, leg, **asked)
    except WrongValue as problem:
        place = f"in_time.{problem.field}"
        raise InputProblem("", place, problem.found, problem.expected) from None


def _of_the_other_sense(test: StudyTest, found: Any) -> InputProblem:
    """A curve along which the tibia moves against its load, by the column suspected."""
    from kneejax.geometry import COORDINATES
    from kneejax.mechanics import NAMED_LOADS

    moved = COORDINATES[found.coordinate].column
    columns = {name: test.columns.get(name, name) for name in (moved, found.load)}
    # A column whose own name speaks of the other sense, unless it was turned round already.
    other = [name for name, column in columns.items()
             if _OTHER_SENSE.search(column) and not column.lstrip().startswith("-")]  # fmt: skip
    name = other[0] if len(other) == 1 else moved
    column = columns[name]
    turned = column.lstrip()[1:].lstrip() if column.lstrip().startswith("-") else f"-{column}"
    (least, most), (low, high) = found.loads, found.values
    unit = NAMED_LOADS[found.load].unit
    expected = (
        f"a coordinate that rises with its load, {found.load} from {least:g} to {most:g} {unit}: "
        f'a column of the other sense is suspected; write {name}: "{turned}" under columns, or '
        "turn the other column round")
    shown = f"{moved} from {low:g} to {high:g} at {found.flexion_deg:g} degrees"
    return InputProblem(test.file, column, shown, expected)


def _that_count(
    test: StudyTest, table: "LabTable", observed: np.ndarray
) -> "tuple[LabTable, np.ndarray]":
    """Without the coordinates, of any bone, that shall not count."""
    seen = dict(zip(UNITS, observed.T, strict=True))
    others = {column: column.rsplit("_", 1)[0] for column in table.readings}
    others = {column: name for column, name in others.items() if name in COORDINATES}
    seen |= {name: table.readings[column] for column, name in others.items()}
    for name in test.coordinates:
        if np.isnan(seen.get(name, np.nan)).all():
            expected = f"coordinates that the table has; not {name}"
            raise test.wrong("coordinates", expected, [*test.coordinates])
    kept = {name: sizes for name, sizes in table.readings.items()
            if name not in others or others[name] in test.coordinates}  # fmt: skip
    observed = np.where([name in test.coordinates for name in UNITS], observed, np.nan)
    return table._replace(readings=kept), observed


def _table_of(test: StudyTest) -> "tuple[LabTable, str | None]":
    """The table that a test names, published or not, and what a published one is counted from."""
    from kneejax.experiments import WITHOUT_LOADS
    from kneejax.files import bundled_bands, read_lab_table

    given, name = test.model_fields_set, test.file
    if os.path.isabs(name):
        if "load" in given:
            raise test.wrong("load", "no load of a published table: this one has columns of loads")
        unloaded = test.counted_from in WITHOUT_LOADS
        return read_lab_table(name, test.columns, test.at_deg, test.convention, test.ignore,
                              unloaded=unloaded, about=test.name), None  # fmt: skip
    published = _lab_tests.published_motions()
    for field in _OF_OWN_TABLES:
        if field in given and not (field == "ignore" and name in published):
            raise test.wrong(field, f"to omit this field: {name} comes with the package")
    if name not in published:
        return _lab_tests.published_laxity(test, bundled_bands(name=name))
    for field in ("load", "counted_from"):
        if field in given:
            raise test.wrong(field, f"to omit this field: {name} says it itself")
    own = published[name]
    table = read_lab_table(own.path, own.columns, ignore=test.ignore, unloaded=True)
    return table, own.counted_from
