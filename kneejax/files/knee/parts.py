"""The parts of a knee file: what every field may be, its mirror image, and what it gives.

Fields stand in the order in which they are written. In a knee file Z points to the person's right
on both sides: laterally on a right knee, medially on a left one. A left knee is mirrored through
its sagittal plane on reading, `z -> -z`, as the marks of the fields say. The reference pose stays
the same, its `lateral_mm` included: it is given by clinical meaning (varus, internal rotation and
lateral are positive on either side).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar, get_args

import numpy as np
from pydantic import BeforeValidator

from kneejax import mechanics
from kneejax.files import reading
from kneejax.files.reading import Mistakes, Number, Part, Text, entries, one_of, reads, text, wrong
from kneejax.geometry import FEMUR, PATELLA, TIBIA, Frame

#: Field of an attachment -> the bone to which it is.
ENDS = {
    "femoral_attachment_mm": FEMUR, "patellar_attachment_mm": PATELLA, "tibial_attachment_mm": TIBIA
}
#: The ways to give a slack length; a ligament has exactly one.
SLACK_FIELDS = ("reference_strain", "slack_length_mm", "reference_force_N")
_M = TypeVar("_M")
ALL_BONES = (FEMUR, TIBIA, PATELLA)
#: Written after the other fields of their part.
_LAST = ("source", "fit_rms_mm", "fit_max_mm")


class Gives(NamedTuple):
    """The attribute of what is built that has the number, where it is not the field's own name."""

    attribute: str


class Mirrored(NamedTuple):
    """How a value of the other side follows from a field's, and from the part it stands in."""

    image: Callable[[Any, Mapping[str, Any]], Any]


class Source(NamedTuple):
    """Of a field that needs no source of its own: whether it has a number, and is built with."""

    number: bool
    builds: bool


#: A number whose source may be missing; a word with which a part is built; any other word or part.
SPARED, WORD, APART = Source(True, True), Source(False, True), Source(False, False)


@functools.cache
def marked(model: type[Part], kind: type[_M]) -> dict[str, _M]:
    """Field -> its mark of a kind; fields without are left out."""

    def marks(*annotations: Any) -> Iterator[_M]:
        for one in annotations:
            if isinstance(one, kind):
                yield one
            yield from marks(*getattr(one, "__metadata__", ()), *get_args(one))

    every = {name: next(marks(*field.metadata, field.annotation), None)
             for name, field in model.model_fields.items()}
    return {name: found for name, found in every.items() if found is not None}


_UNITS = ("_N_per_mm", "_N_s", "_mm2", "_mm", "_deg", "_Nmm", "_N", "_MPa")
#: Fields that no attribute of what is built stands for.
_ELSEWHERE = (*_LAST, "via_points")


@functools.cache
def attributes(model: type[Part]) -> dict[str, str]:
    """Field -> attribute of what is built that has its number."""
    gives, apart = marked(model, Gives), marked(model, Source)
    return {name: gives[name].attribute if name in gives else quantity(name)
            for name in model.model_fields
            if name not in _ELSEWHERE and apart.get(name, SPARED).number}


def quantity(field: str) -> str:
    """`damping_N_s` -> `damping`."""
    unit = next((unit for unit in _UNITS if field.endswith(unit)), "")
    return field.removesuffix(unit)


def negative(x: float) -> float:
    """The other sign, without a negative zero."""
    return 0.0 - x if x == 0 else -x


def signed(*signs: int) -> Mirrored:
    """Of so many numbers, or of each row of a table, the image has these signs."""

    def image(x: Any, part: Any) -> list:
        if not isinstance(x[0], int | float):
            return [image(row, part) for row in x]
        return [negative(one) if sign < 0 else one for one, sign in zip(x, signs, strict=True)]

    return Mirrored(image)


#: Of points and forces; of moments, and of rotations about three axes.
POINTS, TURNS = signed(1, 1, -1), signed(-1, -1, 1)


_texts = reading.mapping_of(lambda value, _: text(value), "a text for each field")


Vector = tuple[float, float, float]
Point = Annotated[Vector, reading.numbers_within(3, "point_mm"), POINTS]
Force = Annotated[Vector, reading.numbers_within(3, "force_N"), POINTS]
Moment = Annotated[Vector, reading.numbers_within(3, "moment_Nmm"), TURNS]


class Sourced(Part):
    """A part with the source of its numbers: a text, or one for each field."""

    makes: ClassVar[Callable[..., Any]]  # the class of what is built of it
    source: Annotated[Any, reads(lambda x: (_texts if isinstance(x, dict) else text)(x))]

    @classmethod
    def __pydantic_init_subclass__(cls, **more: Any) -> None:
        """The source comes last."""
        fields = cls.__pydantic_fields__
        for name in [name for name in _LAST if name in fields]:
            fields[name] = fields.pop(name)

    def built(self, **more: Any) -> Any:
        """What it is in a right knee."""
        frame: dict[str, Any] = {}
        words = [name for name, one in marked(type(self), Source).items() if one == WORD]
        given = {name: getattr(self, name) for name in words} | more
        for field, name in attributes(type(self)).items():
            value = getattr(self, field)
            if value is not None:
                # JAX compiles no conversion for arrays.
                value = np.deg2rad(value) if field.endswith("_deg") else np.array(value, float)
                place, inside, own = name.partition(".")
                (frame if inside else given)[own or place] = value
        return type(self).makes(**given | ({"frame": Frame(**frame)} if frame else {}))

    @reading.checks
    def _check_source(self, mistakes: Mistakes) -> None:
        if isinstance(self.source, dict):
            stated = self.model_fields_set - {"source"}
            given = [name for name in type(self).model_fields if name in stated]
            spared = {*marked(type(self), Source), *self.source}
            for name in (x for x in given if x not in spared):
                mistakes.append(wrong("missing", "this field", at=f"source.{name}"))
            for name in (x for x in self.source if x not in given):
                expected = f"no such field, but one of {', '.join(given)}"
                mistakes.append(wrong(self.source[name], expected, at=f"source.{name}"))


