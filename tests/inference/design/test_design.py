"""The next best test: choices by hand, against random ones, and what they promise."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.inference import (
    Candidate,
    Observations,
    design_tests,
    fit_information,
    information,
    noise_of,
    usual_candidates,
)
from kneejax.inference.design import (
    choose,
    criterion_of,
    departures,
    load_cases_of,
    standard_errors,
    told_by,
)
from kneejax.inference.fit import table_of
from kneejax.parameters import UnsuitableData, select
from kneejax.report.information import design_notes, design_words
from kneejax.statics import LoadCases, Status, balance_with_slopes

pytestmark = pytest.mark.usefixtures("optimised_code")

PARAMETERS = ("*.stiffness", "*.reference_strain")
NOISE = noise_of(0.1, 0.1)
TESTS = usual_candidates()
#: Two knees that differ from the bundled one in strains, stiffnesses and attachments.
SEEDS = (None, 1, 2)


def variant(seed):
    """The four ligaments, or a seeded neighbour of them."""
    knee = kj.load_knee("four_ligament")
    if seed is None:
        return knee
    rng, changes = np.random.default_rng(seed), {}
    for row, name in enumerate(knee.ligaments.names):
        changes[f"{name}.stiffness"] = knee.ligaments.stiffness[row] * rng.uniform(0.7, 1.3)
        for end in ("femoral", "tibial"):
            for column, axis in enumerate(("anterior", "superior", "lateral")):
                old = float(getattr(knee.ligaments, f"{end}_attachment")[row, column])
                changes[f"{name}.{end}_attachment.{axis}"] = old + rng.normal(0.0, 1.0)
    moved = knee.replace(changes)
    strain = np.asarray(knee.reference_strain()) + rng.normal(0.0, 0.01, 4)
    names = (f"{name}.reference_strain" for name in knee.ligaments.names)
    return moved.replace(dict(zip(names, strain, strict=True)))


def known(knee):
    """What a passive motion tells of a knee, at its own parameters."""
    selection, load_cases = select(knee, PARAMETERS), LoadCases.at(np.arange(0.0, 121.0, 5.0))
    values = np.asarray(selection.read(knee))
    fit = balance_with_slopes(knee, selection.apply, values[None], load_cases)
    data = Observations(load_cases, np.zeros((25, 5)), NOISE)
    table = fit.q[0] * np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0]
    return selection, fit_information(knee, selection, data, fit), table.T


def under_loads(selection, knee, values):
    return balance_with_slopes(knee, selection.apply, values[None], load_cases_of(TESTS))


@pytest.fixture(scope="module")
def cases():
    """Three knees with what is known of them, and what each usual test would tell."""
    found = []
    for seed in SEEDS:
        knee = variant(seed)
        selection, data, passive = known(knee)
        poses = under_loads(selection, knee, data.values)
        found.append((knee, selection, data, poses, passive))
    return found


def told_and_usable(case):
    _, _, data, poses, _ = case
    usable = poses.status[0] == Status.BALANCED
    jacobian = np.where(usable[:, None, None], table_of(poses)[1][0], 0.0)
    return told_by(TESTS, jacobian, NOISE, data.scale), usable


def rank_one(*vectors):
    return np.array([np.outer(v, v) for v in vectors], float)


def test_on_a_diagonal_each_criterion_chooses_what_a_hand_would():
    """Information 1 and 4; a test adds 2 to the first, or 6 to the second, or 1 to both."""
    base = np.diag([1.0, 4.0])
    told = np.array([np.diag([2.0, 0.0]), np.diag([0.0, 6.0]), np.diag([1.0, 1.0])])
    # Determinants 12, 10, 10; traces of the inverse 7/12, 11/10, 7/10.
    assert choose(base, told, 1, "D") == choose(base, told, 1, "A") == (0,)
    assert np.exp(-criterion_of(base + told, "D")) == pytest.approx([12.0, 10.0, 10.0])
    assert criterion_of(base + told, "A") == pytest.approx([7 / 12, 1.1, 0.7])
    # Were the second parameter the less certain one for A only:
    told = np.array([np.diag([1.5, 0.0]), np.diag([0.0, 8.0])])
    base = np.diag([3.0, 4.0])
    assert choose(base, told, 1, "D") == (1,) and choose(base, told, 1, "A") == (1,)
    told[1, 1, 1] = 1.9
    assert choose(base, told, 1, "D") == (0,)


def test_exchange_repairs_what_greed_spoils():
    """The single best test lies between two that are better together."""
    told = rank_one([1.0, 0.0], [0.0, 1.0], [0.75, 0.75])
    base = 1e-3 * np.eye(2)
    assert choose(base, told, 1, "D") == (2,)
    assert sorted(choose(base, told, 2, "D")) == [0, 1]
    assert sorted(choose(base, told, 2, "A")) == [0, 1]


def test_a_test_is_made_once_unless_repeats_are_allowed():
    told = rank_one([3.0, 0.0], [0.1, 0.0], [0.0, 0.2])
    base = np.diag([1.0, 100.0])
    assert sorted(choose(base, told, 2)) == [0, 1]
    assert choose(base, told, 2, repeat=True) == (0, 0)
    assert 0 not in choose(base, told, 2, usable=np.array([False, True, True]))


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_all_candidates_tell_the_same_in_any_order(rng, criterion):
    told = rank_one(*rng.normal(size=(6, 3)))
    chosen = choose(np.eye(3), told, 6, criterion)
    assert sorted(chosen) == list(range(6))
    shuffled = rng.permutation(6)
    again = choose(np.eye(3), told[shuffled], 6, criterion)
    assert [shuffled[row] for row in again] == list(chosen)


def test_what_a_test_promises_is_what_refits_scatter(rng):
    """A linear model, measured and fitted ten thousand times."""
    jacobian = rng.normal(size=(8, 5, 3))
    noise, truth = np.array([0.1, 0.2, 0.3, 0.1, 0.5]), np.array([1.0, -2.0, 0.5])
    names = tuple(f"{name}.reference_strain" for name in ("ACL", "PCL", "MCL"))
    tests = [Candidate("none", float(i)) for i in range(8)]
    told = told_by(tests, jacobian, noise, np.ones(3))
    first = information(np.moveaxis(jacobian[:2], 0, 1), noise, names, truth, scale=np.ones(3))
    (row,) = choose(first.matrix, told[2:], 1)
    rows = np.concatenate([*jacobian[:2], jacobian[2 + row]]) / np.tile(noise, 3)[:, None]
    measured = rows @ truth + rng.normal(size=(10_000, 15))
    scatter = np.linalg.lstsq(rows, measured.T, rcond=None)[0].std(axis=1)
    promised = standard_errors(first.matrix + told[2 + row])
    np.testing.assert_allclose(promised, scatter, rtol=0.03)


def test_only_what_is_measured_tells(rng):
    jacobian = rng.normal(size=(1, 5, 2))
    one = [Candidate("drawer", 30.0, measured=("anterior",))]
    row = jacobian[0, 2] / 0.1
    np.testing.assert_allclose(told_by(one, jacobian, NOISE, np.ones(2))[0], np.outer(row, row))


@pytest.mark.long
def test_derivatives_under_loads_are_those_of_differences(cases):
    """Along one direction in all parameters, at every load case."""
    knee, selection, data, poses, _ = cases[0]
    direction = np.random.default_rng(0).normal(size=8) * data.scale * 1e-3

    def table(part):
        moved = data.values + part * direction
        return table_of(under_loads(selection, knee, moved))[0][0]

    near, far = table(0.5) - table(-0.5), table(1.0) - table(-1.0)
    numeric = (8.0 * near - far) / 6.0
    exact = table_of(poses)[1][0] @ direction
    inside = poses.status[0] == Status.BALANCED
    assert inside.sum() > 40
    error = np.abs(exact - numeric).max(axis=1) / np.abs(exact).max(axis=1)
    assert error[inside].max() < 1e-6


def test_a_test_without_load_is_a_pose_of_the_passive_motion(cases):
    """Every 15 degrees of every 5."""
    for *_, poses, passive in cases:
        rows = [i for i, test in enumerate(TESTS) if test.name == "no load"]
        np.testing.assert_allclose(table_of(poses)[0][0, rows], passive.T[::3], atol=1e-6)


def test_loads_act_as_their_names_say(cases):
    _, _, _, poses, _ = cases[0]
    by_name = {str(test): row for test, row in zip(TESTS, table_of(poses)[0][0], strict=True)}

    def change(load, flexion):
        return by_name[f"{load} at {flexion} degrees"] - by_name[f"no load at {flexion} degrees"]

    assert (
        change("anterior force 100 N", 30)[2] > 1.0 > -1.0 > change("posterior force 100 N", 30)[2]
    )
    assert change("internal torque 3 N m", 30)[1] > 5.0
    assert change("external torque 3 N m", 30)[1] < -5.0
    assert change("varus moment 10 N m", 0)[0] > 0.5 > -0.5 > change("valgus moment 10 N m", 0)[0]
    # A drawer follows the tibia: at 90 degrees its anterior is the femur's inferior.
    assert change("anterior force 100 N", 90)[3] < -0.5


@pytest.mark.parametrize("criterion", ["D", "A"])
@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("row", range(len(SEEDS)))
def test_no_random_choice_is_better(cases, row, count, criterion):
    told, usable = told_and_usable(cases[row])
    base = cases[row][2].matrix
    rng, pool = np.random.default_rng(row), np.flatnonzero(usable)
    assert len(pool) > 30
    draws = np.array([rng.choice(pool, count, replace=False) for _ in range(1000)])
    best = criterion_of(base + told[draws].sum(axis=1), criterion).min()
    chosen = list(choose(base, told, count, criterion, usable=usable))
    assert len(set(chosen)) == count and usable[chosen].all()
    assert criterion_of(base + told[chosen].sum(axis=0), criterion) <= best + 1e-12


def test_scales_do_not_change_what_d_chooses(cases):
    data = cases[1][2]
    told, usable = told_and_usable(cases[1])
    other = np.random.default_rng(5).uniform(0.01, 100.0, 8)
    scaled = data.matrix * np.outer(other, other), told * np.outer(other, other)
    expected = choose(data.matrix, told, 4, usable=usable)
    assert choose(*scaled, 4, usable=usable) == expected


def test_a_design_says_what_to_do_and_keeps_its_books(cases):
    knee, selection, data, poses, _ = cases[0]
    design = design_tests(selection, knee, data, NOISE, count=3)
    told, usable = told_and_usable(cases[0])
    np.testing.assert_array_equal(design.status, poses.status[0])
    assert np.isfinite(design.gains).tolist() == usable.tolist()
    np.testing.assert_allclose(design.standard_errors[0], data.standard_error, rtol=1e-6)
    full = data.matrix + told[list(design.chosen)].sum(axis=0)
    np.testing.assert_allclose(design.standard_errors[-1], standard_errors(full) * data.scale)
    assert (np.diff(design.standard_errors, axis=0) <= 0).all()
    assert (np.diff(design.criterion_values) < 0).all()
    # Bits: half the binary logarithm by which the determinant grows.
    row = design.chosen[0]
    ratio = np.linalg.det(data.matrix + told[row]) / np.linalg.det(data.matrix)
    assert design.gains[row] == pytest.approx(0.5 * np.log2(ratio), rel=1e-8)
    single = design.standard_errors_next[row]
    np.testing.assert_allclose(single, design.standard_errors[1])
    first = f"Next: {design.tests[0]}; it cuts the standard error of"
    assert design_words(design)[0].startswith(first)
    left_out = int((~usable).sum())
    assert f"{left_out} of 72 candidates are left out" in " ".join(design_notes(design))
    assert len(design.departures) == 3 and (design.departures > 0).all()


def test_data_that_leave_something_open_borrow_a_prior_and_say_so(cases):
    knee, selection, data, *_ = cases[0]
    bare = information(np.zeros((5, 8)), 0.1, data.names, data.values)
    design = design_tests(selection, knee, bare, NOISE, count=1)
    np.testing.assert_array_equal(design.prior, bare.scale)
    np.testing.assert_allclose(design.standard_errors[0], bare.scale)
    assert design.criterion_values[0] == pytest.approx(1.0)
    assert "The data alone leave combinations" in design_notes(design)[0]
    given = design_tests(selection, knee, bare, NOISE, count=1, prior=bare.scale)
    assert given.chosen == design.chosen and "The data alone" not in " ".join(design_notes(given))


def test_departures_from_a_line_shrink_with_what_is_still_unknown(cases):
    """The second derivative's part of a step, to the first's, goes with the step."""
    knee, selection, data, poses, _ = cases[0]
    row = [str(test) for test in TESTS].index("varus moment 10 N m at 30 degrees")
    covariance = np.diag((0.01 * data.scale) ** 2)
    wide, narrow = (
        departures(selection, knee, data.values, c, NOISE, TESTS, (row,), poses)[0]
        for c in (covariance, covariance / 100)
    )
    assert 0.0 < narrow < wide
    assert wide / narrow == pytest.approx(10.0, rel=0.1)


def test_weak_data_borrow_the_prior_where_they_know_less_than_it(cases):
    knee, selection, data, *_ = cases[0]
    row = data.eigenvectors[:, :7] * np.sqrt(data.eigenvalues[:7])
    weakest = data.eigenvectors[:, 7:]
    for size, borrowed in ((0.9, True), (1.1, False)):
        matrix = row @ row.T + size * weakest @ weakest.T
        weak = dataclasses.replace(data, matrix=matrix)
        design = design_tests(selection, knee, weak, NOISE, count=1)
        assert (design.prior is not None) == borrowed


def test_a_promise_that_no_line_can_hold_is_called_rough(cases):
    knee, selection, data, *_ = cases[0]
    bare = information(np.zeros((5, 8)), 0.1, data.names, data.values)
    design = design_tests(selection, knee, bare, NOISE, count=1, prior=4.0 * bare.scale)
    assert design.departures.max() > 0.5 and "rough guide" in " ".join(design_notes(design))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"criterion": "E"}, "unknown criterion 'E': expected D or A"),
        ({"count": 0}, "0 tests: expected at least 1"),
        ({"count": 73}, "73 tests wanted, of 72 candidates: ask for fewer"),
        (
            {"count": 1, "candidates": (Candidate("far", 170.0),)},
            "1 tests wanted, but the model predicts only 0 of 1",
        ),
        ({"candidates": ()}, "no candidates"),
        ({"prior": np.r_[np.ones(7), 0.0]}, "LCL.reference_strain: prior of width 0: expected"),
        ({"prior": np.ones(3)}, r"prior of shape \(3,\): expected \(8,\)"),
        ({"noise": np.zeros(5)}, "noise .*expected five standard deviations above 0"),
    ],
)
def test_an_unsuitable_question_is_refused(cases, change, words):
    knee, selection, data, *_ = cases[0]
    with pytest.raises(UnsuitableData, match=words):
        design_tests(
            **({"selection": selection, "knee": knee, "known": data, "noise": NOISE} | change)
        )


def test_information_of_other_parameters_is_refused(cases):
    knee, _, data, *_ = cases[0]
    with pytest.raises(UnsuitableData, match="not that of the selected"):
        design_tests(select(knee, ["*.stiffness"]), knee, data, NOISE)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"measured": ("flexion",)}, "unknown coordinate 'flexion'; expected any of adduction"),
        ({"measured": ()}, "nothing is measured"),
        ({"anterior_N": np.nan}, "anterior_N: nan: expected between -100,000 and 100,000 N"),
        ({"varus_Nm": 5000.0}, "varus_Nm: 5000: expected .* N mm are suspected"),
    ],
)
def test_a_candidate_that_means_nothing_is_refused(fields, words):
    with pytest.raises(UnsuitableData, match=f"drawer at 30 degrees: {words}"):
        Candidate("drawer", 30.0, **fields)


def test_loads_are_called_by_their_clinical_names():
    assert [test.name for test in TESTS[::9]] == [
        "no load", "anterior force 100 N", "posterior force 100 N", "internal torque 3 N m",
        "external torque 3 N m", "varus moment 10 N m", "valgus moment 10 N m", "compression 200 N",
    ]  # fmt: skip


def test_stations_carry_the_loads_along_the_axes_of_grood_and_suntay():
    load_cases = load_cases_of(TESTS)
    assert isinstance(load_cases, LoadCases) and len(load_cases) == 72
    (load,) = load_cases.loads
    assert load.axes == "grood_suntay" and load.point_in == "tibia"
    row = [str(test) for test in TESTS].index("varus moment 10 N m at 45 degrees")
    np.testing.assert_allclose(load.moment[row], [10_000.0, 0.0, 0.0])
    assert float(jnp.rad2deg(load_cases.flexion[row])) == pytest.approx(45.0)
