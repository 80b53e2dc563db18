"""Tests in which a machine moves or holds the tibia, and its force is read."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import MeasuredTest
from kneejax.geometry import CLINICAL
from kneejax.parameters import select
from kneejax.statics import Status
from tests.experiments.laboratory.curves import curves_of

#: Each compiles a search of its own.
pytestmark = pytest.mark.long

#: Test -> its load, and the displacement that a machine prescribes in its place.
BY_MACHINE = {
    "drawer": ({"force_N": 60.0}, "displacement_mm"),
    "torsion": ({"moment_Nm": 2.0}, "rotation_deg"),
    "varus-valgus": ({"moment_Nm": 5.0}, "rotation_deg"),
}


@pytest.mark.parametrize(
    "name", ["drawer", "torsion", pytest.param("varus-valgus", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("flexion_deg", [0.0, 30.0, 90.0])
def test_force_and_displacement_trace_the_same_curve(knee, name, flexion_deg):
    load, key = BY_MACHINE[name]
    by_load = curves_of(knee, name, [flexion_deg], steps=2, both=True, **load)
    moved = np.asarray(by_load.displacement)[0]
    known = np.isfinite(moved)
    (test,) = kj.lab_tests(name, [flexion_deg], **{key: 1.0})
    test = dataclasses.replace(test, path=tuple(moved[known].tolist()))
    (by_machine,) = kj.load_curves(knee, test)
    given = np.asarray(by_load.load(test.driven_by))[0, known]
    read = np.asarray(by_machine.load(test.driven_by))[0]
    assert known.sum() > 4
    assert read == pytest.approx(given, rel=1e-6, abs=1e-6)
    assert np.asarray(by_machine.to_table())[0] == pytest.approx(
        np.asarray(by_load.to_table())[0, known], abs=1e-6
    )


def test_a_machine_shows_what_is_beyond_the_load_that_a_knee_holds(knee):
    cut = kj.cut(knee, ["PCL"])
    by_load = curves_of(cut, "drawer", [90.0], steps=20, both=True)
    (held,) = kj.laxity(by_load)
    assert held.status == Status.GIVES_WAY
    (test,) = kj.lab_tests("drawer", [90.0], displacement_mm=20.0)
    test = dataclasses.replace(test, path=tuple(np.linspace(0.0, -1.0, 41).tolist()))
    (by_machine,) = kj.load_curves(cut, test)
    force = np.asarray(by_machine.load("anterior_N"))[0]
    assert np.isfinite(force).all()
    worst = int(np.argmin(force))
    # Between two of its places a smooth curve's least force is a little less than at either.
    assert force[worst] == pytest.approx(held.held_negative, rel=0.01)
    assert 0 < worst < len(force) - 1
    assert force[-1] > force[worst]


def test_a_displacement_counts_from_the_neutral_pose_along_the_floating_axis(knee):
    found = curves_of(
        knee, "drawer", [60.0], steps=2, displacement_mm=3.0, constant={"compression_N": 150.0}
    )
    assert np.asarray(found.displacement)[0] == pytest.approx([0.0, 1.5, 3.0, 1.5, 0.0], abs=1e-8)
    clinical = np.asarray(found.to_table(CLINICAL))[0, :, 3]
    assert clinical - clinical[0] == pytest.approx([0.0, 1.5, 3.0, 1.5, 0.0], abs=1e-8)
    # The machine adds no load to that: the search of the neutral pose serves its motion too.
    assert len(found.motion.load_cases.loads) == 1
    force = np.asarray(found.load("anterior_N"))[0]
    assert force[0] == pytest.approx(0.0, abs=1e-6)
    assert force[2] > force[1] > 0.0
    pressed = kj.passive_flexion(knee, 60.0, [kj.load_of(compression_N=[150.0])])
    assert np.asarray(found.to_table())[0, 0] == pytest.approx(
        np.asarray(pressed.to_table())[0], abs=1e-7
    )


def test_a_robot_takes_a_cut_knee_where_it_had_the_intact_one(knee):
    """At no displacement the tibia is on the intact path, where the cut knee is pushed back to."""
    torn = kj.cut(knee, ["ACL"])
    (test,) = kj.lab_tests("drawer", [30.0], displacement_mm=2.0, steps=1)
    (from_intact,) = kj.load_curves(torn, test, knee)
    intact, rest = (
        float(np.asarray(kj.passive_flexion(k, [30.0]).to_table(CLINICAL))[0, 3])
        for k in (knee, torn)
    )
    assert float(from_intact.neutral[0]) == pytest.approx(intact, abs=1e-8)
    assert np.asarray(from_intact.displacement)[0] == pytest.approx([0.0, 2.0, 0.0], abs=1e-8)
    # It takes what pulls the cut knee from where it rests to there, in the other sense.
    force = float(from_intact.driving_load[0, 0])
    assert rest > intact + 0.2
    assert force < -0.1
    (own,) = kj.load_curves(torn, dataclasses.replace(test, path=((intact - rest) / 2.0,)))
    assert float(own.driving_load[0, 0]) == pytest.approx(force, rel=1e-6)


def test_a_held_rotation_stays_where_it_is_without_the_load(knee):
    free = curves_of(knee, "drawer", [30.0], steps=2, force_N=80.0, both=True)
    held = curves_of(
        knee, "drawer", [30.0], steps=2, force_N=80.0, both=True, held=["internal_rotation"]
    )
    turned = np.asarray(held.to_table())[0, :, 2]
    assert turned == pytest.approx(turned[0], abs=1e-8)
    assert np.ptp(np.asarray(free.to_table())[0, :, 2]) > 0.5
    # What is held cannot give: the knee moves less, and the machine turns it back.
    assert (np.abs(held.displacement) <= np.abs(free.displacement) + 1e-8).all()
    moment = np.asarray(held.motion.reaction("internal_rotation"))[held.nodes][0]
    assert moment[held.steps[0]] == pytest.approx(0.0, abs=1e-4)
    assert np.abs(moment).max() > 10.0


def test_a_held_rotation_does_not_wait_for_the_load(knee):
    # Free, this knee gives way under 5 N backwards; held against varus it stays.
    cut = kj.cut(knee, ["PCL"])
    asked = {"steps": 2, "force_N": 20.0, "both": True}
    (free,) = kj.laxity(curves_of(cut, "drawer", [90.0], **asked))
    (held,) = kj.laxity(curves_of(cut, "drawer", [90.0], held=["adduction"], **asked))
    assert -6.0 < free.held_negative < 0.0
    assert (held.status, held.held_negative) == (Status.BALANCED, -20.0)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("drawer", {"displacement_mm": 4.0}),
        pytest.param("torsion", {"rotation_deg": 6.0}, marks=pytest.mark.slow),
        pytest.param(
            "drawer", {"force_N": 80.0, "held": ["internal_rotation"]}, marks=pytest.mark.slow
        ),
    ],
)
def test_exact_derivatives(knee, central_difference, name, options):
    names = "ACL.stiffness", "PCL.reference_strain", "PCL.femoral_attachment.superior"
    selection = select(knee, names)
    (test,) = kj.lab_tests(name, [30.0], steps=1, both=True, **options)

    def seen(values):
        (curves,) = kj.load_curves(selection.apply(knee, values), test)
        displaced, load = curves.displacement_by_load[0], curves.driving_load[0]
        turning = [curves.motion.reaction(held)[curves.nodes[0]] for held in test.held]
        return jnp.stack([displaced, load, *turning])

    start = jnp.asarray(selection.read(knee))
    size = np.asarray(jnp.abs(start))
    exact = np.asarray(jax.jacfwd(seen)(start)) * size
    by_steps = central_difference(lambda x: seen(jnp.asarray(x) * size), np.asarray(start) / size)
    assert exact == pytest.approx(by_steps, rel=1e-6, abs=1e-6 * np.abs(exact).max())


def test_the_answer_of_a_machine_is_a_measured_test(knee):
    found = curves_of(knee, "drawer", [30.0, 60.0], steps=2, displacement_mm=3.0, both=True)
    measured = MeasuredTest.of(found)
    assert set(measured.loads) == {"anterior_N"}
    force, moved = measured.loads["anterior_N"], measured.observed[:, 2]
    assert (np.sign(force) == np.sign(moved)).all()
    turned = curves_of(knee, "drawer", [30.0], steps=1, held=["adduction"])
    with pytest.raises(ValueError, match="adduction is held"):
        MeasuredTest.of(turned)


def test_laxity_tells_the_force_at_both_ends(knee):
    found = curves_of(knee, "drawer", [30.0], steps=4, displacement_mm=4.0, both=True)
    (row,) = kj.laxity(found)
    force = np.asarray(found.load("anterior_N"))[0]
    assert (row.positive, row.negative) == pytest.approx((4.0, -4.0))
    assert (row.held_positive, row.held_negative) == pytest.approx((force[4], force[12]))
    assert row.stiffness_end == pytest.approx(((force[4] - force[3]) + (force[11] - force[12])) / 2)


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("drawer", {"rotation_deg": 3.0}, "rotation_deg: drawer; expected displacement_mm"),
        ("torsion", {"displacement_mm": 3.0}, "displacement_mm: torsion; expected rotation_deg"),
        ("drawer", {"displacement_mm": 3.0, "force_N": 9.0}, "load too; expected one of the two"),
        ("pivot", {"rotation_deg": 3.0}, "rotation_deg: pivot; expected a test that a machine"),
        ("compression", {"displacement_mm": 3.0}, "expected a test that a machine can drive"),
        ("envelope", {"displacement_mm": 3.0}, "displacement_mm: envelope; expected a test"),
        ("torsion", {"held": ["internal_rotation"]}, "held: 'internal_rotation'; expected no"),
        ("pivot", {"held": ["adduction"]}, "no coordinate that the test itself moves"),
        ("drawer", {"held": ["lateral"]}, "adduction, internal_rotation"),
    ],
)
def test_what_a_machine_cannot_do_is_refused(name, options, says):
    with pytest.raises(ValueError, match=says):
        kj.lab_tests(name, **options)


def test_tests_of_one_call_prescribe_the_same(knee):
    by_load, by_machine = kj.lab_tests("drawer"), kj.lab_tests("drawer", displacement_mm=2.0)
    with pytest.raises(ValueError, match=r"different coordinates \(nothing; drawer\)"):
        kj.load_curves(knee, [*by_load, *by_machine])
