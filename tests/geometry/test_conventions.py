"""The four conventions against each other and against independent formulas."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kneejax.geometry as geo

EXTENSION = np.zeros(6)
SHIFTED = np.array([0.0, 0.0, 0.0, 3.0, -28.0, 2.0])
PAIRS = list(itertools.permutations(geo.CONVENTIONS, 2))

angle = st.floats(-0.6, 0.6)
shift = st.floats(-40.0, 40.0)
coordinates = st.tuples(st.floats(-0.2, 2.4), angle, angle, shift, shift, shift).map(np.array)


def rotation(f, a, i):
    x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    y = np.array([[np.cos(i), 0, np.sin(i)], [0, 1, 0], [-np.sin(i), 0, np.cos(i)]])
    z = np.array([[np.cos(f), np.sin(f), 0], [-np.sin(f), np.cos(f), 0], [0, 0, 1]])
    return z @ x @ y


@given(coordinates)
def test_all_pairs_of_conventions_round_trip(pose):
    for source, target in PAIRS:
        there = geo.convert(pose, source, target)
        back = geo.convert(there, target, source)
        np.testing.assert_allclose(np.asarray(back), pose, atol=1e-11)


@pytest.mark.parametrize("pose", [EXTENSION, SHIFTED], ids=["origin", "shifted"])
@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_round_trips_are_exact_at_extension(source, target, pose):
    back = geo.convert(geo.convert(pose, source, target), target, source)
    np.testing.assert_allclose(np.asarray(back), pose, atol=1e-14)


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_derivatives_at_extension_equal_central_differences(source, target, central_difference):
    change = jax.jit(lambda x: geo.convert(x, source, target))
    exact = np.asarray(jax.jit(jax.jacfwd(change))(SHIFTED))
    assert np.isfinite(exact).all()
    np.testing.assert_allclose(exact, central_difference(change, SHIFTED), atol=1e-6)


@given(coordinates)
def test_grood_suntay_translations_lie_along_its_three_axes(c):
    f, a, i, q2, q3, q1 = c
    r = rotation(f, a, i)
    e1, e3 = np.array([0.0, 0.0, 1.0]), r[:, 1]
    e2 = np.cross(e3, e1) / np.linalg.norm(np.cross(e3, e1))
    translation = q2 * e2 + q3 * e3 + q1 * e1
    ours = geo.convert(c, "grood-suntay", "femoral")
    np.testing.assert_allclose(np.asarray(ours), [f, a, i, *translation], atol=1e-11)


@given(coordinates)
def test_grood_suntay_angles_are_measured_between_its_axes(c):
    r = rotation(*c[:3])
    e1, e3 = np.array([0.0, 0.0, 1.0]), r[:, 1]
    e2 = np.cross(e3, e1) / np.linalg.norm(np.cross(e3, e1))
    flexion = np.arctan2(-e2[1], e2[0])
    adduction = np.arcsin(e1 @ e3)
    internal = np.arctan2(e2 @ r[:, 2], e2 @ r[:, 0])
    np.testing.assert_allclose([flexion, adduction, internal], c[:3], atol=1e-12)


@given(coordinates)
def test_tibial_translations_are_components_along_tibia_axes(c):
    r = rotation(*c[:3])
    ours = np.asarray(geo.convert(c, "femoral", "tibial"))
    np.testing.assert_allclose(ours, [*c[:3], *(r.T @ c[3:])], atol=1e-11)


@given(coordinates)
def test_femur_in_tibia_places_the_femur_and_keeps_the_signs_of_the_angles(c):
    r = rotation(*c[:3])
    ours = np.asarray(geo.convert(c, "femoral", "femur-in-tibia"))
    np.testing.assert_allclose(ours[3:], -r.T @ c[3:], atol=1e-11)
    femur = rotation(*(-ours[:3]))
    np.testing.assert_allclose(femur, r.T, atol=1e-12)
    alone = np.asarray(geo.convert([0.3, 0, 0, 0, 0, 0], "femoral", "femur-in-tibia"))
    np.testing.assert_allclose(alone[:3], [0.3, 0, 0], atol=1e-14)
    varus = np.asarray(geo.convert([0, 0.1, 0, 0, 0, 0], "femoral", "femur-in-tibia"))
    np.testing.assert_allclose(varus[:3], [0, 0.1, 0], atol=1e-14)


def test_a_batch_converts_like_its_members(rng):
    batch = rng.normal(size=(6, 5)) * np.array([0.5, 0.2, 0.2, 9, 9, 9])[:, None]
    together = np.asarray(geo.convert(batch, "femoral", "grood-suntay"))
    for k in range(5):
        alone = geo.convert(batch[:, k], "femoral", "grood-suntay")
        np.testing.assert_allclose(together[:, k], np.asarray(alone), atol=1e-13)


def test_an_unknown_convention_is_an_error():
    with pytest.raises(KeyError):
        geo.convert(np.zeros(6), "femoral", "grood")


def test_the_drawer_is_the_anterior_translation_of_grood_and_suntay(rng):
    poses = rng.uniform(-1.0, 1.0, (6, 20)) * np.array([1.5, 0.3, 0.5, 20, 20, 20])[:, None]
    state = geo.State.of({}, jnp.asarray(poses))
    drawer, lift = state.at(["drawer", "lift"])
    clinical = geo.convert(poses, "femoral", "grood-suntay")
    assert np.asarray(drawer) == pytest.approx(np.asarray(clinical[3]), abs=1e-12)
    held = {"flexion": jnp.asarray(poses[0]), "drawer": drawer}
    free = state.at(geo.free_of(held))
    back = geo.State.of(held, free)
    assert np.asarray(back.at(geo.COORDINATES)) == pytest.approx(poses, abs=1e-12)
    assert np.asarray(lift) == pytest.approx(np.asarray(free[2]))


@pytest.mark.parametrize(
    ("held", "says"),
    [
        ({"drawr_mm": 1.0}, "did you mean 'drawer_mm'"),
        ({"drawer_mm": 1.0, "superior_mm": 1.0}, "drawer_mm beside superior_mm"),
    ],
)
def test_a_held_column_that_means_nothing_is_refused(held, says):
    with pytest.raises(ValueError, match=says):
        geo.prescribed_of(held)
