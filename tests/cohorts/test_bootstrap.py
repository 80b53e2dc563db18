"""Answers whose data are drawn again: reading by reading, and by whole curves."""

import dataclasses

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.cli import main
from kneejax.experiments import MeasuredTest, lab_tests, load_curves, passive_flexion
from kneejax.files import write_poses
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.bootstrap import answered, bootstrap, bootstrap_by_blocks, curves_of
from kneejax.inference.fit import rows_of_tests
from kneejax.parameters import UnsuitableData

pytestmark = pytest.mark.usefixtures("optimised_code")

PARAMETERS = ("ACL.stiffness", "MCL.stiffness")
#: Standard deviation of readings, mm and degrees, so small that the knee answers linearly.
NOISE = 1e-3
#: Error that all readings of a curve share, in these.
OF_CURVE = 2.0
ROWS = tuple(np.linspace(-1.0, 1.0, 7).round(9).tolist())


@pytest.fixture(scope="module")
def asked():
    """A passive motion and nine curves under load, without errors."""
    knee = kj.load_knee("four_ligament")
    kinds = [("drawer", {"force_N": 60.0}), ("torsion", {"moment_Nm": 2.0}),
             ("varus-valgus", {"moment_Nm": 5.0})]  # fmt: skip
    bent = [0.0, 30.0, 60.0]
    tests = [
        dataclasses.replace(test, path=ROWS)
        for name, size in kinds
        for test in lab_tests(name, bent, **size)
    ]
    measured = [
        dataclasses.replace(MeasuredTest.of(one), sd_mm=NOISE, sd_deg=NOISE)
        for one in load_curves(knee, tests)
    ]
    poses = np.array(passive_flexion(knee, [0.0, 30.0, 60.0, 90.0]).to_table())
    return kj.Study(
        title="ten curves", knee=knee, measured=poses, parameters=PARAMETERS,
        weights={"mm": NOISE**-2, "deg": NOISE**-2}, procedures=["III"], noise_mm=NOISE,
        noise_deg=NOISE, tests=measured,
    )  # fmt: skip


@pytest.fixture(scope="module")
def truth(asked):
    return [float(asked.knee.ligaments.stiffness[k]) for k in (0, 2)]


def test_a_curve_is_the_passive_motion_or_a_test_at_one_flexion(asked, truth):
    passive, *others = curves_of(4, asked.tests)
    assert passive.tolist() == [0, 1, 2, 3]
    assert [len(one) for one in others] == [6] * 9  # a row without load tells nothing
    flexion = answered(asked.problem(), truth)[0].load_cases.flexion
    assert [np.ptp(np.asarray(flexion)[one]) for one in others] == [0.0] * 9
    # Flexions that a rig does not hold to a degree are one, and so is what shares a constant.
    rows = np.full((4, 5), np.nan)
    rows[:, FREE_COORDINATES.index("anterior")] = 1.0
    test = MeasuredTest("drawer", [29.4, 60.2, 30.5, 61.0], {"anterior_N": [50.0] * 4}, rows)
    assert [one.tolist() for one in curves_of(0, [test])] == [[0, 2], [1, 3]]
    shared = dataclasses.replace(test, counted_from="offset")
    assert [one.tolist() for one in curves_of(2, [shared])] == [[0, 1], [2, 3, 4, 5]]


@pytest.fixture(scope="module")
def linear(asked, truth):
    """What the model gives, how residuals depend on the parameters, and the curves."""
    cases, first = answered(asked.problem(), truth)
    model = cases.observed(first)[0][0]
    slope = cases.residual(first)[1][0]
    return model, slope.reshape(*model.shape, -1), curves_of(4, asked.tests)


def scattered(curves, shape, draws):
    """Errors in standard deviations of a reading, each curve's own beside those of readings."""
    error = draws.standard_normal(shape)
    for rows in curves:
        error[rows] += OF_CURVE * draws.standard_normal(5)
    return error


