"""What the parts of a knee file may say: ligaments, contacts, surfaces, obstacles, lines, loads."""

from __future__ import annotations

import numpy as np

from kneejax.files.reading import Field
from kneejax.geometry import BASES, BODIES, CUBIC_SPLINE, FEMUR, PATELLA, SIDES, TIBIA
from kneejax.mechanics import AXES, BONES, FORMS, QUADRATURE, RANGES, Range, cartilage_law

#: Bone -> fields of its pose.
POSE_FIELDS = {
    bone: (*(one.column for one in coordinates.values()), "source")
    for bone, coordinates in BODIES.items()
}
#: The ways to give a slack length; a ligament has exactly one.
SLACK_FIELDS = ("reference_strain", "slack_length_mm", "reference_force_N")
#: Field of an attachment -> the bone to which it is.
ENDS = {
    "femoral_attachment_mm": FEMUR,
    "patellar_attachment_mm": PATELLA,
    "tibial_attachment_mm": TIBIA,
}
LIGAMENT_FIELDS = (
    "femoral_attachment_mm",
    "via_points",
    "patellar_attachment_mm",
    "tibial_attachment_mm",
    "wrap",
    "stiffness_N",
    *SLACK_FIELDS,
    "transition_strain",
    "transition_width",
    "failure_strain",
    "damping_N_s",
    "source",
)
_OPTIONAL_OF_LIGAMENT = ("via_points", "wrap", "failure_strain", "damping_N_s", *SLACK_FIELDS)
_FEMUR_AND_TIBIA = ("femoral_attachment_mm", "tibial_attachment_mm")
VIA_FIELDS = ("bone", "point_mm")
CONTACT_FIELDS = (
    "form",
    "points",
    "law",
    "youngs_modulus_MPa",
    "poisson_ratio",
    "layer_thickness_mm",
    "layer_variation_mm",
    "onset_width_mm",
    "femoral_surface",
    "patellar_surface",
    "tibial_surface",
    "source",
)
#: Fields of a contact that hold a surface.
FACES = ("femoral_surface", "patellar_surface", "tibial_surface")
#: Kind of obstacle -> the sizes that it must have.
WRAPS: dict[str, tuple[str, ...]] = {
    "sphere": ("radius_mm",),
    "cylinder": ("radius_mm", "length_mm"),
    "ellipsoid": ("semi_axes_mm",),
}
WRAP_FIELDS = (
    "kind",
    "bone",
    "center_mm",
    "rotation_deg",
    "semi_axes_mm",
    "radius_mm",
    "length_mm",
    "side",
    "source",
)
LINE_FIELDS = ("tension_N", "insertion_mm", "origin_mm", "source")
MUSCLE_FIELDS = (
    "tension_N",
    "origin_mm",
    "via_points",
    "insertion_bone",
    "insertion_mm",
    "wrap",
    "source",
)
LOAD_FIELDS = ("force_N", "moment_Nmm", "point_mm", "axes", "point_in", "source")
#: Kind of surface -> the fields it must have and those it may have.
SURFACES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "condyle": (
        ("axis_point_mm", "angle_deg", "width_mm", "coefficients_mm"),
        ("axis_rotation_deg", "basis"),
    ),
    "plateau": (
        ("origin_mm", "anterior_mm", "lateral_mm", "coefficients_mm"),
        ("rotation_deg", "basis", "outline_mm"),
    ),
    "plane": (("origin_mm", "half_extent_mm"), ("rotation_deg",)),
    "sphere": (("center_mm", "radius_mm"), ()),
    "ellipsoid": (("center_mm", "semi_axes_mm"), ("rotation_deg",)),
}
SURFACE_EXTRAS = ("source", "fit_rms_mm", "fit_max_mm")

_SIZES = {"half_extent_mm": 2, "semi_axes_mm": 3}  # others are one number
_MOST_CONTROL_VALUES = 200
_MOST_POINTS = 1000  # of a contact, along a side


def check_pose(pose: Field, sources: dict[str, str], body: str = TIBIA) -> None:
    """Check a pose of a bone: one number a column."""
    columns = {one.column: f"{one.way}_{one.unit}" for one in BODIES[body].values()}
    pose.mapping(tuple(columns), ("source",))
    for column, kind in columns.items():
        pose[column].number(RANGES["flexion_deg" if column == "flexion_deg" else kind])
    if "source" in pose:
        sources[pose.path] = pose["source"].text()


