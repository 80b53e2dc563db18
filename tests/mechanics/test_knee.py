"""A knee's energy is the sum of its parts, and every number of it is a leaf."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.files import load_knee, load_knee_file
from kneejax.mechanics import Contact, Knee, Ligaments, add_lane_axis, condyle_points

POSE = geo.Pose.from_table([[0.0, 0, 0, 0, -0.3, 0], [29.0, 1.7, 3.0, 1.0, 0.5, 0.3]])


@pytest.fixture(scope="module")
def knee(small_knee):
    return add_lane_axis(small_knee)


@jax.jit
def energies(knee, pose):
    """Energy, energy at the contact points, gaps there, and the same part by part."""
    tibia = pose.placement
    patches = [contact for contact in knee.contacts if contact.has_patch]
    gaps = [contact.gap(tibia, contact.contact_point(tibia)) for contact in patches]
    state = geo.State({"tibia": pose})
    parts = knee.ligaments.energy(state)
    parts = parts + sum(line.energy(state) for line in knee.lines)
    parts = parts + sum(c.patch_energy(gap) for c, gap in zip(patches, gaps, strict=True))
    parts = parts + sum(c.energy(tibia) for c in knee.contacts if not c.has_patch)
    held = knee.press(state)
    depths = jnp.stack([gap.depth for gap in gaps])
    return knee.energy(state), held.energy, held.patches.gap, parts, depths


@pytest.mark.long
def test_energy_is_the_sum_of_the_parts_and_that_at_the_contact_points(knee):
    whole, at_contact_points, gap, parts, depths = energies(knee, POSE)
    np.testing.assert_allclose(np.asarray(whole), np.asarray(parts), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(whole), np.asarray(at_contact_points), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(gap.depth), np.asarray(depths), atol=1e-9)
    assert np.abs(np.asarray(gap.slope)).max() < 1e-9
    assert knee.patch_count == 2


@pytest.mark.long
def test_contacts_of_unlike_kinds_keep_their_order(knee):
    sphere = geo.Sphere(23.0, geo.Frame([0, 0, 23]))
    plane = geo.Plane(geo.Frame([0, -22, 23]), (8.0, 8.0))
    ball = add_lane_axis(Contact(sphere, plane))
    summed = add_lane_axis(Contact(sphere, plane, form="quadrature", points=(4, 4)))
    mixed = eqx.tree_at(
        lambda k: k.contacts, knee, (ball, knee.contacts[0], summed, ball)
    )
    whole, at_contact_points, gap, parts, depths = energies(mixed, POSE)
    assert mixed.patch_count == 3
    np.testing.assert_allclose(np.asarray(whole), np.asarray(parts), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(at_contact_points), np.asarray(parts), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(gap.depth), np.asarray(depths), atol=1e-9)
    assert gap.depth.shape == (3, 2) and gap.steepness.shape == (3, 2)


def test_a_knee_on_planes_alone_answers_in_lanes(knee):
    """A plane's slope is the same everywhere; what follows from it must not lose the lanes."""
    contacts = [
        Contact(geo.Sphere(22.0, geo.Frame([0, 0, z])), geo.Plane(geo.Frame([0, -22, z], tilt)))
        for z, tilt in ((-20.0, [-0.03, 0, 0.03]), (20.0, [0.03, 0, 0.12]))
    ]
    on_planes = eqx.tree_at(lambda k: k.contacts, knee, tuple(map(add_lane_axis, contacts)))
    pressed = on_planes.press(geo.State({"tibia": POSE})).patches
    assert {leaf.shape for leaf in jax.tree.leaves(pressed)} == {(2, 2)}


def test_every_number_is_a_leaf_and_nothing_else_is(small_knee):
    leaves = jax.tree.leaves(small_knee)
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == jnp.float64 for leaf in leaves)
    static = jax.tree.structure(small_knee)
    assert static == jax.tree.structure(jax.tree.map(lambda x: x + 1.0, small_knee))
    assert hash(static) is not None


