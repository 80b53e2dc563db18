"""The wrench of a patch, written out, against the reverse derivative of its energy."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kneejax.geometry as geo
from kneejax.mechanics import Contact, add_lane_axis
from kneejax.numerics import compiler_options
from tests.derivatives import wrench_of

OPTIONS = dict(compiler_options())


def condyle(rng):
    c = np.zeros((4, 4))
    c[:3, :3] = rng.normal(size=(3, 3)) * 0.4
    c[0, 0], c[2, 0], c[0, 2] = 24.0, 0.8, -1.5
    frame = geo.Frame([0, 0, 22], rng.normal(size=3) * 0.05)
    return geo.Condyle(c, np.deg2rad([5, 175]), (-14, 14), frame)


def plateau(rng):
    c = rng.normal(size=(4, 4)) * 0.15
    c[2, 0], c[0, 2] = 0.8, 0.6
    return geo.Plateau(c, (-22, 22), (-15, 15), geo.Frame([0, -25, 22], rng.normal(size=3) * 0.05))


PAIRS = {
    "condyle on plateau": lambda rng: (condyle(rng), plateau(rng)),
    "condyle on plane": lambda rng: (condyle(rng), geo.Plane(geo.Frame([0, -25, 22]))),
    "ellipsoid on plateau": lambda rng: (
        geo.Ellipsoid((27.0, 24.0, 15.0), geo.Frame([0, 0, 22], [0.1, -0.1, 0.0])), plateau(rng)
    ),
}  # fmt: skip


# Fused, a reverse derivative of a search computes its values anew at each of its many uses.
@functools.partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion"})
def both(contact, pose):
    """Written out and by reverse differentiation through the search for the contact point."""
    tibia = pose.placement
    return contact.wrench(tibia), wrench_of(contact.energy, tibia), contact.energy(tibia)


@jax.jit
def depth(contact, pose):
    return contact.gap(pose.placement, contact.contact_point(pose.placement)).depth


# A law says how energy grows, a pair where: each of them once.
@pytest.mark.long
@pytest.mark.parametrize(
    ("pair", "law"), list(zip(PAIRS, ("ratio", "linear", "log"), strict=True))
)
def test_the_wrench_is_the_slope_of_the_energy(pair, law):
    rng = np.random.default_rng(5)
    contact = add_lane_axis(Contact(*PAIRS[pair](rng), law=law))
    angles = jnp.asarray(rng.normal(size=(3, 9)) * 0.03)
    shifts = jnp.asarray(rng.normal(size=(2, 9)))

    def pose(superior):
        return geo.Pose(0.4 + angles[0], *angles[1:], shifts[0], superior, shifts[1])

    # From apart over first touch to a third of the layer.
    wanted = jnp.linspace(-1.0, 2.0, 9)
    ours, theirs, energy = both(contact, pose(wanted - depth(contact, pose(jnp.zeros(9)))))
    assert float(energy[-1]) > 100.0 and float(energy[0]) < 1e-6
    size = 1e-9 + np.linalg.norm(np.stack(theirs.force), axis=0)
    for a, b, scale in ((ours.force, theirs.force, size), (ours.moment, theirs.moment, 30 * size)):
        np.testing.assert_allclose(np.stack(a) / scale, np.stack(b) / scale, atol=2e-9)


@given(st.integers(0, 10_000))
def test_the_two_bones_push_each_other_with_opposite_wrenches(seed):
    """No wrench about the origin is left when the whole knee is moved: energy has no frame."""
    rng = np.random.default_rng(seed)
    contact = Contact(*PAIRS["condyle on plateau"](rng))
    spread, middle = [0.3, 0.05, 0.1, 1.0, 1.0, 1.0], [0.4, 0, 0, 0, 0.5, 0]
    pose = geo.Pose(*(rng.normal(size=6) * spread + middle))
    tibia = jax.tree.map(jnp.asarray, pose).placement
    turn = geo.Frame(rng.normal(size=3), rng.normal(size=3)).placement
    on_tibia = wrench_at(contact, tibia)
    moved = wrench_at(
        Contact(*(_moved(s, turn, i) for i, s in enumerate((contact.femoral, contact.tibial)))),
        turn.after(tibia),
    )
    expected = np.stack(turn.turn(on_tibia.force)), np.stack(turn.turn(on_tibia.moment))
    scale = 1e-6 + np.abs(expected[0]).max()
    np.testing.assert_allclose(np.stack(moved.force) / scale, expected[0] / scale, atol=1e-9)
    np.testing.assert_allclose(np.stack(moved.moment) / scale, expected[1] / scale, atol=1e-7)


wrench_at = jax.jit(lambda contact, tibia: contact.wrench(tibia))


def _moved(surface, turn, bone):
    """The femoral surface carried along by a motion of the femur's frame; the tibial one stays."""
    if bone:
        return surface
    placed = turn.after(surface.frame.placement)
    angles = _angles(placed.rotation)
    return geo.Condyle(
        surface.coefficients,
        surface.angle,
        surface.width,
        geo.Frame(jnp.stack(placed.translation), angles),
    )


def _angles(r):
    """Rotations about X, Y, Z in turn that make a rotation."""
    return jnp.stack([
        jnp.arctan2(-r[1][2], r[2][2]),
        jnp.arcsin(r[0][2]),
        jnp.arctan2(-r[0][1], r[0][0]),
    ])


def test_a_sphere_on_a_plane_pushes_along_the_normal_through_its_centre():
    contact = Contact(geo.Sphere(30.0), geo.Plane())
    tibia = geo.Placement(None, geo.Vector(jnp.asarray(3.0), jnp.asarray(-29.0), jnp.asarray(-4.0)))
    wrench = wrench_at(contact, tibia)
    np.testing.assert_allclose(np.array(wrench.force)[[0, 2]], 0.0, atol=1e-9)
    # The tibia's origin is 3 mm ahead of and 4 mm inside the sphere's centre.
    moment = np.cross([-3.0, 0.0, 4.0], np.array(wrench.force))
    np.testing.assert_allclose(np.array(wrench.moment), moment, rtol=1e-9, atol=1e-7)
    assert float(wrench.force[1]) < -100.0
