"""Maps of a study with tests under load: each grid point is a calibration's objective there."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import evaluate
from kneejax.inference import Condition, sensitivity_map
from kneejax.inference.fit import Problem

pytestmark = pytest.mark.usefixtures("optimised_code")

PAIR = ("ACL.stiffness", "ACL.reference_strain")
NOISE = np.array([0.2, 0.2, 0.1, 0.1, 0.1])
#: One over the variances; the lateral shift does not count.
WEIGHTS = NOISE**-2.0 * [1.0, 1.0, 1.0, 1.0, 0.0]
BOUNDS = {PAIR[0]: (3000.0, 6000.0), PAIR[1]: (0.01, 0.05)}


@pytest.fixture(scope="module")
def measured(knee):
    """Of a knee in the middle of the grid: poses, a drawer with the ACL's pull, and one without
    the MCL, counted from before it was cut."""
    true = knee.replace({PAIR[0]: 4500.0, PAIR[1]: 0.03})
    poses = np.asarray(kj.passive_flexion(true, [10.0, 50.0]).to_table())
    (test,) = kj.lab_tests("drawer", [20.0, 60.0], force_N=60.0, steps=1)
    (whole,) = kj.load_curves(true, test)
    (torn,) = kj.load_curves(kj.cut(true, ["MCL"]), test, true)
    parts = evaluate(true, whole.motion.pose, whole.motion.equilibrium.contact_points)
    pull = np.asarray(parts.tension)[whole.nodes[:, 1], true.ligaments.names.index("ACL")]
    intact = kj.MeasuredTest.of(whole, sd_mm=0.2)
    intact = dataclasses.replace(intact, readings={"ACL.tension_N": pull}, sd_N=3.0)
    cut = dataclasses.replace(kj.MeasuredTest.of(torn, cut=("MCL",)), name="cut")
    return poses, (intact, cut)


@pytest.mark.long
def test_grid_points_are_objectives_of_a_calibration(knee, measured):
    poses, tests = measured
    found = sensitivity_map(
        knee, poses, PAIR, grid=(3, 3), bounds=BOUNDS, weights=WEIGHTS, tests=tests, known=NOISE
    )
    assert (found.condition == Condition.SOUND).all()
    problem = Problem.of(knee, kj.select(knee, PAIR), poses, WEIGHTS, (), (), tests, NOISE)
    for row, column in ((0, 0), (1, 2), (2, 1)):
        at = problem.begin(np.array([[found.x[column], found.y[row]]]))
        objective = float((problem.residual(at)[0] ** 2).sum())
        assert found.objective[row, column] == pytest.approx(objective, rel=1e-5)
    # What made the data stands in the middle, and nothing is left there.
    assert found.objective[1, 1] < 1e-6 * found.objective[[0, 0, 2, 2], [0, 2, 0, 2]].min()
    assert found.minimum[:2] == pytest.approx((4500.0, 0.03))
    own = problem.begin(np.asarray(problem.selection.read(knee))[None])
    assert found.start_objective == pytest.approx(float((problem.residual(own)[0] ** 2).sum()))


def test_each_grid_point_takes_the_best_constants_of_the_frames(knee, measured):
    poses, tests = measured
    moved = poses + np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0])
    given = {"grid": (2, 2), "bounds": BOUNDS, "tests": tests[1:]}
    maps = [
        sensitivity_map(knee, table, PAIR, offsets=("anterior",), **given)
        for table in (poses, moved)
    ]
    np.testing.assert_allclose(maps[0].objective, maps[1].objective, rtol=1e-8, atol=1e-10)