def test_lengths_and_strains_at_the_reference_pose(small_knee):
    fibres = small_knee.ligaments
    expected = np.linalg.norm(fibres.tibial_attachment - fibres.femoral_attachment, axis=1)
    np.testing.assert_allclose(np.asarray(small_knee.reference_length()), expected, rtol=1e-14)
    strain = np.asarray(small_knee.reference_strain())
    np.testing.assert_allclose(strain, expected / np.asarray(fibres.slack_length) - 1, rtol=1e-12)


def shifted(shift):
    return geo.State({"tibia": geo.Pose(*jnp.zeros(3), *shift)})


def test_the_tension_of_a_fibre_is_the_slope_of_its_energy_by_its_length():
    fibre = Ligaments([[1, 2, 3]], [[4, -30, 2]], [3000.0], [31.0], [0.06], [0.002], ["F"])

    def energy(shift):
        return fibre.energy(shifted(shift))

    for shift in ([0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.5, -2.0, 1.0]):
        line = np.array([4, -30, 2]) + shift - np.array([1, 2, 3])
        pull = -np.asarray(jax.grad(energy)(jnp.array(shift)))
        tension = float(fibre.tension(shifted(shift))[0])
        np.testing.assert_allclose(pull, -tension * line / np.linalg.norm(line), rtol=1e-11)


def test_a_fibre_of_zero_length_has_no_nan_in_its_force():
    fibre = Ligaments([[1, 2, 3]], [[1, 2, 3]], [3000.0], [31.0], [0.06], [0.002], ["F"])

    def energy(shift):
        return fibre.energy(shifted(shift))

    assert np.isfinite(np.asarray(jax.grad(energy)(jnp.zeros(3)))).all()


def test_a_mirrored_knee_has_the_mirrored_energy(small_knee):
    def mirror_contact(contact):
        c, t = contact.femoral, contact.tibial
        flip = jnp.array([1.0, 1.0, -1.0])
        odd = (-1.0) ** jnp.arange(3)
        femoral = geo.Condyle(
            c.coefficients * odd, c.angle, -c.width[::-1], geo.Frame(c.frame.origin * flip)
        )
        frame = geo.Frame(t.frame.origin * flip)
        tibial = geo.Plateau(t.coefficients * odd, t.x, -t.z[::-1], frame)
        return Contact(femoral, tibial)

    flip = jnp.array([1.0, 1.0, -1.0])
    fibres = small_knee.ligaments
    line = small_knee.lines[0]
    mirrored = Knee(
        eqx.tree_at(
            lambda f: (f.femoral_attachment, f.tibial_attachment),
            fibres,
            (fibres.femoral_attachment * flip, fibres.tibial_attachment * flip),
        ),
        tuple(mirror_contact(contact) for contact in small_knee.contacts),
        small_knee.loads,
        (eqx.tree_at(lambda x: (x.origin, x.insertion), line,
                     (line.origin * flip, line.insertion * flip)),),
        small_knee.reference_pose,
        small_knee.contact_names,
    )
    table = np.asarray(POSE.to_table()) * [1, -1, -1, 1, 1, -1]
    there = energies(add_lane_axis(mirrored), geo.Pose.from_table(table))[0]
    here = energies(add_lane_axis(small_knee), POSE)[0]
    np.testing.assert_allclose(np.asarray(there), np.asarray(here), rtol=1e-10)


def test_a_condyle_that_two_contacts_share_is_sampled_once():
    bundled = load_knee("four_ligament")
    contacts, names = (*bundled.contacts, bundled.contacts[0]), (*bundled.contact_names, "meniscus")
    shared = dataclasses.replace(bundled, contacts=contacts, contact_names=names)
    for own, other in zip(condyle_points(shared), condyle_points(bundled), strict=True):
        np.testing.assert_array_equal(own, other)


def test_the_groove_of_the_patella_is_no_condyle():
    read = load_knee_file("four_ligament")
    three = read.with_patella()
    assert "patellofemoral" in three.contact_names
    for own, other in zip(condyle_points(three), condyle_points(read.knee), strict=True):
        np.testing.assert_array_equal(own, other)
