"""The model of a knee file, and the document as text, of the other side, with its sources."""

__all__ = ["format_knee", "mirror_document"]

import copy
import fnmatch
import os
from collections.abc import Callable, Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import Field, create_model

from kneejax.files import reading
from kneejax.files._bundled import bundled_files, bundled_path
from kneejax.files.knee import parts
from kneejax.files.knee import surfaces as faces
from kneejax.files.reading import Chosen, InputProblem, Mistakes, Name, Part, Text, reads, wrong
from kneejax.geometry import BODIES, PATELLA, TIBIA
from kneejax.mechanics import BONES, RANGES

#: Version of the format that this package reads and writes.
VERSION = 1


def _pose(bone: str) -> type[Part]:
    """The model of a bone's pose: one number a column."""
    fields: dict[str, Any] = {}
    for one in BODIES[bone].values():
        kind = "flexion_deg" if one.column == "flexion_deg" else f"{one.way}_{one.unit}"
        fields[one.column] = (Annotated[float, reads(reading.number, RANGES[kind])], ...)
    return create_model(f"{bone}_pose", __base__=Part, **fields, source=(Text, ""))


TibiaPose, PatellaPose = _pose(TIBIA), _pose(PATELLA)


def _version(value: Any) -> int:
    if reading.whole(value, 1) != VERSION:
        raise wrong(value, f"{VERSION}, the version of the format")
    return value


class Adaptation(Part):
    """A change of a published value."""

    field: Text
    before: Any = Field(alias="from")
    to: Any
    reason: Text


class Origin(Part):
    """The model that a knee came from; names only where they differ from the knee's."""

    file: Text
    sha256: Text
    side: Text
    femur: Text
    tibia: Text
    ligaments: Annotated[dict[Name, Text], reading.named("the model's name")] = {}
    wraps: Annotated[dict[Name, Text], reading.named("the model's name")] = {}


_PATTERNS = "names of ligaments, or patterns such as ACL*"
Group = Annotated[tuple[Text, ...], reading.entries(_PATTERNS)]
Obstacles = Annotated[dict[Name, faces.AnyObstacle], reading.named("an obstacle")]


class Patella(Part):
    """The patella: its pose, and all parts that join it, with the muscles."""

    reference_pose: PatellaPose  # pyright: ignore[reportInvalidTypeForm]
    ligaments: Annotated[dict[Name, parts.Ligament], reading.named("a ligament")]
    contacts: Annotated[dict[Name, faces.PatellarContact], reading.named("a contact", empty=True)]
    muscles: Annotated[dict[Name, parts.Muscle], reading.named("a muscle")]
    wraps: Obstacles = {}

    @reading.checks
    def _check_patella(self, mistakes: Mistakes) -> None:
        _check_wraps(self, ("ligaments", "muscles"), mistakes)
        if not any(x.tension_N for x in self.muscles.values() if x.insertion_bone == PATELLA):
            expected = "a quadriceps, inserted on the patella, whose tension at rest is above 0"
            mistakes.append(wrong("none", expected, at="muscles"))


class SameAs(Part):
    """A patella that is that of a bundled knee in the same frames."""

    same_as: Annotated[str, reads(lambda name: reading.choice(name, bundled_files("knees")))]
    source: Any = None


class Surfaces(Part):
    """Articular surfaces that no contact uses yet."""

    patella: faces.AnySurface | None = None


