"""What a linear model of a misfit leaves out: how the derivatives change along the way.

Where a valley of the misfit bends, the others cannot make up for a step as the derivatives at one
point say, and an arm that believes them crawls. What it saw of the derivatives elsewhere is kept as
a second-order part of the sum of squares, as NL2SOL does (J. E. Dennis, D. M. Gay and R. E. Welsch,
ACM Trans. Math. Softw. 7, 348, 1981). It costs no evaluation. Of kinks, where a fibre goes slack
or a contact begins, nothing is learned: believed, they end arms early.
"""

from __future__ import annotations

import numpy as np

#: A change of the gradient along a step below this says nothing of curvature.
_SILENT = 1e-12
#: A sum of squares that is flatter than this part of the linear model's has no farthest point.
_FLAT = 1e-9
#: More curvature than so many times the linear model's is no curvature but a kink that was passed.
_KINK = 3.0


def learned(
    curvature: np.ndarray, linear: np.ndarray, step: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Second-order part of half a sum of squares' Hessian, after one more step has been seen.

    Args:
        curvature: as it was, zero if nothing is known, `(p, p)`.
        linear: products of derivatives where the model stands, `(p, p)`.
        step: that was seen, `(p,)`.
        change: of half the gradient along it, `(p,)`.

    Returns:
        The least change of `curvature`, in the metric of what was seen, with which the Hessian
        explains it, `(p, p)`; unchanged where the gradient falls along the step, and where
        a kink was passed.

    Example:
        >>> curvature = learned(np.zeros((1, 1)), np.eye(1), np.array([2.0]), np.array([5.0]))
        >>> float((1.0 + curvature.item()) * 2.0)
        5.0
    """
    along = float(step @ change)
    if along <= _SILENT:
        return curvature
    wanted = change - linear @ step
    if abs(step @ wanted) > _KINK * float(step @ linear @ step):
        return curvature
    had = step @ curvature @ step
    # An old part that is too large for what is seen now would outlive it.
    kept = curvature * (min(1.0, abs(step @ wanted) / abs(had)) if had else 1.0)
    missing = wanted - kept @ step
    outer = np.outer(missing, change) / along
    return kept + outer + outer.T - (missing @ step) * np.outer(change, change) / along**2


def is_convex(hessian: np.ndarray, linear: np.ndarray) -> bool:
    """Whether a Hessian is positive, in the scale of the linear model's, both `(p, p)`."""
    scale = np.sqrt(np.diag(linear))
    return bool(np.linalg.eigvalsh(hessian / np.outer(scale, scale))[0] > _FLAT)
