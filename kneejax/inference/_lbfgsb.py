"""L-BFGS-B of jaxopt, for objectives that are no least squares. The only file that knows jaxopt.

jaxopt is no longer maintained and warns of that on import; the warning is silenced here and
nowhere else. Its default of 50 iterations returns unconverged points without a word, so the
limit is set and its error is checked.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np


def minimise_bounded(
    value_and_gradient: Callable,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    tolerance: float = 1e-6,
    max_steps: int = 500,
) -> tuple[np.ndarray, bool, int]:
    """Minimise a differentiable function within bounds.

    Args:
        value_and_gradient: of a vector scaled to 0..1 over the bounds; traceable by JAX.
        start: shape `(p,)`.
        lower: shape `(p,)`.
        upper: shape `(p,)`.
        tolerance: on the projected gradient over the objective at the start.
        max_steps: iterations.

    Returns:
        The minimiser, whether it converged, and the iterations.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*JAXopt.*", category=DeprecationWarning)
        warnings.filterwarnings("ignore", message=".*jaxopt.*", category=DeprecationWarning)
        import jaxopt

    width = np.where(upper > lower, upper - lower, 1.0)
    value, _ = value_and_gradient(jnp.asarray(start))
    scale = max(abs(float(value)), 1e-12)

    def scaled(z):
        value, gradient = value_and_gradient(lower + z * width)
        return value / scale, gradient * width / scale

    # Its own loops stay in Python (jit=False): the objective is compiled already, with options
    # that JAX takes at the outermost level only.
    solver = jaxopt.LBFGSB(
        scaled, value_and_grad=True, tol=tolerance, maxiter=max_steps, jit=False
    )
    bounds = (jnp.zeros(len(start)), jnp.asarray((upper - lower) / width))
    answer, state = solver.run(jnp.asarray((start - lower) / width), bounds=bounds)
    converged = bool(state.error <= tolerance)
    return lower + np.asarray(answer) * width, converged, int(state.iter_num)
