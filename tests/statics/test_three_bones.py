"""A patella that tips or turns round a corner is followed: where a balance exists, it is found."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import kneejax as kj
from kneejax.geometry import free_of, scales
from kneejax.mechanics import QUADRICEPS, add_lane_axis, pull_of
from kneejax.statics import LoadCases, Status, balance_one, sound
from kneejax.statics._balance import balance

pytestmark = pytest.mark.slow
#: Attachments moved, mm: of the tendon and of the retinacula on the patella; a tendon longer by.
TIPS = ([[2.9, -1.4, 2.0], [-1.3, -0.4, 4.5], [1.3, 2.9, 0.4]],
        [[2.9, 2.0, 1.7], [2.3, 0.8, -0.9]], 0.034)  # fmt: skip
CORNER = ([[-1.7, -2.4, -1.9], [2.5, -0.6, 1.9], [2.4, -1.6, -2.8]],
          [[-1.9, 1.6, -2.9], [0.4, -1.9, 1.6]], 0.017)  # fmt: skip


def moved(of_tendon, of_retinacula, longer):
    """The reduced knee of lenhart2015 with another extensor mechanism."""
    knee = kj.load_knee("lenhart2015_reduced", patella=True)
    fibres = knee.ligaments
    tendon = np.array([fibres.names.index(name) for name in ("PTl", "PTc", "PTm")])
    bands = np.array([fibres.names.index(name) for name in ("lPFL", "mPFL")])
    changed = dataclasses.replace(
        fibres,
        femoral_attachment=fibres.femoral_attachment.at[tendon].add(jnp.array(of_tendon)),
        tibial_attachment=fibres.tibial_attachment.at[bands].add(jnp.array(of_retinacula)),
        slack_length=fibres.slack_length.at[tendon].multiply(1.0 + longer),
    )
    return dataclasses.replace(knee, ligaments=changed)


def lowest(knee, flexion_deg, begin):
    """Where SciPy's trust region finds the energy least, in mm (rotations at 30 mm)."""
    units, lanes = np.array(scales(free_of(["flexion"], knee.bodies))), add_lane_axis(knee)
    held = {"flexion": jnp.array([np.deg2rad(flexion_deg)])}
    at_pose = jax.jit(lambda q: balance(lanes, held, q))

    def at(x):
        found = at_pose(jnp.asarray(x * units)[:, None])
        stiffness = np.asarray(found.tangent[..., 0]) * np.outer(units, units)
        force = np.asarray(found.residual)[:, 0] * units
        return float(found.forces.energy[0]), force, 0.5 * (stiffness + stiffness.T)

    parts = [lambda x, k=k: at(x)[k] for k in range(3)]
    found = minimize(parts[0], begin / units, jac=parts[1], hess=parts[2], method="trust-exact",
                     options={"gtol": 1e-6, "max_trust_radius": 3.0})  # fmt: skip
    return found.x, units


@pytest.mark.parametrize("extensor", [TIPS, CORNER])
def test_a_patella_that_tips_or_turns_a_corner_is_followed(extensor):
    """The one began where its stiffness was not positive, and 80 looks found nothing; the other
    turned by so much in 5 degrees that no parabola led on."""
    motion = kj.passive_flexion(moved(*extensor), np.arange(0.0, 41.0, 5.0))
    assert (np.asarray(motion.status) < Status.UNSTABLE).all()
    assert np.asarray(motion.stable).all()


@pytest.mark.parametrize(("extensor", "angle"), [(TIPS, 0.0), (CORNER, 25.0)])
def test_they_are_where_another_search_finds_the_least_energy(extensor, angle):
    knee = moved(*extensor)
    motion = kj.passive_flexion(knee, [angle])
    rest = np.asarray(knee.at_reference.at(free_of(["flexion"], knee.bodies)))
    least, units = lowest(knee, angle, np.asarray(motion.equilibrium.q[:, 0]) * 0.8 + 0.2 * rest)
    np.testing.assert_allclose(np.asarray(motion.equilibrium.q[:, 0]) / units, least, atol=1e-4)


def test_a_quadriceps_holds_the_patella_in_the_groove_however_far_the_knee_bends():
    """It passes in front of the femur. By the shorter way one head after the other went behind it
    from 119 degrees on, and the patella turned out of the groove under 111 N."""
    knee = moved([[0.0] * 3] * 3, [[0.0] * 3] * 2, 0.0)
    angles, pulls = np.array([90.0, 115.0, 120.0, 140.0]), np.array([20.0, 100.0, 500.0, 1500.0])
    flexion, pull = (x.ravel() for x in np.meshgrid(angles, pulls, indexing="ij"))
    rest = float(knee.muscles.tension.sum())
    load_cases = LoadCases.at(flexion, [pull_of(QUADRICEPS, pull - rest)])
    found = balance_one(knee, load_cases)
    assert sound(found.status).all()
    coordinates = dict(zip(found.free, np.rad2deg(found.q[0].T), strict=True))
    turned = np.abs([coordinates["patella_rotation"], coordinates["patella_tilt"]])
    assert turned.max() < 12.0
    # The harder it pulls, the more firmly it sits there.
    units = np.array(scales(found.free))
    stiffness = found.forces["tangent"][0] * units[:, None] * units
    least = np.linalg.eigvalsh(stiffness + np.swapaxes(stiffness, 1, 2))[:, 0] / 2.0
    assert (np.diff(least.reshape(len(angles), -1)[:, 1:], axis=1) > 0.0).all()


