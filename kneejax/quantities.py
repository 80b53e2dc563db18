"""Every quantity of a knee, declared once: name, unit, field in a file, limits, scales, source.

Parameter names, units, bounds, prior scales and what a file may say come from `QUANTITIES`. Adding
one is an entry here and its use in the physics. It imports no JAX: a wrong number is answered at
once.
"""

import dataclasses
import difflib
from collections.abc import Iterable, Mapping

#: Components of points and directions.
AXES = ("anterior", "superior", "lateral")
#: With which names of columns end.
COLUMN_UNITS = ("N", "mm", "mm2", "MPa", "deg", "Nm", "Nmm", "s", "kg", "m")


def unit_of_column(name: str) -> str:
    """The unit with which the name of a column ends, as `N` of `force_N`; empty without one."""
    stem, _, unit = name.rpartition("_")
    return unit if stem and unit in COLUMN_UNITS else ""


@dataclasses.dataclass(frozen=True)
class Range:
    """The values that a quantity may have.

    Attributes:
        lower: the least.
        upper: the greatest.
        unit: empty for a plain number.
        or_zero: whether zero is allowed too, below `lower`.
        too_small: what a smaller value suggests.
        too_large: what a larger value suggests.

    Example:
        >>> allowed = QUANTITIES["youngs_modulus"].allowed
        >>> allowed.holds(5e6), allowed.expected(5e6)
        (False, 'between 0.001 and 100,000 MPa; Pa are suspected')
    """

    lower: float
    upper: float
    unit: str = ""
    or_zero: bool = False
    too_small: str = ""
    too_large: str = ""

    def holds(self, value: float) -> bool:
        """Whether a value is one of them; NaN is not."""
        return self.lower <= value <= self.upper or (self.or_zero and value == 0.0)

    def expected(self, value: float) -> str:
        """What should stand where this value does, with what its size suggests."""
        return f"{self}{self.hint(value)}"

    def hint(self, value: float) -> str:
        """What the size of a value suggests, if anything, to end a sentence with."""
        suspected = self.too_large if value > self.upper else ""
        suspected = self.too_small if value < self.lower else suspected
        return f"; {suspected}" if suspected else ""

    @property
    def spread(self) -> "Range":
        """What a standard deviation, or a step, of such a quantity can be."""
        width = self.upper - self.lower
        return Range(1e-9 * width, width, self.unit)

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero else ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{zero}between {_plain(self.lower)} and {_plain(self.upper)}{unit}"


