"""Vectors, rotations, placements and poses against explicit matrix products."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import kneejax.geometry as geo
from kneejax import numerics

angle = st.floats(-1.2, 1.2)


def rx(a):
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def ry(a):
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def rz(a):
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def matrix(rotation):
    return np.array([[float(x) for x in row] for row in rotation])


@given(st.floats(-0.3, 2.6), angle, angle)
def test_a_rotation_is_flexion_then_adduction_then_internal_rotation(f, a, i):
    ours = matrix(geo.rotation_from_angles(f, a, i))
    np.testing.assert_allclose(ours, rz(-f) @ rx(a) @ ry(i), atol=1e-14)
    np.testing.assert_allclose(ours @ ours.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(ours) == pytest.approx(1.0, abs=1e-14)


@given(st.floats(-0.3, 2.6), angle, angle)
def test_angles_come_back_from_their_rotation(f, a, i):
    angles = geo.angles_from_rotation(geo.rotation_from_angles(f, a, i))
    np.testing.assert_allclose([float(x) for x in angles], [f, a, i], atol=1e-13)


def test_positive_flexion_swings_the_shank_backwards():
    pose = geo.Pose.from_table([90.0, 0, 0, 0, 0, 0])
    foot = pose.placement.apply((0.0, jnp.asarray(-400.0), 0.0))
    np.testing.assert_allclose([float(x) for x in foot], [-400.0, 0.0, 0.0], atol=1e-10)


def test_positive_adduction_takes_the_foot_medially():
    pose = geo.Pose.from_table([0.0, 10.0, 0, 0, 0, 0])
    foot = pose.placement.apply((0.0, jnp.asarray(-400.0), 0.0))
    assert float(foot[2]) == pytest.approx(-400.0 * np.sin(np.deg2rad(10.0)))


def test_positive_internal_rotation_takes_the_toes_medially():
    pose = geo.Pose.from_table([0.0, 0.0, 10.0, 0, 0, 0])
    toes = pose.placement.apply((jnp.asarray(100.0), 0.0, 0.0))
    assert float(toes[2]) == pytest.approx(-100.0 * np.sin(np.deg2rad(10.0)))


def test_placements_compose_and_invert_like_homogeneous_matrices(rng):
    def random_placement():
        frame = geo.Frame(rng.normal(size=3), rng.normal(size=3))
        r0, r1, r2 = np.asarray(frame.rotation)
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = rx(r0) @ ry(r1) @ rz(r2), np.asarray(frame.origin)
        return frame.placement, m

    def homogeneous(place):
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = matrix(place.rotation), [float(x) for x in place.translation]
        return m

    (a, ma), (b, mb) = random_placement(), random_placement()
    np.testing.assert_allclose(homogeneous(a), ma, atol=1e-14)
    np.testing.assert_allclose(homogeneous(a.after(b)), ma @ mb, atol=1e-14)
    np.testing.assert_allclose(homogeneous(a.inverse()), np.linalg.inv(ma), atol=1e-14)
    point = tuple(jnp.asarray(x) for x in rng.normal(size=3))
    back = a.apply_inverse(a.apply(point))
    np.testing.assert_allclose(np.array(back), np.array(point), atol=1e-14)


def test_a_frame_turns_like_intrinsic_rotations_about_x_y_z():
    angles = np.array([0.3, -0.4, 0.7])
    expected = Rotation.from_euler("XYZ", angles).as_matrix()
    np.testing.assert_allclose(
        matrix(geo.Frame(rotation=angles).placement.rotation), expected, atol=1e-14
    )


def test_a_frame_that_is_not_turned_acts_like_one_turned_by_zero(rng):
    point = tuple(jnp.asarray(x) for x in rng.normal(size=3))
    other = geo.Frame(rng.normal(size=3), rng.normal(size=3)).placement
    plain, turned = geo.Frame([1, 2, 3]), geo.Frame([1, 2, 3], [0, 0, 0])
    for act in (
        lambda p: p.apply(point),
        lambda p: p.apply_inverse(point),
        lambda p: p.inverse().apply(point),
        lambda p: p.after(other).apply(point),
        lambda p: other.after(p).apply(point),
        lambda p: p.after(geo.Frame([3, 2, 1]).placement).apply(point),
        lambda p: p.turn_back(p.turn(point)),
    ):
        left, right = act(plain.placement), act(turned.placement)
        np.testing.assert_allclose(np.array(left), np.array(right), atol=1e-13)


def test_vector_algebra_matches_numpy_and_honours_known_zeros_and_ones(rng):
    a, b = rng.normal(size=(2, 3))
    for known in (0.0, 1.0):
        for place in range(3):
            left = geo.Vector(*(known if k == place else jnp.asarray(x) for k, x in enumerate(a)))
            right = geo.Vector(*(jnp.asarray(x) for x in b))
            na = np.array([float(x) for x in left])
            np.testing.assert_allclose(float(left @ right), na @ b, atol=1e-14)
            for ours, theirs in (
                (left.cross(right), np.cross(na, b)),
                (left + right, na + b),
                (left - right, na - b),
                (right - left, b - na),
                (jnp.asarray(2.5) * left, 2.5 * na),
                (left * right, na * b),
            ):
                np.testing.assert_allclose([float(x) for x in ours], theirs, atol=1e-14)


def test_the_length_of_the_zero_vector_has_a_zero_derivative():
    slope = jax.grad(lambda x: geo.Vector(x, 0.0 * x, 0.0 * x).norm())(0.0)
    assert float(slope) == 0.0


def test_tables_and_states_round_trip_with_batches(rng):
    table = rng.normal(size=(4, 6)) * 10
    pose = geo.Pose.from_table(table)
    np.testing.assert_allclose(np.asarray(pose.to_table()), table, rtol=1e-14)
    state = geo.State({"tibia": pose})
    again = geo.State.of({"flexion": pose.flexion}, state.at(geo.FREE_COORDINATES)).tibia
    np.testing.assert_allclose(np.asarray(again.to_table()), table, rtol=1e-14)
    assert geo.FREE_COORDINATES == tuple(geo.COORDINATES)[1:]
    other = {"lateral": pose.lateral, "adduction": pose.adduction}
    again = geo.State.of(other, state.at(geo.free_of(other))).tibia
    np.testing.assert_allclose(np.asarray(again.to_table()), table, rtol=1e-14)
    one = geo.State.of({"flexion": 0.3}, jnp.zeros((5, 4))).tibia
    assert one.flexion.shape == (4,)


def test_safe_primitives_are_finite_and_exact_where_the_formulas_are_not():
    assert float(numerics.safe_sqrt(-1.0)) == 0.0
    assert np.isnan(numerics.safe_sqrt(np.nan)), "what is not known is not slack"
    assert float(jax.grad(numerics.safe_sqrt)(4.0)) == pytest.approx(0.25)
    assert float(jax.grad(jax.grad(numerics.safe_sqrt))(0.0)) == 0.0
    slope = jax.grad(
        lambda x: numerics.branch(x > 0, jnp.log, jnp.zeros_like, x, inside=1.0, outside=1.0)
    )
    assert float(slope(-1.0)) == 0.0
    assert float(slope(2.0)) == 0.5


@given(st.floats(-5.0, 5.0), st.floats(1e-3, 1.0))
def test_the_smooth_positive_part_is_above_the_corner_by_half_its_width_at_most(x, width):
    excess = float(numerics.positive_part(x, width)) - max(x, 0.0)
    assert -1e-15 <= excess <= 0.5 * width + 1e-15
