"""How should XLA fuse on a CPU, for a motion of 25 poses and one evaluation over 128 lanes?

    python benchmarks/compile_options.py [--repeats 20]

`solve_equilibrium` (a march over 120 degrees, 25 lanes) and `balance` (force and tangent, 128
lanes): processor seconds to trace and compile and milliseconds to run, with XLA's fusion as it is,
without fusion, with shared fusion, and with that from XLA's older emitters, optimised and as it
comes, each in a process of its own.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
from _protocol import PLAIN, arguments, finish, load, timed

from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import add_lane_axis
from kneejax.statics import LoadCases, balance, continued_in_trace

OLDER = {"xla_cpu_use_fusion_emitters": False, "xla_llvm_disable_expensive_passes": True}
MODES = {
    "without_fusion": {"xla_disable_hlo_passes": "fusion"},
    "as_it_is": {},
    "shared": {},
    "shared_older": OLDER,
    "shared_older_as_it_comes": OLDER | {"xla_backend_optimization_level": 0},
}


def measure(knee, mode: str, repeats: int) -> dict[str, float]:
    """Processor seconds to trace and compile, and milliseconds to run, in this process."""
    lanes, rows = add_lane_axis(knee), {}
    many, few = jnp.linspace(0.0, 2.0, 128), jnp.deg2rad(jnp.arange(0.0, 121.0, 5.0))
    reference = lanes.at_reference.at(FREE_COORDINATES)
    q = jnp.broadcast_to(reference, (5, len(many)))
    load_cases = LoadCases({"flexion": few})
    asked = {
        "balance": (balance, (lanes, {"flexion": many}, q)),
        "motion": (continued_in_trace, (knee, load_cases)),
    }
    for name, (function, what) in asked.items():
        begun = time.process_time()
        lowered = jax.jit(function).lower(*what)
        traced = time.process_time()
        ready = lowered.compile(compiler_options=MODES[mode])
        rows[f"{name}_{mode}_trace_s"] = traced - begun
        rows[f"{name}_{mode}_compile_s"] = time.process_time() - traced
        seconds = [timed(ready, *what)[0] for _ in range(repeats + 1)][1:]
        rows[f"{name}_{mode}_run_ms"] = 1e3 * statistics.median(seconds)
    return rows


def main() -> None:
    mode = os.environ.get("KNEEJAX_FUSION")
    options = arguments("compile_options", __doc__, repeats=20)
    if mode:
        print(json.dumps(measure(load(options.knee), mode, options.repeats)))
        return
    rows: dict[str, object] = {}
    for mode in MODES:
        environment = os.environ | {"KNEEJAX_FUSION": mode, PLAIN: "" if "shared" in mode else "1"}
        # What this process has chosen is no choice of that one, nor what others have compiled.
        environment |= {"XLA_FLAGS": "", "JAX_ENABLE_COMPILATION_CACHE": "0"}
        answer = subprocess.run(
            [sys.executable, *sys.argv], env=environment, capture_output=True, check=True
        )
        rows |= json.loads(answer.stdout.splitlines()[-1])
    finish(options.out, "XLA's fusion: compile and run time", rows)


if __name__ == "__main__":
    main()
