"""Does XLA's fusion pass pay on a CPU, for one evaluation of forces and tangent?

    python benchmarks/compile_options.py [--repeats 50]

`kneejax.statics.balance` with and without `compiler_options()`, for 25 and 256 lanes: seconds to
compile (the tracing apart) and milliseconds to run.
"""

from __future__ import annotations

import statistics
import time

import jax
import jax.numpy as jnp
from _protocol import arguments, finish, load, timed

from kneejax.mechanics import add_lane_axis
from kneejax.statics import balance, compiler_options, first_guess


def main() -> None:
    options = arguments("compile_options", __doc__, repeats=50)
    knee = add_lane_axis(load(options.knee))
    rows: dict[str, object] = {}
    for lanes in (25, 256):
        flexion = jnp.linspace(0.0, 2.0, lanes)
        guess = jax.jit(first_guess)(knee, flexion)
        what = (knee, flexion, guess.q, guess.meeting)
        ready = {}
        begun = time.perf_counter()
        lowered = jax.jit(balance).lower(*what)
        rows[f"{lanes}_trace_s"] = time.perf_counter() - begun
        for name, chosen in (("with_fusion", {}), ("without_fusion", compiler_options())):
            begun = time.perf_counter()
            ready[name] = lowered.compile(compiler_options=chosen)
            rows[f"{lanes}_{name}_compile_s"] = time.perf_counter() - begun
        runs = {name: [] for name in ready}
        for _ in range(options.repeats):
            for name, function in ready.items():
                runs[name].append(timed(function, *what)[0])
        for name, seconds in runs.items():
            rows[f"{lanes}_{name}_run_ms"] = 1e3 * statistics.median(seconds)
    finish(options.out, "XLA's fusion pass: compile and run time of one evaluation", rows)


if __name__ == "__main__":
    main()
