"""The knee of a CustomJoint: its coordinates follow flexion along splines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

_AXIS = """          <TransformAxis name="{name}">
            <coordinates>{coordinate}</coordinates>
            <axis>{axis}</axis>
            {function}
          </TransformAxis>"""
# Coordinate -> axis of the transform, of a right knee and of a left one, Z to the person's right.
_AXES = {
    "flexion": ("rotation1", "0 0 1", "0 0 1"),
    "adduction": ("rotation2", "1 0 0", "-1 0 0"),
    "internal_rotation": ("rotation3", "0 1 0", "0 -1 0"),
    "anterior": ("translation1", "1 0 0", "1 0 0"),
    "superior": ("translation2", "0 1 0", "0 1 0"),
    "lateral": ("translation3", "0 0 1", "0 0 -1"),
}


def transform_axes(
    side: str,
    coordinate: str,
    knots: np.ndarray,
    columns: Mapping[str, np.ndarray],
    flexion: tuple[float, float] = (1.0, 0.0),
    wrapped: bool = False,
) -> str:
    """The axes of a SpatialTransform.

    Args:
        side: `right` or `left`.
        coordinate: of the model, on which all depend.
        knots: of the splines, in the coordinate's own unit, `(n,)`.
        columns: coordinate of a pose by clinical meaning -> its values at the knots, rad or m,
            `(n,)`.
        flexion: slope and constant by which flexion, rad, follows from the coordinate.
        wrapped: whether functions stand within an element `function`, as in schema 3.

    Returns:
        The text, axes in OpenSim's order.
    """
    return "\n".join(_axes(side, coordinate, knots, columns, flexion, wrapped))


def _axes(side, coordinate, knots, columns, flexion, wrapped) -> Iterator[str]:
    for name, (axis, right, left) in _AXES.items():
        if name == "flexion":
            numbers = f"{-flexion[0]:.17g} {-flexion[1] + 0.0:.17g}"
            inside = ("LinearFunction", f"<coefficients>{numbers}</coefficients>")
        else:
            inside = "SimmSpline", _points(knots, columns[name])
        kind, text = inside
        named = "" if wrapped else ' name="function"'
        function = f"<{kind}{named}>{text}</{kind}>"
        function = f"<function>{function}</function>" if wrapped else function
        direction = left if side == "left" else right
        yield _AXIS.format(name=axis, coordinate=coordinate, axis=direction, function=function)


def _points(knots: np.ndarray, values: np.ndarray) -> str:
    x, y = (" ".join(repr(float(number)) for number in row) for row in (knots, values))
    return f"<x>{x}</x><y>{y}</y>"
