"""The five clinical measures of paper 5, and the poses that they describe."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES, convert


@dataclasses.dataclass(frozen=True)
class ClinicalMeasure:
    """What a clinical measure is.

    Attributes:
        name: as in paper 5.
        meaning: in words, of positive values.
        unit: `mm` or `deg`.

    Example:
        >>> MEASURES[0].name, MEASURES[0].unit
        ('ML', 'mm')
    """

    name: str
    meaning: str
    unit: str

    @property
    def column(self) -> str:
        """Column of a table: `ML_mm`, ..., `IE_deg`."""
        return f"{self.name}_{self.unit}"


#: In paper 5's order. It prints no signs: they follow from its text and from its Table 3, whose
#: rows are one hinge only with ML lateral and CD distal.
MEASURES = (
    ClinicalMeasure("ML", "tibia lateral of the femur", "mm"),
    ClinicalMeasure("AP", "tibia anterior of the femur", "mm"),
    ClinicalMeasure("CD", "tibia distal of the femur", "mm"),
    ClinicalMeasure("AA", "adduction", "deg"),
    ClinicalMeasure("IE", "internal rotation", "deg"),
)
_PER_UNIT = np.array([180.0 / np.pi] * 3 + [1.0] * 3)
_FLEXION, _AA, _IE, _ANTERIOR, _SUPERIOR, _LATERAL = range(len(COORDINATES))


def clinical_measures(table: ArrayLike) -> np.ndarray:
    """Express poses in the clinical measures of paper 5.

    The way from the femur's origin to the tibia's is projected onto the three axes of Grood and
    Suntay. Two of them are not orthogonal, so a projection is not the component along an axis,
    which the package's convention `grood-suntay` gives: at 3 degrees of adduction ML differs by
    2 mm.

    Args:
        table: shape `(..., 6)`, degrees and mm, in the package's convention and the order of
            `kneejax.geometry.COLUMNS`.

    Returns:
        Shape `(..., 5)`, mm and degrees, in the order of `MEASURES`: projections onto the femoral
        medial-lateral axis (ML, lateral positive), the floating (AP, anterior positive) and the
        tibial long axis (CD, distal positive), adduction (AA) and internal rotation (IE).

    Source: paper 5, section 2.4; Grood and Suntay (1983).

    Example:
        >>> clinical_measures([0.0, 2.0, 5.0, -3.0, -35.0, 4.0]).round(2).tolist()
        [4.0, -3.0, 34.84, 2.0, 5.0]
    """
    rows = np.moveaxis(np.asarray(table, float) / _PER_UNIT, -1, 0)
    seen = np.asarray(convert(rows, "femoral", "grood-suntay"))
    lean = np.sin(seen[_AA])  # cosine of the angle between the two axes that are not orthogonal
    lateral = seen[_LATERAL] + lean * seen[_SUPERIOR]
    distal = -(seen[_SUPERIOR] + lean * seen[_LATERAL])
    turns = np.rad2deg(seen[[_AA, _IE]])
    return np.stack([lateral, seen[_ANTERIOR], distal, *turns], axis=-1)


def poses_from_clinical(flexion_deg: ArrayLike, measures: ArrayLike) -> np.ndarray:
    """The poses that clinical measures describe: the inverse of `clinical_measures`.

    Args:
        flexion_deg: shape `(...)`.
        measures: shape `(..., 5)`, mm and degrees, in the order of `MEASURES`.

    Returns:
        Shape `(..., 6)`, degrees and mm, in the package's convention.

    Example:
        >>> poses_from_clinical(0.0, [4.0, -3.0, 35.0, 0.0, 5.0]).round(6).tolist()
        [0.0, 0.0, 5.0, -3.0, -35.0, 4.0]
    """
    lateral, anterior, distal, adduction, rotation = np.moveaxis(np.asarray(measures, float), -1, 0)
    flexion, turns = np.deg2rad(np.asarray(flexion_deg, float)), np.deg2rad([adduction, rotation])
    lean = np.sin(turns[0])
    along = (lateral + lean * distal) / (1.0 - lean * lean)
    up = -(distal + lean * lateral) / (1.0 - lean * lean)
    rows = np.stack(np.broadcast_arrays(flexion, *turns, anterior, up, along))
    table = np.moveaxis(np.asarray(convert(rows, "grood-suntay", "femoral")), 0, -1)
    return table * _PER_UNIT
