"""L-BFGS-B of jaxopt, for a function that gives its value and gradient.

The only file that knows jaxopt. jaxopt is no longer maintained and warns of that on import; the
warning is silenced here and nowhere else. Its default of 50 iterations returns unconverged points
without a word, so the limit is set, and what ended the search is checked.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.parameters import UnsuitableData

_MAX_STEPS = 500
_CACHE_THRESHOLD = "jax_persistent_cache_min_compile_time_secs"


class Minimum(NamedTuple):
    """Where a minimisation ended.

    Attributes:
        x: the point, `(p,)`.
        value: of the function there.
        converged: whether the projected gradient is below the tolerance.
        iterations: of the search.
        reason: why it did not converge; empty if it did.
    """

    x: np.ndarray
    value: float
    converged: bool
    iterations: int
    reason: str


def minimise_bounded(
    value_and_gradient: Callable,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    scale: np.ndarray | None = None,
    tolerance: float = 1e-8,
    max_steps: int | None = None,
) -> Minimum:
    """Minimise a differentiable function within bounds.

    Args:
        value_and_gradient: of a vector `(p,)`, a number and a vector `(p,)`. It is called with
            numbers, so it need not be traceable. Where it is not finite, steps are cut back.
        start: shape `(p,)`.
        lower: shape `(p,)`.
        upper: shape `(p,)`.
        scale: change of each unknown that matters as much as one of any other, `(p,)`; the width
            of the bounds by default.
        tolerance: on the projected gradient, in units of `scale` and of the value at the start.
        max_steps: iterations; 500 by default.

    Returns:
        The `Minimum`.

    Raises:
        UnsuitableData: jaxopt is not installed.
    """
    jaxopt = _import_jaxopt()
    scale = np.where(upper > lower, upper - lower, 1.0) if scale is None else scale
    first, _ = value_and_gradient(np.asarray(start))
    if not np.isfinite(first):
        reason = "L-BFGS-B could not begin: the function is not finite at the start"
        return Minimum(np.asarray(start), float(first), False, 0, reason)
    unit = max(abs(float(first)), 1e-12)

    def scaled(z):
        # jaxopt calls this with compilation switched off; what it calls needs it.
        with jax.disable_jit(False):
            x = np.clip(np.asarray(z) * scale, lower, upper)
            value, gradient = value_and_gradient(x)
            if not np.isfinite(value):
                return jnp.asarray(jnp.inf), jnp.zeros(len(x))
            return jnp.asarray(value / unit), jnp.asarray(gradient * scale / unit)

    solver = jaxopt.LBFGSB(
        scaled,
        value_and_grad=True,
        tol=tolerance,
        maxiter=_MAX_STEPS if max_steps is None else max_steps,
        stop_if_linesearch_fails=True,
        implicit_diff=False,
        jit=False,
    )
    bounds = (jnp.asarray(lower / scale), jnp.asarray(upper / scale))
    # Its lax loops close over arrays: left to JAX they would compile anew in every iteration.
    with jax.disable_jit(), _small_programs_cached():
        answer, state = solver.run(jnp.asarray(start / scale), bounds=bounds)
    steps, error = int(state.iter_num), float(state.error)
    converged = error <= tolerance
    return Minimum(
        np.clip(np.asarray(answer) * scale, lower, upper),
        float(state.value) * unit,
        converged,
        steps,
        "" if converged else _reason(bool(state.failed_linesearch), steps, error, tolerance),
    )


def _reason(failed: bool, steps: int, error: float, tolerance: float) -> str:
    ended = "its line search found no lower point" if failed else "the limit of iterations"
    return (
        f"L-BFGS-B ended after {steps} iterations ({ended}): projected gradient {error:.1e}, "
        f"expected at most {tolerance:.0e}"
    )


@contextlib.contextmanager
def _small_programs_cached() -> Iterator[None]:
    """Let JAX's compilation cache, where there is one, take programs that compile quickly.

    jaxopt's loops run as some 200 of them, which take longer to compile than the search takes.
    """
    least = getattr(jax.config, _CACHE_THRESHOLD)
    jax.config.update(_CACHE_THRESHOLD, 0.0)
    try:
        yield
    finally:
        jax.config.update(_CACHE_THRESHOLD, least)


def _import_jaxopt():
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*JAXopt.*", category=DeprecationWarning)
        warnings.filterwarnings("ignore", message=".*jaxopt.*", category=DeprecationWarning)
        try:
            import jaxopt
        except ModuleNotFoundError:
            raise UnsuitableData(
                'method lbfgsb needs jaxopt: pip install "kneejax[lbfgsb]"'
            ) from None
    return jaxopt
