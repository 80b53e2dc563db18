import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.experiments import Way, evaluate, status_of, ways_of, with_flips
from kneejax.mechanics import Course, Knee, Ligaments, Wrench, add_lane_axis
from kneejax.report.pose_tables import pose_words
from kneejax.statics import Status
from tests.derivatives import wrench_of

FEMORAL = [[-2.0, 30.0, 1.0], [3.0, 28.0, -2.0], [0.0, 33.0, 0.0]]
TIBIAL = [[4.0, -31.0, 2.0], [-3.0, -30.0, 1.0], [1.0, -29.0, -3.0]]
OBSTACLES = {
    "sphere": geo.WrapSphere(11.0, geo.Frame([-6.0, 1.0, 0.5])),
    "cylinder": geo.WrapCylinder(9.0, 80.0, geo.Frame([-5.0, 0.0, 1.0], [0.2, -0.3, 0.1])),
    "ellipsoid": geo.WrapEllipsoid([9.0, 14.0, 11.0], geo.Frame([-4.0, 2.0, 0], [0.3, 0.1, -0.2])),
}
POSE = [20.0, 3.0, -6.0, 2.0, -1.0, 1.5]


def fibres(courses=(), count=3):
    return Ligaments(
        FEMORAL[:count], TIBIAL[:count], [500.0, 700.0, 900.0][:count], [50.0] * count,
        [0.06] * count, [1e-3] * count, ["a", "b", "c"][:count], courses,
    )  # fmt: skip


def around(kind, bone, rows=(0, 2), **via):
    return Course(rows, obstacle=OBSTACLES[kind], obstacle_bone=bone, **via)


VIA = {"via": [[[9.0, -12.0, 4.0]], [[8.0, 8.0, 3.0]]], "via_bones": ("femur", "tibia")}
COURSES = {
    "straight": [],
    "via on both bones": [Course((1,), **VIA)],
    "sphere on the tibia": [around("sphere", "tibia")],
    "cylinder on the femur": [around("cylinder", "femur")],
    "ellipsoid on the tibia, via on the femur": [
        around("ellipsoid", "tibia"),
        Course((1,), [[[9.0, 0.0, 1.0]]], ("femur",)),
    ],
    "sphere behind a via point": [around("sphere", "femur", (1,), **VIA)],
}


class Where(NamedTuple):
    """A state of which only the tibia's placement is known."""

    there: geo.Placement
    shape: tuple[int, ...] = ()

    def between(self, _):
        return self.there


def tibia_at(pose):
    return geo.State({"tibia": geo.Pose.from_table(pose)})


def shifted(shift):
    return geo.State({"tibia": geo.Pose(*jnp.zeros(3), *jnp.asarray(shift))})


def six(wrench):
    return jnp.stack([*wrench.force, *wrench.moment])


def pull(ligaments, pose):
    pulls, _, _ = ligaments.pull(tibia_at(pose))
    return six(Wrench.total(pulls.between[geo.FEMUR_AND_TIBIA]))


@jax.jit
def pulled(ligaments, pose):
    return pull(ligaments, pose), ligaments.length(tibia_at(pose))


class Followed(NamedTuple):
    """The wrench of some fibres at a pose.

    Attributes:
        wrench: `(6,)`, N and N mm.
        by_energy: what their energy loses along the motions of the tibia.
        slope: derivative of the wrench by the pose, `(6, 6)`.
    """

    wrench: jax.Array
    by_energy: jax.Array
    slope: jax.Array


# Fused, without optimisation, values are computed anew at each of their many uses.
@functools.partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion"})
def followed(ligaments, pose):
    """One program for each kind of course: three would share most of what they compile."""
    wrench, push = jax.linearize(lambda x: pull(ligaments, x), pose)
    there = tibia_at(pose).tibia.placement
    by_energy = wrench_of(lambda there: ligaments.energy(Where(there)), there)
    return Followed(wrench, six(by_energy), jax.vmap(push, out_axes=1)(jnp.eye(6)))


