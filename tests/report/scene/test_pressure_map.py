"""The map of pressure shows the contact that the mechanics computes, on the right side."""

import equinox as eqx
import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax import geometry as geo
from kneejax import report
from kneejax.mechanics import Contact
from kneejax.report.scene.pressure import plateau_pressures, rim_of

POSE = [[20.0, 0.9, 7.5, 1.1, 1.0, -1.1], [60.0, 3.8, 3.1, 1.6, -1.0, -1.2]]
LINEAR = {"law": "linear", "youngs_modulus": 10.0, "onset_width": 1e-4}


def as_left(knee):
    """The same twin, said to be of a left knee."""
    twin = jax.tree.map(lambda x: x, knee)
    object.__setattr__(twin, "side", "left")
    return twin


def with_ball(knee, depth, form, radius=25.0, outline=None):
    """One compartment: a ball that overlaps a flat plateau by a known depth at the zero pose."""
    ball = geo.Sphere(radius, geo.Frame([2.0, radius - depth - 20.0, 14.0]))
    plate = geo.Plateau(
        [[0.0]], (-12.0, 14.0), (-10.0, 10.0), geo.Frame([0.0, -20.0, 14.0]), outline=outline
    )
    contact = Contact(ball, plate, form=form, points=(60, 60), **LINEAR)
    changed = eqx.tree_at(lambda k: k.contacts, knee, (contact,))
    object.__setattr__(changed, "contact_names", ("lateral",))
    return changed


@pytest.mark.parametrize("form", ["elliptical_patch", "quadrature"])
def test_pressure_under_a_ball_is_the_law_of_its_depth(knee, form):
    depth, radius = 0.6, 25.0
    ball = with_ball(knee, depth, form, radius)
    (field,) = plateau_pressures(ball, geo.Pose.from_table([[0.0] * 6]), (80, 80))
    contact = ball.contacts[0]
    away = np.hypot(field.points_mm[..., 0] - 2.0, field.points_mm[..., 2] - 14.0)
    under = np.sqrt(np.maximum(radius**2 - away**2, 0.0)) - radius + depth
    expected = float(contact.modulus) * np.maximum(under, 0.0) / float(contact.layer_thickness)
    np.testing.assert_allclose(field.pressure_MPa[0], expected, atol=2e-3)
    np.testing.assert_allclose(field.center_mm[0], [2.0, -20.0, 14.0], atol=0.02)
    assert field.covered.all()


@pytest.mark.long
def test_the_map_adds_up_to_the_evaluated_force(knee):
    contact = knee.contacts[0]
    summed = Contact(contact.femoral, contact.tibial, form="quadrature", points=(48, 48), **LINEAR)
    changed = eqx.tree_at(lambda k: k.contacts, knee, (summed, summed))
    poses = geo.Pose.from_table(POSE)
    found = kj.evaluate(changed, poses)
    field = plateau_pressures(changed, poses, (48, 48))[0]
    np.testing.assert_allclose(field.center_mm, found.center[:, 0], atol=1e-6)
    np.testing.assert_allclose(
        field.pressure_MPa.max(axis=(1, 2)), found.max_pressure[:, 0], rtol=1e-9
    )


@pytest.mark.long
def test_a_meniscus_that_gives_way_is_drawn_as_it_is_pressed():
    """Its sections have moved outwards: without that the map shows up to twice the pressure."""
    knee = kj.load_knee("average_knee")
    poses = geo.Pose.from_table([[30.0, 1.2, 11.9, 8.9, -1.8, -1.4]])
    found = kj.evaluate(knee, poses)
    for row, field in enumerate(plateau_pressures(knee, poses, (36, 5))):
        if field.name.endswith("meniscus"):
            assert field.peak_MPa == pytest.approx(float(found.max_pressure[0, row]), rel=1e-9)


def test_nothing_is_pressed_where_there_is_no_cartilage_or_no_touch(knee):
    turn = np.linspace(0.0, 2.0 * np.pi, 30)[:-1]
    outline = np.stack([1.0 + 4.0 * np.cos(turn), 4.0 * np.sin(turn)], axis=1)
    ball = with_ball(knee, 0.8, "quadrature", outline=outline)
    (field,) = plateau_pressures(ball, geo.Pose.from_table([[0.0] * 6]))
    away = np.hypot(field.points_mm[..., 0] - 1.0, field.points_mm[..., 2] - 14.0)
    assert not field.pressure_MPa[0][away > 4.0].any()
    assert field.pressure_MPa[0][away < 3.5].all()
    np.testing.assert_allclose(np.hypot(*(field.rim_mm[:, [0, 2]] - [1.0, 14.0]).T), 4.0)

    (apart,) = plateau_pressures(ball, geo.Pose.from_table([[0, 0, 0, 0, -5.0, 0]]))
    assert apart.peak_MPa == 0.0 and np.isnan(apart.center_mm).all()


def test_the_rim_of_a_region_goes_around_it(knee):
    rim = rim_of(knee.contacts[0].tibial)
    (x0, x1), (z0, z1) = knee.contacts[0].tibial.bounds()
    area = 0.5 * abs(
        np.sum(rim[:, 2] * np.roll(rim[:, 0], -1) - np.roll(rim[:, 2], -1) * rim[:, 0])
    )
    assert area == pytest.approx(float((x1 - x0) * (z1 - z0)))


def test_a_left_knee_is_the_mirror_image_and_says_so(knee):
    poses = geo.Pose.from_table(POSE)
    mirror = [1.0, 1.0, -1.0]
    for right, left in zip(
        plateau_pressures(knee, poses),
        plateau_pressures(as_left(knee), poses),
        strict=True,
    ):
        np.testing.assert_allclose(left.points_mm, right.points_mm * mirror)
        np.testing.assert_allclose(left.center_mm, right.center_mm * mirror)
        np.testing.assert_allclose(left.pressure_MPa, right.pressure_MPa)

    def side_of(knee, word):
        axes = report.pressure_figure(knee, poses).axes[0]
        (text,) = [t for t in axes.texts if t.get_text() == word]
        return text.get_position()[0] > np.mean(axes.get_xlim())

    assert side_of(knee, "lateral") and not side_of(knee, "medial")
    assert side_of(as_left(knee), "medial") and not side_of(as_left(knee), "lateral")


def test_figure_has_a_panel_a_pose_and_one_scale(knee, tmp_path):
    table = np.linspace(POSE[0], POSE[1], 11)
    figure = report.pressure_figure(knee, geo.Pose.from_table(table), most=6)
    titles = [axes.get_title("center") for axes in figure.axes]
    assert sum(title.endswith("flexion") for title in titles) == 6
    assert titles[0].startswith("20°") and titles[5].startswith("60°")
    assert figure.axes[-1].get_ylabel() == "Contact pressure, MPa"
    paths = report.save_figure(figure, tmp_path, "pressure")
    assert all(path.stat().st_size > 10_000 for path in paths)


def test_a_knee_without_contacts_has_no_map(knee):
    bare = eqx.tree_at(lambda k: k.contacts, knee, ())
    object.__setattr__(bare, "contact_names", ())
    with pytest.raises(ValueError, match="no contacts"):
        report.pressure_figure(bare, bare.reference_pose)
