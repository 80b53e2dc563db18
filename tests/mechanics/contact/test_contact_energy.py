"""The energy of a contact: first touch, direction of its force, frames and mirrors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kneejax.geometry as geo
from kneejax.mechanics import Contact

OPTIONS = {"xla_disable_hlo_passes": "fusion"}
POSE = np.array([0.35, 0.03, -0.08, 1.0, 1.2, 0.6])


def energy_at_pose(contact, c):
    return contact.energy(geo.Pose(*c).placement)


placed = jax.jit(lambda c: geo.Pose(*c).placement)
slope = jax.jit(jax.grad(energy_at_pose, 1), compiler_options=OPTIONS)
energy_of_placement = jax.jit(
    lambda contact, tibia: contact.energy(tibia), compiler_options=OPTIONS
)


def energy(contact, c):
    return energy_of_placement(contact, placed(c))


def knee_contact(form="elliptical_patch", mirrored=False, turned=True):
    c = np.zeros((4, 3))
    c[:, 0], c[0], c[1, 1] = [23.0, -1.5, 0.8, 0.3], [23.0, 0.4, -1.6], 0.2
    h = np.array([[0.1, 0.3, 0.9], [0.2, 0.1, 0.0], [0.8, 0.0, 0.0]])
    side = -1.0 if mirrored else 1.0
    odd = side ** np.arange(3)
    turn = np.array([side, side, 1.0]) if turned else np.zeros(3)
    return Contact(
        geo.Condyle(
            c * odd, np.deg2rad([10, 170]), (-12, 12),
            geo.Frame([0, 0, 22 * side], turn * [0.02, 0.05, 0.01]),
        ),
        geo.Plateau(
            h * odd, (-20, 20), (-13, 13),
            geo.Frame([0, -25, 22 * side], turn * [0.03, 0.02, -0.08]),
        ),
        form=form,
        points=(20, 20),
    )


@pytest.fixture(scope="module")
def touching():
    """A pose in which the surfaces just touch."""
    contact, c = knee_contact(), POSE.copy()

    @jax.jit
    def depth(c):
        tibia = geo.Pose(*c).placement
        return contact.gap(tibia, contact.contact_point(tibia)).depth

    for _ in range(30):
        c[4] -= float(depth(c))
    assert abs(float(depth(c))) < 1e-10
    return c


@pytest.fixture(scope="module")
def pressed(touching):
    """A pose in which they overlap by about 0.8 mm."""
    return touching + 0.8 * np.eye(6)[4]


@pytest.mark.long
@pytest.mark.parametrize("offset", [-0.5, 0.0, 1.0])
def test_the_slope_of_the_energy_equals_central_differences_through_first_touch(
    offset, touching, central_difference
):
    contact, pose = knee_contact(), touching + offset * np.eye(6)[4]
    exact = np.asarray(slope(contact, pose))
    numeric = central_difference(lambda c: energy(contact, c), pose, 3e-5)
    size = 1e-6 * max(1.0, np.abs(exact).max())
    np.testing.assert_allclose(exact, numeric, atol=size)
    assert np.isfinite(exact).all() and np.abs(exact).max() > 0


def test_the_energy_grows_without_a_jump_through_first_touch(touching):
    heights = np.linspace(-0.1, 0.1, 201)
    contact = knee_contact()
    values = np.array([float(energy(contact, touching + h * np.eye(6)[4])) for h in heights])
    forces = np.array([float(slope(contact, touching + h * np.eye(6)[4])[4]) for h in heights])
    assert (np.diff(values) > 0).all() and (np.diff(forces) > 0).all()
    # The stiffness at 0.1 mm is about 50 N/mm: a step of 1e-3 mm changes the force by 0.05 N.
    assert np.diff(forces).max() < 0.1
    np.testing.assert_allclose(np.diff(values) / 1e-3, 0.5 * (forces[1:] + forces[:-1]), rtol=1e-2)


def test_second_derivatives_are_finite_at_first_touch(touching):
    contact = knee_contact()
    direction = jnp.ones(6)
    curve = jax.jit(
        lambda c: jax.jvp(jax.grad(lambda x: energy_at_pose(contact, x)), (c,), (direction,))[1],
        compiler_options=OPTIONS,
    )
    assert np.isfinite(np.asarray(curve(jnp.asarray(touching)))).all()


@pytest.mark.parametrize(
    "femoral",
    [geo.Sphere(28.0), geo.Ellipsoid((27.4, 25.0, 22.4), geo.Frame(rotation=[0.3, 0.0, 0.2]))],
    ids=["sphere", "ellipsoid"],
)
def test_the_force_on_a_tilted_plane_acts_along_its_normal(femoral):
    plane = geo.Plane(geo.Frame([0.0, 0.0, 0.0], [0.2, 0.0, -0.1]))
    contact = Contact(femoral, plane)
    normal = np.array([float(c) for c in plane.frame.placement.turn((0.0, 1.0, 0.0))])

    def of_shift(shift):
        return contact.energy(geo.Placement(None, geo.Vector.of(shift)))

    shift = jnp.asarray(-24.0 * normal)
    force = -np.asarray(jax.jit(jax.grad(of_shift))(shift))
    assert force @ normal < -10.0
    np.testing.assert_allclose(force - (force @ normal) * normal, 0.0, atol=1e-9 * abs(force).max())


def test_the_force_between_two_spheres_acts_along_the_line_of_their_centres():
    contact = Contact(geo.Sphere(25.0), geo.Sphere(35.0))
    shift = jnp.array([3.0, -58.0, 5.0])
    force = -np.asarray(
        jax.jit(jax.grad(lambda s: contact.energy(geo.Placement(None, geo.Vector.of(s)))))(shift)
    )
    line = np.asarray(shift) / np.linalg.norm(shift)
    np.testing.assert_allclose(np.cross(force, line), 0.0, atol=1e-9 * abs(force).max())
    assert force @ line > 0


@pytest.mark.long
@pytest.mark.parametrize("form", ["elliptical_patch", "quadrature"])
def test_where_the_bones_frames_lie_does_not_change_the_energy(form, pressed, rng):
    contact, tibia = knee_contact(form), placed(pressed)

    def motion(rotation, origin):
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = rotation.as_matrix(), origin
        return m

    def homogeneous(place):
        m = np.eye(4)
        m[:3, :3] = [[float(x) for x in row] for row in place.rotation]
        m[:3, 3] = [float(x) for x in place.translation]
        return m

    def frame(m):
        return geo.Frame(m[:3, 3], Rotation.from_matrix(m[:3, :3]).as_euler("XYZ"))

    g, h = (motion(Rotation.random(rng=rng), 20 * rng.normal(size=3)) for _ in range(2))
    moved = eqx.tree_at(
        lambda k: (k.femoral.frame, k.tibial.frame),
        contact,
        (
            frame(g @ homogeneous(contact.femoral.frame.placement)),
            frame(h @ homogeneous(contact.tibial.frame.placement)),
        ),
    )
    there = frame(g @ homogeneous(tibia) @ np.linalg.inv(h)).placement
    before, after = energy_of_placement(contact, tibia), energy_of_placement(moved, there)
    assert float(before) > 1.0
    assert float(after) == pytest.approx(float(before), rel=1e-9)


@pytest.mark.parametrize("form", ["elliptical_patch", "quadrature"])
def test_a_mirrored_contact_has_the_same_energy_in_the_mirrored_pose(form, pressed):
    mirror = np.array([1, -1, -1, 1, 1, -1])
    right, left = knee_contact(form), knee_contact(form, mirrored=True)
    there, here = float(energy(left, pressed * mirror)), float(energy(right, pressed))
    assert here > 1.0
    assert there == pytest.approx(here, rel=1e-9)


def test_both_forms_agree_on_a_knee_like_contact_to_first_order(pressed):
    patch, summed = (
        float(energy(knee_contact(form), pressed)) for form in ("elliptical_patch", "quadrature")
    )
    assert patch == pytest.approx(summed, rel=0.1)


@pytest.mark.long
def test_a_batch_of_poses_has_the_energies_of_its_members(pressed):
    spread = np.array([0.5, 0.1, 0.1, 1, 1, 1])[:, None]
    poses = pressed[:, None] + np.linspace(-0.2, 0.2, 3) * spread
    for form in ("elliptical_patch", "quadrature"):
        contact = knee_contact(form)
        laned = jax.tree.map(lambda x: x[..., None], contact)
        together = np.asarray(energy(laned, poses))
        alone = [float(energy(contact, poses[:, k])) for k in range(3)]
        np.testing.assert_allclose(together, alone, rtol=1e-10)


def test_beyond_the_layer_the_energy_is_not_a_number_in_that_lane_only():
    contact = Contact(geo.Sphere(30.0), geo.Plane(), layer_thickness=3.0)
    heights = jnp.array([-29.0, -26.5, -28.0])
    zero = jnp.zeros(3)
    laned = jax.tree.map(lambda x: x[..., None], contact)
    values = np.asarray(laned.energy(geo.Placement(None, geo.Vector(zero, heights, zero))))
    assert np.isnan(values[1]) and np.isfinite(values[[0, 2]]).all()
