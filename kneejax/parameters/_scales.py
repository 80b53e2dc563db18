"""How far a parameter is likely to be from what is assumed: one standard deviation, by quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from kneejax.parameters._leaves import is_size
from kneejax.parameters._selection import (
    Selection,
    UnknownParameter,
    UnsuitableData,
    nearest_of,
    unit_of_quantity,
)

T = TypeVar("T")

#: Standard deviations in proportion to the value. Conventions rather than measurements: published
#: values of one ligament differ by as much (ACL 3100 to 5900 N in papers 1 to 3).
PROPORTIONAL_SCALES = {
    "stiffness": 0.3,
    "slack_length": 0.02,
    "transition_strain": 0.3,
    "transition_width": 0.3,
    "failure_strain": 0.3,
    "damping": 0.3,
}
#: Standard deviations whatever the value: a strain, and mm for how well an attachment is seen.
FIXED_SCALES = {
    "reference_strain": 0.02,
    "femoral_attachment": 2.0,
    "tibial_attachment": 2.0,
    "patellar_attachment": 2.0,
}


#: Of anything else, in proportion to its value.
_OTHER_SCALE = 0.1


def prior_scales(
    selection: Selection, values: ArrayLike, given: Mapping[str, float] | None = None
) -> np.ndarray:
    """Prior standard deviations of parameters, in their own units.

    Where none is given: 30 % of a stiffness, 0.02 of a reference strain, 2 % of a slack length,
    30 % of a transition strain or width, 2 mm of an attachment, 1 mm or 0.05 rad of another place,
    10 % of anything else.

    Args:
        selection: the parameters.
        values: of them, `(p,)`.
        given: name, `*.quantity` or quantity -> standard deviation; a name counts before a
            wildcard, and that before a quantity.

    Returns:
        Standard deviations, `(p,)`, all positive.

    Raises:
        UnknownParameter: something is given that none of the parameters is.
        UnsuitableData: a width is zero, negative or not finite.

    Example:
        >>> from kneejax.parameters import Selection, prior_scales
        >>> both = Selection(("ACL.stiffness", "ACL.reference_strain"), ("ACL",))
        >>> prior_scales(both, [4500.0, 0.03], {"reference_strain": 0.01}).tolist()
        [1350.0, 0.01]
    """
    values = np.asarray(values, float)
    scales = np.empty(len(selection))
    for i, own in enumerate(stated(selection, given or {}, "prior")):
        scales[i] = _usual(selection.quantity(i), values[i]) if own is None else own
        if not (np.isfinite(scales[i]) and scales[i] > 0):
            raise UnsuitableData(
                f"{selection.names[i]}: prior of width {scales[i]:g}: expected a standard "
                "deviation above zero; leave the parameter out if it is known exactly"
            )
    return scales


def percent_scales(selection: Selection, values: ArrayLike) -> np.ndarray:
    """One per cent of each parameter; of a reference strain, which may be zero, 0.01.

    Args:
        selection: the parameters.
        values: of them, `(p,)`.

    Returns:
        Widths in their own units, `(p,)`.

    Raises:
        UnsuitableData: a per cent of the parameter means nothing: a coordinate of an attachment,
            or a value of zero.
    """
    scales = []
    for i, value in enumerate(np.asarray(values, float)):
        quantity, name = selection.quantity(i), selection.names[i]
        place = unit_of_quantity(quantity) in ("mm", "rad") and not is_size(quantity)
        if place and quantity not in PROPORTIONAL_SCALES:
            raise UnsuitableData(f"{name} has no per cent, its zero is arbitrary: scale by a prior")
        scales.append(0.01 if quantity == "reference_strain" else 0.01 * abs(value))
        if not scales[-1] > 0:
            raise UnsuitableData(f"{name} is {value:g}, it has no per cent: scale by a prior")
    return np.array(scales)


def stated(selection: Selection, given: Mapping[str, T], what: str) -> list[T | None]:
    """What is given for each parameter, and nothing for anything else.

    Args:
        selection: the parameters.
        given: name, `*.quantity` or quantity -> anything.
        what: is given, for the error.

    Returns:
        As `looked_up`.

    Raises:
        UnknownParameter: something is given that none of the parameters is.
    """
    known = sorted({key for i in range(len(selection)) for key in _keys(selection, i)})
    for key in given:
        if key not in known:
            # A wildcard is no misspelling of one parameter.
            near = nearest_of(key, [name for name in known if ("*" in name) == ("*" in key)])
            end = f"; did you mean {near!r}?" if near else f": free are {', '.join(known)}"
            raise UnknownParameter(f"{what} of {key!r}, which is not free{end}")
    return looked_up(selection, given)


def looked_up(selection: Selection, given: Mapping[str, T]) -> list[T | None]:
    """What is given for each parameter, or None; a name counts before a wildcard, that before a
    quantity."""
    keys = [_keys(selection, i) for i in range(len(selection))]
    return [next((given[key] for key in own if key in given), None) for own in keys]


def _keys(selection: Selection, index: int) -> tuple[str, ...]:
    """What may stand for a parameter, the nearest first: of one number of several
    (`ACL.femoral_attachment.anterior`), all of them too (`ACL.femoral_attachment`)."""
    name, quantity = selection.names[index], selection.quantity(index)
    keys = [name, f"*.{quantity}", quantity]
    if "." in quantity:
        keys = [key for one in keys for key in (one, one.rpartition(".")[0])]
    return tuple(keys)


def _usual(quantity: str, value: float) -> float:
    if quantity in PROPORTIONAL_SCALES:
        return PROPORTIONAL_SCALES[quantity] * abs(value)
    fixed = FIXED_SCALES.get(quantity.split(".")[0])
    if fixed is None and not is_size(quantity):
        fixed = {"mm": 1.0, "rad": 0.05}.get(unit_of_quantity(quantity))
    return _OTHER_SCALE * abs(value) if fixed is None else fixed
