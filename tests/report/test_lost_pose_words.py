"""What is said of a pose that a search did not find."""

import types

import numpy as np
import pytest

from kneejax.geometry import PATELLA, TIBIA, free_of
from kneejax.report.pose_tables import _of_lost
from kneejax.statics import Status


@pytest.mark.parametrize("bodies", [(TIBIA,), (TIBIA, PATELLA)])
def test_a_search_tells_how_far_it_was_with_and_without_a_patella(bodies):
    count = len(free_of(["flexion"], bodies))
    residual = np.zeros((count, 1))
    residual[-1] = 2.0  # a force: translations come last
    equilibrium = types.SimpleNamespace(prescribed={"flexion": 0.0}, residual=residual, fault=[0])
    motion = types.SimpleNamespace(
        reached=[0.5], status=[Status.NOT_CONVERGED], left_mm=np.array([0.3]),
        equilibrium=equilibrium,
        knee=types.SimpleNamespace(bodies=bodies),
    )  # fmt: skip
    told = _of_lost(motion, 0, {})
    assert told.startswith("the search stopped 0.3 mm and 2 N from a balance beyond 0.5 of the")
    # Where it found one that is connected with nothing, it is not a billionth of a mm off.
    motion.left_mm = np.array([6e-11])
    assert _of_lost(motion, 0, {}) == "a balance was found, but no motion leads there"