class KneeDocument(Part):
    """All that a knee file may say."""

    kneejax: Annotated[int, reads(_version)]
    name: Text
    side: Annotated[str, reading.one_of(("right", "left"))]
    description: Text
    reference_pose: TibiaPose  # pyright: ignore[reportInvalidTypeForm]
    # A model without meshes has no contacts yet, meshes alone have no ligaments.
    ligaments: Annotated[dict[Name, parts.LigamentOfTwo], reading.named("a ligament", empty=True)]
    contacts: Annotated[dict[Name, faces.TibialContact], reading.named("a contact", empty=True)]
    patella: Annotated[Patella | SameAs, Chosen(
        lambda x: SameAs if isinstance(x, dict) and "same_as" in x else Patella)] | None = None
    surfaces: Surfaces = Surfaces()
    bands: Annotated[dict[Name, parts.Band], reading.named("a band")] = {}
    wraps: Obstacles = {}
    groups: Annotated[dict[Name, Group], reading.named("a list of ligaments")] = {}
    lines: Annotated[dict[Name, parts.Line], reading.named("one of the lines")] = {}
    loads: Annotated[dict[Name, parts.LoadOfFile], reading.named("one of the loads")] = {}
    adaptations: Annotated[tuple[Adaptation, ...], reading.entries("adaptations")] = ()
    notes: Text = ""
    imported_from: Origin | None = None

    @reading.checks
    def _check_names(self, mistakes: Mistakes) -> None:
        fibres = [one for item in self.bands.items() for one in parts.fibre_names(*item)]
        known = (*self.ligaments, *fibres)
        if not known and not self.contacts:
            expected = "a mapping from a name to a ligament, or contacts"
            mistakes.append(wrong({}, expected, at="ligaments"))
        for name in sorted({*fibres, *self.bands} & {*self.ligaments, *self.groups}):
            expected = "a band whose name, alone or with a number, no ligament or group has"
            mistakes.append(wrong(name, expected, at="bands"))
        taken = {*known, *self.groups}
        for section in ("contacts", "lines"):
            for name in sorted(taken.intersection(getattr(self, section))):
                expected = "a name that no other part of the knee has"
                mistakes.append(wrong(name, expected, at=section))
            taken |= {*getattr(self, section)}
        _check_wraps(self, ("ligaments", "bands"), mistakes)
        for name, wrap in self.wraps.items():
            with mistakes.gathered(f"wraps.{name}.bone"):
                reading.choice(wrap.bone, BONES)
        for name, group in self.groups.items():
            if name in known:
                expected = "a group's name that is not a ligament's"
                mistakes.append(wrong([*group], expected, at=f"groups.{name}"))
            for place, pattern in enumerate(group):
                if not fnmatch.filter(known, pattern):
                    expected = "the name of a ligament, or a pattern that fits one"
                    mistakes.append(wrong(pattern, expected, known, f"groups.{name}[{place}]"))


def _check_wraps(of: Any, sections: tuple[str, ...], mistakes: Mistakes) -> None:
    known = of.wraps or ("none: the file has no section wraps",)
    for place, one in ((f"{x}.{name}.wrap", one) for x in sections
                       for name, one in getattr(of, x).items() if one.wrap is not None):
        with mistakes.gathered(place):
            reading.choice(one.wrap, known)


def sources_of(part: Part, at: str = "") -> Iterator[tuple[str, str]]:
    """Place of each field (or of a part with all its fields), and its source."""
    for name, value in part:
        place = f"{at}.{name}" if at else name
        if isinstance(value, SameAs):
            yield place, f"the patella of {value.same_as}"
        elif isinstance(value, Part):
            yield from sources_of(value, place)
        elif name == "source" and isinstance(value, dict):
            yield from ((f"{at}.{field}", text) for field, text in value.items())
        elif name == "source" and value:
            yield at, value
        elif isinstance(value, dict):
            for own, one in value.items():
                yield from sources_of(one, f"{place}.{own}") if isinstance(one, Part) else ()


def check_knee(document: Any, file: str | os.PathLike[str] = "") -> KneeDocument:
    """Check every field of a knee document, which stands in a file; raises where one is missing,
    unknown, or out of range, with all mistakes."""
    file = os.fspath(file)
    if not isinstance(document, dict):
        raise InputProblem(file, "file", document, "a mapping with the fields of a knee")
    if isinstance(kind := document.get("kneejax"), str):
        expected = f"{VERSION}, as in a knee file; this file holds a {kind}"
        raise InputProblem(file, "kneejax", kind, expected)
    mistakes, patella, others = Mistakes(file), document.get("patella"), document.get("ligaments")
    own = patella.get("ligaments") if isinstance(patella, dict) else None
    if isinstance(own, dict) and isinstance(others, dict):
        for name in (x for x in own if x in others):
            expected = "a name that no ligament between femur and tibia has"
            mistakes.keep(wrong(own[name], expected, at=f"patella.ligaments.{name}"))
    with mistakes.gathered():
        read = reading.checked(KneeDocument, document, file)
    mistakes.check()
    return read  # pyright: ignore[reportPossiblyUnboundVariable]


