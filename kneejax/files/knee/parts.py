"""The parts of a knee file: what every field may be, its mirror image, and what it gives.

Fields stand in the order in which they are written. In a knee file Z points to the person's right
on both sides: laterally on a right knee, medially on a left one. A left knee is mirrored through
its sagittal plane on reading, `z -> -z`, as the marks of the fields say. The reference pose stays
the same, its `lateral_mm` included: it is given by clinical meaning (varus, internal rotation and
lateral are positive on either side).
"""

import functools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, get_args

import numpy as np
from pydantic import BeforeValidator

from kneejax import mechanics
from kneejax.files import reading
from kneejax.files.reading import Mistakes, Number, Part, Text, entries, one_of, reads, text, wrong
from kneejax.geometry import FEMUR, PATELLA, TIBIA, Frame
from kneejax.mechanics import BLANKEVOORT, LIGAMENT_LAWS, RANGES, AttachmentArea

#: Field of an attachment -> the bone to which it is.
ENDS = {
    "femoral_attachment_mm": FEMUR, "patellar_attachment_mm": PATELLA, "tibial_attachment_mm": TIBIA
}
#: The ways to give a slack length; a ligament has exactly one.
SLACK_FIELDS = ("reference_strain", "slack_length_mm", "reference_force_N")
ALL_BONES = (FEMUR, TIBIA, PATELLA)
#: Written after the other fields of their part.
_LAST = ("source", "fit_rms_mm", "fit_max_mm")


class Gives(NamedTuple):
    """Which attribute of what is built has the number, where it is not the field's own name."""

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
def marked(model: type[Part], kind: type) -> dict[str, Any]:
    """Field -> its mark of a kind; fields without are left out."""

    def marks(*annotations: Any) -> Iterator[Any]:
        for one in annotations:
            if isinstance(one, kind):
                yield one
            yield from marks(*getattr(one, "__metadata__", ()), *get_args(one))

    return {name: found for name, field in model.model_fields.items()
            if (found := next(marks(*field.metadata, field.annotation), None)) is not None}


_UNIT = re.compile(r"_(N_per_mm|N_s|mm2?|deg|Nmm|N|MPa)$")
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
    return _UNIT.sub("", field)


def mirror(side: str) -> np.ndarray:
    """Signs of coordinates of a side's knee that make it a right one."""
    return np.array([1.0, 1.0, -1.0 if side == "left" else 1.0])


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


class Built(Part):
    """A part of which something is built."""

    makes: ClassVar[Callable[..., Any]]  # its class

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


class Sourced(Built):
    """A part with the source of its numbers: a text, or one for each field."""

    source: Annotated[Any, reads(lambda x: (_texts if isinstance(x, dict) else text)(x))]

    @classmethod
    def __pydantic_init_subclass__(cls, **more: Any) -> None:
        """The source comes last."""
        fields = cls.__pydantic_fields__
        for name in [name for name in _LAST if name in fields]:
            fields[name] = fields.pop(name)

    @reading.checks
    def _check_source(self, mistakes: Mistakes) -> None:
        if isinstance(self.source, dict):
            given = [x for x in type(self).model_fields if x in self.model_fields_set - {"source"}]
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


def _check_via_points(of: "Ligament | Muscle", mistakes: Mistakes) -> None:
    """They lie on the bones that it joins."""
    for place, via in enumerate(of.via_points):
        with mistakes.gathered(f"via_points[{place}].bone"):
            reading.choice(via.bone, of.bones)


Vias = Annotated[tuple[Via, ...], entries("via points")]
Wrap = Annotated[Text | None, APART]


class Ligament(Sourced):
    """A ligament between two bones, which the fields of its attachments name."""

    femoral_attachment_mm: Point | None = None
    via_points: Vias = ()
    patellar_attachment_mm: Point | None = None
    tibial_attachment_mm: Point | None = None
    wrap: Wrap = None
    law: Annotated[str, one_of(LIGAMENT_LAWS), WORD] = BLANKEVOORT
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
    def ends(self) -> list[str]:
        """The fields of its two attachments."""
        return self._given(ENDS)

    @property
    def bones(self) -> tuple[str, ...]:
        """Those of its attachments."""
        return tuple(ENDS[end] for end in self.ends)

    @property
    def slack_field(self) -> str:
        """The field that gives its slack length."""
        return self._given(SLACK_FIELDS)[0]

    def _given(self, fields: Iterable[str]) -> list[str]:
        return [name for name in fields if getattr(self, name) is not None]

    @reading.checks
    def _check_ligament(self, mistakes: Mistakes) -> None:
        if len(given := self._given(SLACK_FIELDS)) != 1:
            expected = f"exactly one of {', '.join(SLACK_FIELDS)}"
            mistakes.append(wrong(", ".join(given) or "none", expected))
        if len(self.ends) != 2:
            mistakes.append(wrong(", ".join(self.ends) or "none", f"two of {', '.join(ENDS)}"))
        if self.law == BLANKEVOORT and self.transition_strain is None:
            mistakes.append(wrong("missing", "this field", at="transition_strain"))
        _check_via_points(self, mistakes)


