"""L-BFGS-B of jaxopt, for a function that gives its value and gradient: the one file that knows it.

jaxopt is no longer maintained. Its default of 50 iterations returns unconverged points without a
word, so the limit is set, and what ended the search is checked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.numerics import imported

_MAX_STEPS = 500
#: Bound of the projected gradient, in units of the scale and of the value at the start.
_TOLERANCE = 1e-8
_LEAST_CACHED = "jax_persistent_cache_min_compile_time_secs"


class Minimum(NamedTuple):
    """Where a minimisation ended: the point `(p,)`, the value there, whether the projected gradient
    is below the tolerance, and why it is not; that is empty if it is."""

    x: np.ndarray
    value: float
    converged: bool
    reason: str


def minimise_bounded(
    value_and_gradient: Callable, start: np.ndarray, lower: np.ndarray, upper: np.ndarray,
    scale: np.ndarray | None = None, max_steps: int | None = None,
) -> Minimum:  # fmt: skip
    """Minimise a differentiable function of a vector `(p,)` within bounds.

    Args:
        value_and_gradient: is called with numbers, so it need not be traceable. Where it is not
            finite, steps are cut back.
        start: shape `(p,)`; so are the bounds and `scale`.
        scale: change of each unknown that matters as much as one of any other; the width of the
            bounds by default.
        max_steps: iterations; 500 by default.

    Raises:
        MissingPackage: jaxopt is not installed.
    """
    jaxopt = imported("jaxopt", "jaxopt", "lbfgsb")
    scale = np.where(upper > lower, upper - lower, 1.0) if scale is None else scale
    first = float(value_and_gradient(np.asarray(start))[0])
    if not np.isfinite(first):
        reason = "L-BFGS-B could not begin: the function is not finite at the start"
        return Minimum(np.asarray(start), first, False, reason)
    unit = max(abs(first), 1e-12)

    def scaled(z):
        with jax.disable_jit(False):  # jaxopt calls this without compilation, which it needs
            value, gradient = value_and_gradient(np.clip(np.asarray(z) * scale, lower, upper))
            if not np.isfinite(value):
                return jnp.asarray(jnp.inf), jnp.zeros(len(z))
            return jnp.asarray(value / unit), jnp.asarray(gradient * scale / unit)

    solver = jaxopt.LBFGSB(
        scaled, value_and_grad=True, tol=_TOLERANCE, maxiter=max_steps or _MAX_STEPS,
        stop_if_linesearch_fails=True, implicit_diff=False, jit=False,
    )  # fmt: skip
    bounds, least = (jnp.asarray(lower / scale), jnp.asarray(upper / scale)), _LEAST_CACHED
    usual = getattr(jax.config, least)
    jax.config.update(least, 0.0)  # its loops are 200 small programs, slower to compile than to run
    try:
        with jax.disable_jit():  # which close over arrays: compiled again in every iteration
            answer, state = solver.run(jnp.asarray(start / scale), bounds=bounds)
    finally:
        jax.config.update(least, usual)
    error, failed, reason = float(state.error), bool(state.failed_linesearch), ""
    if not error <= _TOLERANCE:
        ended = "its line search found no lower point" if failed else "the limit of iterations"
        reason = (
            f"L-BFGS-B ended after {int(state.iter_num)} iterations ({ended}): projected gradient "
            f"{error:.1e}, expected at most {_TOLERANCE:.0e}"
        )
    x = np.clip(np.asarray(answer) * scale, lower, upper)
    return Minimum(x, float(state.value) * unit, not reason, reason)
