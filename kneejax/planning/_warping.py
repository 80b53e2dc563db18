"""How far apart two strain curves are when each may run ahead of the other: dynamic time warping.

The curves are aligned by dtaidistance; the distance is the sum of the absolute offsets along the
alignment, as in paper 2 (section 4.3).
"""

from __future__ import annotations

import numpy as np

from kneejax.numerics import imported

#: How many places one curve may run ahead of the other, by default.
WINDOW = 5


def warped(
    curve: np.ndarray, reference: np.ndarray, window: int = WINDOW
) -> tuple[float, np.ndarray]:
    """Distance of a curve from a reference, and its derivative.

    Args:
        curve: `(n,)`.
        reference: `(m,)`.
        window: places by which one may run ahead of the other.

    Returns:
        The sum of absolute offsets along the best alignment, and its derivative by the curve,
        `(n,)`. Both are NaN where a number is not finite.

    Raises:
        MissingPackage: dtaidistance is not installed.

    Source: distance and window of `dtaidistance.dtw` with `inner_dist="euclidean"`.

    Example:
        >>> import pytest; _ = pytest.importorskip("dtaidistance")
        >>> warped(np.array([0.0, 1.0, 0.0]), np.array([0.0, 3.0, 0.0]))[0]
        2.0
    """
    if not (np.isfinite(curve).all() and np.isfinite(reference).all()):
        return np.nan, np.full(len(curve), np.nan)
    path = alignment(curve, reference, window)
    offset = curve[path[:, 0]] - reference[path[:, 1]]
    # Of many alignments the best one stays the best under a small change, so the derivative is
    # that of the sum along it.
    slope = np.bincount(path[:, 0], np.sign(offset), minlength=len(curve))
    return float(np.abs(offset).sum()), slope


def alignment(curve: np.ndarray, reference: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """Places of a curve and of the reference that belong together, `(pairs, 2)`.

    Args:
        curve: `(n,)`, finite.
        reference: `(m,)`, finite.
        window: as in `warped`.
    """
    dtw = imported("dtaidistance.dtw", "dtaidistance", "planning")
    curve, reference = (np.ascontiguousarray(x, float) for x in (curve, reference))
    # dtaidistance counts the place itself as within the window.
    path = dtw.warping_path(curve, reference, window=window + 1, inner_dist="euclidean")
    return np.array(path, int)


def warped_distances(curves: np.ndarray, reference: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """Distances of many curves from one, `(k,)`; arguments as in `warped`, curves `(k, n)`."""
    dtw = imported("dtaidistance.dtw", "dtaidistance", "planning")
    fast = dtw.distance_fast if dtw.try_import_c() else dtw.distance
    found, reference = np.full(len(curves), np.nan), np.ascontiguousarray(reference, float)
    for k, curve in enumerate(curves):
        if np.isfinite(curve).all():
            found[k] = fast(
                np.ascontiguousarray(curve, float), reference, window=window + 1,
                inner_dist="euclidean",
            )  # fmt: skip
    return found
