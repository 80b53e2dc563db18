"""What a first run waits for once a leg is balanced."""

import os
import subprocess
import sys

import pytest

#: As a command compiles; of the balance only the shape counts, so nothing is searched.
AS_A_COMMAND = """
import kneejax as kj
kj.configure()
import jax
import numpy as np
from kneejax.experiments._extensor_mechanism import pulls, weight_of
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import counted_programs
from kneejax.statics import Guess, LoadCases, solve_equilibrium

knee = kj.load_knee_file("lenhart2015_reduced").with_patella()
cases = LoadCases.at(np.full(3, 30.0), (weight_of(),)).of(knee)
guess = Guess(np.zeros((len(cases.free), 3)))
shapes = jax.eval_shape(solve_equilibrium, add_lane_axis(knee), cases.prescribed, guess)
balance = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), shapes)
with counted_programs() as programs:
    pulls(knee, cases, balance)
print(programs.summary()["seconds"])
"""


@pytest.mark.long
def test_pulls_of_muscles_around_bones_compile_in_seconds(tmp_path):
    """0.3 s; with XLA's older emitters 315 s."""
    own = {k: x for k, x in os.environ.items() if k != "XLA_FLAGS" and not k.startswith("JAX_")}
    own["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path)
    command = [sys.executable, "-c", AS_A_COMMAND]
    done = subprocess.run(command, env=own, capture_output=True, text=True, timeout=150.0)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 20.0
