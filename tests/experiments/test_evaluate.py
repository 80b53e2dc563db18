"""The mechanics of given poses where a closed form is degenerate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax.experiments import evaluate_beside
from kneejax.mechanics import Contact, Knee, Ligaments
from kneejax.numerics import compiler_options, counted_programs

#: Answers that are smooth where a ball presses on a plane.
SMOOTH = ("length", "tension", "contact_force", "area", "max_pressure", "max_depth", "center")


@pytest.fixture(scope="module")
def ball_on_a_plane():
    """Both relative curvatures are the same, and nothing is tilted."""
    rope = Ligaments([[0, 0, -20]], [[0, -30, -20]], [3e3], [29.0], [0.03], [0.002], ["rope"])
    contact = Contact(geo.Sphere(30.0), geo.Plane())
    reference = geo.Pose.from_table([0.0, 0.0, 0.0, 0.0, -29.0, 0.0])
    return Knee(rope, (contact,), (), (), reference, ("ball",))


@pytest.mark.long
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_ball_that_sinks_into_an_untilted_plane_has_the_derivatives_of_differences(
    ball_on_a_plane, mode, central_difference
):
    def answers(pose):
        found = kj.evaluate(ball_on_a_plane, geo.Pose(*pose[:, None]))
        return jnp.concatenate([jnp.ravel(getattr(found, name)) for name in SMOOTH])

    pose = jnp.array([0.0, 0.0, 0.0, 3.0, -29.0, -4.0])
    options = dict(compiler_options())
    exact = np.asarray(jax.jit(mode(answers), compiler_options=options)(pose))
    numeric = central_difference(jax.jit(answers, compiler_options=options), pose, 1e-4)
    scale = np.abs(numeric).max(axis=1, keepdims=True) + 1e-3
    np.testing.assert_allclose(exact / scale, numeric / scale, atol=1e-6)


@pytest.mark.long
def test_what_a_pose_is_does_not_depend_on_its_row():
    """Borders are asked in blocks of the poses that need it, which are put together for that."""
    knee, rng = kj.load_knee("four_ligament"), np.random.default_rng(3)
    table = rng.uniform(-1.0, 1.0, (64, 6)) * [45.0, 0.5, 25.0, 6.0, 0.5, 4.0]
    table += [45.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    found = kj.evaluate(knee, kj.Pose.from_table(table))
    beyond = np.asarray(found.beyond_mm)
    assert 0 < np.sum(beyond > 0.0) < beyond.size
    order = rng.permutation(len(table))
    mixed = kj.evaluate(knee, kj.Pose.from_table(table[order]))
    for name in ("beyond_mm", "beyond_share", "contact_force", "known"):
        there, here = np.asarray(getattr(found, name))[order], np.asarray(getattr(mixed, name))
        np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-9, err_msg=name)


def test_nothing_is_told_of_a_pose_that_is_not_known(ball_on_a_plane):
    """A smooth law of a length of 0 would say that the rope is slack."""
    table = np.array([[0.0, 0.0, 0.0, 3.0, -29.0, -4.0], [0.0, *[np.nan] * 5]])
    found = kj.evaluate(ball_on_a_plane, geo.Pose.from_table(table))
    for name in ("length", "strain", "tension", "contact_force"):
        told = np.isfinite(np.asarray(getattr(found, name))).reshape(2, -1)
        assert told[0].all() and not told[1].any(), name


def test_what_compiled_beside_is_ready(ball_on_a_plane):
    with evaluate_beside(ball_on_a_plane):
        pass
    poses = geo.Pose.from_table(np.tile([0.0, 0.0, 0.0, 3.0, -29.0, -4.0], (5, 1)))
    with counted_programs() as programs:
        kj.evaluate(ball_on_a_plane, poses, np.full((1, 2, 5), np.nan))
    assert not programs.compiled and not programs.read


def test_every_contact_is_told_in_its_own_row():
    """Those of one kind are computed together, an ellipsoid between two balls by itself."""
    frames = [geo.Frame([0.0, 0.0, z]) for z in (-60.0, 0.0, 60.0)]
    balls = geo.Sphere(30.0, frames[0]), geo.Ellipsoid([30.2] * 3, frames[1])
    balls += (geo.Sphere(30.5, frames[2]),)
    contacts = [Contact(*pair) for pair in zip(balls, map(geo.Plane, frames), strict=True)]
    rope = Ligaments([[0, 0, -20]], [[0, -30, -20]], [3e3], [29.0], [0.03], [0.002], ["rope"])
    table = np.array([0.0, 0.0, 0.0, 0.0, -29.0, 0.0])
    knee = Knee(rope, tuple(contacts), (), (), geo.Pose.from_table(table), tuple("abc"))
    found = kj.evaluate(knee, geo.Pose.from_table(table[None]))
    np.testing.assert_allclose(found.max_depth[0], [1.0, 1.2, 1.5], atol=1e-9)
    np.testing.assert_allclose(found.center[0, :, 2], [-60.0, 0.0, 60.0], atol=1e-6)
    assert np.all(np.diff(found.contact_force[0, :, 1]) < 0.0)
