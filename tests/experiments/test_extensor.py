"""A quadriceps that pulls: closed forms on a patella that rides on a ball."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax import report
from kneejax.dynamics import gravity_of
from kneejax.experiments import (
    TENDON,
    extension_by_length,
    leg_of_person,
    leg_raise_by_length,
    raised_leg,
)
from kneejax.experiments._extensor import held_leg
from kneejax.experiments._extensor_mechanism import weight_of
from kneejax.mechanics import add_lane_axis
from kneejax.report.extensor import extensor_figure, extensor_table, shear_figure
from kneejax.report.in_time import raised_leg_answer
from kneejax.statics import Guess, solve_equilibrium

#: Each compiles a search of its own.
pytestmark = pytest.mark.long

#: Flexions and one pull: what all tests look at, so that one compiled program serves them.
FLEXION, PULL_N = np.array([30.0, 45.0]), 300.0
CENTER = np.array([0.0, 5.0, 0.0])


@pytest.fixture(scope="module")
def knee(pulled_knee):
    return pulled_knee


@pytest.fixture(scope="module")
def tracked(knee):
    return kj.patellar_tracking(knee, FLEXION, PULL_N)


def test_all_that_pulls_on_the_patella_has_no_moment_about_the_ball(knee, tracked):
    """The ball presses through its centre: quadriceps, tendon and bands balance about it."""
    assert bool(np.all(tracked.motion.stable))
    state = tracked.motion.equilibrium.state
    muscles = knee.muscles.pulling({"quadriceps": PULL_N - 20.0})
    moment = np.zeros((3, len(FLEXION)))
    patella = state.poses["patella"].placement

    @jax.jit
    def told(knee, muscles, state):
        fibres = knee.ligaments
        forces = fibres.length_wrap_and_forces(state)[2]
        every = fibres.unit_pulls(state), forces, muscles.unit_pulls(state)
        return fibres.tension(state), *map(jnp.stack, every)

    found = told(add_lane_axis(knee), add_lane_axis(muscles), state)
    own, unit, forces, pulls = map(np.asarray, found)
    np.testing.assert_allclose(forces, own * unit, atol=1e-9 * own.max())

    def about(point, force):
        place = np.stack([np.asarray(x) for x in patella.apply(tuple(point))])
        return np.cross(place - CENTER[:, None], force, axis=0)

    for row, pair in enumerate(knee.ligaments.bodies):
        if pair == ("patella", "tibia"):  # the patella feels the opposite
            moment += about(knee.ligaments.femoral_attachment[row], -own[row] * unit[:, row])
        elif pair == ("femur", "patella"):
            moment += about(knee.ligaments.tibial_attachment[row], own[row] * unit[:, row])
    for row, tension in enumerate(muscles.tension):
        moment += about(muscles.tibial_attachment[row], float(tension) * pulls[:, row])
    np.testing.assert_allclose(moment, 0.0, atol=1e-3 * PULL_N)


def test_the_arm_is_the_growth_of_the_length_with_flexion(knee, tracked):
    """By virtual work: found as the growth of the moment with the pull, both of one energy."""
    step = 0.02
    lengths = []
    for way in (1.0, -1.0):
        there = kj.patellar_tracking(knee, FLEXION + way * step, PULL_N)
        each = add_lane_axis(knee.muscles).length(there.motion.equilibrium.state)
        lengths.append(np.asarray(knee.muscles.tension / 20.0 @ each))
    grown = (lengths[0] - lengths[1]) / np.deg2rad(2.0 * step)
    np.testing.assert_allclose(tracked.arm_mm, grown, rtol=1e-6)
    assert np.all((tracked.arm_mm > 20.0) & (tracked.arm_mm < 70.0))


def test_heads_share_the_pull_as_at_rest(knee):
    pulled = knee.muscles.pulling({"quadriceps": 80.0, "vasmed": 1.0})
    np.testing.assert_allclose(pulled.tension, [52.5, 48.5])


def test_a_raised_leg_is_held_and_nothing_is_left_over(knee):
    shank = kj.Shank.of_person(75.0, 1.75, ankle_kg=1.0)
    held = kj.leg_raise(knee, FLEXION, shank)
    assert np.abs(held.extension_Nm).max() < 1e-8
    assert not held.continued.any()
    # Sitting, the shank's weight turns with the cosine of flexion about the hinge.
    length, mass = 246.0 * 1.75, 0.061 * 75.0
    moment = 9.80665 * (mass * 0.606 + 1.0) * length * np.cos(np.deg2rad(FLEXION))
    np.testing.assert_allclose(1000.0 * held.weight_Nm, moment, rtol=0.05)
    assert held.quadriceps_N[0] > held.quadriceps_N[1] > 0.0
    forces = held.forces_on_tibia
    np.testing.assert_allclose(sum(forces.values()), 0.0, atol=1e-4)
    assert np.linalg.norm(forces[TENDON], axis=1) == pytest.approx(held.tendon_N)


#: How much of each kind of number a direction changes; of all others a thousandth.
SIZES = {"attachment": 0.3, "stiffness": 30.0, "slack_length": 0.03, "origin": 0.03,
         "rotation": 1e-3, "radius": 0.1, "force": 1.0, "point": 1.0}  # fmt: skip


def test_a_held_leg_is_differentiable_by_every_number_of_the_knee(knee):
    """The pull that holds it and both poses, along a random change of everything at once."""
    weight, flexion = kj.Shank.of_person(75.0, 1.75).load(), jnp.asarray(FLEXION)
    rng = np.random.default_rng(0)

    def change(path, leaf):
        name = jax.tree_util.keystr(path).split(".")[-1]
        size = next((size for end, size in SIZES.items() if name.endswith(end)), 1e-3)
        return jnp.asarray(size * rng.uniform(-1.0, 1.0, jnp.shape(leaf)))

    way = jax.tree_util.tree_map_with_path(change, (knee, weight))

    def held(knee, weight):
        motion, pull, _ = held_leg(knee, flexion, weight)
        return pull, motion.equilibrium.q

    exact = jax.jvp(held, (knee, weight), way)[1]
    step, parts = 2e-3, {2: -1.0, 1: 8.0, -1: -8.0, -2: 1.0}
    moved = {
        k: held(*jax.tree.map(lambda x, d, k=k: x + k * step * d, (knee, weight), way))
        for k in parts
    }
    for row, what in enumerate(("pull", "coordinates")):
        numeric = sum(part * moved[k][row] for k, part in parts.items()) / (12.0 * step)
        scale = np.abs(numeric).max(axis=-1, keepdims=True)
        np.testing.assert_allclose(exact[row] / scale, numeric / scale, atol=1e-6, err_msg=what)


def test_a_quadriceps_of_given_length_pulls_as_the_force_under_which_it_is_as_long(knee):
    """At a held flexion the pull is a result; given as a force it leads to the same length."""
    driven = extension_by_length(knee, FLEXION, [0.5, 0.0, -0.4, -1.2])
    found, length = driven.found, np.asarray(driven.found.quadriceps_mm).reshape(2, 4)
    assert np.all(found.motion.stable)
    under = kj.patellar_tracking(knee, found.flexion_deg, np.asarray(found.quadriceps_N))
    np.testing.assert_allclose(found.quadriceps_mm, under.quadriceps_mm, atol=1e-6)
    rest = np.asarray(kj.patellar_tracking(knee, FLEXION, 20.0).quadriceps_mm)[:, None]
    np.testing.assert_allclose(length[:, 2:] - rest, [[-0.4, -1.2]] * 2, atol=2e-6)
    # A cable that is longer than the way hangs slack: the heads keep what they have at rest. One
    # that is as long as the way does not hang.
    assert driven.slack.tolist() == [True, False, False, False] * 2
    np.testing.assert_allclose(found.quadriceps_N[::4], 20.0, atol=0.1)
    np.testing.assert_allclose(length[:, :1], rest, atol=1e-3)


@pytest.mark.slow
def test_a_leg_whose_quadriceps_has_a_length_rests_where_it_would_be_held(knee):
    shank = kj.Shank.of_person(75.0, 1.75)
    raised = leg_raise_by_length(knee, [12.0, 18.0], shank).found
    held = kj.leg_raise(knee, raised.flexion_deg, shank)
    np.testing.assert_allclose(raised.quadriceps_N, held.quadriceps_N, atol=1e-3)
    np.testing.assert_allclose(raised.quadriceps_mm, held.quadriceps_mm, atol=1e-6)
    np.testing.assert_allclose(np.diff(raised.quadriceps_mm), [6.0], atol=2e-6)
    assert np.abs(raised.extension_Nm).max() < 1e-4 and np.all(raised.motion.stable)
    with pytest.raises(ValueError, match=r"90 mm longer than at rest; expected between .* mm"):
        leg_raise_by_length(knee, [90.0], shank)


@pytest.mark.slow
def test_derivatives_under_a_given_length_are_exact(knee, central_difference):
    """Of the pull at a held flexion, of the pull and of where a leg rests: by the tendon's slack
    length and by the length."""
    shank = kj.Shank.of_person(75.0, 1.75)
    own = kj.select(knee, ["PT1.slack_length"])
    start = float(own.read(knee)[0])

    def drawn(x):
        return extension_by_length(own.apply(knee, x[:1]), [45.0], x[1:]).found.quadriceps_N

    def raised(x):
        found = leg_raise_by_length(own.apply(knee, x[:1]), x[1:], shank).found
        return jnp.concatenate([found.flexion_deg, found.quadriceps_N])

    for of, longer in ((drawn, -0.8), (raised, 15.0)):
        at = np.array([start, longer])
        exact = np.asarray(jax.jacfwd(of)(jnp.asarray(at)))
        numeric = central_difference(lambda x, of=of: of(jnp.asarray(x)), at, 0.01)
        scale = np.abs(numeric).max(axis=-1, keepdims=True)
        np.testing.assert_allclose(exact / scale, numeric / scale, atol=1e-6)


def test_a_balance_elsewhere_than_expected_is_reached_by_continuation(knee, monkeypatch):
    shank = kj.Shank.of_person(75.0, 1.75)
    near = kj.leg_raise(knee, FLEXION, shank)
    monkeypatch.setattr("kneejax.experiments._extensor._MISSED_MM", -1.0)
    far = kj.leg_raise(knee, FLEXION, shank)
    assert far.continued.all() and not near.continued.any()
    np.testing.assert_allclose(far.quadriceps_N, near.quadriceps_N, rtol=1e-9)
    np.testing.assert_allclose(far.patella, near.patella, atol=1e-6)


def test_a_held_leg_inside_a_program_is_refused(knee):
    shank = kj.Shank.of_person(75.0, 1.75)
    with pytest.raises(TypeError, match=r"inside jax\.jit"):
        jax.jit(lambda x: kj.leg_raise(knee, x, shank).quadriceps_N)(FLEXION)


def test_tables_and_figures_tell_what_was_found(tracked):
    status = np.asarray(tracked.motion.status)
    table = extensor_table(tracked, status)
    named = table.records()
    assert [row["flexion_deg"] for row in named] == pytest.approx(list(FLEXION))
    assert named[0]["tendon_by_quadriceps"] == pytest.approx(tracked.tendon_N[0] / PULL_N)
    assert named[1]["patella_flexion_deg"] == pytest.approx(tracked.patella[1, 0])
    assert {row["status"] for row in named} == {"balanced"}
    assert len(table.terminal().splitlines()) == 2 + len(FLEXION)
    figure = extensor_figure(tracked, status, "a ball: tracking")
    assert [axes.get_ylabel() for axes in figure.axes][3] == "Patella, deg"
    lines = shear_figure(tracked).axes[0].get_lines()
    total = next(line for line in lines if line.get_label() == "sum")
    np.testing.assert_allclose(total.get_ydata(), 0.0, atol=1e-3)


def test_ankle_and_shank_are_one_weight():
    one = kj.Shank(4.0, (1.0, -250.0, 2.0), 2.0, (4.0, -400.0, -1.0)).load()
    np.testing.assert_allclose(one.force, [-6.0 * 9.80665, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(one.point, [2.0, -300.0, 1.0])
    # Standing, the femur's superior axis points up; with the knee above the hip, down in part.
    standing = kj.Shank(4.0, (0.0, -250.0, 0.0), femur_deg=-90.0).load()
    np.testing.assert_allclose(standing.force, [0.0, -4.0 * 9.80665, 0.0], atol=1e-12)
    assert kj.Shank(4.0, (0.0, -250.0, 0.0), femur_deg=30.0).load().force[1] > 0.0
    assert not np.any(weight_of(np.zeros(3), np.zeros(3)).force)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda k: kj.patellar_tracking(k, FLEXION, -5.0), "pulls with -5 N: expected above 0"),
        (lambda k: kj.patellar_tracking(k, FLEXION, np.nan), "pulls with nan N"),
        (lambda k: kj.leg_raise(dataclasses.replace(k, muscles=None), FLEXION, None),
         "no patella with a quadriceps"),
        (lambda k: kj.Shank(-1.0, (0.0, -250.0, 0.0)), "mass_kg is -1"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(knee, call, words):
    with pytest.raises(ValueError, match=words):
        call(knee)


def test_three_bones_are_drawn_where_they_are(knee, tracked):
    state, row = tracked.motion.equilibrium.state, 1
    corner = report.BoneMesh("patella", np.array([[0.0, 0.0, 0.0]]), np.zeros((0, 3), int))
    small = eqx.tree_at(lambda k: k.contacts[0].tibial.half_extent, knee, jnp.full(2, 12.0))
    scene = report.scenes(small, state, [corner], points=(24, 24))[row]
    turn = jnp.stack([jnp.stack(x) for x in state.poses["tibia"].placement.rotation])[..., row]

    def on_tibia(point, bone):
        """A point of the patella or of the femur, in the tibia's frame."""
        if bone == "patella":
            place = state.poses["patella"].placement
            point = np.array([float(jnp.asarray(x)[row]) for x in place.apply(tuple(point))])
        shift = [float(x[row]) for x in state.poses["tibia"].placement.translation]
        return (np.asarray(point) - shift) @ np.asarray(turn)

    lines, fibres = {fibre.name: fibre for fibre in scene.fibres}, knee.ligaments
    for name in ("PT0", "PFL2", "LCL"):
        i = fibres.names.index(name)
        (first, second), line = fibres.bodies[i], lines[name].points_mm
        begins, ends = fibres.femoral_attachment[i], fibres.tibial_attachment[i]
        np.testing.assert_allclose(line[0], on_tibia(begins, first), atol=1e-9)
        ends = ends if second == "tibia" else on_tibia(ends, second)
        np.testing.assert_allclose(line[-1], ends, atol=1e-9)
    np.testing.assert_allclose(scene.bones[0].points_mm[0], on_tibia(np.zeros(3), "patella"))
    # What is pressed lies in the ball, and the middle of that on the line through its centre.
    (facet,) = scene.plateaus
    assert facet.bone == "patella"
    ball = on_tibia(CENTER, "femur")
    pressed = facet.points_mm[facet.pressure_MPa > 0]
    assert len(pressed) and np.linalg.norm(pressed - ball, axis=-1).max() < 30.0
    normal = on_tibia([-1.0, 0.0, 0.0], "patella") - on_tibia(np.zeros(3), "patella")
    away = facet.center_mm - ball
    assert np.linalg.norm(away - (away @ normal) * normal) < 2.0
    # A head is shown near the knee, from its insertion on; its origin is far.
    head = lines["vaslat"]
    assert head.is_muscle and head.group == "quadriceps" and not head.slack
    np.testing.assert_allclose(head.points_mm[-1], on_tibia([2.0, 18.0, 5.0], "patella"), atol=1e-9)
    assert np.linalg.norm(np.ptp(head.points_mm, axis=0)) < 150.0
    with pytest.raises(ValueError, match="'fibula'; expected one of 'femur', 'tibia', 'patella'"):
        report.scenes(knee, state, [dataclasses.replace(corner, bone="fibula")])