def format_knee(document: dict[str, Any]) -> str:
    """Write a knee document as text.

    Args:
        document: content of a knee file; NumPy numbers and arrays may stand in it.

    Returns:
        YAML with fields in the order of the format, names in the order given, every float with
        the digits that it has; the same text for the same document.

    Example:
        >>> print(format_knee({"side": "right", "name": "small", "kneejax": 1}), end="")
        kneejax: 1
        name: small
        side: right
    """
    return reading.format_yaml(plain_document(document))


def plain_document(document: dict[str, Any]) -> dict[str, Any]:
    """A knee document of Python's own numbers, texts and lists, in the order of the format."""
    return _walked(KneeDocument, reading.plain(document), lambda value, marks, part: value)


def mirror_document(document: dict[str, Any]) -> dict[str, Any]:
    """The other side's twin of a knee document.

    Args:
        document: content of a knee file, of either side.

    Returns:
        A new document of the other side; mirroring it again gives the first one back.

    Example:
        >>> document = {"side": "right", "loads": {"push": {"force_N": [1.0, 2.0, 3.0]}}}
        >>> mirror_document(document)
        {'side': 'left', 'loads': {'push': {'force_N': [1.0, 2.0, -3.0]}}}
    """
    side = "left" if document["side"] == "right" else "right"
    return _walked(KneeDocument, document | {"side": side}, _image)


def mirror_part(part: dict[str, Any]) -> dict[str, Any]:
    """The other side's twin of a contact, an obstacle or a surface of a knee document."""
    return _walked(faces.model_of(part), part, _image)


def with_own_patella(document: dict[str, Any]) -> dict[str, Any]:
    """The document of a knee with a patella, with the section itself where it says that it is the
    same as another knee's."""
    same_as = document["patella"].get("same_as")
    if same_as is None:
        return document
    whole = reading.load_yaml(bundled_path("knees", same_as), "a knee file")
    own = whole if whole["side"] == document["side"] else mirror_document(whole)
    return document | {"patella": own["patella"]}


def _image(value: Any, marks: tuple[Any, ...], part: Mapping[str, Any]) -> Any:
    for mark in marks:
        if isinstance(mark, parts.Mirrored):
            return mark.image(value, part)
    return copy.deepcopy(value)


#: Takes a value, the marks of its field, and the mapping in which it stands.
_Change = Callable[[Any, tuple[Any, ...], Mapping[str, Any]], Any]


def _walked(model: type[Part], part: Any, change: _Change) -> Any:
    """A part with its fields in the order of the model, each of them changed."""
    if not isinstance(part, dict):
        return part
    fields = {field.alias or name: (field.annotation, tuple(field.metadata))
              for name, field in model.model_fields.items()}
    names = [*(x for x in fields if x in part), *(x for x in part if x not in fields)]
    return {x: _inside(*fields.get(x, (None, ())), part[x], change, part) for x in names}


def _inside(
    kind: Any, marks: tuple[Any, ...], value: Any, change: _Change, part: Mapping[str, Any]
) -> Any:
    """What stands in a field of this type, changed."""
    origin, inner = get_origin(kind), get_args(kind)
    for mark in (x for x in marks if isinstance(x, Chosen)):
        try:
            return _walked(mark.model(value), value, change)
        except InputProblem:
            return value
    if origin in (Annotated, Union, UnionType):
        marks = (*marks, *inner[1:]) if origin is Annotated else marks
        return _inside(inner[0], marks, value, change, part)
    if isinstance(kind, type) and issubclass(kind, Part):
        return _walked(kind, value, change)
    if origin is dict and isinstance(value, dict):
        return {name: _inside(inner[1], (), one, change, value) for name, one in value.items()}
    if origin is tuple and inner[1:] == (...,) and isinstance(value, list):
        return [_inside(inner[0], (), one, change, part) for one in value]
    return change(value, marks, part)
