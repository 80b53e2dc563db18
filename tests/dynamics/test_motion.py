"""Motions whose ends are known: pendulum, spring, a body that tumbles, a bounce, a settling."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kneejax.dynamics import (
    Account,
    Grid,
    LoadCurve,
    MovingKnee,
    given_of,
    gravity_of,
    march,
    move,
)
from kneejax.experiments import Mechanics, Transient
from kneejax.geometry import Frame, Plane, Sphere
from kneejax.mechanics import Contact, Load, Mass, add_lane_axis, load_of
from kneejax.statics import Guess, Status, solve_equilibrium
from tests.dynamics.massed import (
    ALL_BUT_FLEXION,
    ALL_BUT_SUPERIOR,
    SHANK,
    STEPS,
    bare,
    fibres,
    in_a_vice,
)

pytestmark = pytest.mark.usefixtures("optimised_code")

SIZES = [STEPS // 4, STEPS // 2, STEPS]


@pytest.mark.long
def test_a_pendulum_swings_as_its_equation_says_with_errors_of_second_order(slope_on_log_axes):
    swinging = MovingKnee.of(bare(), SHANK, gravity_m_s2=gravity_of(-90.0))
    x, y, _ = np.asarray(SHANK.center_mm)
    inertia = float(SHANK.inertia_kg_mm2[2, 2]) + 2.0 * (x * x + y * y)

    def equation(_, z):
        # Flexion turns by minus its angle about Z, mm/s^2 throughout.
        c, s = np.cos(-z[0]), np.sin(-z[0])
        moment = -2.0 * 9806.65 * (c * x - s * y)
        return [z[1], -moment / inertia]

    span = 0.3
    exact = solve_ivp(equation, [0, span], [0.6, -1.0], rtol=1e-11, atol=1e-12).y[:, -1]
    found = [
        move(swinging, [0.6, 0, 0, 0, 0, 0], np.linspace(0.0, span, n + 1),
             rate=[-1.0, 0, 0, 0, 0, 0], held=ALL_BUT_FLEXION)
        for n in SIZES
    ]  # fmt: skip
    off = [abs(float(one.q[-1, 0]) - exact[0]) for one in found]
    assert slope_on_log_axes(SIZES, off) == pytest.approx(-2.0, abs=0.3)
    assert off[-1] < 3e-3 and abs(float(found[-1].rate[-1, 0]) - exact[1]) < 0.03
    account = found[-1].account()
    assert account.closes and found[-1].ended is Status.BALANCED
    _has_all_over_time(found[-1], account)
    # The pivot holds the weight and makes the centre go round: N of 2 kg and mm/s^2.
    c, s = np.cos(-exact[0]), np.sin(-exact[0])
    turning = -equation(0.0, exact)[1]
    along = turning * (c * x - s * y) - exact[1] ** 2 * (s * x + c * y)
    holds = found[-1].flow().holding["superior"]
    assert float(holds[-1]) == pytest.approx(2e-3 * (9806.65 + along), rel=0.02)


def _has_all_over_time(found, account):
    """A data set with a unit for everything."""
    count = len(found.time_s)
    nothing = Mechanics(*[None] * len(dataclasses.fields(Mechanics)))
    held = dataclasses.replace(
        nothing, tension=np.zeros((count, 0)), contact_force=np.zeros((count, 0, 3))
    )
    pull = {"anterior_N": np.linspace(0.0, 5.0, count)}
    data = Transient(found, held, np.zeros((count, 0)), account, pull, None, np.nan).to_dataset()
    assert all("units" in x.attrs for name, x in data.variables.items()
               if name not in ("status", "ligament", "contact"))  # fmt: skip
    np.testing.assert_allclose(data["flexion"], np.rad2deg(found.q[:, 0]))
    np.testing.assert_allclose(data["flexion_rate"], np.rad2deg(found.rate[:, 0]))
    assert data["flexion_rate"].units == "deg s-1" and data["load_anterior_N"].units == "N"
    total = data["energy_kinetic"] + data["energy_potential"] + data["energy_dissipated"]
    gained = total - data["energy_kinetic"][0]
    np.testing.assert_allclose(gained - data["energy_missing"], data["energy_work"], atol=1e-9)


@pytest.mark.long
def test_a_mass_on_a_damped_fibre_swings_as_in_closed_form(slope_on_log_axes):
    on_fibre = bare(fibres([[0.0, 100.0, 0.0]], [[0.0, 0.0, 0.0]]), loads=(Load([0.0, -190.0, 0]),))
    mass = Mass(2.0, [0.0] * 3, np.zeros((3, 3)))
    moving = MovingKnee.of(on_fibre, mass).critically_damped(0.15)
    slack = float(on_fibre.ligaments.slack_length[0])
    spring = 1e4 / slack
    rest = 100.0 - slack * (1.0 + 0.019 + 0.001)
    omega, part = np.sqrt(spring / 2e-3), 0.15
    damped = omega * np.sqrt(1.0 - part**2)
    span = 0.012

    def exact(t):
        a, b = 0.4 - rest, part * omega * (0.4 - rest) / damped
        return rest + np.exp(-part * omega * t) * (a * np.cos(damped * t) + b * np.sin(damped * t))

    found = [
        move(moving, [0, 0, 0, 0, 0.4, 0], np.linspace(0.0, span, n + 1), held=ALL_BUT_SUPERIOR)
        for n in SIZES
    ]
    off = [abs(float(one.q[-1, 4]) - exact(span)) for one in found]
    assert slope_on_log_axes(SIZES, off) == pytest.approx(-2.0, abs=0.35)
    assert off[-1] < 0.02


@pytest.mark.long
def test_a_body_that_tumbles_keeps_energy_and_momentum(slope_on_log_axes):
    """Free of all forces, with three different moments; Euler's equations tell how it turns."""
    moments = np.array([3e4, 1.2e4, 2.2e4])
    tumbling = MovingKnee.of(bare(), Mass(3.0, [0.0] * 3, np.diag(moments)))
    spin = np.array([6.0, -4.0, 5.0])  # about its own axes, which are the femur's at first

    def euler(_, z):
        w, turn = z[:3], z[3:].reshape(3, 3)
        rate = np.cross(moments * w, w) / moments
        hat = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.concatenate([rate, (turn @ hat).ravel()])

    span = 0.12
    begin = np.concatenate([spin, np.eye(3).ravel()])
    exact = solve_ivp(euler, [0, span], begin, rtol=1e-11, atol=1e-12).y[3:, -1].reshape(3, 3)
    rate = [-spin[2], spin[0], spin[1], 100.0, 0.0, -50.0]
    off = []
    for n in SIZES:
        found = move(tumbling, [0.0] * 6, np.linspace(0.0, span, n + 1), rate=rate)
        turned = np.array(found.pose.placement.rotation)[..., -1]
        off.append(np.abs(turned - exact).max())
    assert slope_on_log_axes(SIZES, off) == pytest.approx(-2.0, abs=0.3)
    assert off[-1] < 3e-3
    flow = found.flow()
    np.testing.assert_allclose(flow.kinetic, flow.kinetic[0], rtol=2e-3)
    np.testing.assert_allclose(found.q[-1, 3:], np.array([100.0, 0.0, -50.0]) * span, atol=1e-9)


