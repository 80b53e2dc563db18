"""The mean of the highest tenth: of a paraboloid of pressure it is 0.95 of the highest."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.geometry import Frame, Plane, Plateau, Pose, Sphere
from kneejax.mechanics import Contact, Knee, Ligaments, add_lane_axis
from kneejax.papers.varus_valgus import peak_pressure

DEPTH, LAYER, PLACE = 0.8, 6.0, (7.0, 20.0)
POSES = Pose.from_table([[0.0, 0, 0, 0, DEPTH, 0], [0.0, 0, 0, 0, -1.0, 0]])


def knee_of(contact):
    nothing = Ligaments([], [], [], [], [], [], [])
    return Knee(nothing, (contact,), (), (), Pose.from_table([0.0] * 6), ("medial",))


def ball_on_plane(**more):
    anterior, lateral = PLACE
    return Contact(
        Sphere(25.0, Frame([anterior, 0.0, lateral])),
        Plane(Frame([0.0, -25.0, 0.0])),
        layer_thickness=LAYER,
        onset_width=1e-6,
        law="linear",
        **more,
    )


def test_a_patch_has_the_closed_form():
    contact = ball_on_plane()
    knee = knee_of(contact)
    contact_points = jnp.stack(
        [
            jnp.stack(contact.contact_point(Pose.from_table(row).placement))
            for row in POSES.to_table()
        ],
        axis=-1,
    )
    pressure, center = peak_pressure(add_lane_axis(knee), POSES, contact_points[None])
    highest = float(contact.modulus) * DEPTH / LAYER
    assert np.asarray(pressure)[:, 0] == pytest.approx([0.95 * highest, 0.0], rel=1e-9)
    anterior, lateral = PLACE
    center = np.asarray(center)[:, 0]
    # The femur's lowest point, in the tibia, which has come up by the depth.
    assert center[0] == pytest.approx([anterior, -25.0 - DEPTH, lateral], abs=1e-6)
    assert np.isnan(center[1]).all()


def test_points_approach_the_closed_form():
    """A ball on a flat plateau: the depth along the normal is the paraboloid but for the fourth
    order, and a share of the area is a share of the patch."""
    plateau = Plateau([[0.0]], (-14.0, 14.0), (-14.0, 14.0), Frame([7.0, -25.0, 20.0]))
    contact = dataclasses.replace(ball_on_plane(form="quadrature", points=(30, 30)), tibial=plateau)
    pressure, center = peak_pressure(add_lane_axis(knee_of(contact)), POSES, jnp.zeros((0, 2, 2)))
    highest = float(contact.modulus) * DEPTH / LAYER
    assert np.asarray(pressure)[:, 0] == pytest.approx([0.95 * highest, 0.0], rel=5e-3)
    # The last of the elements that count stands alone, 0.3 mm wide.
    assert np.asarray(center)[0, 0] == pytest.approx([7.0, -25.0, 20.0], abs=0.1)


def test_the_whole_area_gives_the_mean_pressure():
    contact = ball_on_plane()
    contact_points = contact.contact_point(Pose.from_table(POSES.to_table()[0]).placement)
    contact_points = jnp.stack(contact_points)[None, :, None]
    one = Pose.from_table(POSES.to_table()[:1])
    pressure, _ = peak_pressure(add_lane_axis(knee_of(contact)), one, contact_points, 1.0)
    half = 0.5 * float(contact.modulus) * DEPTH / LAYER
    assert float(pressure[0, 0]) == pytest.approx(half, rel=1e-9)
