"""Numbers as people read them."""

from __future__ import annotations

import math

import numpy as np

from kneejax.parameters import unit_of_quantity

NONE = "-"


def number(value: float, digits: int = 4) -> str:
    """Write a number with so many significant digits, without needless exponents.

    Args:
        value: any number; NaN and None become a dash.
        digits: significant digits; whole digits before the point are never dropped.

    Returns:
        Plain ASCII.
    """
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size > 7:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - size, 0)}f}"


def trimmed(value: float, digits: int = 4) -> str:
    """Write a number like `number`, without trailing zeros: for what a person has set.

    Args:
        value: any number; NaN and None become a dash.
        digits: significant digits.

    Returns:
        Plain ASCII.
    """
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def with_error(value: float, standard_error: float) -> tuple[str, str]:
    """Write an estimate and its standard error with matching decimals.

    Args:
        value: the estimate.
        standard_error: gives two significant digits; NaN becomes a dash.

    Returns:
        Estimate and standard error.
    """
    known = standard_error is not None and math.isfinite(standard_error) and standard_error > 0
    if not known or not math.isfinite(value):
        return number(value), number(standard_error, 2)
    size = math.floor(math.log10(standard_error))
    whole = math.floor(math.log10(abs(value))) if value else 0
    decimals = min(max(1 - size, 3 - whole, 0), max(6 - whole, 0))
    error = f"{standard_error:.{decimals}f}"
    return f"{value:.{decimals}f}", error if float(error) else f"{standard_error:.1e}"


def change(before: float, after: float) -> str:
    """Say by how much something fell or rose.

    Args:
        before: value at the start.
        after: value at the end.

    Returns:
        E.g. `99.4 % lower`; empty if it cannot be said.
    """
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return ""
    percent = 100 * (after / before - 1)
    if abs(percent) < 0.05:
        return "unchanged"
    shown = f"{abs(percent):.1f}"
    if shown == "100.0" and percent < 0:
        return "more than 99.9 % lower" if after > 0 else "100 % lower"
    return f"{shown} % {'lower' if percent < 0 else 'higher'}"


def listed(words: list[str], most: int = 12) -> str:
    """Join words with commas; long lists end in a count.

    Args:
        words: what to join.
        most: how many are shown.

    Returns:
        E.g. `a, b, c and 4 more`.
    """
    if len(words) <= most:
        return ", ".join(words)
    return f"{', '.join(words[:most])} and {len(words) - most} more"


def plain(name: str) -> str:
    """A parameter's name in words: `ACL.reference_strain` becomes `ACL reference strain`."""
    return name.replace(".", " ").replace("_", " ")


def unit_after(name: str) -> str:
    """Unit of a parameter with a blank before it, empty for strains."""
    unit = unit_of_quantity(name.split(".", 1)[-1])
    return f" {unit}" if unit else ""


def short(value: float) -> str:
    """A number with two or three digits, thousands set apart."""
    if not np.isfinite(value):
        return "unknown"
    if abs(value) >= 1e6 or 0 < abs(value) < 1e-4:
        return f"{value:.1e}"
    return f"{value:,.0f}" if abs(value) >= 99.5 else f"{value:.2g}"