@pytest.mark.long
def test_a_knee_that_settles_ends_in_its_static_balance():
    pulled = Load([30.0, 20.0, -10.0], [200.0, 100.0, 300.0], point_in="tibia")
    vice = in_a_vice()
    knee = bare(vice.knee.ligaments, loads=(pulled,))
    moving = MovingKnee.of(knee, SHANK, gravity_m_s2=gravity_of(-30.0)).damped_everywhere(5.0)
    found = move(moving, [0.05, 0, 0.02, 0.3, 0, 0], np.linspace(0.0, 28.0, STEPS + 1))
    held = add_lane_axis(bare(knee.ligaments, loads=moving.loads))
    still = solve_equilibrium(held, {}, Guess(jnp.zeros((6, 1)), jnp.zeros((0, 2, 1))))
    np.testing.assert_allclose(found.q[-1], still.q[:, 0], atol=1e-6)
    assert found.account().dissipated[-1] > 0.0


@pytest.fixture(scope="module")
def ball():
    """A tibia that a sphere of the femur rests on: it may only rise and fall."""
    plateau = Plane(Frame([0.0, -20.5, 0.0]))
    contact = Contact(Sphere(20.0), plateau)
    return MovingKnee.of(bare(contacts=(contact,)), Mass(2.0, [0.0] * 3, np.zeros((3, 3))),
                         gravity_m_s2=(0.0, 60.0, 0.0))  # fmt: skip


