"""OpenSim's functions of a coordinate, as far as the pose of a joint needs them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from kneejax.files.opensim._xml import Element
from kneejax.files.reading import plain_number

#: Kinds of function that are understood.
FUNCTIONS = (
    "Constant", "LinearFunction", "PolynomialFunction", "SimmSpline", "NaturalCubicSpline",
    "PiecewiseLinearFunction", "MultiplierFunction", "GCVSpline", "Sine",
)  # fmt: skip
#: Properties of an axis, a coordinate or a constraint that hold one.
_HOLDERS = ("function", "prescribed_function", "coupled_coordinates_function")


def function_of(owner: Element) -> Element | None:
    """The function of an axis, a multiplier, a coordinate or a constraint.

    It is the child of `<function>` and the like, or a child itself: classes have capitals,
    properties have none.
    """
    held = owner.child(*_HOLDERS)
    inside = (owner if held is None else held).children
    return next((child for child in inside if child.tag[:1].isupper()), None)


def evaluate(function: Element, arguments: Sequence[Any]) -> Any:
    """A function's value, rad or m, at values of its coordinates: numbers, or arrays `(n,)`.

    Raises:
        InputProblem: its kind is not one of `FUNCTIONS`, or its numbers are not what that needs.
    """
    x, kind = arguments[0] if arguments else 0.0, function.tag
    if kind not in FUNCTIONS:
        inner = (*FUNCTIONS, "TransformAxis")
        owners = (e for e in function.iterancestors() if e.name and e.tag not in inner)
        expected = f"one of the functions that are supported: {', '.join(FUNCTIONS)}"
        raise function.problem(f"function of {next(owners).name}", kind, expected)
    inner = function_of(function)
    factor = evaluate(inner, arguments) if inner is not None else 1.0
    try:
        if kind == "Constant":
            return _number(function.word("value", default="0"))
        if kind == "LinearFunction":
            # OpenSim 2 and 3 call them coefficients too; the constant comes last.
            *slopes, constant = _numbers(function, "coefficients", 2)
            return sum(a * b for a, b in zip(slopes, arguments, strict=False)) + constant
        if kind == "PolynomialFunction":
            return np.polyval(_numbers(function, "coefficients", 1), x)
        if kind == "MultiplierFunction":
            if inner is None:
                raise ValueError("no function to multiply")
            return _number(function.word("scale", default="1")) * factor
        if kind == "Sine":
            size, rate, phase, middle = (
                _number(function.word(tag, default=usual)) for tag, usual in
                (("amplitude", "1"), ("omega", "1"), ("phase", "0"), ("offset", "0"))
            )
            return size * np.sin(rate * np.asarray(x) + phase) + middle
        knots, values = (_numbers(function, name, 2) for name in ("x", "y"))
        if len(knots) != len(values):
            raise ValueError(f"{len(knots)} values of x and {len(values)} of y")
        if kind == "GCVSpline":
            return _natural(function, knots, values, x)
        if kind == "PiecewiseLinearFunction":
            return _between(knots, values, x)
        return simm_spline(knots, values, x)
    except ValueError as error:
        expected = "the numbers of this kind of function"
        raise function.problem("numbers", str(error), expected) from None


def describe(function: Element) -> str:
    """A function of any kind in a few words, for a report."""
    if function.tag == "Constant":
        return f"constant {_number(function.word('value', default='0')):g}"
    if function.tag in ("LinearFunction", "PolynomialFunction"):
        return f"{function.tag} {function.word('coefficients')}"
    if function.tag == "MultiplierFunction":
        inner = function_of(function)
        scale = _number(function.word("scale", default="1"))
        return f"{scale:g} times {describe(inner) if inner is not None else 'nothing'}"
    count = len(function.word("x").split())
    return f"{function.tag} through {count} points" if count else function.tag


def simm_spline(knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    """The cubic spline of SIMM and OpenSim at a number or several `(m,)`; see `simm_splines`.

    Where knots do not increase, or are two, lines join them.

    Example:
        >>> t = np.array([0.0, 1.0, 3.0, 4.0, 6.0])
        >>> round(float(simm_spline(t, t**3 - t, 2.0)), 12)
        6.0
    """
    if len(knots) == 2 or np.any(np.diff(knots) <= 0):
        return _between(knots, values, x)
    return simm_splines(knots, values, np.ravel(x)).reshape(np.shape(x))


def simm_splines(knots: np.ndarray, values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Cubic splines of SIMM and OpenSim, with the same knots.

    Twice continuously differentiable; its third derivative in the first and last interval is that
    of the cubic through the first and last four points; straight outside.

    Args:
        knots: shape `(n,)`, increasing, three or more.
        values: shape `(n, ...)`.
        x: where, shape `(m,)`.

    Returns:
        Shape `(m, ...)`.

    Source: Forsythe, Malcolm and Moler, Computer Methods for Mathematical Computations (1977).
    """
    ends = [(3, np.zeros(values.shape[1:]))] * 2
    if len(knots) > 3:
        ends = [(3, _third_derivative(knots[k], values[k])) for k in (slice(4), slice(-4, None))]
    spline = make_interp_spline(knots, values, k=3, bc_type=([ends[0]], [ends[1]]))
    inside = np.clip(x, knots[0], knots[-1])
    beyond = (x - inside).reshape(-1, *[1] * (values.ndim - 1))
    return spline(inside) + beyond * spline(inside, 1)


def _natural(function: Element, knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    """The natural spline of degree `2 half_order - 1`; outside of degree `half_order - 1`."""
    if float(function.word("error_variance", default="0")) > 0:
        raise ValueError("error_variance above 0: a spline that misses its points")
    half = min(int(function.word("half_order", default="3")), len(knots) // 2)
    ends = [(order, 0.0) for order in range(half, 2 * half - 1)]
    bounds = (ends, ends) if ends else None
    spline = make_interp_spline(knots, values, k=2 * half - 1, bc_type=bounds)
    inside = np.clip(x, knots[0], knots[-1])
    beyond = np.asarray(x) - inside
    return sum(spline(inside, i) * beyond**i / math.factorial(i) for i in range(half))


def _third_derivative(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of the cubic through four points."""
    for order in range(1, 4):
        y = np.diff(y, axis=0) / (x[order:] - x[:-order]).reshape(-1, *[1] * (y.ndim - 1))
    return 6.0 * y[0]


def _between(knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    width = knots[i + 1] - knots[i]
    slope = np.where(width > 0, values[i + 1] - values[i], 0.0) / np.where(width > 0, width, 1.0)
    return values[i] + (x - knots[i]) * slope


def _numbers(function: Element, name: str, at_least: int) -> np.ndarray:
    numbers = np.array([_number(word) for word in function.word(name).split()])
    if len(numbers) < at_least or not np.isfinite(numbers).all():
        raise ValueError(f"{name}: {function.word(name) or 'missing'}")
    return numbers


def _number(word: str) -> float:
    found = plain_number(word)
    if found is None:
        raise ValueError(f"{word} is no number")
    return found
