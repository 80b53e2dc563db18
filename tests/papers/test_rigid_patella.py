"""Paper 3's rigid patella: its own equations, and the elastic form that becomes stiff."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax.mechanics import Contact, Knee, Ligaments, Muscles, add_lane_axis
from kneejax.papers.rigid_patella import RigidPatella, held_by_rigid_patella, rigid_leg
from kneejax.statics import Guess, solve_equilibrium

PULL_N, THICKNESS = 200.0, 6.0
#: Medial and lateral polynomial of the groove, second order; planes 130 degrees apart.
RADII = ([[30.0, -1.0, -4.0], [-1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]],
         [[31.0, 1.5, -4.0], [-1.5, 0.0, 0.0], [-2.0, 0.0, 0.0]])  # fmt: skip
TILT = np.deg2rad(25.0)
START = [0.1, 0.0, 0.0, 44.0, 8.0, 0.0, 0.0, -10.0, 0.0, 10.0, 0.3, 0.3, 1.0]


@pytest.fixture(scope="module")
def patella():
    groove = [
        geo.Condyle(radii, (-0.6, 1.5), width)
        for radii, width in zip(RADII, ((-26.0, -2.0), (2.0, 26.0)), strict=True)
    ]
    facets = [geo.Plane(geo.Frame([-14.0, 0.0, 0.0], [0.0, side * TILT, np.pi / 2]))
              for side in (-1.0, 1.0)]  # fmt: skip
    return RigidPatella(
        tuple(groove), tuple(facets), jnp.array([0.0, -18.0, 0.0]), jnp.array([32.0, -55.0, 1.0]),
        jnp.array(48.0), jnp.array([34.0, 170.0, 0.0]), jnp.array([2.0, 18.0, 0.0]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def found(patella):
    """In balance, the tibia in extension."""
    return jax.jit(RigidPatella.balanced)(patella, patella.tibial_attachment, jnp.array(START))


@pytest.mark.long
def test_the_constraints_hold_and_the_forces_are_pushes(patella, found):
    there = geo.Pose(*found[:6]).placement
    for side in (0, 1):
        met = found[6 + 2 * side : 8 + 2 * side]
        assert float(patella.gap(side, there, met)) == pytest.approx(0.0, abs=1e-9)
        # Eqs 1 and 2: the tangents of the groove lie in the facet.
        slope = jax.grad(lambda s, side=side: patella.gap(side, there, s))(met)
        np.testing.assert_allclose(slope, 0.0, atol=1e-8)
    tendon = patella.tendon(there, patella.tibial_attachment)
    assert float(jnp.linalg.norm(tendon)) == pytest.approx(48.0, abs=1e-9)
    assert np.all(np.asarray(found[10:]) > 0.0)


def test_four_forces_keep_the_patella_in_balance(patella, found):
    """Newton: they and their moments about any point sum to zero."""
    there = geo.Pose(*found[:6]).placement

    def seen(point):
        return np.array([float(x) for x in there.apply(tuple(point))])

    quadriceps = seen(patella.insertion), np.asarray(patella.origin)
    tendon = seen(patella.patellar_attachment), np.asarray(patella.tibial_attachment)
    forces, points = [], []
    for size, (here, end) in zip((1.0, float(found[12])), (quadriceps, tendon), strict=True):
        forces.append(size * (end - here) / np.linalg.norm(end - here))
        points.append(here)
    for side in (0, 1):
        groove, met = patella.groove[side], found[6 + 2 * side : 8 + 2 * side]
        normal = patella.facets[side].frame.placement.turn((0.0, 1.0, 0.0))
        inwards = -np.array([float(x) for x in there.turn(normal)])
        forces.append(float(found[10 + side]) * inwards)
        points.append(np.array([float(x) for x in groove.point(*met)]))
    np.testing.assert_allclose(sum(forces), 0.0, atol=1e-9)
    np.testing.assert_allclose(sum(map(np.cross, points, forces)), 0.0, atol=1e-7)


@pytest.mark.long
def test_its_derivative_is_exact(patella):
    @jax.jit
    def of(change):
        longer = dataclasses.replace(patella, tendon_length=patella.tendon_length + change[0])
        place = patella.tibial_attachment + change[1:]
        return longer.balanced(place, jnp.array(START))

    exact = jax.jit(jax.jacfwd(of))(jnp.zeros(4))
    step = 1e-2 * np.eye(4)
    numeric = [(8.0 * (of(d) - of(-d)) - (of(2.0 * d) - of(-2.0 * d))) / 12e-2 for d in step]
    np.testing.assert_allclose(exact, np.stack(numeric, axis=1), atol=1e-6)


def elastic(patella, modulus, stiffness):
    """The same with layer and tendon that give, and a tibia that is held."""
    contacts = tuple(
        Contact(groove, facet, youngs_modulus=1.0, layer_thickness=THICKNESS, onset_width=1e-8,
                law="linear", bodies=("femur", "patella"))
        for groove, facet in zip(patella.groove, patella.facets, strict=True)
    )  # fmt: skip
    tendon = Ligaments(
        patella.patellar_attachment[None], patella.tibial_attachment[None], [1.0],
        patella.tendon_length[None], [1e-9], [1e-10], ["PT"], bodies=(("patella", "tibia"),),
    )  # fmt: skip
    head = Muscles(patella.origin[None], patella.insertion[None], [PULL_N], ["recfem"],
                   bodies=(("femur", "patella"),))  # fmt: skip
    at = geo.Pose.from_table([0.0] * 6)
    knee = add_lane_axis(
        Knee(tendon, contacts, (), (), at, ("medial", "lateral"), other_bones={"patella": at},
             muscles=head)
    )  # fmt: skip
    stiff = tuple(dataclasses.replace(c, youngs_modulus=modulus) for c in knee.contacts)
    strong = dataclasses.replace(knee.ligaments, stiffness=stiffness[None])
    return dataclasses.replace(knee, contacts=stiff, ligaments=strong)


@pytest.mark.long
def test_the_elastic_patella_becomes_the_rigid_one_with_the_root_of_its_stiffness(patella, found):
    """A patch under a force sinks in by the root of force over stiffness; a tendon stretches by
    force over stiffness itself. From 10 MPa on, in factors of ten."""
    modulus = jnp.asarray(10.0 ** np.arange(1, 7))
    knee = elastic(patella, modulus, 1e3 * modulus)
    held = {name: jnp.zeros(len(modulus)) for name in geo.COORDINATES}
    near = jnp.tile(found[:6, None], len(modulus))
    stiff = solve_equilibrium(knee, held, Guess(near, jnp.full((2, 2, len(modulus)), jnp.nan)))
    assert bool(stiff.stable.all())
    away = np.abs(np.asarray(stiff.q - near)) / np.array(geo.scales(geo.BODIES["patella"]))[:, None]
    away = away.max(axis=0)
    order = np.log10(away[:-1] / away[1:])
    # At first it is the tendon that gives.
    np.testing.assert_allclose(order[2:], 0.5, atol=0.02)
    assert abs(order[-1] - 0.5) < 2e-3 and away[-1] < 1e-3
    # And so do the forces.
    tension = np.asarray(knee.ligaments.tension(stiff.state))[0] / PULL_N
    np.testing.assert_allclose(tension[-1], found[12], atol=1e-4)


@pytest.mark.long
def test_a_leg_on_a_rigid_patella_is_held_and_differentiable(patella, hinged_knee):
    """Along the length of the tendon, the stiffness of the ligaments and the weight at once."""
    knee, flexion, shank = hinged_knee, np.array([10.0, 25.0]), kj.Shank.of_person(75.0, 1.75)
    start = geo.Pose(*jnp.array(START[:6]))
    leg = rigid_leg(knee, patella, start, flexion, shank)
    assert np.all(leg.quadriceps_N > 0.0) and np.all(leg.arm_mm > 0.0)
    near = leg.unknowns

    def held(change):
        longer = dataclasses.replace(patella, tendon_length=patella.tendon_length + 0.1 * change)
        stiff = knee.ligaments.stiffness * (1.0 + 0.01 * change)
        other = dataclasses.replace(
            knee, ligaments=dataclasses.replace(knee.ligaments, stiffness=stiff)
        )
        weight = shank.load()
        heavier = dataclasses.replace(weight, force=weight.force * (1.0 + 0.01 * change))
        return held_by_rigid_patella(other, longer, heavier, jnp.deg2rad(flexion), near)

    exact = jax.jvp(held, (0.0,), (1.0,))[1]
    step = 0.05
    at = {k: held(k * step) for k in (2, 1, -1, -2)}
    numeric = (8.0 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12.0 * step)
    np.testing.assert_allclose(held(0.0)[:, 5], leg.quadriceps_N, rtol=1e-9)
    np.testing.assert_allclose(exact, numeric, atol=1e-6 * np.abs(numeric).max())