class Via(Part):
    """A point through which a fibre runs."""

    bone: Text
    point_mm: Point


class Course(Sourced):
    """What may run through points, and around an obstacle."""

    def check_bones(self, bones: tuple[str, ...]) -> None:
        """Via points lie on the bones that it joins."""
        mistakes = Mistakes()
        for place, via in enumerate(getattr(self, "via_points", ())):
            with mistakes.gathered(f"via_points[{place}].bone"):
                reading.choice(via.bone, bones)
        mistakes.check()


Vias = Annotated[tuple[Via, ...], entries("via points")]
Wrap = Annotated[Text | None, APART]


class Ligament(Course):
    """A ligament between two bones, which the fields of its attachments name."""

    femoral_attachment_mm: Point | None = None
    via_points: Vias = ()
    patellar_attachment_mm: Point | None = None
    tibial_attachment_mm: Point | None = None
    wrap: Wrap = None
    law: Annotated[str, one_of(mechanics.LIGAMENT_LAWS), WORD] = mechanics.BLANKEVOORT
    stiffness_N: Number
    area_mm2: Number = 0.0
    reference_strain: Number | None = None
    slack_length_mm: Number | None = None
    reference_force_N: Number | None = None
    transition_strain: Number | None = None
    transition_width: Annotated[Number, SPARED]
    failure_strain: Annotated[Number | None, SPARED] = None
    damping_N_s: Number = 0.0

    @property
    def ends(self) -> tuple[str, str]:
        """The fields of its two attachments."""
        first, second = (field for field in ENDS if getattr(self, field) is not None)
        return first, second

    @property
    def slack_field(self) -> str:
        """The field that gives its slack length."""
        return next(field for field in SLACK_FIELDS if getattr(self, field) is not None)

    @reading.checks
    def _check_ligament(self, mistakes: Mistakes) -> None:
        given = [name for name in SLACK_FIELDS if getattr(self, name) is not None]
        if len(given) != 1:
            expected = f"exactly one of {', '.join(SLACK_FIELDS)}"
            mistakes.append(wrong(", ".join(given) or "none", expected))
        ends = [name for name in ENDS if getattr(self, name) is not None]
        if len(ends) != 2:
            mistakes.append(wrong(", ".join(ends) or "none", f"two of {', '.join(ENDS)}"))
        if self.law == mechanics.BLANKEVOORT and self.transition_strain is None:
            mistakes.append(wrong("missing", "this field", at="transition_strain"))
        with mistakes.gathered():
            self.check_bones(tuple(ENDS[end] for end in ends))


def _no_field(value: Any) -> None:
    raise wrong(value, "no such field between femur and tibia")


Absent = Annotated[None, BeforeValidator(_no_field)]


class LigamentOfTwo(Ligament):
    """A ligament between femur and tibia."""

    femoral_attachment_mm: Point  # pyright: ignore[reportGeneralTypeIssues]
    patellar_attachment_mm: Absent = None
    tibial_attachment_mm: Point  # pyright: ignore[reportGeneralTypeIssues]


class Line(Sourced):
    """A line of constant tension."""

    makes = mechanics.ConstantTensionLine
    tension_N: Number
    insertion_mm: Point
    origin_mm: Annotated[Any, reads(reading.rows, 3, mechanics.RANGES["coefficient_mm"]), POINTS]


class Muscle(Course):
    """A muscle from the femur to the patella or the tibia."""

    tension_N: Number
    origin_mm: Annotated[Point, Gives("femoral_attachment")]
    via_points: Vias = ()
    insertion_bone: Annotated[str, one_of((PATELLA, TIBIA)), APART]
    insertion_mm: Annotated[Point, Gives("tibial_attachment")]
    wrap: Wrap = None

    @reading.checks
    def _check_muscle(self, mistakes: Mistakes) -> None:
        self.check_bones((FEMUR, self.insertion_bone))


class LoadOfFile(Sourced):
    """A force and a moment."""

    makes = mechanics.Load
    force_N: Force | None = None
    moment_Nmm: Moment | None = None
    point_mm: Point | None = None
    axes: Annotated[str, one_of(mechanics.AXES), WORD]
    point_in: Annotated[str, one_of(mechanics.BONES), WORD] = TIBIA

    @reading.checks
    def _check_load(self, mistakes: Mistakes) -> None:
        if self.force_N is None and self.moment_Nmm is None:
            mistakes.append(wrong("neither", "force_N, moment_Nmm, or both"))
        for name in ("point_mm", "point_in") if self.force_N is not None else ():
            if name not in self.model_fields_set:
                mistakes.append(wrong("missing", "this field", at=name))
