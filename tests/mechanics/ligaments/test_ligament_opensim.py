"""The published ligament law against OpenSim's Blankevoort1991Ligament."""

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.geometry import Pose, State
from kneejax.mechanics import Ligaments, ligament_law

pytestmark = pytest.mark.opensim
SLACK_LENGTH_MM = 50.0


@pytest.fixture(scope="module")
def opensim_ligament():
    """A function of stiffness, transition strain and strains: strains and forces of OpenSim."""
    osim = pytest.importorskip("opensim")

    def forces(stiffness, transition_strain, strains):
        model = osim.Model()
        body = osim.Body("body", 1.0, osim.Vec3(0), osim.Inertia(1.0))
        model.addBody(body)
        joint = osim.SliderJoint("slider", model.getGround(), body)
        joint.updCoordinate().setName("x")
        model.addJoint(joint)
        slack = SLACK_LENGTH_MM * 1e-3
        ligament = osim.Blankevoort1991Ligament(
            "fibre", model.getGround(), osim.Vec3(0), body, osim.Vec3(0), stiffness, slack
        )
        ligament.set_damping_coefficient(0.0)
        ligament.set_transition_strain(transition_strain)
        model.addForce(ligament)
        state = model.initSystem()
        coordinate = model.getCoordinateSet().get("x")
        answer = []
        for strain in strains:
            coordinate.setValue(state, slack * (1.0 + strain))
            model.realizeDynamics(state)
            answer.append((ligament.getStrain(state), ligament.getSpringForce(state)))
        return np.array(answer).T

    return forces


@pytest.mark.parametrize(("stiffness", "toe"), [(2000.0, 0.06), (4500.0, 0.03)])
def test_tensions_equal_those_of_opensim(stiffness, toe, opensim_ligament):
    strains = np.linspace(-0.1, 0.1, 41)
    theirs_strain, theirs = opensim_ligament(stiffness, toe, strains)
    np.testing.assert_allclose(theirs_strain, strains, atol=1e-12)
    ours = np.asarray(ligament_law.exact_tension(theirs_strain, stiffness, toe))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_a_fibre_of_small_width_carries_the_force_of_opensim(opensim_ligament):
    strains = np.linspace(-0.1, 0.1, 21)
    _, theirs = opensim_ligament(3000.0, 0.06, strains)
    fibre = Ligaments(
        [[[0.0]] * 3], [[[0.0]] * 3], [[3000.0]], [[SLACK_LENGTH_MM]], [[0.06]], [[1e-9]], ["F"]
    )
    zero = jnp.zeros(len(strains))
    pose = Pose(zero, zero, zero, jnp.asarray(SLACK_LENGTH_MM * (1 + strains)), zero, zero)
    tension = np.asarray(fibre.tension(State({"tibia": pose})))[0]
    np.testing.assert_allclose(tension, theirs, rtol=1e-9, atol=1e-9)
