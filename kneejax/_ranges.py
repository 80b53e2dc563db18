"""What a number of a knee can be at all, by the name and the unit of its field.

The ranges are generous: they hold every published knee and every trial that means something, and
keep out what only a slip or a wrong unit explains. One table serves knee files, studies, tables and
the command line. It imports no JAX: a wrong number is answered at once.
"""

from __future__ import annotations

import dataclasses


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
        >>> RANGES["force_N"].holds(1e30), str(RANGES["force_N"])
        (False, 'between -100,000 and 100,000 N')
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
    def spread(self) -> Range:
        """What a standard deviation, or a step, of such a quantity can be."""
        width = self.upper - self.lower
        return Range(1e-9 * width, width, self.unit)

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero else ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{zero}between {_plain(self.lower)} and {_plain(self.upper)}{unit}"


def _plain(x: float) -> str:
    return f"{x:,.0f}" if abs(x) >= 1e4 else f"{x:g}"


_METRES = "metres are suspected"
_PERCENT = "a strain, not percent"
_SIZE = Range(1.0, 1000.0, "mm", too_small=_METRES)

#: Name of a field, a column or a load, with its unit -> the values that it may have.
RANGES: dict[str, Range] = {
    # of a fibre
    "stiffness_N": Range(1e-3, 1e7, "N"),
    "reference_strain": Range(-0.9, 0.5, too_large=_PERCENT, too_small=_PERCENT),
    # The iliotibial band, the longest of all, is 550 mm.
    "slack_length_mm": Range(1.0, 700.0, "mm", too_small=_METRES),
    "length_mm": Range(1.0, 700.0, "mm"),
    "reference_force_N": Range(1e-6, 1e5, "N"),
    "transition_strain": Range(1e-4, 0.5, too_large=_PERCENT),
    "transition_width": Range(1e-7, 0.5, too_large=_PERCENT),
    "failure_strain": Range(1e-3, 1.0, too_large=_PERCENT),
    "damping_N_s": Range(1e-9, 1e5, "N s", or_zero=True),
    # of places and sizes
    "point_mm": Range(-1000.0, 1000.0, "mm"),
    "scan_mm": Range(-1e4, 1e4, "mm"),  # from a scanner's origin
    "size_mm": _SIZE,
    "within_mm": Range(1e-3, 1000.0, "mm"),
    "radius_mm": _SIZE,
    "corner_radius_mm": Range(1e-3, 1000.0, "mm"),  # a fitted table may fall off at its corners
    "coefficient_mm": Range(-1e4, 1e4, "mm"),
    "fit_mm": Range(1e-9, 1000.0, "mm", or_zero=True),
    "rotation_deg": Range(-360.0, 360.0, "degrees"),
    "angle_deg": Range(-90.0, 270.0, "degrees"),
    # of a contact
    "youngs_modulus_MPa": Range(1e-3, 1e5, "MPa", too_large="Pa are suspected"),
    "poisson_ratio": Range(0.0, 0.4999),
    "layer_thickness_mm": Range(0.1, 50.0, "mm", too_small=_METRES),
    "onset_width_mm": Range(1e-6, 5.0, "mm"),
    # of a pose
    "flexion_deg": Range(-30.0, 180.0, "degrees", too_small="flexion is positive"),
    "adduction_deg": Range(-45.0, 45.0, "degrees"),
    "internal_rotation_deg": Range(-90.0, 90.0, "degrees"),
    "anterior_mm": Range(-1000.0, 1000.0, "mm"),
    "superior_mm": Range(-1000.0, 1000.0, "mm"),
    "lateral_mm": Range(-1000.0, 1000.0, "mm"),
    # of loads
    "tension_N": Range(1e-6, 1e5, "N", or_zero=True),
    "force_N": Range(-1e5, 1e5, "N"),
    "moment_Nmm": Range(-1e6, 1e6, "N mm"),
    "lateral_N": Range(-1e5, 1e5, "N"),
    "anterior_N": Range(-1e5, 1e5, "N"),
    "compression_N": Range(-1e5, 1e5, "N"),
    "varus_Nm": Range(-1e3, 1e3, "N m", too_large="N mm are suspected",
                      too_small="N mm are suspected"),
    "internal_Nm": Range(-1e3, 1e3, "N m", too_large="N mm are suspected",
                         too_small="N mm are suspected"),
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
    "weight": Range(1e-9, 1e9, or_zero=True),
    "strain": Range(-0.9, 1.0, too_large=_PERCENT, too_small=_PERCENT),
}  # fmt: skip
#: Quantity of a parameter -> its field in a knee file.
QUANTITY_FIELDS = {
    "stiffness": "stiffness_N",
    "reference_strain": "reference_strain",
    "slack_length": "slack_length_mm",
    "transition_strain": "transition_strain",
    "transition_width": "transition_width",
    "failure_strain": "failure_strain",
    "damping": "damping_N_s",
}
#: Quantity of any part -> what its numbers may be.
_OTHERS = {
    "youngs_modulus": "youngs_modulus_MPa",
    "poisson_ratio": "poisson_ratio",
    "layer_thickness": "layer_thickness_mm",
    "onset_width": "onset_width_mm",
    "tension": "tension_N",
    "radius": "size_mm",
    "semi_axes": "size_mm",
    "force": "force_N",
    "moment": "moment_Nmm",
} | dict.fromkeys(
    ("femoral_attachment", "tibial_attachment", "patellar_attachment", "femoral_surface",
     "tibial_surface", "wrap", "origin", "insertion", "point", "via"), "point_mm",
)  # fmt: skip


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
    quantities = [name.split(".", 1)[-1], name]
    for quantity in quantities:
        if quantity in QUANTITY_FIELDS:
            return RANGES[QUANTITY_FIELDS[quantity]]
    words = {word for quantity in quantities for word in quantity.split(".")}
    others = (RANGES[allowed] for word, allowed in _OTHERS.items() if word in words)
    return next(others, None)