#: Fields whose numbers stand in an array of fibres.
OF_FIBRE = tuple(x for x in attributes(Ligament) if x not in (*ENDS, *SLACK_FIELDS))


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
    origin_mm: Annotated[Any, reads(reading.rows, 3, RANGES["coefficient_mm"]), POINTS]


class Muscle(Sourced):
    """A muscle from the femur to the patella or the tibia."""

    tension_N: Number
    origin_mm: Annotated[Point, Gives("femoral_attachment")]
    via_points: Vias = ()
    insertion_bone: Annotated[str, one_of((PATELLA, TIBIA)), APART]
    insertion_mm: Annotated[Point, Gives("tibial_attachment")]
    wrap: Wrap = None

    @property
    def bones(self) -> tuple[str, ...]:
        """Those of its origin and insertion."""
        return FEMUR, self.insertion_bone

    @reading.checks
    def _check_muscle(self, mistakes: Mistakes) -> None:
        _check_via_points(self, mistakes)


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


#: Fibres of a band at most.
_MOST_FIBRES = 400
_ELLIPSE = ("centre_mm", "half_axes_mm")
_PLACES = reads(reading.rows, 3, RANGES["point_mm"])
#: Half of an area -> the direction in which it lies, in axes of a right knee.
_HALVES = {
    "anterior": (1.0, 0.0, 0.0), "posterior": (-1.0, 0.0, 0.0), "proximal": (0.0, 1.0, 0.0),
    "distal": (0.0, -1.0, 0.0), "lateral": (0.0, 0.0, 1.0), "medial": (0.0, 0.0, -1.0),
}  # fmt: skip


class Area(Part):
    """Where a band is attached, in its bone's frame: an ellipse, or an outline; or half of it."""

    centre_mm: Point | None = None
    half_axes_mm: Annotated[Any, _PLACES, entries("two half diameters", count=2), POINTS] = None
    outline_mm: Annotated[Any, _PLACES, POINTS] = None
    half: Annotated[str, one_of(_HALVES)] | None = None

    @reading.checks
    def _check_area(self, mistakes: Mistakes) -> None:
        given = [x for x in (*_ELLIPSE, "outline_mm") if getattr(self, x) is not None]
        if given not in ([*_ELLIPSE], ["outline_mm"]):
            raise wrong(", ".join(given) or "none", f"{' and '.join(_ELLIPSE)}, or outline_mm")
        try:
            self.ellipse()
        except ValueError as problem:
            raise wrong(self.outline_mm, f"an outline around an area ({problem})") from None

    def ellipse(self, side: str = "right") -> AttachmentArea:
        """Its ellipse, or that of its half, in a knee of a side."""
        if self.outline_mm is not None:
            whole = AttachmentArea.of_outline(self.outline_mm)
        else:
            whole = AttachmentArea(np.array(self.centre_mm), np.array(self.half_axes_mm))
        return whole if self.half is None else whole.half(_HALVES[self.half] * mirror(side))


def _prestretch(value: Any) -> float | tuple[float, ...]:
    allowed, several = RANGES["prestretch"], isinstance(value, list)
    return reading.numbers(value, 2, allowed) if several else reading.number(value, allowed)


class Band(Sourced):
    """A ligament between two areas, of a material."""

    femoral_area: Area
    tibial_area: Area
    youngs_modulus_MPa: Number
    area_mm2: Number
    prestretch: Annotated[Any, reads(_prestretch)]
    law: Annotated[str, one_of(LIGAMENT_LAWS)]
    transition_strain: Number | None = None
    transition_width: Number
    failure_strain: Number | None = None
    damping_N_s: Number = 0.0
    wrap: Text | None = None
    fibres: Annotated[int, reads(reading.whole, 1, _MOST_FIBRES)] = 24

    @reading.checks
    def _check_band(self, mistakes: Mistakes) -> None:
        strain = self.transition_strain
        if (self.law == BLANKEVOORT) == (strain is None):
            expected = f"a transition strain with the law {BLANKEVOORT}, and only with that"
            given = "missing" if strain is None else strain
            mistakes.append(wrong(given, expected, at="transition_strain"))


def fibre_names(name: str, band: Band) -> tuple[str, ...]:
    """Names of a band's fibres: its own with a number."""
    return tuple(f"{name}{row + 1:0{len(str(band.fibres))}d}" for row in range(band.fibres))
