"""Priors as words of a command: `--prior NAME=MEAN:SD`."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kneejax.cli._given import check_parameter, check_width
from kneejax.files import InputProblem
from kneejax.mechanics import Knee
from kneejax.parameters import Selection, select

_OPTION = "--prior"


def read_priors(
    words: Sequence[str], knee: Knee, parameters: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Read normal priors from the command line.

    Args:
        words: `NAME=MEAN:SD` each; a name is that of a free parameter, or `*.quantity` for all of
            its kind. `SD` may be `inf`: flat between the bounds.
        knee: that has the parameters.
        parameters: that are free, wildcards included.

    Returns:
        Parameter -> mean and standard deviation. A prior of its own counts before a wildcard,
        whichever comes first.

    Raises:
        InputProblem: a word of another form, a name that is not free (with the nearest that is), a
            name given twice, a mean that is not finite, a standard deviation that is not positive.
        UnknownParameter: `parameters` has one that the knee does not have.
    """
    given: dict[str, tuple[float, float]] = {}
    selection = select(knee, tuple(parameters))
    for word in words:
        name, prior = _read(word)
        if not _meant(name, selection):
            kinds = dict.fromkeys(f"*.{selection.quantity(i)}" for i in range(len(selection)))
            known = (*selection.names, *kinds)
            raise InputProblem(_OPTION, "name", name, "a free parameter or *.quantity", known)
        if name in given:
            raise InputProblem(_OPTION, name, word, "one prior of a name")
        given[name] = prior
    wild_first = sorted(given, key=lambda name: not name.startswith("*."))
    return {parameter: given[name] for name in wild_first for parameter in _meant(name, selection)}


def _read(word: str) -> tuple[str, tuple[float, float]]:
    name, equals, numbers = word.partition("=")
    mean, colon, sd = numbers.partition(":")
    if not (name and equals and colon):
        raise InputProblem(
            _OPTION, name or "name", word, "NAME=MEAN:SD, e.g. ACL.stiffness=4500:900"
        )
    centre, width = _number(mean), _number(sd)
    if not math.isfinite(centre):
        raise InputProblem(_OPTION, name, mean, "a mean that is a finite number")
    if not width > 0:
        raise InputProblem(
            _OPTION, name, sd, "a standard deviation above zero, or inf for none at all"
        )
    check_parameter(_OPTION, name, [centre])
    if math.isfinite(width):
        check_width(_OPTION, name, width)
    return name, (centre, width)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def _meant(name: str, selection: Selection) -> list[str]:
    """The parameters that a name or wildcard stands for."""
    return [
        own for i, own in enumerate(selection.names) if name in (own, f"*.{selection.quantity(i)}")
    ]