@pytest.mark.slow
def test_a_leg_that_a_motor_raises_slowly_is_one_that_is_held(knee):
    person = leg_of_person(75.0, 1.75)
    moving = kj.MovingKnee.of(knee, person, gravity_m_s2=gravity_of(0.0)).critically_damped()
    flexion = [45.0, 40.0, 35.0, 30.0]

    def raised(seconds, **options):
        found = raised_leg(moving, flexion, np.linspace(0.0, seconds, 101), **options)
        assert found.transient.trajectory.ended.word == "balanced"
        assert found.transient.account.closes
        return found

    slow, quick = raised(20.0), raised(2.0)
    np.testing.assert_allclose(np.asarray(slow.held.flexion_deg)[[0, -1]], [45, 30], atol=0.01)
    assert slow.farthest < 0.1
    # What is left is of inertia and of damping, which fall with the speed or with its square.
    assert 5.0 * slow.farthest < quick.farthest < 5.0
    pulls = slow.transient.quadriceps["quadriceps_N"]
    np.testing.assert_allclose(pulls[slow.rows], slow.held.quadriceps_N, rtol=5e-3)
    said = " ".join(raised_leg_answer("a ball", slow).terminal().split())
    assert "Farthest from a leg that is held" in said
    data = slow.transient.to_dataset()
    np.testing.assert_allclose(data["quadriceps_force"], pulls)
    assert data["quadriceps_length"].units == "mm" and not np.isnan(data["flexion"]).any()
    length = slow.held.quadriceps_mm
    back = raised(20.0, lengths=([0.0, 10.0, 20.0], [0.0, float(length[2] - length[0]), 0.0]))
    assert back.transient.trajectory.to_table()[-1, 0] == pytest.approx(45.0, abs=0.05)
    with pytest.raises(ValueError, match=r"quadriceps_mm: \+1 longer than at the start"):
        raised(20.0, lengths=([0.0, 20.0], [200.0, 201.0]))


