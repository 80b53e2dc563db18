"""Other choices of free and prescribed coordinates than flexion prescribed and five free.

Most of it on a body that hangs in ten cables: statics knows no more of a knee than that.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import COORDINATES, State, scales
from kneejax.mechanics import Knee, Ligaments, Support, add_lane_axis, load_of
from kneejax.statics import LoadCases, Status, balance_many, balance_with_slopes

#: What is held besides flexion, and whether flexion is free. Each is a program of its own.
CHOICES = {
    "anterior held": ({"anterior_mm": 2.0}, False),
    "rotation held": ({"internal_rotation_deg": 5.0}, False),
    "flexion free": ({}, True),
    "flexion free, two held": ({"internal_rotation_deg": 6.0, "anterior_mm": 1.0}, True),
}
MORE = {"rotation held", "flexion free"}


@pytest.fixture(scope="module")
def knee():
    """A body in ten taut cables, stiffer to one side than to the other."""
    rng = np.random.default_rng(3)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    far = np.vstack([40.0 * corners, [[50.0, 0.0, 10.0], [-45.0, 5.0, 0.0]]])
    near = np.vstack([15.0 * np.roll(corners, 1, axis=1), [[12.0, 8.0, 0.0], [-12.0, 0.0, 5.0]]])
    far, near = (x + rng.uniform(-3.0, 3.0, x.shape) for x in (far, near))
    length = np.linalg.norm(far - near, axis=1)
    names = tuple(f"cable{i}" for i in range(10))
    cables = Ligaments(
        far, near, rng.uniform(800.0, 2500.0, 10), length / 1.06, np.full(10, 0.02),
        np.full(10, 1e-3), names, failure_strain=np.full(10, 5.0),
    )  # fmt: skip
    return Knee(cables, (), (), (), kj.Pose.from_table(np.zeros(6)), ())


@pytest.fixture(
    scope="module",
    params=[pytest.param(x, marks=[pytest.mark.long] * (x in MORE)) for x in CHOICES],
)
def choice(request):
    return CHOICES[request.param]


@pytest.fixture(scope="module")
def motion(knee, choice):
    held, free = choice
    return kj.passive_flexion(knee, [-5.0, 10.0], held=held, flexion_is_free=free)


@jax.jit
def energy(knee, q):
    """Of all six coordinates, with the poses along the last axis."""
    return add_lane_axis(knee).energy(State.of({}, q))


@pytest.mark.long
def test_what_is_held_is_where_it_is_held_and_the_rest_balances(knee, motion, choice):
    assert (np.asarray(motion.status) == Status.BALANCED).all()
    rows = np.asarray(motion.to_table())
    for column, value in choice[0].items():
        np.testing.assert_allclose(rows[:, kj.geometry.COLUMNS.index(column)], value, atol=1e-12)
    # Minus the slope of the energy, by central differences, is what holds a coordinate.
    names = tuple(COORDINATES)
    here = np.asarray(motion.equilibrium.state.at(names))
    for name, scale, unit in zip(names, scales(names), np.eye(6)[:, :, None], strict=True):
        step = 1e-4 * scale
        slope = (energy(knee, here + step * unit) - energy(knee, here - step * unit)) / (2 * step)
        if name in motion.load_cases.prescribed:
            np.testing.assert_allclose(motion.reaction(name) * scale, slope * scale, atol=2e-4)
        else:
            assert np.abs(slope * scale).max() < 2e-4


@pytest.mark.long
def test_a_table_of_a_motion_tells_what_holds_it(knee):
    motion = kj.passive_flexion(knee, [-5.0, 10.0], held={"anterior_mm": 2.0})
    table = motion.to_dataframe()
    assert list(table.columns[-2:]) == ["status", "reaction_anterior_N"]
    np.testing.assert_allclose(table["reaction_anterior_N"], motion.reaction("anterior"))


def test_a_pose_held_where_it_rests_is_that_pose(knee):
    """Whatever is prescribed to what it would be anyway changes nothing, and nothing holds it."""
    rest = kj.passive_flexion(knee, [-5.0, 10.0])
    table = np.asarray(rest.to_table())
    held = {"anterior_mm": table[:, 3], "internal_rotation_deg": table[:, 2]}
    again = kj.passive_flexion(knee, [-5.0, 10.0], held=held)
    np.testing.assert_allclose(again.to_table(), table, atol=1e-7)
    assert np.abs(again.reaction("anterior")).max() < 1e-4


@pytest.mark.long
def test_a_knee_that_is_let_go_comes_to_rest_at_one_flexion(knee):
    """Wherever it was begun; there no moment is needed to keep its flexion."""
    rest = kj.passive_flexion(knee, [-5.0, 10.0], flexion_is_free=True)
    table = np.asarray(rest.to_table())
    np.testing.assert_allclose(table[0], table[1], atol=1e-6)
    at_rest = kj.passive_flexion(knee, table[:1, 0])
    np.testing.assert_allclose(at_rest.to_table()[0], table[0], atol=1e-6)
    assert abs(float(at_rest.reaction("flexion")[0])) < 1e-2


@pytest.mark.long
def test_the_moment_that_keeps_a_flexion_keeps_it_when_flexion_is_free(knee):
    kept = kj.passive_flexion(knee, [20.0])
    support = Support(kept.reaction("flexion")[0], "flexion")
    loaded = dataclasses.replace(knee, loads=(support,))
    free = kj.passive_flexion(loaded, [15.0], flexion_is_free=True)
    np.testing.assert_allclose(free.to_table(), kept.to_table(), atol=1e-6)


def test_a_displacement_and_its_reaction_are_a_load_and_its_displacement(knee):
    """Displacement control and force control of the same drawer meet in the same pose."""
    held = kj.passive_flexion(knee, [0.0], held={"anterior_mm": 2.0})
    force = float(held.reaction("anterior")[0])
    # In extension the femur's anterior axis is the floating axis.
    pushed = kj.passive_flexion(knee, [0.0], [load_of(anterior_N=force)])
    np.testing.assert_allclose(pushed.to_table(), held.to_table(), atol=1e-5)


@pytest.mark.long
def test_derivatives_are_central_differences(knee, choice):
    held, free = choice
    names = ["cable0.stiffness", "cable3.slack_length", "cable8.femoral_attachment.superior"]
    selection = kj.select(knee, names)
    values = np.asarray(selection.read(knee))
    load_cases = LoadCases.at([-5.0, 10.0], (), held, free)
    found = balance_with_slopes(knee, selection.apply, values[None], load_cases)
    assert found.converged.all()
    units = np.array(scales(load_cases.free))
    for k, value in enumerate(values):
        steps = abs(value) * np.array([-2e-4, -1e-4, 1e-4, 2e-4])
        moved = np.repeat(values[None], 4, axis=0)
        moved[:, k] += steps
        near = np.repeat(found.jacobian, 4, axis=0)
        guess = type(found)(
            np.repeat(values[None], 4, axis=0), *(np.repeat(x, 4, axis=0) for x in (
                found.q, found.jacobian, found.contact_points, found.tangent, found.status)),
        )  # fmt: skip
        q = balance_with_slopes(knee, selection.apply, moved, load_cases, guess).q / units
        slope = (q[0] - 8 * q[1] + 8 * q[2] - q[3]) / (12 * steps[2])
        exact = near[0, ..., k] / units
        np.testing.assert_allclose(slope, exact, atol=1e-6 * np.abs(exact).max())


def test_variants_are_held_each_from_its_own_balance(knee):
    selection = kj.select(knee, ["cable1.stiffness"])
    base = np.asarray(selection.read(knee))
    values = base * np.array([[0.5], [1.0], [2.0]])
    load_cases = LoadCases.at([10.0, 10.0], (), {"anterior_mm": [1.0, 3.0]})
    found = balance_many(knee, selection.apply, values, load_cases)
    assert found.converged.all() and found.q.shape == (3, 2, 4)
    for row, value in enumerate(values):
        alone = kj.passive_flexion(
            selection.apply(knee, jnp.asarray(value)), [10.0, 10.0],
            held={"anterior_mm": [1.0, 3.0]},
        )  # fmt: skip
        np.testing.assert_allclose(found.q[row].T, alone.equilibrium.q, atol=1e-7)


def test_what_is_held_must_be_a_coordinate(knee):
    with pytest.raises(ValueError, match="'anterior' is no coordinate.*did you mean 'anterior_mm'"):
        kj.passive_flexion(knee, [20.0], held={"anterior": 1.0})
    with pytest.raises(ValueError, match="flexion_deg stands among"):
        kj.passive_flexion(knee, [20.0], held={"flexion_deg": 1.0})
    with pytest.raises(ValueError, match="name: 'anterior'; expected one that is prescribed"):
        kj.passive_flexion(knee, [20.0]).reaction("anterior")


@pytest.mark.long
def test_a_knee_with_contact_is_drawn_forwards_and_pulls_back():
    """The bundled knee at 30 degrees, moved as in Figure 10 of paper 3: the force grows with it."""
    knee = kj.load_knee("four_ligament")
    held = {"anterior_mm": [-3.0, 0.0, 3.0]}
    motion = kj.passive_flexion(knee, 30.0, held=held)
    assert motion.stable.all()
    force = np.asarray(motion.reaction("anterior"))
    assert (np.diff(force) > 20.0).all()
    assert motion.tension("ACL")[2] > motion.tension("ACL")[0]
