"""A quadriceps that a motor gives its length: a mass on a cable, in closed form."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.dynamics import MovingKnee, move
from kneejax.mechanics import QUADRICEPS, Cable, Knee, Ligaments, Mass, Muscles
from kneejax.statics import Status

MASS_KG, REST_N, ABOVE_MM = 2.0, 4.0, 150.0
TIMES = np.linspace(0.0, 0.2, 29)
#: All but the patella's height.
NAMES = geo.coordinates_of((geo.TIBIA, geo.PATELLA))
HEIGHT = NAMES.index("patella_superior")
HELD = tuple(name for name in NAMES if name != "patella_superior")
WEIGHT_N = 1e-3 * MASS_KG * 9806.65


@pytest.fixture(scope="module")
def hanging():
    """A patella with mass that hangs on two heads of a quadriceps, side by side."""
    here = geo.Pose.from_table([0.0] * 6)
    heads = Muscles(
        [[0.0, ABOVE_MM, -5.0], [0.0, ABOVE_MM, 5.0]], [[0.0, 0.0, -5.0], [0.0, 0.0, 5.0]],
        [0.25 * REST_N, 0.75 * REST_N], ["vasmed", "vaslat"],
        bodies=((geo.FEMUR, geo.PATELLA),) * 2,
    )  # fmt: skip
    nothing = Ligaments([], [], [], [], [], [], [])
    knee = Knee(nothing, (), (), (), here, (), other_bones={geo.PATELLA: here}, muscles=heads)
    shank, patella = (Mass(m, [0.0] * 3, 400.0 * np.eye(3)) for m in (1.0, MASS_KG))
    return MovingKnee.of(knee, shank, patella=patella, gravity_m_s2=(0.0, -9.80665, 0.0))


def swung(moving, way, pull_N=WEIGHT_N - REST_N, **options):
    held = {name: None for name in HELD} | {QUADRICEPS: way}
    return move(moving, np.zeros(12), TIMES, held=held, pull_N=pull_N, **options)


@pytest.mark.long
def test_the_pull_is_what_a_mass_on_a_cable_needs(hanging, slope_on_log_axes):
    """Weight and acceleration, with errors of second order; lengths are those that were given."""
    size, turning = 3.0, 2.0 * np.pi / TIMES[-1]

    def way(t):
        return ABOVE_MM - size * (1.0 - np.cos(turning * t)) / 2.0

    exact = 1e-3 * MASS_KG * (9806.65 + size / 2.0 * turning**2 * np.cos(turning * TIMES)) - REST_N
    off, counts = [], (1, 2, 4)
    for within in counts:
        found = swung(hanging, way, within=within)
        assert found.ended is Status.BALANCED
        np.testing.assert_allclose(found.q[:, HEIGHT], ABOVE_MM - way(TIMES), atol=1e-4)
        off.append(np.abs(found.pull_N - exact)[8:].max())
    assert slope_on_log_axes(counts, off) == pytest.approx(-2.0, abs=0.35)
    assert off[-1] < 0.05
    # Work of the motor and of the weight is the change of energy.
    account = found.account()
    assert account.closes and float(account.part_missing) < 2e-3


def test_a_cable_that_is_paid_out_too_fast_becomes_slack(hanging):
    """What hangs on it falls freely, but for its tension at rest, until it is caught."""
    found = swung(hanging, lambda t: ABOVE_MM + 40.0 * np.clip(t / 0.06, 0.0, 1.0), within=4)
    assert found.ended is Status.BALANCED
    falls = (TIMES > 0.005) & (TIMES < 0.055)
    free = -0.5 * (9806.65 - REST_N / (1e-3 * MASS_KG)) * TIMES**2
    np.testing.assert_allclose(np.asarray(found.q)[falls, HEIGHT], free[falls], atol=0.02)
    assert found.pull_N[falls].max() < 0.1 and found.pull_N.min() >= 0.0
    every = found.moments.known
    assert np.nanmax(every.pull) > 1000.0 and np.nanmin(every.q[:, HEIGHT]) > -40.2


@pytest.mark.long
def test_derivatives_of_a_driven_motion_equal_differences(hanging):
    """Of pose and pull by what is lifted and by the way, forward and backward."""
    weights = np.random.default_rng(3).normal(size=(2, len(TIMES)))

    def told(values):
        mass, size = values
        patella = Mass(mass, [0.0] * 3, 400.0 * jnp.eye(3))
        moving = dataclasses.replace(hanging, masses={**hanging.masses, geo.PATELLA: patella})
        found = swung(moving, lambda t: ABOVE_MM - size * jnp.sin(15.0 * t) ** 2)
        pulls = found.moments.known.pull[found.rows, 0]
        return weights[0] @ found.q[:, HEIGHT] + weights[1] @ pulls

    at = jnp.array([MASS_KG, 2.0])
    backward, forward = jax.grad(told)(at), jax.jacfwd(told)(at)
    np.testing.assert_allclose(backward, forward, rtol=1e-9)
    # A pull is known to 1e-8 N, its cable being stiff: steps are wide, and of fourth order.
    size = 2e-2
    for k in range(2):
        step = size * np.eye(2)[k]
        near, far = (float(told(at + m * step) - told(at - m * step)) for m in (1, 2))
        difference = (8.0 * near - far) / (12.0 * size)
        assert float(forward[k]) == pytest.approx(difference, rel=1e-6)


def test_heads_share_the_pull_of_a_cable_and_its_energy_is_its_work(hanging):
    muscles = hanging.knee.muscles
    lanes = jax.tree.map(lambda x: x[..., None], muscles)
    cable = Cable(jnp.array([ABOVE_MM - 1e-4]), jnp.array([12.0]))
    driven = dataclasses.replace(lanes, cable=cable)

    def energy(height):
        q = jnp.zeros((12, 1)).at[HEIGHT, 0].set(height)
        return driven.energy(geo.State.of({}, q, hanging.knee.bodies))[0]

    # 0.1 micrometre too long: 10 N more than expected.
    assert -float(jax.grad(energy)(0.0)) == pytest.approx(REST_N + 22.0, abs=0.03)
    np.testing.assert_allclose(muscles.shares, [0.25, 0.75])
    assert float(muscles.quadriceps_length(hanging.knee.at_reference)) == ABOVE_MM


def test_a_knee_without_a_quadriceps_is_given_no_length(hanging):
    without = dataclasses.replace(hanging, knee=dataclasses.replace(hanging.knee, muscles=None))
    with pytest.raises(ValueError, match="path: quadriceps; expected a knee with a quadriceps"):
        swung(without, lambda t: 0.0 * t + ABOVE_MM)
