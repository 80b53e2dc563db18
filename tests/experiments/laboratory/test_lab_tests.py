"""Tests under load: what acts is what was asked for, and the answer obeys mechanics."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson

import kneejax as kj
from kneejax.experiments import LAXITY_COLUMNS, READY
from kneejax.geometry import State
from kneejax.mechanics import add_lane_axis, load_called
from kneejax.parameters import select
from kneejax.statics import Status
from tests.experiments.laboratory.curves import curves_of


def test_a_load_goes_up_and_down_both_ways():
    assert kj.load_cycle(2) == (0.0, 0.5, 1.0, 0.5, 0.0)
    path = np.array(kj.load_cycle(20, both=True))
    assert len(path) == 81
    assert np.abs(np.diff(path)).max() == pytest.approx(0.05)
    assert (path[0], path[20], path[60], path[-1]) == (0.0, 1.0, -1.0, 0.0)
    with pytest.raises(ValueError, match="at least 1"):
        kj.load_cycle(0)


def test_every_ready_test_works_along_what_it_observes():
    for name, kind in READY.items():
        (test,) = kj.lab_tests(name)
        if name != "pivot":  # which observes what a valgus moment does to the anterior translation
            assert load_called(test.observed) == test.driven_by
        assert test.flexion_deg == kind.flexion_deg


def test_an_envelope_is_three_tests_both_ways():
    tests = kj.lab_tests("envelope", [0.0, 30.0], force_N=80.0, moment_Nm=8.0)
    assert [test.full for test in tests] == [
        {"anterior_N": 80.0}, {"varus_Nm": 8.0}, {"internal_Nm": 4.0}
    ]  # fmt: skip
    assert all(min(test.path) == -1.0 for test in tests)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"full": {"anterior": 1.0}}, "anterior_N"),
        ({"full": {}}, "expected a load, or a displacement"),
        ({"observed": "flexion"}, "adduction"),
        ({"constant": {"axial_N": 3.0}}, "compression_N"),
        ({"path": ()}, "path: nothing; expected a number at least"),
    ],
)
def test_what_is_no_test_is_refused(change, says):
    good = kj.LabTest("own", {"anterior_N": 1.0}, "anterior", (0.0,), (0.0, 1.0))
    with pytest.raises(ValueError, match=says):
        dataclasses.replace(good, **change)


def test_a_force_is_no_moment():
    with pytest.raises(ValueError, match="moment_Nm: drawer; expected force_N"):
        kj.lab_tests("drawer", moment_Nm=3.0)
    with pytest.raises(ValueError, match="test: 'drawr'; expected one of drawer"):
        kj.lab_tests("drawr")


@pytest.mark.long
@pytest.mark.parametrize("name", ["drawer", "torsion", "varus-valgus"])
def test_the_work_of_the_load_is_the_change_of_energy(knee, name):
    found = curves_of(knee, name, [30.0], steps=160)
    rows = found.nodes[0, found.steps[:161]]
    load = np.asarray(found.load(found.test.driven_by))[0, :161]
    moved = np.asarray(found.displacement)[0, :161]
    if found.test.driven_by.endswith("_Nm"):
        load, moved = 1000.0 * load, np.deg2rad(moved)
    pose = jax.tree.map(lambda x: x[np.array([rows[0], rows[-1]])], found.motion.pose)
    energy = np.asarray(add_lane_axis(knee).energy(State({"tibia": pose})))
    assert simpson(load * np.gradient(moved, edge_order=2)) == pytest.approx(
        energy[1] - energy[0], rel=2e-4
    )
    # Integrated over the load, which is even: what is not done is the complementary work.
    work = load[-1] * moved[-1] - simpson(moved, x=load)
    assert work == pytest.approx(energy[1] - energy[0], rel=1e-6)


def test_no_load_depends_on_the_others(knee):
    few = curves_of(knee, "torsion", [60.0], steps=2, both=True)
    many = curves_of(knee, "torsion", [60.0, 0.0, 45.0], steps=8, both=True)
    every = np.asarray(many.to_table())[0, ::4]
    assert np.asarray(few.to_table())[0] == pytest.approx(every, abs=1e-8)


@pytest.mark.long
def test_no_test_depends_on_those_made_with_it(knee):
    envelope = kj.lab_tests("envelope", [0.0, 45.0], steps=3)
    (pressed,) = kj.lab_tests("drawer", [45.0], steps=2, constant={"compression_N": 100.0})
    together = kj.load_curves(knee, [*envelope, pressed])
    for test, found in zip([*envelope, pressed], together, strict=True):
        (alone,) = kj.load_curves(knee, test)
        assert np.asarray(found.to_table()) == pytest.approx(np.asarray(alone.to_table()), abs=1e-8)
    with pytest.raises(ValueError, match="at least one"):
        kj.load_curves(knee, [])


def test_small_loads_superpose(knee):
    share = {"anterior_N": 0.02, "varus_Nm": 0.001}
    path = (0.0, 1.0)

    def moved(full):
        test = kj.LabTest("own", full, "anterior", (45.0,), path)
        table = np.asarray(kj.load_curves(knee, test)[0].to_table())[0]
        return table[1] - table[0]

    alone = sum(moved({name: size}) for name, size in share.items())
    assert moved(share) == pytest.approx(alone, abs=2e-3 * np.abs(alone).max())


def test_the_neutral_pose_is_the_one_under_what_acts_throughout(knee):
    pressed = curves_of(knee, "drawer", [30.0], steps=1, constant={"compression_N": 200.0})
    alone = kj.passive_flexion(knee, 30.0, [kj.load_of(compression_N=[200.0])])
    neutral = np.asarray(pressed.to_table())[0, 0]
    assert neutral == pytest.approx(np.asarray(alone.to_table())[0], abs=1e-8)
    assert float(pressed.displacement[0, 0]) == 0.0
    assert pressed.load("compression_N").tolist() == [[200.0, 200.0, 200.0]]


def test_where_a_knee_gives_way_the_load_is_named(knee):
    found = curves_of(kj.cut(knee, ["PCL"]), "drawer", [90.0], steps=5, both=True)
    (row,) = kj.laxity(found)
    assert row.status == Status.GIVES_WAY
    assert -20.0 < row.held_negative < 0.0
    assert np.isnan(row.negative)
    # The turning point is where it is, whatever load was asked for beyond it.
    (other,) = kj.laxity(
        curves_of(kj.cut(knee, ["PCL"]), "drawer", [90.0], steps=3, both=True, force_N=60.0)
    )
    assert other.held_negative == pytest.approx(row.held_negative, rel=1e-3)


def test_laxity_is_read_off_the_curve(knee):
    found = curves_of(knee, "drawer", [20.0], steps=4, both=True)
    (row,) = kj.laxity(found)
    moved = np.asarray(found.displacement)[0]
    assert (row.positive, row.negative) == (moved[4], moved[12])
    assert row.range == pytest.approx(moved[4] - moved[12])
    slopes = 25.0 / np.abs([moved[1], moved[9]])
    assert row.stiffness_start == pytest.approx(slopes.mean())
    assert [*LAXITY_COLUMNS][:4] == ["test", "flexion_deg", "coordinate", "range"]
    assert len(row.row) == len(LAXITY_COLUMNS)


def test_a_test_of_the_negative_sense_is_read_the_same(knee):
    (test,) = kj.lab_tests("distraction", [30.0], steps=4)
    (pulled,) = kj.laxity(kj.load_curves(knee, test)[0])
    assert pulled.negative < 0.0
    assert pulled.held_negative == -50.0
    assert np.isnan(pulled.positive)
    (pivot,) = kj.laxity(curves_of(knee, "pivot", [30.0], steps=2))
    assert np.isnan(pivot.stiffness_start)


@pytest.mark.long
def test_a_curve_has_exact_derivatives(knee, central_difference):
    selection = select(knee, ["ACL.stiffness", "PCL.reference_strain"])
    (test,) = kj.lab_tests("drawer", [30.0], steps=2, both=True)

    def moved(values):
        return kj.load_curves(selection.apply(knee, values), test)[0].displacement_by_load[0]

    start = jnp.asarray(selection.read(knee))
    exact = np.asarray(jax.jacfwd(moved)(start))
    size = np.asarray(jnp.abs(start))
    by_steps = central_difference(lambda x: moved(jnp.asarray(x) * size), np.asarray(start) / size)
    assert exact * size == pytest.approx(by_steps, rel=1e-6, abs=1e-7)
