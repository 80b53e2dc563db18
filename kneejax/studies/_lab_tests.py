"""Tests under load of a study: what may be said of one, and what published ones say."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, PlainValidator, ValidationInfo, model_validator

from kneejax.files import InputProblem, reading
from kneejax.files.reading import Number, Part, Text, entries, meaning, reads, within, wrong
from kneejax.quantities import RANGES
from kneejax.studies._fields import LOAD_NAMES, UNITS, Angles, Convention

if TYPE_CHECKING:
    from kneejax.experiments import MeasuredTest
    from kneejax.files import LabTable, LaxityBand, Measurement
    from kneejax.mechanics import Knee

PATELLA = ("flexion", "rotation", "tilt", "anterior", "superior", "lateral")
COORDINATES = (*UNITS, *(f"patella_{name}" for name in PATELLA))
CountedFrom = Literal["unloaded", "intact", "least_load", "opposite", "offset",
                      "offset_each_flexion", "absolute", "extension"]  # fmt: skip
Axes = Literal["femur", "tibia", "grood_suntay"]
_loads = reading.mapping_of(lambda value, name: reading.number(value, RANGES[name]),
                            f"a mapping with the fields {', '.join(LOAD_NAMES)}", LOAD_NAMES)
_columns = reading.mapping_of(lambda value, _: reading.text(value),
                              "a mapping from a name to a column of the file")


class InTime(Part):
    """What makes rows of a test the frames of a knee in motion."""

    body_kg: Number = meaning("of the person", 75.0)
    height_m: Number = meaning("of the person", 1.75)
    ankle_kg: Number = meaning("a weight there", 0.0)
    femur_deg: Number | None = meaning("of the femur to the horizontal; no gravity otherwise", None)
    critical: Number | None = meaning("damping of each fibre as part of the critical one", None)
    damping_N_s_per_mm: Number | None = meaning("of every coordinate, rotations at 30 mm", None)
    period_s: Number | None = meaning("of a motion that repeats itself", None)
    error_mm: Number | None = meaning("that steps through time may leave of any pose", None)
    harmonics: Annotated[int, reads(reading.whole, 1, 12)] | None = meaning(
        "with which flexion is led, of a motion that repeats itself", None)
    cycles_before: Annotated[int, reads(reading.whole, 0, 100)] | None = meaning(
        "that the motion had gone through before the first row", None)

    @reading.checks
    def _check_period(self, _: reading.Mistakes) -> None:
        for name in ("harmonics", "cycles_before"):
            value = getattr(self, name)
            if value is not None and self.period_s is None:
                raise wrong(value, "period_s too, of a motion that repeats itself", at=name)


def _test_table(value: Any, info: ValidationInfo) -> str:
    """The whole path of a table, or the name of a published test."""
    from kneejax.files import bundled_laxity_sources

    name = reading.text(value)
    if os.path.isfile(path := reading.folder_of(info) / name):
        return os.path.abspath(path)
    known = (*bundled_laxity_sources(), *published_motions())
    if name not in known:
        raise wrong(value, f"a CSV table, or a published test ({', '.join(known)})", known)
    return name


def published_motions() -> "dict[str, Measurement]":
    """Motions that come with the package as tests."""
    from kneejax.files import bundled_measurements

    return {name: one for name, one in bundled_measurements().items() if one.use == "test"}


def older_name(said: Any) -> Any:
    """What a file says of a test: `constant` is the older name of what a study calls loads too."""
    if isinstance(said, dict) and "constant" in said and "loads" not in said:
        return {"loads" if name == "constant" else name: one for name, one in said.items()}
    return said


class StudyTest(Part):
    """A test under load, as a study names it."""

    name: Text = meaning("what tables and figures call it")
    file: Annotated[str, PlainValidator(_test_table)] = meaning(
        "CSV table, relative to the study's folder, or a published test")
    source: Any = meaning("who measured it", None)
    columns: Annotated[dict[str, str], PlainValidator(_columns)] = meaning(
        "name -> column, perhaps scaled", dict)
    ignore: Annotated[tuple[Text, ...], entries("columns")] = meaning("columns left out", ())
    convention: Convention = meaning("what coordinates mean", "grood-suntay")
    mirror: reading.Flag = meaning("whether a left knee was measured in axes with Z to the right",
                                   False)
    flexion_deg: Angles | None = meaning("flexions that count", None)
    at_deg: Annotated[float, within("flexion_deg")] | None = meaning(
        "flexion of a table without a column of it", None)
    coordinates: Annotated[
        tuple[Annotated[str, reading.one_of(COORDINATES)], ...], entries("coordinates")
    ] = meaning("that count; all that the table has if empty", ())
    counted_from: Annotated[CountedFrom, reading.Choice()] | None = meaning(
        "what numbers are counted from; as a published test says, or `unloaded`", None)
    within_deg: Annotated[float, reads(reading.number, RANGES["within_deg"])] = meaning(
        "by which flexions of one curve, or of trials in opposite senses, may differ", 1.0)
    loads: Annotated[dict[str, float], PlainValidator(_loads)] = meaning(
        "load -> size that acted throughout", dict)
    load: Any = meaning("load -> size of a published laxity whose load is not known", None)
    point_mm: Annotated[
        tuple[float, float, float], reading.numbers_within(3, "point_mm")
    ] = meaning("where forces act, in the tibia's frame of a knee file", (0.0, 0.0, 0.0))
    axes: Annotated[Axes, reading.Choice()] = meaning("in which loads are given", "grood_suntay")
    sd_mm: Annotated[float, within("noise_mm")] | None = meaning(
        "standard deviation of displacements; as the poses' if not stated", None)
    sd_deg: Annotated[float, within("noise_deg")] | None = meaning("of rotations; likewise", None)
    sd_N: Annotated[float, within("tension_N")] | None = meaning("of forces that were read", None)
    sd_strain: Annotated[float, reads(reading.number, RANGES["strain"].spread)] | None = meaning(
        "of strains that were read", None)
    cut: Annotated[
        tuple[Text, ...], entries("ligaments"),
        BeforeValidator(lambda one: [one] if isinstance(one, str) else one),
    ] = meaning("ligaments, groups or menisci that had been cut", ())
    weight: Annotated[Literal["by_load"], reading.Choice()] | None = meaning(
        "`by_load` weighs rows in proportion to their load", None)
    in_time: InTime | None = meaning("of rows that are frames of a motion", None)

    @model_validator(mode="before")
    @classmethod
    def _named_as_today(cls, said: Any) -> Any:
        return older_name(said)

    def wrong(self, field: str, expected: str, value: Any = None) -> reading.InputProblem:
        """A mistake in a field of this test."""
        value = getattr(self, field) if value is None else value
        value = os.path.basename(value) if field == "file" else value
        return wrong(value, expected, at=field)


def published_laxity(
    test: StudyTest, bands: "Sequence[LaxityBand]"
) -> "tuple[LabTable, str | None]":
    """The rows of a published laxity, of knees with those ligaments cut that the test had cut;
    where its load is not known, the test says it, as `load: {internal_Nm: 5}`."""
    import numpy as np

    from kneejax.files import LabTable
    from kneejax.mechanics import load_called

    name = bands[0].name
    if bands[0].end == "range_increase":
        raise test.wrong("file", f"a test of one knee; not {name}, a difference that cutting makes")
    own = [band for band in bands if {*band.cut} == {*test.cut}]
    if not own:
        known = sorted({" and ".join(band.cut) or "nothing" for band in bands})
        value = test.cut[0] if len(test.cut) == 1 else None
        expected = f"{name} with {' or '.join(known)} cut, as it was measured"
        raise test.wrong("cut" if test.cut else "file", expected, value)
    load, size = own[0].load, own[0].size
    unknown, stated = math.isnan(size), "load" in test.model_fields_set
    if unknown and not stated:
        expected = f"load: {{{load}: ...}} beside it, since the load of {name} is not known"
        raise test.wrong("file", expected)
    if stated and not unknown:
        expected = f"to omit this field: {name} was measured under {load} {size:g}"
        raise test.wrong("load", expected)
    if stated:
        if not isinstance(test.load, dict) or not test.load:
            raise test.wrong("load", f"a mapping from {load} to its size")
        for other in test.load:
            if other != load:
                expected = f"no such field, but one of {load}"
                raise test.wrong(f"load.{other}", expected, test.load[other])
        try:
            size = reading.number(test.load[load], RANGES[load])
        except InputProblem as problem:
            raise test.wrong(f"load.{load}", problem.expected, problem.value) from None
        if not size > 0:
            raise test.wrong(f"load.{load}", "the size of the load, above 0", size)
    (column,) = [k for k, coordinate in enumerate(UNITS) if load_called(coordinate) == load]
    rows = []  # flexion, load, reading
    for band in own:
        sense = -1.0 if band.end == "negative" else 1.0
        rows += [(x, sense * size, y) for x, y in zip(band.flexion_deg, band.mean, strict=True)]
        if band.end == "range":
            rows += [(x, -size, 0.0) for x in band.flexion_deg]
    flexion, sizes, read = np.array(rows).T
    observed = np.full((len(rows), len(UNITS)), np.nan)
    observed[:, column] = read
    ranges = any(band.end == "range" for band in own)
    if ranges and test.counted_from:
        expected = f"to omit this field: {name} is of ranges between opposite loads"
        raise test.wrong("counted_from", expected)
    table = LabTable(flexion, {load: sizes}, observed)
    return table, "opposite" if ranges else own[0].counted_from


def check_tests(knee: "Knee", tests: "Sequence[MeasuredTest]", stated: Mapping[str, float | None],
                measured: bool, mistakes: reading.Mistakes) -> None:
    """Of tests no two have one name, and none is better known than the poses can say, whose noise
    is stated in mm and degrees, where they are measured."""
    if not tests:  # importing takes longer than everything else here
        return
    from kneejax.inference.fit import check_readable
    from kneejax.parameters import cut

    for number, test in enumerate(tests):
        place = f"tests[{number}]"
        with mistakes.gathered(place):
            cut(knee, test.cut)
            check_readable(knee, test.readings)
            if test.name in [one.name for one in tests[:number]]:
                raise InputProblem("", "name", test.name, "every name once")
            for unit, noise in stated.items():
                if test.readings and noise is None:
                    expected = f"noise_{unit} of the study too, against which it counts"
                    raise InputProblem("", "", next(iter(test.readings)), expected)
                if (sd := getattr(test, f"sd_{unit}")) is None:
                    continue
                if not (math.isfinite(sd) and sd > 0):
                    raise InputProblem("", f"sd_{unit}", sd, "a standard deviation above 0")
                if noise is None and measured:
                    expected = f"noise_{unit} of the study too, against which tests are weighed"
                    raise InputProblem("", f"sd_{unit}", sd, expected)