@pytest.mark.long
@pytest.mark.parametrize("name", COURSES)
def test_the_wrench_is_what_the_energy_loses(name):
    found = followed(fibres(COURSES[name]), np.array(POSE))
    assert np.abs(found.by_energy).max() > 1.0
    np.testing.assert_allclose(found.wrench, found.by_energy, rtol=1e-9, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("name", COURSES)
def test_the_wrench_has_a_derivative_that_central_differences_confirm(name, central_difference):
    ligaments = fibres(COURSES[name])
    exact = followed(ligaments, np.array(POSE)).slope
    numeric = central_difference(lambda x: followed(ligaments, x).wrench, POSE, 1e-3)
    assert np.abs(exact - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_a_via_point_on_the_line_changes_nothing():
    straight = fibres()
    tibia = tibia_at(np.zeros(6))
    middle = 0.5 * (np.array(FEMORAL[1]) + np.array(TIBIAL[1]))
    bent = fibres([Course((1,), [[middle]], ("femur",))])
    np.testing.assert_allclose(bent.length(tibia), straight.length(tibia), rtol=1e-14)


def test_beyond_a_via_point_on_the_tibia_its_attachment_does_not_matter():
    """The last piece lies within one bone: it is part of the length but pulls on nothing."""
    course = Course((0,), [[[5.0, -10.0, 2.0]]], ("tibia",))
    one = fibres([course], 1)
    other = Ligaments(
        FEMORAL[:1], [[5.0, -10.0 - 21.0, 2.0]], [500.0], [50.0], [0.06], [1e-3], ["a"], [course]
    )
    (wrench, length), (same, shorter) = pulled(one, POSE), pulled(other, POSE)
    last = np.linalg.norm(np.array(TIBIAL[0]) - [5.0, -10.0, 2.0])
    assert float(length[0] - shorter[0]) == pytest.approx(last - 21.0, abs=1e-12)
    direction = np.asarray(wrench) / np.linalg.norm(wrench)
    np.testing.assert_allclose(np.asarray(same) / np.linalg.norm(same), direction, atol=1e-12)


def test_fibres_keep_their_order_however_they_run():
    alone = [
        float(fibres([around("sphere", "tibia", (row,))]).length(tibia_at(POSE))[row])
        for row in (0, 2)
    ]
    together = fibres([Course((1,), **VIA), around("sphere", "tibia", (2, 0))])
    length, wrap, _ = jax.jit(Ligaments.length_wrap_and_pulls)(together, tibia_at(POSE))
    np.testing.assert_allclose(np.asarray(length)[[0, 2]], alone, rtol=1e-14)
    assert np.isneginf(wrap.angle[1]) and np.isfinite(np.asarray(wrap.angle)[[0, 2]]).all()


@pytest.mark.long
def test_courses_of_one_kind_are_one_program_and_each_keeps_its_obstacle():
    """Also where one obstacle differs from lane to lane, and by derivatives by its numbers."""
    radii = {0: 14.0, 2: 8.0}

    def course(row):
        return Course((row,), obstacle=geo.WrapSphere(radii[row], geo.Frame([-4.0 - row, 2.0, 0])))

    together = fibres([course(2), around("sphere", "femur", (1,)), course(0)])
    assert [kind.rows for kind in together.kinds] == [(2, 0), (1,)]
    find = jax.jit(Ligaments.length)
    straight, one = (find(x, tibia_at(POSE)) for x in (fibres(), together))
    wanted = {row: find(fibres([course(row)]), tibia_at(POSE))[row] for row in radii}
    assert all(float(wanted[row] - straight[row]) > 0.1 for row in radii)

    two, other = around("sphere", "tibia"), Course((1,), obstacle=geo.WrapSphere(14.0))
    uneven = find(fibres([two, other]), tibia_at(POSE))
    for part in (two, other):
        rows = np.array(part.rows)
        alone = find(fibres([part]), tibia_at(POSE))[rows]
        np.testing.assert_allclose(uneven[rows], alone, rtol=1e-14)

    def in_lanes(radius):
        here, lanes = together.courses[0].obstacle.frame.origin, add_lane_axis(together)
        origin = jnp.stack([here, here - 1.0], axis=1)
        return eqx.tree_at(
            lambda x: (x.courses[0].obstacle.radius, x.courses[0].obstacle.frame.origin),
            lanes,
            (radius, origin),
        )

    radius = jnp.array([8.0, 9.0])
    length = jax.jit(lambda r: in_lanes(r).length(tibia_at([POSE] * 2)))
    for row, expected in wanted.items():
        np.testing.assert_allclose(one[row], expected, rtol=1e-14)
        np.testing.assert_allclose(length(radius)[row, 0], expected, rtol=1e-14)
    np.testing.assert_allclose(length(radius)[0, 1], wanted[0], rtol=1e-14)
    assert abs(float(length(radius)[2, 1] - wanted[2])) > 0.1
    slope = jax.jvp(length, (radius,), (jnp.ones(2),))[1]
    step = 1e-5
    central = (length(radius + step) - length(radius - step)) / (2 * step)
    assert float(slope[2].min()) > 1e-3 and not np.asarray(slope)[:2].any()
    np.testing.assert_allclose(slope, central, rtol=1e-6, atol=1e-9)


def test_turning_femur_tibia_and_obstacle_together_changes_no_length():
    turn = geo.Frame([0.0, 0.0, 0.0], [0.4, -0.2, 0.7]).placement
    rows = np.stack([np.stack(row) for row in turn.rotation])

    def turned(points):
        return np.asarray(points) @ rows.T

    tibia, moved = shifted([3.0, 1.0, -2.0]), shifted(turned([3.0, 1.0, -2.0]))
    plain = fibres([around("sphere", "tibia")])
    frame = geo.Frame(turned(OBSTACLES["sphere"].frame.origin))
    course = Course((0, 2), obstacle=geo.WrapSphere(11.0, frame))
    other = Ligaments(
        turned(FEMORAL), turned(TIBIAL), plain.stiffness, plain.slack_length,
        plain.transition_strain, plain.transition_width, plain.names, [course],
    )  # fmt: skip
    np.testing.assert_allclose(other.length(moved), plain.length(tibia), rtol=1e-12)


MOST_SHIFTS = 6


def swept_knee(course):
    return Knee(
        Ligaments([[0, 40, 0]], [[0, -40, 0]], [500.0], [75.0], [0.06], [1e-3], ["a"], [course]),
        (), (), (), geo.Pose.from_table(np.zeros(6)), (),
    )  # fmt: skip


def swept(course, shifts):
    """A fibre whose tibia moves past an obstacle, from front to back."""
    knee = swept_knee(course)
    # Always as many poses: one program for each kind of course.
    table = np.zeros((MOST_SHIFTS, 6))
    table[:, 3] = np.resize(shifts, MOST_SHIFTS)
    found = evaluate(knee, geo.Pose.from_table(table))
    return jax.tree.map(lambda x: x[: len(shifts)], found)


def test_a_flip_to_the_other_side_is_reported_where_it_happens():
    course = Course((0,), obstacle=geo.WrapSphere(12.0), obstacle_bone="femur")
    found = swept(course, [40.0, 8.0, 0.2, -8.0, -40.0, -80.0])
    words = [Way(way).word for way in ways_of(found)[:, 0]]
    assert words == ["free", "wrapped", "near_flip", "flipped", "free", "free"]
    assert np.isfinite(np.asarray(found.length)).all()


def test_a_line_through_the_centre_has_a_length_and_says_that_it_may_flip():
    course = Course((0,), obstacle=geo.WrapSphere(12.0), obstacle_bone="femur")
    found = swept(course, [0.0])
    assert np.isfinite(float(found.length[0, 0])) and float(found.length[0, 0]) > 80.0
    assert ways_of(found)[0, 0] == Way.NEAR_FLIP


def test_an_end_inside_its_obstacle_and_a_cylinder_too_short_are_reported():
    inside = Course((0,), obstacle=geo.WrapSphere(12.0, geo.Frame([0.0, -40.0, 0.0])))
    assert ways_of(swept(inside, [0.0]))[0, 0] == Way.INSIDE
    short = Course((0,), obstacle=geo.WrapCylinder(5.0, 2.0, geo.Frame([1.0, 0.0, 30.0])))
    assert ways_of(swept(short, [0.0]))[0, 0] == Way.BEYOND_ENDS


def test_a_pose_takes_the_status_of_its_worst_fibre():
    reach = [40.0, 8.0, 0.2, -8.0, -40.0, -80.0]
    course = Course((0,), obstacle=geo.WrapSphere(12.0), obstacle_bone="femur")
    found, knee = swept(course, reach), swept_knee(course)
    each = np.asarray(status_of(found, knee))
    # 75 mm of slack length: all of them are strained, the last ones by more than 0.15.
    torn = [Status.OVERSTRETCHED if e > 0.15 else Status.BALANCED for e in found.strain[:, 0]]
    assert {*torn} == {Status.OVERSTRETCHED, Status.BALANCED} and each.tolist()[2:4] == torn[2:4]
    flipped = with_flips(each, found)
    assert flipped[3] == Status.WAY_FLIPPED and (np.delete(flipped, 3) == np.delete(each, 3)).all()
    said = pose_words(knee, found)
    assert "a flipped to the other side" in said[3] and "fails at 0.15" in said[-1]
    for obstacle, expected in (
        (geo.WrapSphere(12.0, geo.Frame([0.0, -40.0, 0.0])), "wrap_inside"),
        (geo.WrapCylinder(5.0, 2.0, geo.Frame([1.0, 0.0, 30.0])), "past_wrap"),
    ):
        course = Course((0,), obstacle=obstacle)
        alone = status_of(swept(course, [0.0]), swept_knee(course))
        assert Status(int(alone[0])).word == expected


def test_courses_name_each_fibre_once():
    with pytest.raises(ValueError, match="expected each once"):
        fibres([Course((0,), **VIA), around("sphere", "tibia", (0,))])
    with pytest.raises(ValueError, match="existing"):
        fibres([around("sphere", "tibia", (5,))])
