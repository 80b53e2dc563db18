"""Between which limits a parameter is sought."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee
from kneejax.parameters._leaves import is_size
from kneejax.parameters._scales import looked_up
from kneejax.parameters._selection import Selection, UnsuitableData
from kneejax.parameters._structures import of_one_fibre, structure_range

#: Bounds of paper 1, section 2.3, and wide ones for the rest, by quantity. Paper 1 draws each
#: structure as one line: its bounds of stiffness are a structure's.
DEFAULT_BOUNDS = {
    "stiffness": (300.0, 10000.0),
    "reference_strain": (-0.2, 0.2),
    "slack_length": (5.0, 200.0),
    "transition_strain": (0.005, 0.2),
    "transition_width": (1e-4, 0.02),
    "failure_strain": (0.05, 0.5),
    "damping": (0.0, 200.0),
}


def default_bounds(knee: Knee, selection: Selection) -> tuple[Array, Array]:
    """Lower and upper bounds of a selection.

    Those of `DEFAULT_BOUNDS`; points may move by 10 mm and angles by 0.2 rad; anything else may be
    half or twice what it is. The stiffness of a structure drawn as several fibres may be a quarter
    of and four times what it is at least, and those of its fibres and bundles in proportion
    (`structure_range`).
    """
    values = np.asarray(selection.read(knee))
    pairs = [_usual_bounds(knee, selection, i, float(value)) for i, value in enumerate(values)]
    lower, upper = np.array(pairs, float).T
    return jnp.asarray(lower), jnp.asarray(upper)


def _usual_bounds(
    knee: Knee, selection: Selection, index: int, value: float
) -> tuple[float, float]:
    quantity, unit = selection.quantity(index), selection.unit(index)
    fibres = selection.fibres(index)
    if quantity == "stiffness" and fibres:
        return structure_range(knee, fibres, DEFAULT_BOUNDS[quantity])
    if quantity == "damping" and fibres:
        return DEFAULT_BOUNDS[quantity][0], DEFAULT_BOUNDS[quantity][1] * len(fibres)
    if quantity in DEFAULT_BOUNDS:
        return DEFAULT_BOUNDS[quantity]
    shift = {"mm": 10.0, "rad": 0.2}.get(unit)
    if shift and not is_size(quantity):
        return value - shift, value + shift
    if value == 0.0:
        return -1.0, 1.0
    low, high = sorted((0.5 * value, 2.0 * value))
    return low, high


def stated_bounds(
    knee: Knee, selection: Selection, given: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a selection: those that are stated, default ones for the rest.

    Args:
        knee: gives the middle of default bounds of attachments.
        selection: the parameters.
        given: name, `*.quantity` or quantity -> lower and upper bound; a name counts before a
            wildcard, that before a quantity.

    Returns:
        Lower and upper bounds, `(p,)` each.

    Raises:
        UnsuitableData: bounds that are reversed, equal or not finite.
    """
    lower, upper = (np.array(b) for b in default_bounds(knee, selection))
    for i, (name, own) in enumerate(zip(selection.names, looked_up(selection, given), strict=True)):
        if own is not None:
            lower[i], upper[i] = own
        if not (np.isfinite([lower[i], upper[i]]).all() and lower[i] < upper[i]):
            raise UnsuitableData(
                f"{name}: bounds {lower[i]:g} to {upper[i]:g}: expected lower below upper"
            )
    return lower, upper


def start_within(
    knee: Knee, selection: Selection, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """The knee's own values, `(p,)`; raises `UnsuitableData` where bounds exclude one."""
    start = np.asarray(selection.read(knee))
    for name, value, low, high in zip(selection.names, start, lower, upper, strict=True):
        if not low <= value <= high:
            hint = of_one_fibre(knee, name, low, high)
            raise UnsuitableData(
                f"{name}: bounds {low:g} to {high:g} exclude the start {value:g}{hint}"
            )
    return start
