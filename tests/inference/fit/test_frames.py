"""Rows of a test that are frames of a knee in motion: poses of a motion, not balances."""

import dataclasses
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.report as report
from kneejax.dynamics import LoadCurve, move_within
from kneejax.experiments import Frames, MeasuredTest
from kneejax.geometry import coordinates_of, table_units
from kneejax.inference import CalibrationProblem, FittedTest, Noise, identify, sensitivity_maps
from kneejax.inference.calibration import _side_by_side
from kneejax.inference.fit import Problem, form_of
from kneejax.mechanics import load_of
from kneejax.parameters import UnsuitableData, select
from kneejax.report.calibration_parameters import reading_table
from kneejax.report.calibration_verdict import laxity_doubts
from tests.dynamics.massed import SHANK, in_a_vice

#: Each compiles a search of its own.
pytestmark = [pytest.mark.long, pytest.mark.usefixtures("optimised_code")]

KNEE = in_a_vice(4e4).knee
FREE = ("f0.stiffness", "f4.slack_length")
SELECTION = select(KNEE, FREE)
START = np.asarray(SELECTION.read(KNEE))
BOUNDS = {name: (0.5 * x, 2.0 * x) for name, x in zip(FREE, START.tolist(), strict=True)}
PAD_MM, PUSH_N = (0.0, -350.0, 0.0), 8.0
COUNT = 12


def frames(period_s=0.5, **given):
    """A knee that bends by 4 degrees to and fro."""
    times = np.arange(COUNT) / COUNT * period_s
    bent = 2.0 - 2.0 * np.cos(2.0 * np.pi * times / period_s)
    one = dict(period_s=period_s, harmonics=1, damping_N_s_per_mm=3.0, most_mm=1e-3) | given
    return Frames(times, bent, SHANK, **one)


def measured(observed=None, **given):
    """Under a pad that follows the shank."""
    through = frames(**given)
    push = PUSH_N * np.sin(2.0 * np.pi * through.time_s / through.period_s)
    seen = np.zeros((COUNT, 5)) if observed is None else observed
    return MeasuredTest(
        "cine", through.flexion_deg, {"anterior_N": push}, seen, counted_from="absolute",
        point_mm=PAD_MM, axes="tibia", frames=through, sd_mm=0.1, sd_deg=0.1,
    )  # fmt: skip


def asked(test):
    problem = Problem.of(KNEE, SELECTION, np.zeros((0, 6)), np.ones(5), tests=[test])
    return problem.stepping(START)


def balances(test):
    """The same rows as if the knee stood still in each."""
    still = dataclasses.replace(test, flexion_deg=test.bent_deg, frames=None)
    return Problem.of(KNEE, SELECTION, np.zeros((0, 6)), np.ones(5), tests=[still])


def poses(problem, values=START):
    return problem.begin(values[None]).q[0] * table_units(coordinates_of(("tibia",))[1:])