def _plain(x: float) -> str:
    return f"{x:,.0f}" if abs(x) >= 1e4 else f"{x:g}"


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number, or the components of a point, that parts of a knee have."""

    name: str  # as in `ACL.stiffness`
    # kinds of parts that have it: `ligament`, `band` (fibres whose cross-section is known),
    # `contact`, `line`, `muscle`, `load`, `obstacle` (what fibres wrap around); empty where no part
    # is advised to name it
    owners: tuple[str, ...]
    unit: str  # of a parameter; empty for a plain number
    allowed: Range  # what every knee's numbers lie between
    field: str = ""  # in a knee file; empty where the file says it otherwise
    # kind of part -> attributes that lead from it to the number, where they are not the name
    paths: Mapping[str, str] = dataclasses.field(default_factory=dict)
    bone: str = ""  # on which the point lies, of an attachment
    summed: bool = False  # a structure's value is the sum over its fibres; the mean otherwise
    # of a search for a single line; None where they go by the knee's own value
    bounds: tuple[float, float] | None = None
    # Bounds lie so far from the knee's own value, of a place, whose zero is arbitrary, so that no
    # per cent of it means anything; None for from half to twice of it.
    within: float | None = None
    # Prior standard deviation as a part of the value, or whatever the value, in the unit:
    # conventions of ours; published stiffnesses of one ligament differ by as much.
    relative: float = 0.1
    deviation: float | None = None
    source: str = ""  # of the bounds

    def bounds_around(self, value: float) -> tuple[float, float]:
        """Bounds of a search that begins at a value."""
        if self.bounds is not None:
            return self.bounds
        if self.within is not None:
            return value - self.within, value + self.within
        if value == 0.0:
            return -1.0, 1.0
        low, high = sorted((0.5 * value, 2.0 * value))
        return low, high

    def scale_of(self, value: float) -> float:
        """Prior standard deviation of a value."""
        return self.relative * abs(value) if self.deviation is None else self.deviation


_METRES, _PERCENT = "metres are suspected", "a strain, not percent"
_STRAIN = {"too_large": _PERCENT, "too_small": _PERCENT}
_POINT = Range(-1000.0, 1000.0, "mm")
_SIZE = Range(1.0, 1000.0, "mm", too_small=_METRES)
_PAPER1 = "paper 1, section 2.3"


def _point(name: str, *owners: str, **other) -> Quantity:
    """A point on a bone, that may move by 10 mm."""
    fields = {"field": f"{name}_mm", "within": 10.0, "deviation": 1.0} | other
    return Quantity(name, owners, "mm", _POINT, **fields)


_ALL = (
    Quantity("stiffness", ("ligament",), "N", Range(1e-3, 1e7, "N"), "stiffness_N", summed=True,
             bounds=(300.0, 10000.0), relative=0.3, source=_PAPER1),
    Quantity("reference_strain", ("ligament",), "", Range(-0.9, 0.5, **_STRAIN), "reference_strain",
             bounds=(-0.2, 0.2), deviation=0.02, source=_PAPER1),
    # The iliotibial band, the longest of all, is 550 mm.
    Quantity("slack_length", ("ligament",), "mm", Range(1.0, 700.0, "mm", too_small=_METRES),
             "slack_length_mm", bounds=(5.0, 200.0), relative=0.02),
    Quantity("transition_strain", ("ligament",), "", Range(1e-4, 0.5, too_large=_PERCENT),
             "transition_strain", bounds=(0.005, 0.2), relative=0.3),
    Quantity("transition_width", ("ligament",), "", Range(1e-7, 0.5, too_large=_PERCENT),
             "transition_width", bounds=(1e-4, 0.02), relative=0.3),
    Quantity("failure_strain", ("ligament",), "", Range(1e-3, 1.0, too_large=_PERCENT),
             "failure_strain", bounds=(0.05, 0.5), relative=0.3),
    Quantity("damping", ("ligament",), "N s", Range(1e-9, 1e5, "N s", or_zero=True), "damping_N_s",
             summed=True, bounds=(0.0, 200.0), relative=0.3),
    # Ends of ligaments are seen to within 2 mm.
    _point("femoral_attachment", "ligament", bone="femur", deviation=2.0),
    _point("tibial_attachment", "ligament", bone="tibia", deviation=2.0),
    _point("patellar_attachment", "ligament", bone="patella", deviation=2.0),
    Quantity("youngs_modulus", ("contact", "band"), "MPa", Range(1e-3, 1e5, "MPa",
             too_large="Pa are suspected"), "youngs_modulus_MPa"),
    Quantity("area", ("band",), "mm²", Range(1e-4, 1e4, "mm²", or_zero=True), "area_mm2",
             summed=True, relative=0.2),
    Quantity("prestretch", ("band",), "", Range(0.1, 1.5, too_large=_PERCENT), "prestretch",
             bounds=(0.8, 1.2), deviation=0.02),
    Quantity("poisson_ratio", ("contact",), "", Range(0.0, 0.4999), "poisson_ratio"),
    Quantity("layer_thickness", ("contact",), "mm", Range(0.1, 50.0, "mm", too_small=_METRES),
             "layer_thickness_mm"),
    Quantity("cross_section", ("contact",), "mm²", Range(0.1, 1e4, "mm²"), "cross_section_mm2",
             paths={"contact": "ring.cross_section"}),
    Quantity("hoop_modulus", ("contact",), "MPa", Range(1e-3, 1e5, "MPa"), "",
             paths={"contact": "ring.youngs_modulus"}),
    Quantity("horn_stiffness", ("contact",), "N/mm", Range(1e-3, 1e6, "N/mm"),
             "horn_stiffness_N_per_mm", paths={"contact": "ring.horn_stiffness"}),
    Quantity("coronary_stiffness", ("contact",), "N/mm", Range(1e-3, 1e6, "N/mm"),
             "coronary_stiffness_N_per_mm", paths={"contact": "ring.coronary_stiffness"}),
    Quantity("onset_width", ("contact",), "mm", Range(1e-6, 5.0, "mm"), "onset_width_mm"),
    _point("femoral_surface", "contact", field="", paths={"contact": "femoral.frame.origin"}),
    _point("tibial_surface", "contact", field="", paths={"contact": "tibial.frame.origin"}),
    Quantity("tension", ("line", "muscle"), "N", Range(1e-6, 1e5, "N", or_zero=True), "tension_N"),
    _point("insertion", "line", "muscle", paths={"muscle": "tibial_attachment"}),
    _point("origin", "line", "muscle", paths={"muscle": "femoral_attachment"}),
    Quantity("force", ("load",), "N", Range(-1e5, 1e5, "N"), "force_N"),
    Quantity("moment", ("load",), "N mm", Range(-1e6, 1e6, "N mm"), "moment_Nmm"),
    _point("point", "load"),
    Quantity("radius", ("obstacle",), "mm", _SIZE, "radius_mm",
             paths={"obstacle": "obstacle.radius"}),
    Quantity("semi_axes", ("obstacle",), "mm", _SIZE, "semi_axes_mm",
             paths={"obstacle": "obstacle.semi_axes"}),
    _point("wrap", "obstacle", field="", paths={"obstacle": "obstacle.frame.origin"}),
    Quantity("length", (), "mm", Range(1.0, 700.0, "mm"), "length_mm"),
    _point("via", field=""),
    Quantity("rotation", (), "rad", Range(-6.3, 6.3, "rad"), within=0.2, deviation=0.05),
)  # fmt: skip
#: Whole ligament -> stiffnesses that models of it have had, N per unit strain, the least and the
#: greatest; deep fibres and all bundles included. Sources: paper 1, Table 1; paper 2, Table 1, and
#: paper 3, Table 1 (sums over bundles); Lenhart et al. 2015 (sums over fibres).
PUBLISHED_STIFFNESS = {
    "ACL": (3100.0, 9840.0),
    "PCL": (3860.0, 6000.0),
    "MCL": (8000.0, 14500.0),
    "LCL": (2000.0, 6000.0),
}
#: Name -> quantity.
QUANTITIES = {one.name: one for one in _ALL}
#: What a parameter of a ligament may be called after its name; the last of them of bands alone.
BAND_QUANTITIES = tuple(one.name for one in _ALL if "band" in one.owners)
FIBRE_QUANTITIES = (
    *(
        f"{one.name}.{axis}" if axis else one.name
        for one in _ALL
        if "ligament" in one.owners
        for axis in (AXES if one.bone else ("",))
    ),
    *BAND_QUANTITIES,
)
_OTHER = Quantity("", (), "", Range(-float("inf"), float("inf")))


def quantity_of(name: str) -> Quantity:
    """The quantity that a parameter, or a field of a part, is of: the last that is named in
    `ACL.stiffness`, `stiffness`, `medial.tibial_surface.superior`; one without name, unit and
    limits where none is known.

    Example:
        >>> quantity_of("ACL.femoral_attachment.anterior").unit, quantity_of("ACL.colour").name
        ('mm', '')
    """
    known = [word for word in name.split(".") if word in QUANTITIES]
    return QUANTITIES[known[-1]] if known else _OTHER


#: Name of a field, a column or a load, with its unit -> the values that it may have.
RANGES: dict[str, Range] = {one.field: one.allowed for one in _ALL if one.field} | {
    "reference_force_N": Range(1e-6, 1e5, "N"),
    # of places and sizes
    "point_mm": _POINT,
    "scan_mm": Range(-1e4, 1e4, "mm"),  # from a scanner's origin
    "size_mm": _SIZE,
    "within_mm": Range(1e-3, 1000.0, "mm"),
    "corner_radius_mm": Range(1e-3, 1000.0, "mm"),  # a fitted table may fall off at its corners
    "coefficient_mm": Range(-1e4, 1e4, "mm"),
    "fit_mm": Range(1e-9, 1000.0, "mm", or_zero=True),
    "rotation_deg": Range(-360.0, 360.0, "degrees"),
    "angle_deg": Range(-90.0, 270.0, "degrees"),
    # of a pose
    "flexion_deg": Range(-30.0, 180.0, "degrees", too_small="flexion is positive"),
    "adduction_deg": Range(-45.0, 45.0, "degrees"),
    "internal_rotation_deg": Range(-90.0, 90.0, "degrees"),
    **dict.fromkeys(("anterior_mm", "superior_mm", "lateral_mm"), _POINT),
    # of loads
    **dict.fromkeys(("lateral_N", "anterior_N", "compression_N"), Range(-1e5, 1e5, "N")),
    **dict.fromkeys(("varus_Nm", "internal_Nm"), Range(
        -1e3, 1e3, "N m", too_large="N mm are suspected", too_small="N mm are suspected")),
    # of motion through time
    "body_kg": Range(20.0, 300.0, "kg"),
    "height_m": Range(1.0, 2.5, "m", too_large="cm are suspected"),
    "ankle_kg": Range(0.0, 100.0, "kg"),
    "femur_deg": Range(-90.0, 90.0, "degrees"),
    "time_s": Range(-1e6, 1e6, "s"),
    "period_s": Range(1e-2, 1e3, "s"),
    "error_mm": Range(1e-6, 10.0, "mm"),
    "critical": Range(0.0, 100.0, ""),
    "damping_N_s_per_mm": Range(0.0, 1e3, "N s/mm"),
    "dissipation_s_per_mm": Range(0.0, 10.0, "s/mm", too_large="s/m are suspected"),
    # of what is measured
    "noise_mm": Range(1e-6, 100.0, "mm", or_zero=True),
    "noise_deg": Range(1e-6, 90.0, "degrees", or_zero=True),
    "within_deg": Range(0.0, 15.0, "degrees"),
    "weight": Range(1e-9, 1e9, or_zero=True),
    "strain": Range(-0.9, 1.0, **_STRAIN),
}  # fmt: skip


def range_of_parameter(name: str) -> Range | None:
    """What a parameter may be, by its name.

    Args:
        name: `LIGAMENT.quantity`, `*.quantity` or a quantity alone.

    Returns:
        The range; None for a quantity that is not known.

    Example:
        >>> str(range_of_parameter("ACL.slack_length"))
        'between 1 and 700 mm'
    """
    found = quantity_of(name)
    return found.allowed if found.name and found.unit != "rad" else None


#: What is compared of a word.
_LONGEST_NAME = 100
#: Words of opposite sense: names that differ in them are never suggested for one another.
_OPPOSITE = (
    ("anterior", "posterior"), ("lateral", "medial"), ("superior", "inferior"),
    ("compression", "distraction"), ("varus", "valgus"), ("adduction", "abduction"),
    ("internal", "external"), ("flexion", "extension"),
)  # fmt: skip


def nearest_name(word: str, known: Iterable[str]) -> str | None:
    """The known name most like a word, or None if none is; never one of the opposite sense.

    Example:
        >>> nearest_name("stifness_N", ["stiffness_N", "slack_length_mm"])
        'stiffness_N'
        >>> nearest_name("posterior_N", ["anterior_N", "lateral_N"])
    """
    lower = word.lower()[:_LONGEST_NAME]
    by_lower = {name.lower(): name for name in known}
    if lower in by_lower:
        return by_lower[lower]
    opposites = {lower.replace(a, b) if a in lower else lower.replace(b, a) for a, b in _OPPOSITE}
    if opposites & {*by_lower}:
        return None
    pairs = [*_OPPOSITE, *((b, a) for a, b in _OPPOSITE)]
    like = [name for name in by_lower if not any(a in lower and b in name for a, b in pairs)]
    found = difflib.get_close_matches(lower, like, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None
