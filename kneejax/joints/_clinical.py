"""The five clinical measures of paper 5, and the poses that they describe."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES, convert


@dataclasses.dataclass(frozen=True)
class ClinicalMeasure:
    """What a clinical measure is in the package's terms.

    Attributes:
        name: as in paper 5.
        meaning: in words, of positive values.
        unit: `mm` or `deg`.
        coordinate: of the Grood-Suntay convention that it is.
        sign: of the measure along that coordinate.
    """

    name: str
    meaning: str
    unit: str
    coordinate: str
    sign: float

    @property
    def column(self) -> str:
        """Column of a table: `ML_mm`, ..., `IE_deg`."""
        return f"{self.name}_{self.unit}"


#: In paper 5's order. It does not print which way ML is positive; lateral is assumed here.
MEASURES = (
    ClinicalMeasure("ML", "tibia lateral of the femur", "mm", "lateral", 1.0),
    ClinicalMeasure("AP", "tibia anterior of the femur", "mm", "anterior", 1.0),
    ClinicalMeasure("CD", "tibia distal of the femur", "mm", "superior", -1.0),
    ClinicalMeasure("AA", "adduction", "deg", "adduction", 1.0),
    ClinicalMeasure("IE", "internal rotation", "deg", "internal_rotation", 1.0),
)
_ROWS = [COORDINATES.index(one.coordinate) for one in MEASURES]
_SIGNS = np.array([one.sign for one in MEASURES])
_PER_UNIT = np.array([180.0 / np.pi] * 3 + [1.0] * 3)


def clinical_measures(table: ArrayLike) -> np.ndarray:
    """Express poses in the clinical measures of paper 5: Grood-Suntay, with its signs.

    Args:
        table: shape `(..., 6)`, degrees and mm, in the package's convention and the order of
            `kneejax.geometry.COLUMNS`.

    Returns:
        Shape `(..., 5)`, mm and degrees, in the order of `MEASURES`: from the femur's origin to the
        tibia's along the femoral medial-lateral (ML, lateral positive), the floating (AP, anterior
        positive) and the tibial long axis (CD, distal positive), adduction (AA) and internal
        rotation (IE).

    Source: paper 5, section 2.4; Grood and Suntay (1983).

    Example:
        >>> clinical_measures([0.0, 2.0, 5.0, -3.0, -35.0, 4.0]).round(2).tolist()
        [5.22, -3.0, 35.02, 2.0, 5.0]
    """
    rows = np.moveaxis(np.asarray(table, float) / _PER_UNIT, -1, 0)
    seen = np.moveaxis(np.asarray(convert(rows, "femoral", "grood-suntay")), 0, -1) * _PER_UNIT
    return seen[..., _ROWS] * _SIGNS


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
    measures = np.asarray(measures, float)
    flexion = np.broadcast_to(np.asarray(flexion_deg, float), measures.shape[:-1])
    seen = np.empty((*measures.shape[:-1], len(COORDINATES)))
    seen[..., 0], seen[..., _ROWS] = flexion, measures * _SIGNS
    rows = jnp.moveaxis(seen / _PER_UNIT, -1, 0)
    table = np.moveaxis(np.asarray(convert(rows, "grood-suntay", "femoral")), 0, -1)
    return table * _PER_UNIT + 0.0
