"""Paper 1's patella on its path: closed forms, and the patella in balance that gave the path."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments._extensor_mechanism import tendon_of
from kneejax.geometry import COORDINATES, Pose, State
from kneejax.mechanics import add_lane_axis, generalised_force
from kneejax.papers.patella_on_path import PatellaOnPath, Strands, on_path

PULL_N, LENGTH_MM = 200.0, 60.0
#: Transition strain, and how it is rounded.
LAW = ([0.06], [1e-5])


def straight(stiffness_N=5e5, tilt=0.0, pull_N=PULL_N):
    """A patella on a straight path of 60 mm down the femur; the quadriceps pulls along it.

    The tendon, of one fibre, goes to the tibia's origin; `tilt` holds the patella by a second
    fibre, across the path.
    """
    half = 0.5 * LENGTH_MM
    ends = jnp.array([[[50.0, 30.0 - half, 0.0]], [[0.0, -half, 0.0]]])
    tendon = Strands(ends, jnp.zeros((1, 3)), *jnp.array([[stiffness_N], [50.0], *LAW]))
    aside = jnp.array([[50.0, 0.0, 40.0]])
    held = Strands(ends, aside, *jnp.array([[tilt], [30.0], *LAW]))
    quadriceps = jnp.array([100.0 + half, half])
    return PatellaOnPath(jnp.asarray(pull_N), jnp.array([0.0, LENGTH_MM]), quadriceps, tendon, held)


def tibia_at(anterior):
    return State({"tibia": Pose.from_table([[0.0, 0.0, 0.0, anterior, -60.0, 0.0]])})


@pytest.mark.parametrize("anterior", [50.0, 40.0, 20.0])
def test_a_patella_on_a_straight_path_pulls_as_far_as_the_tendon_runs_along_it(anterior):
    """Along the path the pulls are equal: `tension cos(angle) = quadriceps`."""
    path = add_lane_axis(straight())
    state = tibia_at(anterior)
    place = float(path.arc_length(state)[0])
    across, along = anterior - 50.0, -60.0 - (30.0 - place)
    cosine = abs(along) / np.hypot(across, along)
    assert float(path.wrench(state).force.norm()[0]) == pytest.approx(PULL_N / cosine, rel=1e-12)


@pytest.mark.parametrize("stiffness_N", [1e4, 1e5, 1e6])
def test_a_tendon_stretches_as_its_law_says(stiffness_N):
    """In the toe by the root of pull over stiffness: a stiff tendon keeps its length."""
    path, state = add_lane_axis(straight(stiffness_N)), tibia_at(40.0)
    length = np.hypot(-10.0, -60.0 - (30.0 - float(path.arc_length(state)[0])))
    tension = float(path.wrench(state).force.norm()[0])
    strain = np.sqrt(2.0 * LAW[0][0] * tension / stiffness_N)
    assert length == pytest.approx(50.0 * (1.0 + strain), abs=2e-4)


def test_the_wrench_is_what_the_energy_loses(central_difference):
    """So it is a potential of the tibia's pose: stiffness is symmetric, and exact."""
    path = add_lane_axis(straight(2e4, tilt=3e4))
    names = tuple(COORDINATES)

    def at(x):
        return State({"tibia": Pose(*(jnp.atleast_1d(v) for v in x[:6]))})

    @jax.jit
    def force(x):
        """Along all coordinates, the pull standing last in `x`."""
        pulled = dataclasses.replace(path, tension=x[6])
        rows = generalised_force(at(x), path.bodies, pulled.wrench(at(x)), names)
        return jnp.stack([jnp.reshape(row, ()) for row in rows])

    x = np.array([0.3, 0.1, -0.1, 35.0, -58.0, 3.0, PULL_N])
    energy = jax.jit(lambda x: path.energy(at(x))[0])
    lost = -central_difference(energy, x, 1e-4)[:6]
    assert np.asarray(force(x)) == pytest.approx(lost, rel=1e-6, abs=1e-5)
    exact = np.asarray(jax.jit(jax.jacfwd(force))(x))
    assert exact[:, :6] == pytest.approx(exact[:, :6].T, rel=1e-9, abs=1e-6)
    assert exact == pytest.approx(central_difference(force, x, 1e-4), rel=1e-6, abs=1e-2)


def test_where_the_patella_is_has_its_second_derivative(central_difference):
    path = add_lane_axis(straight(2e4))

    @jax.jit
    def slope(anterior):
        return jax.jvp(lambda x: path.arc_length(tibia_at(x))[0], (anterior,), (1.0,))[1]

    bend = float(jax.jit(jax.grad(slope))(40.0))
    assert bend == pytest.approx(float(central_difference(slope, 40.0, 0.05)), rel=1e-6)


def test_a_knee_that_has_its_patella_already_is_refused():
    three = kj.load_knee("four_ligament", patella=True)
    with pytest.raises(ValueError, match="four_ligament has its patella already"):
        on_path(three, three)
    two = kj.load_knee("four_ligament")
    with pytest.raises(ValueError, match="four_ligament has no patella"):
        on_path(two, two)


@pytest.mark.long
def test_a_patella_on_its_path_moves_the_knee_as_the_patella_in_balance_does():
    """Of which the path was taken, within a degree; a line of constant tension is eight away."""
    two, three = (kj.load_knee("four_ligament_fitted", patella=x) for x in (False, True))
    knee, flexion = on_path(two, three), np.arange(-10.0, 122.6, 2.5)
    pull, balanced = float(knee.lines[0].tension), kj.passive_flexion(three, flexion)
    some = (flexion >= 0.0) & (flexion <= 120.0)
    table = np.asarray(balanced.to_table())[some]
    ridden = kj.passive_flexion(knee, flexion[some])
    away = np.abs(np.asarray(ridden.to_table()) - table).max(axis=0)
    assert away[1:3].max() < 1.0 and away[3:].max() < 0.1
    line = np.asarray(kj.passive_flexion(two, flexion[some]).to_table())
    assert np.abs(line - table)[:, 2].max() > 5.0
    there = kj.evaluate(three, balanced.equilibrium.state, balanced.equilibrium.contact_points)
    own = np.asarray(tendon_of(three, there))[some] / pull
    wrench = add_lane_axis(knee.lines[0]).wrench(ridden.equilibrium.state)
    tendon = np.asarray(wrench.force.norm()) / pull
    middle = (flexion[some] >= 10.0) & (flexion[some] <= 80.0)
    assert tendon[middle] == pytest.approx(own[middle], abs=0.03)
