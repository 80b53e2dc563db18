"""The menisci of the average knee: rings that hold a condyle which leaves its path."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_path, mirror_document, read_knee, read_poses, write_knee
from kneejax.geometry import State
from tests.derivatives import wrench_of

RIMS = ("medial_meniscus", "lateral_meniscus")
#: Where the femur passes while the knee flexes, degrees and mm.
ROOM = bundled_path("studies", "average_knee").with_name("average_knee_room.csv")


def tibia_at(pose):
    flexion = jnp.deg2rad(pose[0])
    free = jnp.array([*np.deg2rad(pose[1:3]), *pose[3:]])
    return State.of({"flexion": flexion}, free).tibia.placement


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("average_knee")


@pytest.fixture(scope="module")
def rims(knee):
    return {name: knee.contacts[knee.contact_names.index(name)] for name in RIMS}


@pytest.fixture(scope="module")
def forwards():
    """A tibia 12 mm in front of its path at 60 degrees of flexion."""
    pose = read_poses(ROOM)[6]
    pose[3] += 12.0
    return tibia_at(pose)


force_of = eqx.filter_jit(lambda contact, tibia: jnp.stack(contact.wrench(tibia).force))


@pytest.mark.long
def test_an_unloaded_knee_rests_on_them_and_moves_them_less_than_in_life(knee):
    """From extension to 120 degrees they move by 5.1 mm medially and 11.2 mm laterally (Thompson
    1991), which here is the way of a section that gives way; its path is hardly another."""
    flexion = np.arange(0.0, 121.0, 20.0)
    motion = kj.passive_flexion(knee, flexion)
    found = kj.evaluate(knee, motion.pose)
    rows = [knee.contact_names.index(name) for name in RIMS]
    push = np.linalg.norm(np.asarray(found.contact_force)[:, rows], axis=-1)
    assert (push[0] > 10.0).all() and push.max() < 80.0
    assert (np.asarray(found.max_extrusion)[:, rows] < [5.1, 11.2]).all()
    without = kj.passive_flexion(kj.cut(knee, list(RIMS)), flexion)
    apart = np.asarray(motion.to_table("grood-suntay")) - without.to_table("grood-suntay")
    # Degrees and mm; beyond 80 degrees the femur presses them outwards.
    assert np.abs(apart[flexion <= 80.0]).max() < 2.0 and np.abs(apart).max() < 3.5


def test_they_push_a_tibia_back_that_is_drawn_forwards(rims, forwards):
    back = [float(force_of(contact, forwards)[0]) for contact in rims.values()]
    assert max(back) < 1.0 and sum(back) < -50.0


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [RIMS[0], pytest.param(RIMS[1], marks=pytest.mark.long)]
)
def test_their_wrench_is_the_derivative_of_their_energy(rims, forwards, name):
    contact = rims[name]
    found, derived = jax.jit(
        lambda tibia: (contact.wrench(tibia), wrench_of(contact.energy, tibia))
    )(forwards)
    size = max(abs(float(x)) for x in derived.force)
    for one, other in ((found.force, derived.force), (found.moment, derived.moment)):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * 30.0 * size)


@pytest.mark.long
def test_force_by_their_numbers_and_heights_against_differences(
    rims, forwards, central_difference
):
    """At the border of a femoral surface its level bends most: there a ray's end is found last."""
    contact = rims["medial_meniscus"]

    @jax.jit
    def push(change):
        modulus, thickness, higher = change
        tibial = dataclasses.replace(
            contact.tibial, coefficients=contact.tibial.coefficients + higher
        )
        changed = dataclasses.replace(
            contact,
            tibial=tibial,
            youngs_modulus=contact.youngs_modulus + modulus,
            layer_thickness=contact.layer_thickness + thickness,
        )
        return changed.wrench(forwards).force[0]

    slopes = jax.jit(jax.jacfwd(push))(jnp.zeros(3))
    assert np.all(np.abs(slopes) > 0.1)
    np.testing.assert_allclose(slopes, central_difference(push, np.zeros(3)), rtol=1e-6)


def test_a_left_twin_has_the_same_menisci(knee, tmp_path):
    file = read_knee(bundled_path("knees", "average_knee"))
    path = tmp_path / "left.yaml"
    write_knee(mirror_document(file.document), path)
    twin = read_knee(path).knee
    assert twin.side == "left" and twin.contact_names == knee.contact_names
    pairs = zip(jax.tree.leaves(twin.contacts), jax.tree.leaves(knee.contacts), strict=True)
    for own, other in pairs:
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-12)


def test_cartilage_and_fibres_are_those_of_lenhart2015_on_turned_plateaus(knee):
    start = kj.load_knee("lenhart2015")
    for own, other in zip(knee.contacts[:2], start.contacts, strict=True):
        turned = np.asarray(own.tibial.frame.rotation - other.tibial.frame.rotation)
        # To less steep plateaus, about the lateral axis alone.
        assert turned[2] < -0.03
        np.testing.assert_array_equal(turned[:2], 0.0)
        as_it_was = dataclasses.replace(own.tibial, frame=other.tibial.frame)
        np.testing.assert_array_equal(own.tibial.frame.origin, other.tibial.frame.origin)
        straight = dataclasses.replace(own, tibial=as_it_was)
        for leaf, known in zip(jax.tree.leaves(straight), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(leaf, known)
    assert knee.ligaments.names == (*start.ligaments.names, "ALL", "POP")
    names = start.ligaments.names
    for field in ("femoral_attachment", "tibial_attachment", "transition_strain"):
        own, other = (np.asarray(getattr(k.ligaments, field)) for k in (knee, start))
        moved = own[: len(names)] - other
        for bundle in ("ACLam", "ACLpl", "PCLal", "PCLpm", "MCLp"):
            rows = [row for row, name in enumerate(names) if name.startswith(bundle)]
            # The whole bundle alike, as far as files have digits.
            assert np.ptp(moved[rows], axis=0).max() < 2e-3
            moved[rows] = 0.0
        np.testing.assert_array_equal(moved, 0.0)
