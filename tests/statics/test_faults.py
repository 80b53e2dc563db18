"""What is no knee says so: as a balance, as a given pose, and alike in both."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax.experiments import status_of
from kneejax.mechanics import (
    LIMITS,
    WIDEST_GAP_MM,
    Contact,
    add_lane_axis,
    displacement,
    load_of,
)
from kneejax.report.pose_tables import pose_words
from kneejax.statics import LoadCases, Status, balance_one
from kneejax.statics._newton import look

FLEXION = np.array([0.0, 30.0, 60.0, 90.0])


@pytest.fixture(scope="module")
def motion(knee):
    return kj.passive_flexion(knee, FLEXION)


def judged(knee, table):
    return np.asarray(status_of(kj.evaluate(knee, kj.Pose.from_table(table)), knee)).tolist()


def under(knee, load, flexion_deg):
    """The balance of a knee under a load, and what it is as a given pose."""
    load_cases = LoadCases.at([flexion_deg], [load])
    found = balance_one(knee, load_cases)
    table = np.c_[flexion_deg, found.table[0]]
    return found.status[0, 0], judged(knee, table)[0], table


def test_a_balance_and_the_same_pose_given_are_called_alike(knee, motion):
    assert (np.asarray(motion.status) == Status.BALANCED).all()
    assert judged(knee, motion.to_table()) == [Status.BALANCED] * len(FLEXION)


def test_poses_that_a_knee_takes_stay_balanced(knee, motion, rng):
    """Laxity on a rig, four standard deviations at random: 5 mm and 10 degrees of rotation."""
    table = np.repeat(np.asarray(motion.to_table()), 16, axis=0)
    table[:, 2] += rng.uniform(-10.0, 10.0, len(table))
    table[:, 3] += rng.uniform(-5.0, 5.0, len(table))
    table[:, 4] -= 1.5  # apart from the bone below
    allowed = {Status.BALANCED, Status.OUTSIDE_REGION, Status.OVERSTRETCHED}
    assert set(judged(knee, table)) <= allowed
    rigid = eqx.tree_at(lambda k: k.ligaments.failure_strain, knee, jnp.full(4, 10.0))
    assert set(judged(rigid, table)) <= {Status.BALANCED, Status.OUTSIDE_REGION}


def test_a_coordinate_beyond_that_of_any_knee_is_a_dislocation(knee):
    """Without contacts, so that no bone is in the way."""
    fibres = dataclasses.replace(
        knee.ligaments, failure_strain=jnp.full(4, 10.0), femoral_attachment=jnp.zeros((4, 3))
    )
    bare = dataclasses.replace(knee, ligaments=fibres, contacts=(), contact_names=())
    for part, expected in ((0.95, Status.BALANCED), (1.05, Status.DISLOCATED)):
        off = np.diag([limit * part for limit in LIMITS.values()])
        table = np.c_[np.zeros(10), np.concatenate([off, -off])]
        assert judged(bare, table) == [expected] * 10


def test_where_the_bones_have_their_origins_does_not_matter(knee, motion):
    """With the femur's origin at the hip, the tibia's moves by half a metre in flexion."""
    shift = jnp.array([10.0, 400.0, -30.0])

    def moved(surface):
        return eqx.tree_at(lambda s: s.frame.origin, surface, surface.frame.origin + shift)

    contacts = tuple(dataclasses.replace(c, femoral=moved(c.femoral)) for c in knee.contacts)
    ligaments = dataclasses.replace(
        knee.ligaments, femoral_attachment=knee.ligaments.femoral_attachment + shift
    )

    def seen(pose):
        here = pose.anterior, pose.superior, pose.lateral
        place = [x + s for x, s in zip(here, shift, strict=True)]
        return geo.Pose(pose.flexion, pose.adduction, pose.internal_rotation, *place)

    other = dataclasses.replace(
        knee, contacts=contacts, ligaments=ligaments, reference_pose=seen(knee.reference_pose)
    )
    np.testing.assert_allclose(
        displacement(other, seen(motion.pose)), displacement(knee, motion.pose), atol=1e-9
    )


def test_a_compartment_that_gapes_is_a_dislocation_and_lift_off_is_none(knee):
    table = np.zeros((3, 6))
    table[:, 4] = [-2.0, 1.0 - WIDEST_GAP_MM, -2.0 - WIDEST_GAP_MM]
    strong = eqx.tree_at(lambda k: k.ligaments.failure_strain, knee, jnp.full(4, 10.0))
    assert judged(strong, table) == [Status.BALANCED, Status.BALANCED, Status.DISLOCATED]
    said = pose_words(strong, kj.evaluate(strong, kj.Pose.from_table(table)))
    assert said[0].startswith("compartments apart: medial") and "open by" in said[2]


def test_a_knee_that_hangs_in_long_ligaments_is_dislocated_by_varus(knee):
    lax = eqx.tree_at(
        lambda k: k.ligaments.slack_length,
        knee,
        knee.ligaments.slack_length * jnp.array([1.5, 1.5, 1.0, 1.6]),
    )
    status, given, table = under(lax, load_of(varus_Nm=np.array([8.0])), 0.0)
    assert status == given == Status.DISLOCATED
    assert table[0, 1] > LIMITS["adduction"]


def test_a_fibre_beyond_its_failure_strain_is_a_warning_with_numbers(knee, motion):
    strain = np.asarray(kj.evaluate(knee, motion.pose).strain)
    fails = knee.ligaments.failure_strain.at[2].set(0.5 * strain[0, 2])
    weak = eqx.tree_at(lambda k: k.ligaments.failure_strain, knee, fails)
    found = kj.passive_flexion(weak, FLEXION)
    expected = np.where(strain[:, 2] > 0.5 * strain[0, 2], Status.OVERSTRETCHED, Status.BALANCED)
    assert np.asarray(found.status).tolist() == expected.tolist()
    # No force depends on it.
    np.testing.assert_allclose(found.to_table(), motion.to_table(), atol=1e-9)
    said = pose_words(weak, kj.evaluate(weak, found.pose, found.equilibrium.contact_points))
    assert said[0] == f"MCL strained by {strain[0, 2]:.3f} (fails at {0.5 * strain[0, 2]:g})"


def test_a_tibia_pushed_into_the_femur_is_too_deep_and_then_through_bone(knee, motion):
    table = np.tile(np.asarray(motion.to_table())[0], (7, 1))
    table[:, 4] += [0.0, 2.0, 7.0, 12.0, 30.0, 40.0, 60.0]
    status = judged(knee, table)
    # The deeper the larger the patch: it leaves the fitted region first.
    assert status[:3] == [Status.BALANCED, Status.OUTSIDE_REGION, Status.TOO_DEEP]
    # However deep: also where no point reports contact any more.
    assert status[4:] == [Status.THROUGH_BONE] * 3
    assert not np.diff(status[1:]).min() < 0
    assert (
        "medial condyle has passed"
        in pose_words(knee, kj.evaluate(knee, kj.Pose.from_table(table)))[-1]
    )


def test_a_balance_through_bone_is_none(knee):
    """A pull that no knee stands, with a layer as good as air: the tibia would go through."""
    soft = dataclasses.replace(
        knee,
        contacts=tuple(
            dataclasses.replace(c, youngs_modulus=jnp.asarray(1e-4)) for c in knee.contacts
        ),
    )
    status, _, table = under(soft, load_of(compression_N=np.array([3000.0])), 45.0)
    assert not Status(int(status)).converged and np.isnan(table[0, 1:]).all()


@pytest.mark.long
def test_nothing_is_through_bone_that_meets_within_the_layer_where_surfaces_are_known(knee, motion):
    """So a search need not ask it of such poses: 4,000 random ones, up to 80 mm off the motion."""
    rng = np.random.default_rng(0)
    table = np.asarray(motion.to_table())[rng.integers(0, len(FLEXION), 4000)]
    table = table + rng.uniform(-1.0, 1.0, table.shape) * [5.0, 30.0, 50.0, 30.0, 80.0, 30.0]
    pose = kj.Pose.from_table(table)
    lanes = add_lane_axis(knee).for_many_poses()
    q = geo.State({"tibia": pose}).at(geo.FREE_COORDINATES)
    _, forces = jax.jit(look)(q, (lanes, {"flexion": pose.flexion}, None))
    through = 0
    for row, contact in enumerate(lanes.contacts):
        passed = np.asarray(contact.passed_through(pose.placement))
        plain = np.asarray(forces.known[row] & (forces.depth[row] < contact.layer_thickness))
        met = np.isfinite(np.asarray(forces.energy))
        assert not (passed & plain & met).any()
        assert (plain & met).sum() > 100
        through += passed.sum()
    assert through > 500


def test_flat_upon_flat_has_no_patch(knee):
    femoral = geo.Plane(geo.Frame([0.0, -20.0, 0.0], np.deg2rad([180.0, 0.0, 0.0])))
    tibial = geo.Plane(geo.Frame([0.0, -20.0, 0.0]))
    flat = dataclasses.replace(knee, contacts=(Contact(femoral, tibial),), contact_names=("flat",))
    assert judged(flat, [[0.0, 0.0, 0.0, 0.0, 0.5, 0.0]]) == [Status.NO_PATCH]
