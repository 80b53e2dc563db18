"""Dampers of fibres and coordinates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.dynamics import MovingKnee
from kneejax.geometry import State
from kneejax.mechanics import CoordinateDampers, Dampers, critical_damping, damping_force, tautness
from tests.dynamics.massed import SHANK, bare, fibres, in_a_vice


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
    with pytest.raises(ValueError, match="names 'patella_tilt'"):
        MovingKnee.of(knee, SHANK, coordinate_damping={"patella_tilt": 1.0})
    with pytest.raises(ValueError, match="names 'patella'; the knee moves tibia"):
        MovingKnee.of(knee, SHANK, patella=SHANK)
    with pytest.raises(ValueError, match="2 rows for 1 fibres"):
        one = bare(fibres([[0.0, 100.0, 0.0]], [[0.0, 0.0, 0.0]]))
        MovingKnee(one, {"tibia": SHANK}, jnp.zeros(2), {}, jnp.zeros(3))
