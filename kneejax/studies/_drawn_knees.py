"""Knees as the uncertainty of a calibration leaves them possible."""

from __future__ import annotations

import numpy as np

from kneejax.files import Calibrated
from kneejax.mechanics import range_of_parameter

#: Tries for each draw before the nearest possible value is taken.
_TRIES = 100


def drawn_parameters(
    calibrated: Calibrated, count: int, seed: int = 0
) -> tuple[list[dict[str, float]], tuple[str, ...]]:
    """Draw parameters from the normal distribution about a fit.

    Args:
        calibrated: values, standard errors and their correlation.
        count: of draws.
        seed: of the random numbers.

    Returns:
        Parameter -> value of each draw; and the parameters without a standard error, which keep
        their values. A draw that no knee can have is drawn anew.

    Example:
        >>> fit = Calibrated("k", {}, {"ACL.stiffness": 5000.0}, {}, "", {},
        ...                  {"ACL.stiffness": 100.0})
        >>> draws, held = drawn_parameters(fit, 1000)
        >>> round(float(np.std([x["ACL.stiffness"] for x in draws])), -1), held
        (100.0, ())
    """
    names = [name for name in calibrated.found if name in calibrated.standard_error]
    held = tuple(name for name in calibrated.found if name not in names)
    middle = np.array([calibrated.found[name] for name in names])
    error = np.array([calibrated.standard_error[name] for name in names])
    root = _root(_correlation(calibrated, names)) * error[:, None] if names else np.zeros((0, 0))
    ranges = [range_of_parameter(name) for name in names]
    draw, answer = np.random.default_rng(seed), []
    for _ in range(count):
        values = middle
        for _ in range(_TRIES):
            values = middle + root @ draw.standard_normal(len(names))
            if all(one is None or one.holds(x) for one, x in zip(ranges, values, strict=True)):
                break
        else:
            values = np.array([
                x if one is None else np.clip(x, one.lower, one.upper)
                for one, x in zip(ranges, values, strict=True)
            ])  # fmt: skip
        answer.append(dict(zip(names, values.tolist(), strict=True)))
    return answer, held


def _correlation(calibrated: Calibrated, names: list[str]) -> np.ndarray:
    known, matrix = calibrated.correlation
    if not known or any(name not in known for name in names):
        return np.eye(len(names))
    rows = [known.index(name) for name in names]
    found = np.array(matrix)[np.ix_(rows, rows)]
    np.fill_diagonal(found, 1.0)
    return 0.5 * (found + found.T)


def _root(matrix: np.ndarray) -> np.ndarray:
    """A root of a correlation, whose smallest values may have been rounded below zero."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0))
