"""Local sensitivity: exact derivatives of the coordinates with respect to the parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kneejax.inference.fit import table_of
from kneejax.mechanics import Knee
from kneejax.parameters import Selection, UnsuitableData, percent_scales, prior_scales, select
from kneejax.statics import LoadCases, balance_with_slopes

#: How a slope is scaled -> words that finish "mm or degrees per ...".
SCALES = {"prior": "standard deviation of the prior", "percent": "per cent of the parameter"}


@dataclasses.dataclass(frozen=True)
class LocalSensitivity:
    """Derivatives of a motion with respect to parameters; rows that failed are NaN.

    Attributes:
        names: parameters, `(p,)`.
        units: of the parameters; empty for strains.
        values: of the parameters, `(p,)`.
        flexion_deg: shape `(n,)`.
        table: free coordinates, degrees and mm, `(n, 5)`.
        status: `Status` values, `(n,)`.
        derivative: of coordinates (degrees, mm) with respect to parameters in their units,
            `(n, 5, p)`.
        scale: `prior` or `percent`.
        widths: of one step of that scale in the parameters' units, `(p,)`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    flexion_deg: np.ndarray
    table: np.ndarray
    status: np.ndarray
    derivative: np.ndarray
    scale: str
    widths: np.ndarray

    @property
    def scaled(self) -> np.ndarray:
        """Degrees and mm for one step of the scale, `(n, 5, p)`: what can be compared."""
        return self.derivative * self.widths

    def largest(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest scaled slope (with its sign) over flexion and its row, each `(5, p)`."""
        size = np.nan_to_num(np.abs(self.scaled))
        row = size.argmax(axis=0)
        return np.take_along_axis(np.nan_to_num(self.scaled), row[None], axis=0)[0], row


def local_sensitivity(
    knee: Knee,
    parameters: Sequence[str],
    flexion_deg: ArrayLike,
    *,
    scale: str = "prior",
    given: Mapping[str, float] | None = None,
) -> LocalSensitivity:
    """Differentiate the motion of a knee with respect to parameters.

    The derivatives are exact: they follow from the implicit function theorem at each balance, not
    from differences of two motions.

    Args:
        knee: where the slopes are taken.
        parameters: names or wildcards.
        flexion_deg: prescribed angles, `(n,)`.
        scale: `prior` for one standard deviation of a prior (see `prior_scales`), `percent` for
            one per cent of the value (0.01 for a reference strain).
        given: standard deviations of priors, by name, wildcard or quantity.

    Returns:
        The `LocalSensitivity`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: an unknown scale, a prior of zero width, or a per cent that means nothing.
    """
    selection = select(knee, tuple(parameters))
    values = np.asarray(selection.read(knee))
    widths = step_widths(selection, values, scale, given)
    flexion = np.atleast_1d(np.asarray(flexion_deg, float))
    load_cases = LoadCases.at(flexion)
    found = balance_with_slopes(knee, selection.apply, values[None], load_cases)
    table, slope = table_of(found)
    return LocalSensitivity(
        selection.names,
        tuple(selection.unit(i) for i in range(len(selection))),
        values,
        flexion,
        table[0],
        found.status[0],
        slope[0],
        scale,
        widths,
    )


def step_widths(
    selection: Selection,
    values: np.ndarray,
    scale: str,
    given: Mapping[str, float] | None = None,
) -> np.ndarray:
    """One step of a scale in the parameters' own units, `(p,)`; refuses as `local_sensitivity`.

    Args:
        selection: the parameters.
        values: of them, `(p,)`.
        scale: `prior` or `percent`.
        given: standard deviations of priors, by name, wildcard or quantity.
    """
    if scale not in SCALES:
        raise UnsuitableData(f"unknown scale {scale!r}: expected one of {', '.join(SCALES)}")
    if scale == "prior":
        return prior_scales(selection, values, given)
    return percent_scales(selection, values)
