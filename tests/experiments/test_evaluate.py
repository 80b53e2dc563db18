"""The mechanics of given poses where a closed form is degenerate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax.mechanics import Contact, Knee, Ligaments
from kneejax.numerics import compiler_options

#: Answers that are smooth where a ball presses on a plane.
SMOOTH = ("length", "tension", "contact_force", "area", "max_pressure", "max_depth", "center")


@pytest.fixture(scope="module")
def ball_on_a_plane():
    """Both relative curvatures are the same, and nothing is tilted."""
    rope = Ligaments([[0, 0, -20]], [[0, -30, -20]], [3e3], [29.0], [0.03], [0.002], ["rope"])
    contact = Contact(geo.Sphere(30.0), geo.Plane())
    reference = geo.Pose.from_table([0.0, 0.0, 0.0, 0.0, -29.0, 0.0])
    return Knee(rope, (contact,), (), (), reference, ("ball",))


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
