import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.mechanics import Knee
from kneejax.parameters import UnknownParameter, select


@pytest.fixture
def bundled(small_knee):
    """The small knee, its cruciates a group and all its fibres another."""
    groups = (("cruciates", ("ACL", "PCL")), ("all", small_knee.ligaments.names))
    return dataclasses.replace(small_knee, groups=groups)


def test_strains_of_groups_ask_for_lengths_once(bundled, monkeypatch):
    """Each way around an obstacle is a search: one for every fibre took minutes to compile."""
    asked, length = [], Knee.reference_length
    monkeypatch.setattr(Knee, "reference_length", lambda knee: asked.append(0) or length(knee))
    names = ("cruciates.reference_strain", "MCL.reference_strain", "LCL.reference_strain")
    selection = select(bundled, [*names, "MCL.femoral_attachment.superior"])
    values = jnp.array([0.01, 0.02, 0.03, 7.0])
    asked.clear()
    found = selection.apply(bundled, values)
    assert len(asked) == 1
    # At the attachment that was set beside it.
    assert np.asarray(selection.read(found)) == pytest.approx(np.asarray(values), abs=1e-14)


def test_stiffness_and_damping_of_a_group_are_sums_and_anything_else_the_mean(bundled):
    fibres = bundled.ligaments
    damped = eqx.tree_at(lambda k: k.ligaments.damping, bundled, jnp.array([1.0, 2.0, 0.0, 0.0]))
    names = ["cruciates.stiffness", "cruciates.damping", "all.femoral_attachment.anterior",
             "cruciates.reference_strain", "all.transition_strain", "MCL.stiffness"]  # fmt: skip
    expected = [
        fibres.stiffness[:2].sum(), 3.0, fibres.femoral_attachment[:, 0].mean(),
        bundled.reference_strain()[:2].mean(), fibres.transition_strain.mean(), 2750.0,
    ]  # fmt: skip
    np.testing.assert_allclose(select(damped, names).read(damped), expected, rtol=1e-14)
    # Beside a number of another part, each is read by itself.
    both = select(damped, [*names, "medial.youngs_modulus"])
    np.testing.assert_allclose(both.read(damped)[:-1], expected, rtol=1e-14)


def test_fibres_that_have_nothing_share_what_their_group_gets(bundled):
    """Every knee file leaves damping out; a factor times nothing was not a number."""
    selection = select(bundled, ["cruciates.damping"])
    damped = selection.apply(bundled, jnp.array([8.0]))
    assert damped.ligaments.damping.tolist() == [4.0, 4.0, 0.0, 0.0]
    slope = jax.jacfwd(lambda x: selection.apply(bundled, x).ligaments.damping)(jnp.array([8.0]))
    assert slope[:, 0].tolist() == [0.5, 0.5, 0.0, 0.0]


def test_a_structure_is_set_under_vmap_as_one_by_one(bundled):
    selection = select(bundled, ["cruciates.stiffness"])
    sums = jnp.array([[5000.0], [9500.0], [19000.0]])
    many = jax.vmap(lambda x: selection.apply(bundled, x).ligaments.stiffness)(sums)
    np.testing.assert_allclose(many[:, :2].sum(axis=1), sums[:, 0], rtol=1e-14)
    np.testing.assert_array_equal(many[1], bundled.ligaments.stiffness)
    np.testing.assert_array_equal(many[:, 2:], many[:1, 2:].repeat(3, axis=0))


@pytest.mark.parametrize(
    ("quantity", "value", "keeps"),
    [
        ("stiffness", 9000.0, "ratio"),
        ("slack_length", 40.0, "ratio"),
        ("transition_strain", 0.05, "ratio"),
        ("reference_strain", 0.02, "difference"),
        ("tibial_attachment.superior", -33.0, "difference"),
    ],
)
def test_setting_a_group_keeps_how_its_fibres_differ(bundled, quantity, value, keeps):
    selection = select(bundled, [f"cruciates.{quantity}"])
    changed = selection.apply(bundled, jnp.array([value]))
    np.testing.assert_allclose(selection.read(changed), [value], rtol=1e-12)

    each = select(bundled, [f"ACL.{quantity}", f"PCL.{quantity}"])
    before, after = np.asarray(each.read(bundled)), np.asarray(each.read(changed))
    if keeps == "ratio":
        assert after[0] / after[1] == pytest.approx(before[0] / before[1], rel=1e-12)
    else:
        assert after[0] - after[1] == pytest.approx(before[0] - before[1], rel=1e-9)
    others = select(bundled, [f"MCL.{quantity}", f"LCL.{quantity}"])
    np.testing.assert_array_equal(others.read(changed), others.read(bundled))


def test_a_single_fibre_takes_its_value_to_the_last_digit(bundled):
    changed = bundled.replace({"ACL.stiffness": 1234.1})
    assert float(changed.ligaments.stiffness[0]) == 1234.1


def test_a_knee_with_other_numbers_is_differentiable(small_knee, central_difference):
    names = ("ACL.stiffness", "ACL.femoral_attachment.superior", "MCL.reference_strain",
             "medial.youngs_modulus")  # fmt: skip
    start = np.asarray(select(small_knee, names).read(small_knee))
    scale = np.maximum(np.abs(start), 0.1)

    @jax.jit
    def energy(values):
        changed = small_knee.replace(dict(zip(names, values * scale, strict=True)))
        modulus = changed.contacts[0].youngs_modulus
        return changed.ligaments.energy(small_knee.at_reference) * modulus

    exact = jax.jit(jax.grad(energy))(start / scale)
    numeric = central_difference(energy, start / scale, 1e-3)
    np.testing.assert_allclose(exact, numeric, rtol=1e-6)


