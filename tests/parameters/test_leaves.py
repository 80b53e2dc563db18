"""Any number of a knee is a parameter by name."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import FEMUR, PATELLA, TIBIA
from kneejax.mechanics import Implausible
from kneejax.numerics import compiled
from kneejax.parameters import UnknownParameter, default_bounds, prior_scales, select
from kneejax.statics import LoadCases, balance_with_slopes


@pytest.fixture(scope="module")
def wrapped():
    return kj.load_knee("lenhart2015")


def test_names_lead_to_the_numbers_that_they_name(knee, wrapped):
    contact, line = knee.contacts[0], knee.lines[0]
    named = {
        "medial.youngs_modulus": contact.youngs_modulus,
        "medial.layer_thickness": contact.layer_thickness,
        "medial.tibial_surface.superior": contact.tibial.frame.origin[1],
        "medial.femoral.coefficients.3.2": contact.femoral.coefficients[3, 2],
        f"{line.name}.tension": line.tension,
        f"{line.name}.insertion.lateral": line.insertion[2],
        "ACL.stiffness": knee.ligaments.stiffness[knee.ligaments.names.index("ACL")],
    }
    selection = select(knee, list(named))
    expected = [float(x) for x in named.values()]
    np.testing.assert_array_equal(selection.read(knee), expected)
    assert [selection.unit(i) for i in range(3)] == ["MPa", "mm", "mm"]
    course = next(c for c in wrapped.ligaments.courses if hasattr(c.obstacle, "radius"))
    fibre = wrapped.ligaments.names[course.rows[0]]
    radius = select(wrapped, [f"{fibre}.radius"]).read(wrapped)
    assert float(radius[0]) == float(course.obstacle.radius)


def test_writing_changes_that_number_and_no_other(knee):
    selection = select(knee, ["lateral.youngs_modulus", "medial.tibial_surface.superior"])
    values = selection.read(knee) + 0.5
    changed = selection.apply(knee, values)
    np.testing.assert_allclose(selection.read(changed), values)
    pairs = zip(*map(jax.tree.leaves, (knee, changed)), strict=True)
    moved = sum(int((np.asarray(a) != np.asarray(b)).sum()) for a, b in pairs)
    assert moved == 2


def test_a_name_of_several_numbers_frees_all_of_them(knee):
    assert select(knee, ["ACL.femoral_attachment"]).names == (
        "ACL.femoral_attachment.anterior",
        "ACL.femoral_attachment.superior",
        "ACL.femoral_attachment.lateral",
    )
    assert len(select(knee, ["medial.tibial.coefficients"])) == 9
    assert select(knee, ["*.youngs_modulus"]).names == (
        "medial.youngs_modulus", "lateral.youngs_modulus",
    )  # fmt: skip


#: Numbers of every part: of both surfaces, of law and layer, of a fibre's end and of a line.
LEAVES = ("medial.youngs_modulus", "lateral.layer_thickness", "medial.tibial_surface.superior",
          "lateral.femoral_surface.anterior", "PCL.tibial_attachment.superior",
          "medial.femoral.coefficients.0.1", "patellar_tendon.tension")  # fmt: skip
FLEXION = [10.0, 40.0, 80.0]


@pytest.mark.long
def test_leaves_are_calibrated_without_a_line_written_for_them(knee):
    """Poses made with other values of them lead back to those values."""
    selection = select(knee, LEAVES)
    begin = np.asarray(selection.read(knee))
    low, high = map(np.asarray, default_bounds(knee, selection))
    width = 0.02 * (high - low)
    truth = begin + 0.5 * width
    near = dict(zip(LEAVES, zip(begin - width, begin + width, strict=True), strict=True))
    made = kj.passive_flexion(selection.apply(knee, jnp.asarray(truth)), FLEXION)
    study = kj.Study(
        title="leaves", knee=knee, measured=made.to_table(), parameters=LEAVES, bounds=near,
        procedures=["III"], noise_mm=0.1, noise_deg=0.1,
    )  # fmt: skip
    found = kj.calibrate(study)
    for name, value, size in zip(LEAVES, truth, width, strict=True):
        assert found[name].value == pytest.approx(value, abs=1e-4 * size), name


@pytest.mark.long
def test_slopes_of_other_parts_are_central_differences(knee):
    selection, load_cases = select(knee, LEAVES), LoadCases.at(FLEXION)
    values = np.asarray(selection.read(knee))[None]
    found = balance_with_slopes(knee, selection.apply, values, load_cases)
    steps = 1e-3 * np.array([values[0, 0], 1.0, 0.1, 0.1, 1.0, 0.1, values[0, 6]])
    along = np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * np.diag(steps)
    moved = (values + along).reshape(-1, len(steps))
    near = found.take(np.zeros(len(moved), int))
    q = balance_with_slopes(knee, selection.apply, moved, load_cases, near).q
    q = q.reshape(4, len(steps), *q.shape[1:])
    slopes = (q[0] - 8 * q[1] + 8 * q[2] - q[3]) / (12 * steps[:, None, None])
    for slope, exact in zip(slopes, np.moveaxis(found.jacobian[0], -1, 0), strict=True):
        np.testing.assert_allclose(slope, exact, atol=2e-6 * np.abs(exact).max())


def test_what_is_not_there_is_named_with_the_nearest_that_is(knee):
    with pytest.raises(UnknownParameter, match="did you mean 'medial.youngs_modulus'"):
        select(knee, ["medial.young_modulus"])
    with pytest.raises(UnknownParameter, match="did you mean 'medial.youngs_modulus'"):
        select(knee, ["medal.youngs_modulus"])
    with pytest.raises(UnknownParameter, match="are one number"):
        select(knee, ["medial.tibial_surface.superior", "medial.tibial.frame.origin.superior"])
    with pytest.raises(Implausible, match="Pa are suspected"):
        knee.replace({"medial.youngs_modulus": 5e6})


def test_every_parameter_has_bounds_and_a_width_of_its_prior(knee):
    selection = select(knee, ["medial.youngs_modulus", "medial.tibial_surface", "ACL.stiffness"])
    values, (lower, upper) = selection.read(knee), default_bounds(knee, selection)
    assert (np.asarray(lower) < np.asarray(values)).all()
    assert (np.asarray(values) < np.asarray(upper)).all()
    assert (prior_scales(selection, values) > 0).all()


@pytest.mark.long
def test_muscles_and_the_patella_have_numbers_with_names():
    knee = kj.load_knee("lenhart2015_reduced", patella=True)
    row = knee.muscles.names.index("vasint")
    given = {"vasint.tension": 50.0, "vasint.insertion.lateral": 3.0, "PTc.stiffness": 5000.0,
             "patellofemoral.layer_thickness": 5.0}  # fmt: skip
    changed = knee.replace(given)
    assert changed.muscles.tension[row] == 50.0
    assert changed.muscles.tibial_attachment[row, 2] == 3.0
    assert changed.contacts[-1].layer_thickness == 5.0
    others = np.delete(np.arange(len(knee.muscles.names)), row)
    np.testing.assert_array_equal(changed.muscles.tension[others], knee.muscles.tension[others])
    assert select(knee, ["recfem.origin"]).names == tuple(
        f"recfem.origin.{axis}" for axis in ("anterior", "superior", "lateral")
    )
    with pytest.raises(UnknownParameter, match="one of tension, insertion, origin"):
        select(knee, ["vasint.courses"])


def test_ends_are_named_by_the_bones_that_they_are_on():
    knee = kj.load_knee("lenhart2015_reduced", patella=True)
    fibres = knee.ligaments
    of_pairs = {pair: row for row, pair in enumerate(fibres.bodies)}
    tendon, band = of_pairs[PATELLA, TIBIA], of_pairs[FEMUR, PATELLA]
    for row, name, array in (
        (tendon, "patellar_attachment", "femoral_attachment"),
        (tendon, "tibial_attachment", "tibial_attachment"),
        (band, "femoral_attachment", "femoral_attachment"),
        (band, "patellar_attachment", "tibial_attachment"),
    ):
        free = select(knee, [f"{fibres.names[row]}.{name}"])
        assert free.read(knee).tolist() == np.asarray(getattr(fibres, array))[row].tolist()
        moved = free.apply(knee, free.read(knee) + 1.0).ligaments
        expected = dataclasses.replace(
            fibres, **{array: getattr(fibres, array).at[row].add(1.0)}
        )
        assert jax.tree.all(jax.tree.map(np.array_equal, moved, expected))
    ends = "joins patella and tibia; its ends are tibial_attachment and patellar_attachment"
    with pytest.raises(UnknownParameter, match=ends):
        select(knee, [f"{fibres.names[tendon]}.femoral_attachment"])


def test_lengths_follow_ends_and_strains_backwards(wrapped, central_difference):
    # Fibres of one kind are not neighbours here: what was read through a gather ended the process
    # while XLA compiled this.
    names = ["ACLam.reference_strain", "MCLd.reference_strain", "ACLam.femoral_attachment",
             "ACLam.tibial_attachment"]  # fmt: skip
    selection = select(wrapped, names)
    values = selection.read(wrapped)

    def found(values):
        ligaments = selection.apply(wrapped, values).ligaments
        return ligaments.slack_length, ligaments.femoral_attachment, ligaments.tibial_attachment

    @compiled()
    def backwards(lanes, weights):
        every, pull = jax.vjp(jax.vmap(found), lanes)
        weighed = jax.tree.map(lambda w, x: jnp.broadcast_to(w, x.shape), tuple(weights), every)
        return pull(weighed)[0]

    slope = jax.jit(jax.vmap(backwards, (None, 0)))(jnp.tile(values, (2, 1)), jnp.eye(3))[:, 0]
    sums = jax.jit(lambda values: jnp.stack([jnp.sum(x) for x in found(values)]))
    expected = central_difference(sums, values, 1e-4)
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-6)
