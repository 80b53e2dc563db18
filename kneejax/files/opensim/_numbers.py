"""Numbers of an OpenSim model as decimals: metres become millimetres by moving the point.

OpenSim prints a double with 17 digits, so 0.0017455 stands in its files as 0.0017455000000000001.
A text that is such a print is read as the shortest decimal of that double, which is what its author
wrote; any other text is read as it stands. Moving the decimal point is exact, whereas multiplying a
double by 1000 is not, and the way back gives every digit again.
"""

from __future__ import annotations

import math
from decimal import Context, Decimal, localcontext

from kneejax.files.reading import plain_number

#: Powers of ten from SI to the package's units.
METRES_TO_MM = 3
PASCAL_TO_MPA = -6
_WIDE = Context(prec=60)
_PI = Decimal("3.14159265358979323846264338327950288419716939937511")


def read_decimal(word: str) -> Decimal:
    """The number that a word of a model stands for.

    Args:
        word: a number as OpenSim writes it.

    Returns:
        Its decimal.

    Raises:
        ValueError: it is not a finite number.

    Example:
        >>> str(read_decimal("0.0017455000000000001")), str(read_decimal("0.10"))
        ('0.0017455', '0.10')
    """
    x = plain_number(word)
    if x is None or not math.isfinite(x):
        raise ValueError(word)
    exact = Decimal(word.strip())
    printed = len(_digits(exact)) == 17 and exact == Decimal(f"{x:.17g}")
    return Decimal(repr(x)) if printed else exact


def write_decimal(value: Decimal) -> str:
    """The shortest word that `read_decimal` reads as this number.

    Example:
        >>> write_decimal(Decimal("0.030750")), write_decimal(Decimal("1E+3"))
        ('0.03075', '1000')
    """
    value = value.normalize(_WIDE) if value else Decimal(0)
    exponent = value.adjusted()
    word = f"{value:f}" if -6 <= exponent < 17 else str(value).replace("E", "e")
    if read_decimal(word) == value:
        return word
    # It happens to be the print of another number; one more digit says that it is meant.
    mantissa, e, power = word.partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.'}0{e}{power}"


def shifted(value: Decimal, places: int) -> float:
    """A decimal times a power of ten, as the nearest double.

    Args:
        value: the decimal.
        places: power of ten.

    Example:
        >>> shifted(Decimal("0.0012345"), METRES_TO_MM)
        1.2345
    """
    return float(value.scaleb(places, _WIDE)) + 0.0  # no minus zero


def unshifted(x: float, places: int) -> Decimal:
    """The decimal that `shifted` reads as `x`."""
    return Decimal(repr(float(x))).scaleb(-places, _WIDE)


def degrees(radians: Decimal) -> float:
    """Degrees of an angle in rad, correctly rounded.

    Example:
        >>> degrees(Decimal("1.5707963267948966"))
        90.0
    """
    with localcontext(_WIDE):
        return float(radians * 180 / _PI) + 0.0


def radians(x: float) -> Decimal:
    """The shortest angle in rad that `degrees` reads as `x`.

    Example:
        >>> degrees(radians(33.3))
        33.3
    """
    with localcontext(_WIDE) as context:
        exact = Decimal(repr(float(x))) * _PI / 180
        for context.prec in range(14, 24):
            angle = +exact
            if degrees(read_decimal(write_decimal(angle))) == x:
                break
    return angle


def _digits(value: Decimal) -> tuple[int, ...]:
    digits = value.as_tuple().digits
    return digits if any(digits) else (0,)
