"""Inertia of masses on their way: closed forms, and the order of the differences."""

import numpy as np
import pytest

from kneejax.mechanics import MovingMass, wrench_in_frame

TIME = np.linspace(0.1, 0.9, 5)


def swinging(step, length=0.2, mass=4.0, inertia=0.05):
    """A mass on an arm about the ground's Z axis, its angle and the angle's derivatives."""
    around = TIME + step * np.arange(-2, 3)[:, None]
    angle = 0.4 * np.sin(3.0 * around)
    cos, sin, zero, one = np.cos(angle), np.sin(angle), 0.0 * angle, 1.0 + 0.0 * angle
    turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1)
    turn = turn.reshape(*angle.shape, 3, 3)
    center = turn @ np.array([0.0, -length, 0.0])
    rate, faster = 1.2 * np.cos(3.0 * TIME), -3.6 * np.sin(3.0 * TIME)
    body = MovingMass(mass, np.diag([0.05, 0.01, inertia]), turn, center, step)
    return body, turn[2], rate, faster


def wrench(step):
    body, turn, rate, faster = swinging(step)
    found = wrench_in_frame(*body.inertia(), turn, np.zeros((len(TIME), 3)))
    expected = np.zeros_like(found)
    expected[:, 0], expected[:, 1] = -0.8 * faster, -0.8 * rate**2
    expected[:, 5] = -1000.0 * (4.0 * 0.04 + 0.05) * faster
    return found, expected


def test_a_pendulum_has_the_inertia_of_its_closed_form():
    found, expected = wrench(5e-4)
    assert np.allclose(found, expected, rtol=1e-5, atol=1e-4)


def test_its_error_is_of_second_order(slope_on_log_axes):
    steps = np.array([0.08, 0.04, 0.02])
    errors = [np.abs(found - expected).max() for found, expected in map(wrench, steps)]
    assert slope_on_log_axes(steps, errors) == pytest.approx(2.0, abs=0.05)


def test_what_falls_freely_has_no_weight_left():
    step, gravity = 5e-4, np.array([0.0, -9.81, 0.0])
    around = TIME + step * np.arange(-2, 3)[:, None]
    center = np.array([1.0, 2.0, 3.0]) + 0.5 * around[..., None] ** 2 * gravity
    turn = np.broadcast_to(np.eye(3), (5, len(TIME), 3, 3))
    body = MovingMass(3.0, np.eye(3), turn, center, step)
    for inertia, weight in zip(body.inertia(), body.weight(gravity), strict=True):
        assert np.allclose(inertia + weight, 0.0, atol=1e-6)


def test_a_spinning_body_that_nothing_turns_obeys_euler():
    """About a principal axis that itself turns: the moment is the axis' rate times the spin."""
    step, spin, slow = 1e-4, 20.0, 1.5
    around = TIME + step * np.arange(-2, 3)[:, None]

    def about(axis, angle):
        x, y, z = np.eye(3)[axis]
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        sin, cos = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
        return np.eye(3) + sin * skew + (1 - cos) * (skew @ skew)

    turn = about(1, slow * around) @ about(2, spin * around)
    own = np.diag([0.02, 0.02, 0.03])
    body = MovingMass(1.0, own, turn, np.zeros((5, len(TIME), 3)), step)
    moment = body.inertia()[1]
    # A wheel whose axle (Z) turns about Y: Iz spin slow about the axle's third axis.
    third = np.stack([np.cos(slow * TIME), 0 * TIME, -np.sin(slow * TIME)], axis=1)
    assert np.allclose(moment, -0.03 * spin * slow * third, atol=2e-4)