def check_ligament(
    ligament: Field,
    sources: dict[str, str],
    wraps: tuple[str, ...],
    ends: tuple[str, ...] = _FEMUR_AND_TIBIA,
) -> None:
    """Check a ligament between two bones, which the fields of its attachments name."""
    others = (*_OPTIONAL_OF_LIGAMENT, *ENDS)
    required = [name for name in LIGAMENT_FIELDS if name not in others]
    ligament.mapping((*ends, *required), _OPTIONAL_OF_LIGAMENT)
    for end in ends:
        check_point(ligament[end])
    check_course(ligament, wraps, tuple(ENDS[end] for end in ends))
    if "damping_N_s" in ligament:
        ligament["damping_N_s"].number(RANGES["damping_N_s"])
    given = [name for name in SLACK_FIELDS if name in ligament]
    if len(given) != 1:
        what = f"exactly one of {', '.join(SLACK_FIELDS)}"
        raise Field(ligament.file, ligament.path, ", ".join(given) or "none").problem(what)
    for name in ("stiffness_N", given[0], "transition_strain", "transition_width"):
        ligament[name].number(RANGES[name])
    if "failure_strain" in ligament:
        ligament["failure_strain"].number(RANGES["failure_strain"])
    check_source(ligament, sources, without=("transition_width", "failure_strain", "wrap"))


def check_course(part: Field, wraps: tuple[str, ...], bones: tuple[str, ...]) -> None:
    """Check via points and obstacle of what runs between two bones."""
    for via in part["via_points"].items("via points") if "via_points" in part else ():
        via.mapping(VIA_FIELDS)["bone"].choice(bones)
        check_point(via["point_mm"])
    if "wrap" in part:
        part["wrap"].choice(wraps or ("none: the file has no section wraps",))


def check_wrap(wrap: Field, sources: dict[str, str], bones: tuple[str, ...] = BONES) -> None:
    """Check what fibres go around."""
    if not isinstance(wrap.value, dict) or "kind" not in wrap:
        raise wrap.problem(f"a mapping with the field kind, one of {', '.join(WRAPS)}")
    sizes = WRAPS[wrap["kind"].choice(WRAPS)]
    side = ("side",) if wrap["kind"].value == "cylinder" else ()
    wrap.mapping(("kind", "bone", "center_mm", *sizes, "source"), ("rotation_deg", *side))
    wrap["bone"].choice(bones)
    check_point(wrap["center_mm"])
    if "rotation_deg" in wrap:
        wrap["rotation_deg"].numbers(3, RANGES["rotation_deg"])
    for name in sizes:
        _check_size(wrap[name])
    if "side" in wrap:
        wrap["side"].choice(tuple(SIDES))
    check_source(wrap, sources, without=("kind", "bone", "side"))


def check_contact(
    contact: Field,
    sources: dict[str, str],
    faces: tuple[str, ...] = ("femoral_surface", "tibial_surface"),
) -> None:
    """Check a contact of two surfaces."""
    optional = ("points", "layer_variation_mm")
    required = [name for name in CONTACT_FIELDS if name not in (*optional, *FACES)]
    contact.mapping((*required, *faces), optional)
    form = contact["form"].choice(FORMS)
    for name in optional:
        if name in contact and form != QUADRATURE:
            raise contact[name].problem(f"no {name} unless form is {QUADRATURE}")
    if "points" in contact:
        for count in contact["points"].items("numbers of points", 2):
            count.integer(2, _MOST_POINTS)
    contact["law"].choice(cartilage_law.LAWS)
    for name in ("youngs_modulus_MPa", "poisson_ratio", "layer_thickness_mm", "onset_width_mm"):
        contact[name].number(RANGES[name])
    if "layer_variation_mm" in contact:
        variation = contact["layer_variation_mm"]
        layer = contact["layer_thickness_mm"].value + _polynomial(variation)
        if not all(RANGES["layer_thickness_mm"].holds(x) for x in (layer.min(), layer.max())):
            expected = f"a layer {RANGES['layer_thickness_mm']} all over the region"
            raise variation.problem(expected)
    for name in faces:
        check_surface(contact[name])
        sources[contact[name].path] = contact[name]["source"].text()
    unsourced = ("form", "points", "law", "onset_width_mm", "layer_variation_mm", *FACES)
    check_source(contact, sources, without=unsourced)


def check_surface(surface: Field) -> None:
    """Check a surface of a knee file.

    Args:
        surface: a mapping with `kind` and that kind's fields.

    Raises:
        InputProblem: the first field that is missing, unknown, or out of range.
    """
    if not isinstance(surface.value, dict) or "kind" not in surface:
        raise surface.problem(f"a mapping with the field kind, one of {', '.join(SURFACES)}")
    kind = surface["kind"].choice(SURFACES)
    required, optional = SURFACES[kind]
    surface.mapping(("kind", *required, "source"), (*optional, *SURFACE_EXTRAS[1:]))
    surface["source"].text()
    for name in SURFACE_EXTRAS[1:]:
        if name in surface:
            surface[name].number(RANGES["fit_mm"])
    for name in ("axis_point_mm", "origin_mm", "center_mm"):
        if name in surface:
            check_point(surface[name])
    for name in ("axis_rotation_deg", "rotation_deg"):
        if name in surface:
            surface[name].numbers(3, RANGES["rotation_deg"])
    if kind == "condyle":
        lower, upper = surface["angle_deg"].interval(RANGES["angle_deg"])
        if upper - lower < 10:
            raise surface["angle_deg"].problem(
                "a region at least 10 degrees wide; a narrower one suggests radians"
            )
        _extent(surface["width_mm"])
        _check_values(surface, "a radius", RANGES["corner_radius_mm"], RANGES["radius_mm"])
    elif kind == "plateau":
        _extent(surface["anterior_mm"])
        _extent(surface["lateral_mm"])
        if "outline_mm" in surface and len(surface["outline_mm"].rows(2, RANGES["point_mm"])) < 3:
            raise surface["outline_mm"].problem("at least three corners [anterior, lateral]")
        _check_values(surface, "a height", RANGES["point_mm"], RANGES["point_mm"])
    else:
        for name in required[1:]:
            _check_size(surface[name])