def redrawn(slope, error, curves, draws):
    """Answers of the linear model to curves that are drawn with replacement."""
    found = []
    for random in draws:
        lot = random.integers(0, len(curves), len(curves))
        rows = np.concatenate([curves[k] for k in lot])
        normal = np.einsum("rcp,rcq->pq", slope[rows], slope[rows])
        found.append(np.linalg.solve(normal, np.einsum("rcp,rc->p", slope[rows], error[rows])))
    return np.array(found)


def test_draws_of_curves_are_those_of_the_linear_model(asked, truth, linear):
    model, slope, curves = linear
    error = scattered(curves, model.shape, np.random.default_rng(1))
    found = bootstrap_by_blocks(with_data(asked, model + NOISE * error).problem(), truth, range(10))
    expected = redrawn(slope, error, curves, (np.random.default_rng([0, k]) for k in range(10)))
    np.testing.assert_allclose(found - truth, expected, rtol=0.02, atol=0.02 * expected.std())


@pytest.mark.long
def test_errors_of_whole_curves_are_felt_by_blocks_alone(asked, truth, linear):
    model, slope, curves = linear
    shared = np.zeros((len(model), len(model)))  # which rows are of one curve
    for rows in curves:
        shared[np.ix_(rows, rows)] = OF_CURVE**2
    known = np.linalg.inv(np.einsum("rcp,rcq->pq", slope, slope))
    of_curves = known @ np.einsum("rcp,rs,scq->pq", slope, shared, slope) @ known
    by_readings, true = (np.sqrt(np.diag(x)) for x in (known, known + of_curves))

    made = np.std(bootstrap(asked.problem(), truth, np.full(5, NOISE), range(100)), axis=0)
    np.testing.assert_allclose(made, by_readings, rtol=0.25)
    assert (made < 0.65 * true).all()
    draws = np.random.default_rng(0)
    sds = [
        redrawn(slope, scattered(curves, model.shape, draws), curves, [draws] * 60).std(axis=0)
        for _ in range(60)
    ]
    ratio = np.median(sds, axis=0) / true
    assert (ratio > 1.0).all() and (ratio < 2.0).all()


def with_data(asked, table):
    """The same study of other data, a row for each load case."""
    own = []
    for test, rows in zip(asked.tests, rows_of_tests(4, asked.tests), strict=True):
        seen = table[rows.start : rows.start + len(test.flexion_deg)]
        seen = np.where(np.isnan(test.observed), np.nan, seen)
        own.append(dataclasses.replace(test, observed=seen))
    poses = np.column_stack([asked.measured[:, 0], table[:4]])
    return asked.replace(measured=poses, tests=own)


def test_draws_depend_on_their_own_number_alone(asked, truth):
    several = bootstrap_by_blocks(asked.problem(), truth, range(3))
    alone = bootstrap_by_blocks(asked.problem(), truth, range(1, 2))
    np.testing.assert_allclose(several[1], alone[0], rtol=1e-9)
    # Data without errors have one answer, whichever of their curves are drawn.
    np.testing.assert_allclose(several, np.tile(truth, (3, 1)), rtol=1e-5)


def test_too_few_curves_and_what_is_not_drawn_again_are_refused(asked, truth, tmp_path, capsys):
    with pytest.raises(UnsuitableData, match="4 curves: expected at least 6"):
        bootstrap_by_blocks(asked.replace(tests=asked.tests[:1]).problem(), truth, range(1))
    write_poses(tmp_path / "poses.csv", asked.measured)
    (tmp_path / "knees.csv").write_text("name,measured.file\nA1,poses.csv\nA2,poses.csv\n")
    study = {
        "title": "Knee", "knee": "four_ligament", "parameters": list(PARAMETERS),
        "measured": {"file": "", "source": "made"},
    }  # fmt: skip
    document = {"title": "Knees", "study": study, "knees": "knees.csv"}
    (tmp_path / "cohort.yaml").write_text(yaml.safe_dump(document))
    out = tmp_path / "out"
    words = ["calibrate", str(tmp_path), "--out", str(out), "--bootstrap", "9", "--blocks"]
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    place = f"kneejax: {tmp_path / 'knees.csv'}: row"
    assert all(line.startswith(f"{place} {k}") for k, line in enumerate(lines[:2], 1))
    assert "1 curve: expected at least 6" in lines[0] and len(lines) == 3
    assert not out.exists()