def test_a_bone_that_bounces_gains_no_energy(ball):
    """Apart by half a mm it is thrown up, meets the femur, and leaves it again."""
    found = move(ball, [0.0] * 6, np.linspace(0.0, 0.014, STEPS + 1), held=ALL_BUT_SUPERIOR)
    height = np.asarray(found.q[:, 4])
    assert found.ended is Status.BALANCED and np.isfinite(height).all()
    assert height.max() > 0.55 and np.argmax(height) < STEPS - 4
    account = found.account()
    whole = np.asarray(account.kinetic + account.potential - account.work)
    assert whole.max() < 0.01 * float(account.kinetic.max())


def test_a_step_that_cannot_be_taken_ends_the_motion_and_says_so(ball):
    fast = [0.0, 0.0, 0.0, 0.0, 30000.0, 0.0]
    times = np.linspace(0.0, 0.014, STEPS + 1)
    found = move(ball, [0.0] * 6, times, rate=fast, held=ALL_BUT_SUPERIOR)
    assert not found.ended.converged and "try" not in found.ended.fault and found.ended.advice
    assert np.isnan(np.asarray(found.q[-1])).all() and np.isfinite(np.asarray(found.q[0])).all()
    assert 0.0 <= found.ended_s < 0.014


def test_an_account_is_of_the_steps_that_were_taken():
    """A motion that ended early has no energies afterwards: of what changed hands before, 1/200."""
    known = jnp.array([0.0, 100.0, jnp.nan])
    ended = Account(known, known, known, known, missing=known / 200.0, turnover=known)
    assert float(ended.part_missing) == pytest.approx(0.005) and ended.closes
    assert not Account(*[jnp.full(3, jnp.nan)] * 6).closes


def test_times_that_go_back_are_refused():
    with pytest.raises(ValueError, match=r"time_s: 0.1 s after 0.2 s; expected times that rise"):
        Grid.of([0.0, 0.2, 0.1])
    with pytest.raises(ValueError, match="two finite times"):
        Grid.of([0.0, np.nan])


def test_a_motion_that_begins_later_meets_what_acts_and_is_led_then():
    vice, times = in_a_vice(), np.linspace(0.0, 0.01, 6)

    def moved(later):
        load = load_of(anterior_N=np.array([0.0, 30.0]))
        pull = LoadCurve.of(later + np.array([0.0, 0.01]), load)
        way = {"flexion": lambda t: 0.2 * np.sin(40.0 * (t - later))}
        return move(vice, np.zeros(6), later + times, loads=pull, held=way)

    now, later = moved(0.0), moved(0.35)
    assert np.abs(np.asarray(now.q)[-1]).max() > 0.05
    np.testing.assert_allclose(later.q, now.q, atol=1e-9)
    np.testing.assert_allclose(later.time_s, 0.35 + now.time_s)
    assert later.ended_s == pytest.approx(0.36)
    for name, energy in dataclasses.asdict(now.account()).items():
        np.testing.assert_allclose(dataclasses.asdict(later.account())[name], energy, atol=1e-7)


@pytest.mark.long
def test_a_search_needs_no_derivative_and_a_motion_in_a_jit_is_the_same():
    vice = in_a_vice()
    times = np.linspace(0.0, 0.01, STEPS + 1)
    begin = jnp.array([0.02, 0.0, 0.0, 0.1, 0.0, 0.0])
    alone = move(vice, begin, times)
    within = jax.jit(lambda q: move(vice, q, times).q)(begin)
    np.testing.assert_allclose(within, alone.q, atol=1e-10)


@pytest.mark.long
def test_many_motions_are_each_what_it_is_alone_on_however_many_cores():
    """37 lanes are two parts, the second filled up."""
    moving, grid = in_a_vice(), Grid.of(np.linspace(0.0, 0.01, 6))
    given = given_of(moving, np.zeros(6), grid, held=("flexion",))
    start = np.zeros((6, 37))
    start[4] = np.linspace(0.0, 0.5, 37)
    lanes = jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], 37)), given.steps.held)
    steps = dataclasses.replace(given.steps, held=lanes)
    rate = jnp.zeros((6, 37))
    many = dataclasses.replace(given, q=jnp.asarray(start), rate=rate, steps=steps)
    found = march(add_lane_axis(moving), many)
    assert found.known.q.shape == (len(grid.time_s), 6, 37)
    for lane in (0, 18, 19, 36):
        alone = dataclasses.replace(given, q=jnp.asarray(start[:, [lane]]))
        one = march(add_lane_axis(moving), alone)
        np.testing.assert_allclose(found.known.q[..., [lane]], one.known.q, atol=1e-9)