def test_a_name_that_a_knee_has_not_is_answered_with_the_nearest(small_knee):
    with pytest.raises(UnknownParameter, match="did you mean 'ACL.stiffness'"):
        small_knee.replace({"ACL.stifness": 300.0})


def test_one_parameter_drives_the_energy_of_all_its_fibres(bundled, central_difference):
    selection = select(bundled, ["cruciates.stiffness", "MCL.reference_strain"])

    def energy(values):
        knee = selection.apply(bundled, values)
        return knee.ligaments.energy(bundled.at_reference)

    start = np.asarray(selection.read(bundled))
    exact = np.asarray(jax.jacfwd(energy)(jnp.asarray(start)))
    scale = np.array([1.0, 1e-3])
    numeric = central_difference(lambda x: energy(jnp.asarray(x * scale)), start / scale, 1e-2)
    np.testing.assert_allclose(exact, numeric / scale, rtol=1e-6)


def test_no_number_is_driven_twice(bundled):
    with pytest.raises(UnknownParameter, match="ACL.stiffness and cruciates.stiffness"):
        select(bundled, ["ACL.stiffness", "cruciates.stiffness"])
    with pytest.raises(UnknownParameter, match="one number .of ACL."):
        select(bundled, ["cruciates.slack_length", "all.reference_strain"])
    with pytest.raises(UnknownParameter, match="did you mean 'cruciates.stiffness'"):
        select(bundled, ["crucates.stiffness"])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("acl.stiffnes", "did you mean 'ACL.stiffness'"),
        ("*.stifness", r"did you mean '\*.stiffness'"),
        ("ACL.femoral_attachment.anteror", "did you mean 'ACL.femoral_attachment.anterior'"),
        # Nothing like it: what could stand there, and no wildcard for one part of a knee.
        ("patellar_tendon.tension", "expected a ligament, a group or a part of the knee, of ACL"),
        ("line.tensoin", "did you mean 'line.tension'"),
        ("ACL.tension", "tension': expected ACL. and one of stiffness, reference_strain"),
    ],
)
def test_the_nearest_name_is_one_that_would_be_right_there(bundled, name, said):
    with pytest.raises(UnknownParameter, match=said):
        select(bundled, [name])


def test_a_strain_is_that_of_the_moved_fibre_whatever_is_said_first(small_knee):
    values = {"ACL.reference_strain": 0.04, "ACL.femoral_attachment.superior": 6.0}
    for order in (values, dict(reversed(values.items()))):
        knee = small_knee.replace(order)
        selection = select(knee, list(values))
        np.testing.assert_allclose(selection.read(knee), [0.04, 6.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("values", "read"),
    [
        # A name counts before a wildcard, also a group's.
        ({"ACL.stiffness": 500.0, "*.stiffness": 3000.0},
         {"ACL.stiffness": 500.0, "PCL.stiffness": 3000.0}),
        ({"cruciates.stiffness": 9000.0, "*.stiffness": 3000.0},
         {"cruciates.stiffness": 9000.0, "MCL.stiffness": 3000.0}),
        ({"medial.youngs_modulus": 6.0, "*.youngs_modulus": 3.0},
         {"medial.youngs_modulus": 6.0, "lateral.youngs_modulus": 3.0}),
        # One number of several counts before all of them.
        ({"ACL.femoral_attachment.anterior": -9.0, "ACL.femoral_attachment": -5.0},
         {"ACL.femoral_attachment.anterior": -9.0, "ACL.femoral_attachment.superior": -5.0}),
    ],
)  # fmt: skip
def test_what_is_given_first_says_nothing(bundled, values, read):
    for order in (values, dict(reversed(values.items()))):
        knee = bundled.replace(order)
        selection = select(knee, list(read))
        np.testing.assert_allclose(selection.read(knee), [*read.values()], rtol=1e-12)


@pytest.mark.parametrize(
    ("values", "number"),
    [
        ({"ACL.stiffness": 500.0, "cruciates.stiffness": 9000.0}, "stiffness"),
        ({"ACL.slack_length": 31.0, "all.reference_strain": 0.02}, "slack length"),
        ({"ACL.slack_length": 31.0, "*.reference_strain": 0.02}, "slack length"),
        ({"*.slack_length": 31.0, "*.reference_strain": 0.02}, "slack length"),
    ],
)
def test_no_number_is_given_two_values(bundled, values, number):
    for order in (values, dict(reversed(values.items()))):
        with pytest.raises(UnknownParameter, match=f"give one number .{number} of ACL.: choose"):
            bundled.replace(order)


@pytest.mark.parametrize("value", [True, "500", [500.0, 600.0], None])
def test_what_is_no_number_is_refused(bundled, value):
    with pytest.raises(ValueError, match=r"ACL.stiffness: .*: expected a number"):
        bundled.replace({"ACL.stiffness": value})


def test_a_stiffness_that_is_given_beside_an_area_is_that_stiffness(small_knee):
    fibres = dataclasses.replace(small_knee.ligaments, area=jnp.full(4, 20.0))
    band = dataclasses.replace(small_knee, ligaments=fibres)
    for values in ({"ACL.stiffness": 500.0, "ACL.area": 40.0},
                   {"ACL.area": 40.0, "ACL.stiffness": 500.0}):  # fmt: skip
        found = band.replace(values).ligaments
        assert (float(found.stiffness[0]), float(found.area[0])) == (500.0, 40.0)