def moved(test, values=START):
    """Poses of the motion that steps ten times as exact find."""
    through = test.frames
    moving = through.moving(SELECTION.apply(KNEE, values)).critically_damped(through.critical)
    moving = moving.damped_everywhere(through.damping_N_s_per_mm)
    times = through.since_start_s
    push = load_of(
        anterior_N=jnp.asarray(through.over_time(test.loads["anterior_N"][:, None])[:, 0]),
        point=np.tile(PAD_MM, (len(times), 1)), axes="tibia",
    )  # fmt: skip
    # It begins where it is bent most, as in the row half a period later, which no load pushes.
    start = np.r_[through.led(np.zeros(1)), balances(test).begin(values[None]).q[0, COUNT // 2]]
    found = move_within(
        1e-4, moving, start, times, loads=LoadCurve(jnp.asarray(times), (push,)),
        held={"flexion": lambda t: np.deg2rad(2.0 + 2.0 * np.cos(4.0 * np.pi * t))},
    )  # fmt: skip
    return found.to_table()[-COUNT:, 1:]


def test_frames_are_poses_of_the_motion_that_steps_ten_times_as_exact_find():
    test = measured()
    problem = asked(test)
    assert problem.begin(START[None]).converged.all()
    assert form_of(problem) is None, "knees in motion do not stand side by side"
    np.testing.assert_allclose(moved(test), poses(problem), atol=2e-3)
    assert np.abs(poses(problem) - poses(balances(test))).max() > 0.05


def test_derivatives_are_those_of_the_motion_and_of_the_balance_in_which_it_begins():
    # Nothing damps here but fibres: what the start was is seen in every frame. There are nearly as
    # many steps as in the other motion, so that one program follows both.
    problem = asked(measured(cycles_before=0, damping_N_s_per_mm=0.0, most_mm=1e-2))
    found = problem.begin(START[None])
    for k, size in enumerate(START):
        step = 1e-5 * size * (np.arange(2) == k)
        ends = (problem.begin((START + sign * step)[None]).q[0] for sign in (1.0, -1.0))
        by_differences = np.subtract(*ends) / (2.0 * step[k])
        slope = found.jacobian[0, ..., k]
        assert np.abs(slope[0]).max() > 0.05 * np.abs(slope).max()
        np.testing.assert_allclose(slope, by_differences, atol=1e-6 * np.abs(slope).max())


@pytest.mark.slow
def test_the_slower_a_knee_is_led_the_nearer_it_is_to_balances():
    away = []
    # So exact that there are as many steps as in the other motions: one program follows all.
    for period, most_mm in ((2.0, 3e-4), (4.0, 2e-4), (8.0, 1e-4)):
        test = measured(period_s=period, most_mm=most_mm)
        away.append(np.abs(poses(asked(test)) - poses(balances(test))).max())
    # Dampers hold a slow knee back, in proportion to its rate; inertia by the square of that.
    np.testing.assert_allclose(np.divide(away[:-1], away[1:]), 2.0, rtol=0.05)
    assert away[0] > 1e-3


@pytest.mark.slow
def test_parameters_come_back_from_a_motion_and_from_its_frames_as_balances_they_do_not():
    true = START * [1.3, 1.002]
    test = measured(moved(measured(), true))
    study = kj.Study(
        title="in motion", knee=KNEE, tests=[test], parameters=FREE, bounds=BOUNDS,
        procedures=["III"], noise_mm=0.1, noise_deg=0.1,
    )  # fmt: skip
    led = kj.calibrate(study)
    assert led.fit.success
    assert 0.0 < led.fit.tests[0].restless < 0.05
    for one, x in zip(led.fit.estimates, true, strict=True):
        assert abs(one.value - x) < 0.02 * (one.high - one.low)
    table = reading_table(led)
    at = table.names.index("time_s")
    assert [row[at] for row in table.rows[::5]] == test.frames.time_s.tolist()
    assert report.tests_figure(led).axes[0].get_xlabel() == "Time, s"
    still = dataclasses.replace(test, flexion_deg=test.bent_deg, frames=None)
    stood = kj.calibrate(study.replace(tests=[still]))
    pairs = zip(stood.fit.estimates, true, strict=True)
    assert not all(one.low < x < one.high for one, x in pairs)


@pytest.mark.slow
def test_what_a_motion_tells_can_be_asked_before_anything_is_fitted():
    test = measured(poses(asked(measured()), START))
    problem = CalibrationProblem.of(
        KNEE, kj.select(KNEE, FREE), np.zeros((0, 6)), noise=Noise.of(0.1, 0.1), tests=[test],
        bounds=BOUNDS,
    )  # fmt: skip
    told = identify(problem, with_profiles=False)
    assert told.converged and np.isfinite(told.information.matrix).all()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"period_s": 0.4}, "period_s: 0.4 s of rows over 0.45.*; expected a longer one"),
        ({"harmonics": 6}, "harmonics: 6; expected at most 5 from 12 rows"),
        ({"time_s": [0.0, 0.1, 0.1]}, "time_s: 0.1 s after 0.1 s; expected times that rise"),
    ],
)
def test_frames_that_cannot_be_are_refused(given, sentence):
    times = np.linspace(0.0, 0.45, COUNT)
    one = {"time_s": times, "flexion_deg": times, "leg": SHANK, "period_s": 0.5} | given
    with pytest.raises(ValueError, match=sentence):
        Frames(**one)


def test_tests_say_what_frames_cannot_go_with():
    test = measured()
    with pytest.raises(ValueError, match="frames: 12 times; expected 6"):
        dataclasses.replace(
            test, flexion_deg=test.flexion_deg[:6], observed=test.observed[:6],
            loads={"anterior_N": np.ones(6)},
        )  # fmt: skip
    with pytest.raises(ValueError, match="frames: f0.tension_N too; expected loads"):
        dataclasses.replace(test, readings={"f0.tension_N": np.ones(COUNT)}, sd_N=1.0)


def test_a_knee_that_swings_on_is_known_not_to_repeat_itself():
    swings = asked(measured(damping_N_s_per_mm=0.0, critical=0.01, most_mm=0.1))
    assert swings.restless["cine"] > 0.1
    assert asked(measured()).restless["cine"] < 0.05


def test_that_a_knee_swings_on_is_said():
    nothing = np.full((COUNT, 5), np.nan)
    one = FittedTest(measured(), nothing, nothing, np.zeros(COUNT, int), restless=0.3)
    (said,) = laxity_doubts((one,))
    assert "0.3 mm or degrees from where the knee was a period before" in said


def test_a_map_takes_no_knee_in_motion():
    with pytest.raises(UnsuitableData, match="cine: a knee in motion; expected tests of a knee at"):
        sensitivity_maps(KNEE, np.zeros((0, 6)), [FREE], grid=(2, 2), tests=[measured()])


@dataclasses.dataclass
class Asked:
    """A question in motion that always asks for more steps."""

    fitted: object


@pytest.mark.parametrize(("more", "fits"), [(0, 1), (1, 3)])
def test_each_answer_is_looked_at_the_last_too(monkeypatch, more, fits):
    """Steps are chosen anew twice at most; what the last answer does is told all the same."""
    made = []

    def problem(steps):
        return SimpleNamespace(
            steps=steps, restless={"cine": 0.1 * steps}, cases=SimpleNamespace(passages=(1,)),
            stepping=lambda values: problem(steps + more),
        )  # fmt: skip

    def answered(members, progress):
        made.append(members[0].fitted.steps)
        return [SimpleNamespace(fit=SimpleNamespace(success=True), told=None)]

    def told(answer, restless):
        return SimpleNamespace(fit=answer.fit, told=restless["cine"])

    monkeypatch.setattr(_side_by_side, "_of_one_form", answered)
    monkeypatch.setattr(_side_by_side, "Calibration", SimpleNamespace)
    monkeypatch.setattr(_side_by_side, "_values", lambda answer: None)
    monkeypatch.setattr(_side_by_side, "_with_restless", told)
    (answer,) = _side_by_side._with_short_steps([Asked(problem(4))], lambda *_: None)
    assert len(made) == fits
    np.testing.assert_allclose(answer.told, 0.1 * (made[-1] + more))