def check_line(line: Field, sources: dict[str, str]) -> None:
    """Check a line of constant tension."""
    line.mapping(LINE_FIELDS)
    line["tension_N"].number(RANGES["tension_N"])
    check_point(line["insertion_mm"])
    line["origin_mm"].rows(3, RANGES["coefficient_mm"])
    check_source(line, sources)


def check_muscle(muscle: Field, sources: dict[str, str], wraps: tuple[str, ...]) -> None:
    """Check a muscle from the femur to the patella or the tibia."""
    required = [name for name in MUSCLE_FIELDS if name not in ("via_points", "wrap")]
    muscle.mapping(required, ("via_points", "wrap"))
    muscle["tension_N"].number(RANGES["tension_N"])
    bone = muscle["insertion_bone"].choice((PATELLA, TIBIA))
    for name in ("origin_mm", "insertion_mm"):
        check_point(muscle[name])
    check_course(muscle, wraps, (FEMUR, bone))
    check_source(muscle, sources, without=("insertion_bone", "wrap"))


def check_load(load: Field, sources: dict[str, str]) -> None:
    """Check a force and a moment."""
    load.mapping(("axes", "source"), LOAD_FIELDS)
    if "force_N" not in load and "moment_Nmm" not in load:
        raise load.problem("force_N, moment_Nmm, or both")
    if "force_N" in load:
        load.mapping(("force_N", "point_mm", "point_in", "axes", "source"), LOAD_FIELDS)
    for name in ("force_N", "moment_Nmm"):
        if name in load:
            load[name].numbers(3, RANGES[name])
    if "point_mm" in load:
        check_point(load["point_mm"])
    load["axes"].choice(AXES)
    if "point_in" in load:
        load["point_in"].choice(BONES)
    check_source(load, sources, without=("axes", "point_in"))


def check_source(part: Field, sources: dict[str, str], without: tuple[str, ...] = ()) -> None:
    """One text for the part, or a text for each of its fields but those in `without`."""
    source = part["source"]
    if not isinstance(source.value, dict):
        sources[part.path] = source.text()
        return
    fields = [name for name in part.value if name != "source"]
    source.mapping([name for name in fields if name not in without], fields)
    for name in source.value:
        sources[f"{part.path}.{name}"] = source[name].text()


def check_point(field: Field) -> None:
    """Check a point, mm."""
    field.numbers(3, RANGES["point_mm"])


def _extent(field: Field) -> None:
    lower, upper = field.interval(RANGES["point_mm"])
    width = RANGES["size_mm"]
    if not width.holds(upper - lower):
        raise field.problem(f"a width {width.expected(upper - lower)}")


def _check_size(field: Field) -> None:
    """One length, or one along each axis."""
    count = _SIZES.get(field.path.rsplit(".", 1)[-1])
    if count is None:
        field.number(RANGES["size_mm"])
    else:
        field.numbers(count, RANGES["size_mm"])


def _check_values(surface: Field, what: str, least: Range, greatest: Range) -> None:
    """The least and the greatest value of a surface's table over its region."""
    values = _values(surface)
    for value, allowed in ((values.max(), greatest), (values.min(), least)):
        if not allowed.holds(value):
            expected = f"{what} {allowed} all over the region{allowed.hint(value)}"
            raise surface["coefficients_mm"].problem(expected)


def _values(surface: Field) -> np.ndarray:
    """A surface's table over its region, at a grid of points."""
    coefficients = surface["coefficients_mm"]
    if "basis" not in surface or surface["basis"].choice(BASES) != CUBIC_SPLINE:
        return _polynomial(coefficients)
    table = np.array(coefficients.rows(allowed=RANGES["coefficient_mm"]))
    if min(table.shape) < 4 or max(table.shape) > _MOST_CONTROL_VALUES:
        expected = f"rows and columns of 4 to {_MOST_CONTROL_VALUES} control values of a spline"
        raise coefficients.problem(expected)
    for _ in range(2):  # at the knots, along either variable
        table = ((table[:-2] + 4.0 * table[1:-1] + table[2:]) / 6.0).T
    return table


def _polynomial(coefficients: Field) -> np.ndarray:
    table = np.array(coefficients.rows(allowed=RANGES["coefficient_mm"]))
    s = np.linspace(-1.0, 1.0, 25)
    if max(table.shape) > 13:
        raise coefficients.problem("powers up to 12")
    return np.polynomial.polynomial.polygrid2d(s, s, table)
