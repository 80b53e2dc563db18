"""Surfaces, what fibres go around, and contacts of a knee file."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

from kneejax import geometry
from kneejax.files import reading
from kneejax.files.knee import parts
from kneejax.files.knee.parts import APART, WORD, Gives, Mirrored, Point, Sourced
from kneejax.files.reading import Chosen, Mistakes, Number, Part, Text, one_of, reads, wrong
from kneejax.geometry import BASES, CUBIC_SPLINE, FEMUR, PATELLA, POWER, SIDES, TIBIA
from kneejax.mechanics import FORMS, QUADRATURE, RANGES, Contact, Range, Ring, cartilage_law

#: Fields of a contact that hold a surface.
FACES = ("femoral_surface", "patellar_surface", "tibial_surface")
_MOST_POINTS = 1000  # of a contact, along a side
_MOST_CONTROL_VALUES = 200


def model_of(part: Mapping[str, Any]) -> type[Sourced]:
    """The model of a surface, an obstacle or a contact of a knee document."""
    kinds: Mapping[str, type[Sourced]] = OBSTACLES if "bone" in part else SURFACES
    return kinds[part["kind"]] if "kind" in part else ContactPart


def build_surface(part: dict[str, Any]) -> Any:
    """The surface, or what fibres go around, that a part of a knee document is."""
    return model_of(part).model_construct(**part).built()


def _odd(table: Any, part: Mapping[str, Any]) -> Any:
    """Coefficients of odd powers of the width or z; control values of a spline over it."""
    if part.get("basis") == CUBIC_SPLINE:
        return [list(row[::-1]) for row in table]
    return [[parts.negative(c) if j % 2 else c for j, c in enumerate(row)] for row in table]


#: Of places in a plane, forwards and to the right; of limits along Z, or of angles about Y.
_TURNED = parts.signed(1, -1)
_SWAPPED = Mirrored(lambda x, _: [parts.negative(x[1]), parts.negative(x[0])])


def _extent(value: Any) -> tuple[float, float]:
    lower, upper = reading.interval(value, RANGES["point_mm"])
    width = RANGES["size_mm"]
    if not width.holds(upper - lower):
        raise wrong(value, f"a width {width.expected(upper - lower)}")
    return lower, upper


def _angles(value: Any) -> tuple[float, float]:
    lower, upper = reading.interval(value, RANGES["angle_deg"])
    if upper - lower < 10:
        raise wrong(value, "a region at least 10 degrees wide; a narrower one suggests radians")
    return lower, upper


def _outline(value: Any) -> list[tuple[float, ...]]:
    if len(corners := reading.rows(value, 2, RANGES["point_mm"])) < 3:
        raise wrong(value, "at least three corners [anterior, lateral]")
    return corners


Origin = Annotated[Point, Gives("frame.origin")]
Turn = Annotated[parts.Vector, reading.numbers_within(3, "rotation_deg"), parts.TURNS]
Rotation = Annotated[Turn | None, Gives("frame.rotation")]
Extent = Annotated[tuple[float, float], reads(_extent), _SWAPPED]
Table = Annotated[Any, reads(reading.rows, None, RANGES["coefficient_mm"]), Mirrored(_odd)]
Count = Annotated[int, reads(reading.whole, 2, _MOST_POINTS)]
_TWO = reading.entries("numbers of points", count=2)
Size = Annotated[float, reading.within("size_mm")]
SemiAxes = Annotated[parts.Vector, reading.numbers_within(3, "size_mm")]


class Surface(Sourced):
    """A surface of a bone, and how well it was fitted."""

    kind: Annotated[str, APART]
    source: Text
    fit_rms_mm: Annotated[float, reading.within("fit_mm")] | None = None
    fit_max_mm: Annotated[float, reading.within("fit_mm")] | None = None
    # of a table over a region: what its values are, and what the least and the greatest may be
    bounds: ClassVar[tuple[str, Range, Range] | None] = None

    @reading.checks
    def _check_table(self, mistakes: Mistakes) -> None:
        if self.bounds is not None:
            what, least, greatest = self.bounds
            table, spline = self.coefficients_mm, self.basis == CUBIC_SPLINE  # pyright: ignore
            with mistakes.gathered("coefficients_mm"):
                values = (_spline if spline else _powers)(table)
                for value, one in ((values.max(), greatest), (values.min(), least)):
                    if not one.holds(value):
                        expected = f"{what} {one} all over the region{one.hint(value)}"
                        raise wrong([*map(list, table)], expected)


def _powers(table: list[tuple[float, ...]]) -> np.ndarray:
    """A polynomial over its region, at a grid of points."""
    s = np.linspace(-1.0, 1.0, 25)
    if max(np.shape(table)) > 13:
        raise wrong([*map(list, table)], "powers up to 12")
    return np.polynomial.polynomial.polygrid2d(s, s, np.array(table))


def _spline(table: list[tuple[float, ...]]) -> np.ndarray:
    """A cubic spline at its knots."""
    values = np.array(table)
    if min(values.shape) < 4 or max(values.shape) > _MOST_CONTROL_VALUES:
        expected = f"rows and columns of 4 to {_MOST_CONTROL_VALUES} control values of a spline"
        raise wrong([*map(list, table)], expected)
    for _ in range(2):  # along either variable
        values = ((values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0).T
    return values


class Condyle(Surface):
    """A radius over the angle about an axis, and along it."""

    makes = geometry.Condyle
    bounds = "a radius", RANGES["corner_radius_mm"], RANGES["radius_mm"]
    axis_point_mm: Origin
    axis_rotation_deg: Rotation = None
    basis: Annotated[str, one_of(BASES), WORD] = POWER
    angle_deg: Annotated[tuple[float, float], reads(_angles)]
    width_mm: Extent
    coefficients_mm: Table


class Plateau(Surface):
    """A height over a plane."""

    makes = geometry.Plateau
    bounds = "a height", RANGES["point_mm"], RANGES["point_mm"]
    origin_mm: Origin
    rotation_deg: Rotation = None
    basis: Annotated[str, one_of(BASES), WORD] = POWER
    outline_mm: Annotated[Any, reads(_outline), _TURNED] = None
    anterior_mm: Annotated[tuple[float, float], reads(_extent), Gives("x")]
    lateral_mm: Annotated[Extent, Gives("z")]
    coefficients_mm: Table


class PlaneSurface(Surface):
    """A rectangle."""

    makes = geometry.Plane
    origin_mm: Origin
    rotation_deg: Rotation = None
    half_extent_mm: Annotated[tuple[float, float], reading.numbers_within(2, "size_mm")]


class SphereSurface(Surface):
    """A sphere."""

    makes = geometry.Sphere
    center_mm: Origin
    radius_mm: Size


class EllipsoidSurface(Surface):
    """An ellipsoid."""

    makes = geometry.Ellipsoid
    center_mm: Origin
    rotation_deg: Rotation = None
    semi_axes_mm: SemiAxes


class Obstacle(Sourced):
    """What fibres go around."""

    kind: Annotated[str, APART]
    bone: Annotated[str, one_of(parts.ALL_BONES), APART]
    center_mm: Origin
    rotation_deg: Rotation = None


class SphereObstacle(Obstacle):
    """A sphere."""

    makes = geometry.WrapSphere
    radius_mm: Size


class CylinderObstacle(Obstacle):
    """A cylinder, and the side on which fibres run if one is meant."""

    makes = geometry.WrapCylinder
    radius_mm: Size
    length_mm: Size
    side: Annotated[str, one_of(SIDES), WORD] = ""


class EllipsoidObstacle(Obstacle):
    """An ellipsoid."""

    makes = geometry.WrapEllipsoid
    semi_axes_mm: SemiAxes


#: Kind of a surface, or of an obstacle -> its model.
SURFACES: dict[str, type[Surface]] = {
    "condyle": Condyle, "plateau": Plateau, "plane": PlaneSurface, "sphere": SphereSurface,
    "ellipsoid": EllipsoidSurface,
}  # fmt: skip
OBSTACLES: dict[str, type[Obstacle]] = {
    "sphere": SphereObstacle, "cylinder": CylinderObstacle, "ellipsoid": EllipsoidObstacle,
}  # fmt: skip


def _by_kind(models: Mapping[str, type[Part]]) -> Chosen:
    def model(value: Any) -> type[Part]:
        if not isinstance(value, dict) or "kind" not in value:
            raise wrong(value, f"a mapping with the field kind, one of {', '.join(models)}")
        if not isinstance(kind := value["kind"], str) or kind not in models:
            raise wrong(kind, models, at="kind")
        return models[kind]

    return Chosen(model)


AnySurface = Annotated[Surface, _by_kind(SURFACES)]
AnyObstacle = Annotated[Obstacle, _by_kind(OBSTACLES)]
#: By how much a meniscus may reach beyond its horns: what lies there bears nothing.
_BEYOND_HORNS_DEG = 1.0


def _horns(value: Any) -> tuple[float, float]:
    begin, end = reading.numbers(value, 2, RANGES["rotation_deg"])
    if not 10.0 <= end - begin < 360.0:
        raise wrong(value, "two angles, the second larger by 10 degrees at least, less than 360")
    return begin, end


class RingPart(parts.Built):
    """What holds a meniscus from horn to horn; without it a rim stands still."""

    makes = Ring
    youngs_modulus_MPa: Number
    cross_section_mm2: Number
    horn_stiffness_N_per_mm: Number
    coronary_stiffness_N_per_mm: Number
    middle_mm: Annotated[tuple[float, float], reading.numbers_within(2, "point_mm"), _TURNED]
    horns_deg: Annotated[tuple[float, float], reads(_horns), _SWAPPED]
    sections: Annotated[int, reads(reading.whole, 2, 60), WORD] = 12

    def beyond_horns(self, outline_mm: list[tuple[float, ...]]) -> float:
        """How far an outline reaches beyond the nearer horn, degrees."""
        forwards, right = (np.asarray(outline_mm) - self.middle_mm).T
        begin, end = self.horns_deg
        turned = np.rad2deg(np.arctan2(right, forwards)) - 0.5 * (begin + end)
        return float(np.max(np.abs((turned + 180.0) % 360.0 - 180.0)) - 0.5 * (end - begin))


class ContactPart(Sourced):
    """A contact of two surfaces with cartilage."""

    makes = Contact
    form: Annotated[str, one_of(FORMS), WORD]
    points: Annotated[tuple[Count, ...], _TWO, WORD] = reading.meaning(
        "along both parameters of the surface; of a ring along its arc and across it", (24, 24))
    law: Annotated[str, one_of(cartilage_law.LAWS), WORD]
    youngs_modulus_MPa: Number
    poisson_ratio: Number
    layer_thickness_mm: Number
    layer_variation_mm: Annotated[Table, parts.SPARED] = None
    onset_width_mm: Annotated[Number, parts.SPARED]
    ring: Annotated[RingPart | None, APART] = None
    femoral_surface: Annotated[AnySurface, APART]
    patellar_surface: Annotated[AnySurface | None, APART] = None
    tibial_surface: Annotated[AnySurface | None, APART] = None

    @property
    def other_face(self) -> str:
        """The field of the surface that meets the femur's."""
        return FACES[2] if self.patellar_surface is None else FACES[1]

    def built(self, **more: Any) -> Contact:
        """The contact in a right knee."""
        bodies = FEMUR, TIBIA if self.patellar_surface is None else PATELLA
        femoral, other = self.femoral_surface.built(), getattr(self, self.other_face).built()
        if self.ring is not None:
            more["ring"] = self.ring.built()
        return super().built(femoral=femoral, tibial=other, bodies=bodies, **more)

    @reading.checks
    def _check_layer(self, mistakes: Mistakes) -> None:
        for name in ("points", "layer_variation_mm", "ring"):
            if name in self.model_fields_set and self.form != QUADRATURE:
                expected = f"no {name} unless form is {QUADRATURE}"
                mistakes.append(wrong(getattr(self, name), expected, at=name))
        if self.ring is not None:
            face = self.other_face
            outline = getattr(getattr(self, face), "outline_mm", None)
            if outline is None:
                expected = "a plateau with outline_mm, that of the meniscus, since there is a ring"
                mistakes.append(wrong(getattr(self, face).kind, expected, at=face))
            elif (beyond := self.ring.beyond_horns(outline)) > _BEYOND_HORNS_DEG:
                expected = "horns between which all of outline_mm lies, seen from middle_mm; it "
                expected += f"reaches {beyond:.3g} degrees beyond"
                mistakes.append(wrong([*self.ring.horns_deg], expected, at="ring.horns_deg"))
        if (table := self.layer_variation_mm) is not None:
            with mistakes.gathered("layer_variation_mm"):
                allowed = RANGES["layer_thickness_mm"]
                layer = self.layer_thickness_mm + _powers(table)
                if not (allowed.holds(layer.min()) and allowed.holds(layer.max())):
                    raise wrong([*map(list, table)], f"a layer {allowed} all over the region")


class TibialContact(ContactPart):
    """A contact of femur and tibia."""

    patellar_surface: parts.Absent = None
    tibial_surface: Annotated[AnySurface, APART]  # pyright: ignore[reportGeneralTypeIssues]


class PatellarContact(ContactPart):
    """A contact of femur and patella."""

    patellar_surface: Annotated[AnySurface, APART]  # pyright: ignore[reportGeneralTypeIssues]
    tibial_surface: parts.Absent = None