@pytest.mark.slow
def test_a_patella_without_mass_is_in_balance_at_every_moment_of_a_motion(knee, tracked):
    pulled = dataclasses.replace(knee, muscles=knee.muscles.pulling({"quadriceps": PULL_N - 20.0}))
    names = geo.coordinates_of(knee.bodies)
    start = tracked.motion.equilibrium.state.at(names)[:, 0]
    shank = kj.Mass(3.5, [0.0, -200.0, 0.0], np.diag([5e4, 5e3, 5e4]))
    moving = kj.MovingKnee.of(pulled, shank).critically_damped()
    on_patella = np.array(["patella" in pair for pair in knee.ligaments.bodies])
    moving = dataclasses.replace(
        moving, fibre_damping=jnp.where(on_patella, 0.0, moving.fibre_damping)
    )
    times = np.linspace(0.0, 0.03, 31)

    def pulled_by(anterior_N):
        load = kj.load_of(anterior_N=jnp.array([0.0, anterior_N]))
        return kj.move(moving, start, times, loads=kj.LoadCurve.of([0.0, 0.01], load),
                       held=("flexion",))  # fmt: skip

    still, moved = pulled_by(0.0), pulled_by(60.0)
    assert np.abs(np.asarray(still.q) - np.asarray(start)).max() < 1e-6
    assert moved.account().closes
    assert np.abs(moved.to_table()[-1] - moved.to_table()[0])[6:].max() > 0.05
    # With the tibia held where it is, nothing is left to move the patella.
    q = jnp.asarray(moved.q)[np.array([10, 20, 30])].T
    prescribed = dict(zip(names[:6], q[:6], strict=True))
    lanes = add_lane_axis(pulled)
    there = solve_equilibrium(lanes, prescribed, Guess(q[6:]))
    assert bool(jnp.all(there.stable))
    np.testing.assert_allclose(there.q, q[6:], atol=1e-6)
