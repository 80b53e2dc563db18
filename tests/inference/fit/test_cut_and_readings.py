"""Tests on cut knees, and forces and strains that were read, as data of the one fit."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import evaluate, weights_by_load
from kneejax.geometry import FREE_COORDINATES, Frame, Plane, Sphere
from kneejax.inference import balances_of
from kneejax.inference.fit import Problem, _cut, fit_lanes, slack_at
from kneejax.mechanics import Contact, Knee, Ligaments, add_lane_axis
from kneejax.parameters import UnknownParameter
from kneejax.statics import Slopes, balance_with_slopes

#: Each compiles a search of its own.
pytestmark = pytest.mark.long

NAMES = ["ACL.stiffness", "ACL.reference_strain", "PCL.reference_strain", "MCL.reference_strain"]
NOISE = np.full(5, 0.1)
ANTERIOR = FREE_COORDINATES.index("anterior")
#: With a line's own tension: one program serves all knees whose tables tell pulls.
UNDER_PULLS = [*NAMES, "patellar_tendon.tension"]
READ = ("ACL.tension_N", "MCL.strain", "medial.contact_N")


@pytest.fixture(scope="module")
def passive(knee):
    return np.asarray(kj.passive_flexion(knee, [0.0, 45.0]).to_table())


def curves_of(knee, **options):
    (test,) = kj.lab_tests("drawer", [20.0, 60.0], force_N=60.0, both=True, steps=2, **options)
    return kj.load_curves(knee, test)[0]


def measured(knee, cut=(), read=(), **given):
    """A drawer of a knee, without some ligaments, and what is read of its parts."""
    curves = curves_of(kj.cut(knee, cut) if cut else knee)
    test = kj.MeasuredTest.of(curves, cut=cut)
    motion, under = curves.motion, np.asarray(curves.test.path) != 0.0
    parts = evaluate(motion.knee, motion.pose, motion.equilibrium.contact_points)
    names = motion.knee.ligaments.names
    rows = {
        "ACL.tension_N": parts.tension[:, names.index("ACL")],
        "MCL.strain": parts.strain[:, names.index("MCL")],
        "medial.contact_N": np.linalg.norm(parts.contact_force[:, 0], axis=-1),
    }
    readings = {}
    for name in read:
        at = np.asarray(rows[name])[curves.nodes]
        if name.endswith(".strain"):
            unloaded = curves.nodes[:, int(np.argmin(np.abs(curves.part)))]
            at = at - np.asarray(rows[name])[unloaded][:, None]
        readings[name] = at[:, curves.steps[under]].ravel()
    sd = {"sd_N": 5.0, "sd_strain": 0.001} if read else {}
    return dataclasses.replace(test, readings=readings, **sd, **given)


def problem_of(knee, passive, tests, names=NAMES):
    return Problem.of(knee, kj.select(knee, names), passive, NOISE**-2.0, tests=tests)


@pytest.fixture(scope="module")
def whole_and_cut(knee):
    return [measured(knee, read=READ), dataclasses.replace(measured(knee, ("ACL",)), name="cut")]


@pytest.fixture(scope="module")
def problem(knee, passive, whole_and_cut):
    return problem_of(knee, passive, whole_and_cut)


def start_of(problem):
    return np.asarray(problem.selection.read(problem.knee))


def test_a_knee_shows_no_residual_against_what_was_measured_of_it_whole_and_cut(problem):
    residual, _ = problem.residual(problem.begin(start_of(problem)[None]))
    assert len(residual) == 5 * problem.used.sum() + len(problem.cases.readings)
    assert np.abs(residual).max() < 1e-4


def test_residuals_have_exact_derivatives(problem, central_difference):
    start = start_of(problem) * 1.05
    begin, size = problem.begin(start[None]), np.abs(start)
    _, slope = problem.residual(begin)
    assert np.abs(slope[-3 * len(problem.tests[0].flexion_deg) :]).max() > 1.0

    def residual(x):
        return problem.residual(problem.balance((x * size)[None], begin))[0]

    differences = central_difference(residual, start / size, 1e-4)
    assert slope * size == pytest.approx(differences, rel=1e-6, abs=1e-4)


def test_what_is_cut_does_not_pull_and_nothing_else_changes(problem):
    start = start_of(problem)
    found, cases = problem.begin(start[None]), problem.cases
    whole, without = (np.flatnonzero(cases.cut == k) for k in (0, 1))
    # Without an ACL its numbers change nothing, and with one the others are as they are alone.
    assert np.abs(found.jacobian[0, without][..., :2]).max() < 1e-12
    assert np.abs(found.jacobian[0, whole][..., :2]).max() > 1e-6
    slack = slack_at(problem.knee, problem.selection, cases, found)["ACL"]
    assert slack[without].all() and not slack[whole].all()
    torn = kj.cut(problem.knee, ["ACL"])
    alone = kj.passive_flexion(torn, [20.0])
    row = without[np.isclose(np.rad2deg(cases.load_cases.flexion[without]), 20.0)][-1]
    assert found.q[0, row] == pytest.approx(np.asarray(alone.equilibrium.q)[:, 0], abs=1e-7)


def test_a_load_that_is_taken_away_again_is_balanced_once(knee, monkeypatch):
    selection = kj.select(knee, NAMES)
    cases = problem_of(knee, np.zeros((0, 6)), [measured(knee, ("ACL",))]).cases
    forces = np.asarray(cases.load_cases.loads[0].force)[:, 0]
    assert (len(forces), len(np.unique(forces))) == (14, 5)
    values = np.asarray(selection.read(knee))[None] * np.array([[1.0], [1.01]])
    asked = []

    def watched(knee, vary, values, load_cases, *rest):
        asked.append(len(load_cases))
        return balance_with_slopes(knee, vary, values, load_cases, *rest)

    monkeypatch.setattr(_cut, "balance_with_slopes", watched)
    balance = balances_of(knee, selection, cases)
    begin = balance(values[:1])
    near = balance(values, begin.take([0, 0]))
    assert asked == [10, 10]
    vary = _cut.without(knee, selection, ("ACL",))
    every = balance_with_slopes(*vary, values, cases.load_cases, near)
    for name in ("q", "jacobian", "status"):
        assert np.allclose(getattr(near, name), getattr(every, name), rtol=1e-6, atol=1e-8)


def test_a_robot_counts_from_the_intact_knee(knee, passive):
    """What a laboratory counts so is what a study of its numbers compares."""
    own, torn = curves_of(kj.cut(knee, ["ACL"])), kj.cut(knee, ["ACL"])
    counted = kj.load_curves(torn, own.test, knee)[0]
    column = [np.asarray(kj.passive_flexion(k, [20.0, 60.0]).to_table("grood-suntay"))[:, 3]
              for k in (knee, torn)]  # fmt: skip
    moved = column[1] - column[0]
    assert np.abs(moved).max() > 0.5
    shift = np.asarray(counted.displacement - own.displacement)
    assert shift == pytest.approx(np.tile(moved[:, None], shift.shape[1]), abs=1e-8)
    test = kj.MeasuredTest.of(counted, cut=("ACL",))
    assert test.counted_from == "intact"
    problem = problem_of(knee, passive, [test])
    residual, _ = problem.residual(problem.begin(start_of(problem)[None]))
    assert np.abs(residual).max() < 1e-4


def test_a_tension_tells_where_a_ligament_goes_slack(knee, passive):
    errors = []
    for read in ((), READ[:1]):
        test = measured(knee, read=read)
        test = dataclasses.replace(test, sd_N=1.0 if read else None)
        one = problem_of(knee, passive, [test])
        _, slope = one.residual(one.begin(start_of(one)[None]))
        errors.append(np.sqrt(np.diag(np.linalg.inv(slope.T @ slope))))
    assert errors[1][1] < 0.5 * errors[0][1]


def test_a_twin_comes_back_from_cut_knee_and_readings(problem):
    truth = start_of(problem)
    start, wide = truth * 1.1, 0.5 * np.abs(truth)
    fits = fit_lanes(
        problem.balance, problem.cases, problem.begin(start[None]), start[None],
        (truth - wide)[None], (truth + wide)[None], far=True,
    )  # fmt: skip
    assert fits.values[0] == pytest.approx(truth, rel=1e-4)


def test_weights_scale_squares_and_a_row_without_weight_counts_for_nothing(knee, passive):
    plain = measured(knee, read=READ[:1])
    weight = weights_by_load(plain.loads["anterior_N"])
    weight[0] = 0.0
    both = [problem_of(knee, passive, [x])
            for x in (plain, dataclasses.replace(plain, weight=weight))]  # fmt: skip
    start = start_of(both[0]) * 1.05
    rows = len(plain.flexion_deg)
    posed, read = [], []
    for one in both:
        residual, _ = one.residual(one.begin(start[None]))
        count = 5 * len(one.cases.load_cases)
        posed.append(residual[:count].reshape(-1, 5)[2 : 2 + rows, ANTERIOR])
        read.append(residual[count:])
    assert posed[1] ** 2 == pytest.approx(posed[0] ** 2 * weight)
    assert read[1] ** 2 == pytest.approx(read[0][1:] ** 2 * weight[1:])
    assert both[1].cases.numbers == both[0].cases.numbers - 2


def test_a_part_that_the_knee_lacks_is_named(knee, passive):
    for wrong, says in (("ACLL.tension_N", "did you mean 'ACL'"), ("mediul.contact_N", "medial")):
        test = measured(knee)
        test = dataclasses.replace(
            test, readings={wrong: np.zeros(len(test.flexion_deg))}, sd_N=1.0
        )
        with pytest.raises(UnknownParameter, match=says):
            problem_of(knee, passive, [test])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"readings": {"ACL.pull": np.zeros(8)}}, "expected of PART.tension_N"),
        ({"readings": {"ACL.tension_N": np.zeros(3)}, "sd_N": 1.0}, r"expected \(8,\)"),
        ({"readings": {"ACL.tension_N": np.zeros(8)}}, "sd_N: not stated"),
        ({"readings": {"ACL.strain": np.zeros(8)}, "sd_strain": 0.01, "counted_from": "offset"},
         "expected unloaded or absolute"),
        ({"counted_from": "intact"}, "expected cut too"),
        ({"loads": {}, "readings": {"ACL.tension_N": np.ones(8)}, "sd_N": 1.0},
         "expected each once, since no load acts"),
        ({"weight": np.full(8, -1.0)}, "negative"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused(knee, given, says):
    rows = {"anterior_N": np.array([30.0, 60, -30, -60] * 2)}
    observed = np.full((8, 5), 1.0)
    with pytest.raises(ValueError, match=says):
        flexion = [20.0] * 4 + [60.0] * 4
        kj.MeasuredTest(**{"name": "drawer", "flexion_deg": flexion, "loads": rows,
                           "observed": observed} | given)  # fmt: skip


def test_a_pull_in_the_table_is_that_of_a_knee_with_such_a_line(knee, passive):
    """Tension per row against knees whose own line pulls so hard throughout."""
    test = measured(knee)
    extra = np.where(np.arange(len(test.flexion_deg)) % 2 == 0, 60.0, 25.0)
    pulled = dataclasses.replace(test, tensions={"patellar_tendon": extra}, counted_from="absolute")
    problem = problem_of(knee, passive, [pulled], UNDER_PULLS)
    found = problem.begin(start_of(problem)[None])
    assert found.converged.all()
    rows = slice(2, 2 + len(extra))
    for size in (60.0, 25.0):
        own = float(knee.lines[0].tension)
        other = knee.replace({"patellar_tendon.tension": own + size})
        alike = problem_of(other, passive, [dataclasses.replace(test, counted_from="absolute")])
        there = alike.begin(start_of(alike)[None])
        at = extra == size
        assert found.q[0, rows][at] == pytest.approx(there.q[0, rows][at], abs=1e-7)
        assert np.abs(found.q[0, rows][~at] - there.q[0, rows][~at]).max() > 1e-3


def test_residuals_under_a_pull_have_exact_derivatives(knee, passive, central_difference):
    test = measured(knee, read=READ[:1])
    extra = np.linspace(20.0, 80.0, len(test.flexion_deg))
    pulled = dataclasses.replace(test, tensions={"patellar_tendon": extra})
    problem = problem_of(knee, passive, [pulled], UNDER_PULLS)
    start = start_of(problem)
    begin, size = problem.begin(start[None]), np.abs(start)
    _, slope = problem.residual(begin)

    def residual(x):
        return problem.residual(problem.balance((x * size)[None], begin))[0]

    differences = central_difference(residual, start / size, 1e-4)
    assert slope * size == pytest.approx(differences, rel=1e-6, abs=1e-4)


def test_parts_of_a_knee_over_points_are_read_where_it_stands():
    """No contact of it has a contact point: nothing else differs."""
    plane = Plane(Frame([0.0, -29.0, 0.0]), half_extent=(8.0, 8.0))
    contact = Contact(Sphere(30.0), plane, form="quadrature", points=(4, 4))
    name = "fibre"
    fibre = Ligaments([[-8, 4, 6]], [[14, -26, 0]], [4500.0], [36.0], [0.03], [0.002], [name])
    knee = Knee(fibre, (contact,), (), (), kj.Pose.from_table(np.zeros(6)), ("medial",))
    test = kj.MeasuredTest(
        "still", [0.0, 30.0], {}, np.full((2, 5), np.nan), counted_from="absolute",
        readings={f"{name}.strain": np.zeros(2)}, sd_strain=0.01,
    )  # fmt: skip
    names = [f"{name}.stiffness", f"{name}.slack_length"]
    problem = problem_of(knee, np.empty((0, 6)), [test], names)
    values = np.asarray(problem.selection.read(knee))[None]
    nothing = np.zeros((1, 2, 0, 2))
    here = Slopes(
        values, np.zeros((1, 2, 5)), np.zeros((1, 2, 5, 2)), nothing, np.zeros((1, 2, 0, 2, 2)),
        np.zeros((1, 2, 5, 5)), np.zeros((1, 2), int),
    )  # fmt: skip
    strain, slope = problem.cases.readings.error(problem.cases, here)
    poses = kj.State({"tibia": kj.Pose.from_table([[0.0] * 6, [30.0] + [0.0] * 5])})
    length = np.asarray(add_lane_axis(knee.ligaments).length(poses))[0]
    assert strain[0] == pytest.approx(length / values[0, 1] - 1.0, abs=1e-12)
    assert slope[0] == pytest.approx(
        np.column_stack([np.zeros(2), -(1.0 + strain[0]) / values[0, 1]]), abs=1e-12
    )
