"""Implicit steps and an integrator of others follow the same equations."""

import dataclasses
from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.dynamics import Grid, MovingKnee, integrated, move, move_within
from kneejax.geometry import Frame, Plane, Sphere, scales
from kneejax.mechanics import Contact, Mass
from kneejax.statics import Status
from tests.dynamics.massed import ALL_BUT_SUPERIOR, STEPS, bare, in_a_vice

pytestmark = pytest.mark.usefixtures("optimised_code")

START = np.array([0.03, -0.01, 0.02, 0.2, -0.1, 0.15])


def damped():
    vice = in_a_vice()
    fibres = dataclasses.replace(vice.knee.ligaments, damping=jnp.full(12, 2.0))
    knee = dataclasses.replace(vice.knee, ligaments=fibres)
    return dataclasses.replace(vice, knee=knee, fibre_damping=jnp.full(12, 0.05),
                               coordinate_damping={"lateral": jnp.asarray(0.02)})  # fmt: skip


def ball(dissipation=None):
    contact = Contact(Sphere(20.0), Plane(Frame([0.0, -20.5, 0.0])))
    mass = Mass(2.0, [0.0] * 3, np.zeros((3, 3)))
    knee = bare(contacts=(contact,))
    pressed = {} if dissipation is None else {"0": dissipation}
    return MovingKnee.of(knee, mass, gravity_m_s2=(0.0, 60.0, 0.0), contact_dissipation=pressed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "start", "span", "held"),
    [
        (damped, START, 0.02, ()),
        (in_a_vice, START, 0.02, ()),
        (partial(ball, 0.002), np.zeros(6), 0.012, ALL_BUT_SUPERIOR),
    ],
    ids=["damped", "undamped", "damped bounce"],
)
def test_diffrax_integrates_the_same_motion(make, start, span, held):
    """Lagrange's equations from energies alone, by Dormand and Prince's method of eighth order."""
    pytest.importorskip("diffrax")
    times = np.linspace(0.0, span, 41)
    expected, rates = integrated(make(), start, times, held=held)
    found = move_within(5e-5, make(), start, times, held=held)
    off = np.abs(np.asarray(found.q) - expected)
    assert np.rad2deg(off[:, :3]).max() < 1e-4 and off[:, 3:].max() < 1e-4
    assert np.abs(np.asarray(found.rate) - rates)[:, 3:].max() < 1e-3 * np.abs(rates).max()


def test_a_knee_with_a_bone_without_mass_is_refused_there():
    with pytest.raises(ValueError, match="masses: of nothing; expected one of each of tibia"):
        integrated(dataclasses.replace(in_a_vice(), masses={}), START, [0.0, 0.1])


@pytest.mark.long
def test_steps_become_as_short_as_an_error_asks():
    times = np.linspace(0.0, 0.01, 6)
    exact = move(damped(), START, times, within=400)
    lax, strict = (move_within(most, damped(), START, times) for most in (1e-1, 1e-3))
    for found, most in ((lax, 1e-1), (strict, 1e-3)):
        assert found.error_mm <= most
        off = (np.asarray(found.q) - np.asarray(exact.q)) / np.array(scales(found.names))
        assert np.abs(off).max() == pytest.approx(found.error_mm, rel=0.35)
    assert strict.grid.within().max() > lax.grid.within().max()
    assert (strict.grid.ratio <= 2.0 + 1e-9).all()


@pytest.mark.long
def test_a_step_that_fails_is_tried_in_shorter_ones():
    """Thrown onto the femur in one long step the layer is crossed; in short ones it bounces."""
    fast = [0.0, 0.0, 0.0, 0.0, 900.0, 0.0]
    times = np.linspace(0.0, 0.02, 3)
    whole = move(ball(), np.zeros(6), times, rate=fast, held=ALL_BUT_SUPERIOR)
    found = move_within(0.05, ball(), np.zeros(6), times, rate=fast, held=ALL_BUT_SUPERIOR)
    assert found.ended is Status.BALANCED and found.grid.within().max() > 8
    assert not np.isfinite(float(whole.q[-1, 4])) or found.error_mm < abs(
        float(whole.q[-1, 4] - found.q[-1, 4]))  # fmt: skip


def test_a_grid_says_its_steps_and_grows_slowly():
    grid = Grid.of(np.linspace(0.0, 1.0, 5), [16, 1, 1, 4])
    assert grid.within().tolist() == [16, 8, 4, 4]
    assert grid.time_s[grid.asked].tolist() == [0.25, 0.5, 0.75, 1.0]
    assert STEPS + 4 == len(Grid.of(np.linspace(0.0, 1.0, STEPS + 1)).time_s)
