"""Dampers of fibres and coordinates."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from kneejax.dynamics import MovingKnee, move
from kneejax.geometry import Frame, Plane, Sphere, State
from kneejax.mechanics import (
    Contact,
    ContactDamper,
    CoordinateDampers,
    Dampers,
    Mass,
    critical_damping,
    damping_force,
    tautness,
)
from tests.dynamics.massed import ALL_BUT_SUPERIOR, SHANK, STEPS, bare, fibres, in_a_vice


@pytest.mark.parametrize(
    ("length_mm", "rate_mm_s", "damping_force_N"),
    [(102.0, 50.0, 3.5), (100.5, 50.0, 1.75), (102.0, -50.0, 0.0), (99.0, 50.0, 0.0)],
)
def test_a_fibre_is_damped_as_by_opensim(length_mm, rate_mm_s, damping_force_N):
    """What OpenSim 4.6 answers for a coefficient of 7 and a slack length of 100 mm."""
    taut = tautness(length_mm / 100.0 - 1.0)
    force = damping_force(jnp.asarray(rate_mm_s), taut * 7.0 / 100.0, jnp.asarray(0.0))
    assert float(force) == pytest.approx(damping_force_N, rel=1e-12)


def test_dampers_of_a_step_have_a_potential():
    dampers = Dampers(jnp.array([0.3, 0.2, 0.0]), jnp.array([0.1, 0.0, 0.4]),
                      jnp.array([30.0, 31.0, 29.5]), jnp.full(3, 150.0))  # fmt: skip
    length = jnp.array([30.2, 30.9, 29.0])
    slope = jax.grad(lambda x: jnp.sum(dampers.energy(x)))(length)
    np.testing.assert_allclose(dampers.tension(length), slope, rtol=1e-12)
    assert float(dampers.tension(length)[1]) == 0.0  # it becomes shorter


@pytest.mark.parametrize("rate", [-900.0, -300.0, 400.0])
def test_a_contact_damper_has_a_potential_and_never_pulls(rate):
    before, per_s = 0.3, 800.0
    damper = ContactDamper(*(jnp.asarray(x) for x in (0.002, 40.0, before, per_s)))
    overlap = jnp.asarray(before + rate / per_s)
    assert float(damper.force(overlap)) == pytest.approx(40.0 * max(0.002 * rate, -1.0))
    assert float(damper.force(overlap)) == pytest.approx(float(jax.grad(damper.energy)(overlap)))
    edge = [float(damper.energy(before - 500.0 / per_s + x)) for x in (-1e-9, 1e-9)]
    assert edge[0] == pytest.approx(edge[1], rel=1e-6)
    none = dataclasses.replace(damper, dissipation=jnp.asarray(0.0))
    assert float(none.energy(overlap)) == float(jax.grad(none.energy)(overlap)) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("form", ["elliptical_patch", "quadrature"])
def test_a_damped_bounce_is_as_slow_as_its_equation_says(form):
    """Whatever the elastic force: `u - log(1 + u)` is the same before and after a bounce.

    From `m v dv = -f (1 + c v) dx`, with `u = c v` and the integral of `f` over the bounce zero.
    """
    speed, dissipation = 300.0, 0.003
    plane = Plane(Frame([0.0, -20.5, 0.0]), half_extent=(8.0, 8.0))
    contact = Contact(Sphere(20.0), plane, form=form, points=(16, 16))
    mass = Mass(2.0, [0.0] * 3, np.zeros((3, 3)))
    ball = MovingKnee.of(
        bare(contacts=(contact,)), mass, contact_dissipation={"0": dissipation}
    )
    found = move(ball, np.zeros(6), np.linspace(0.0, 0.014, STEPS + 1), within=18,
                 rate=[0.0, 0.0, 0.0, 0.0, speed, 0.0], held=ALL_BUT_SUPERIOR)  # fmt: skip

    def gone(v):
        return dissipation * v - np.log1p(dissipation * v)

    after = brentq(lambda v: gone(v) - gone(speed), -0.999 / dissipation, -1.0)
    assert float(found.rate[-1, 4]) == pytest.approx(after, rel=1e-3)
    account = found.account()
    lost = 0.5 * 2e-3 * (speed**2 - after**2)
    assert account.closes and float(account.dissipated[-1]) == pytest.approx(lost, rel=2e-3)


def test_coordinate_dampers_have_a_potential():
    before = {"flexion": jnp.asarray(0.1), "anterior": jnp.asarray(2.0)}
    damping = {"flexion": jnp.asarray(50.0), "anterior": jnp.asarray(0.3)}
    dampers = CoordinateDampers(damping, before, jnp.asarray(100.0))

    def energy(q):
        return dampers.energy(State.of({}, q))

    q = jnp.array([0.15, 0.0, 0.0, 1.5, 0.0, 0.0])
    forces = dampers.forces(State.of({}, q))
    slope = jax.grad(energy)(q)
    assert float(forces["flexion"]) == pytest.approx(-float(slope[0]))
    assert float(forces["anterior"]) == pytest.approx(-float(slope[3]))


def test_critical_damping_is_that_of_paper_2():
    """`sqrt(4 k m)` in SI: 1,500 N of aACL on 32.3 mm / 1.02, and 4 kg."""
    slack = 32.3 / 1.02
    in_si = np.sqrt(4.0 * (1500.0 / (slack * 1e-3)) * 4.0)
    assert float(critical_damping(1500.0, slack, 4.0)) == pytest.approx(in_si / 1000.0)


def test_what_a_knee_has_not_is_not_damped():
    knee = in_a_vice().knee
    with pytest.raises(ValueError, match="coordinate_damping: 'patella_tilt'; expected of flexion"):
        MovingKnee.of(knee, SHANK, coordinate_damping={"patella_tilt": 1.0})
    with pytest.raises(ValueError, match="masses: 'patella'; expected of tibia"):
        MovingKnee.of(knee, SHANK, patella=SHANK)
    with pytest.raises(ValueError, match="contact_dissipation: 'medail'; expected of 0"):
        ball = bare(contacts=(Contact(Sphere(20.0), Plane()),))
        MovingKnee.of(ball, SHANK, contact_dissipation={"medail": 0.01})
    with pytest.raises(ValueError, match="fibre_damping: 2 rows; expected 1"):
        one = bare(fibres([[0.0, 100.0, 0.0]], [[0.0, 0.0, 0.0]]))
        MovingKnee(one, {"tibia": SHANK}, jnp.zeros(2), {}, jnp.zeros(3))
