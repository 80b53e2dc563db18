"""Second stable balances: found from the intact knee's side, and followed."""

import types

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import _activity, activity, lab_tests, load_curves, second_balances
from kneejax.experiments import _motion as second
from kneejax.experiments._branches import SecondBalances, changed_in_steps
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import LegRecord, Muscles
from kneejax.parameters import cut
from kneejax.statics import LoadCases, Status

ANTERIOR = FREE_COORDINATES.index("anterior")


def double_well(load, begin):
    """Where a body in the energy (x^2 - 9)^2 / 36 - load x rests that rolls down from `begin`."""
    x = begin
    for _ in range(4000):
        x = x - 0.05 * (x * (x**2 - 9.0) / 9.0 - load)
    return x


@pytest.fixture
def two_wells(monkeypatch):
    """A knee that moves forwards and backwards only, with two places to rest; and its calls."""
    calls = []

    def near(knee, vary, base, load_cases, q, contact_points):
        load = np.asarray(load_cases.loads[0].force)[:, 0]
        calls.append(float(np.sum(np.asarray(knee.ligaments.stiffness))))
        found, contact_points = np.array(q)[0], np.asarray(contact_points)[0]
        begin = found[:, ANTERIOR]
        found[:, ANTERIOR] = [double_well(*pair) for pair in zip(load, begin, strict=True)]
        nodes = {"q": found, "contact_points": contact_points,
                 "status": np.full(len(load), int(Status.BALANCED))}  # fmt: skip
        return types.SimpleNamespace(in_nodes=lambda: nodes, reached=np.ones((1, len(load))))

    monkeypatch.setattr(second, "balance_near", near)
    return calls


def guessed(x):
    """Balances of which only the anterior translation is known."""
    q = np.zeros((len(x), 5))
    q[:, ANTERIOR] = x
    return {"q": q, "contact_points": np.zeros((len(x), 2, 2))}


def load_cases(load):
    return LoadCases.at(30.0, [kj.load_of(anterior_N=np.asarray(load, float))])


def test_a_second_balance_is_followed_as_far_as_it_exists(two_wells, knee):
    """Up to the load at which one of the two wells vanishes, 2 / sqrt(3) here, either way."""
    load = np.linspace(-2.0, 2.0, 21)
    main = guessed([double_well(f, -3.0) for f in load])
    main["status"] = np.full(len(load), int(Status.BALANCED))
    known = SecondBalances(knee, load_cases(load), main)
    other = known.found
    other["q"][10], other["contact_points"][10] = 0.0, 0.0
    other["q"][10, ANTERIOR] = 3.0
    known.follow(np.arange(len(load))[None])
    known = np.isfinite(other["q"]).all(axis=1)
    limit = 2.0 / np.sqrt(3.0)
    assert known.tolist() == (np.abs(load) < limit).tolist()
    np.testing.assert_allclose(
        other["q"][known, ANTERIOR], [double_well(f, 3.0) for f in load[known]], atol=1e-6
    )


def test_a_jump_of_what_is_reported_is_looked_at_from_both_sides(two_wells, knee):
    load = np.linspace(-0.5, 0.5, 6)
    main = guessed([double_well(f, 3.0 if f > 0 else -3.0) for f in load])
    main["status"] = np.full(len(load), int(Status.BALANCED))
    known = SecondBalances(knee, load_cases(load), main)
    known.follow(np.arange(len(load))[None])
    other = known.found
    assert np.isfinite(other["q"]).all()
    assert (np.sign(other["q"][:, ANTERIOR]) == -np.sign(main["q"][:, ANTERIOR])).all()


def test_a_ligament_is_cut_in_steps_and_what_was_cut_pulls_nothing(two_wells, knee):
    torn = cut(knee, ["ACL"])
    begin = [*guessed([-3.0, 3.0]).values()]
    found = changed_in_steps(knee, torn, load_cases([0.2, 0.2]), begin)
    assert np.sign(found["q"][:, ANTERIOR]).tolist() == [-1.0, 1.0]
    whole, last = (float(jnp.sum(x.ligaments.stiffness)) for x in (knee, torn))
    assert two_wells == pytest.approx([last + part * (whole - last) for part in (0.1, 0.01, 0.0)])
    # A knee with other parts is none that was changed.
    other = kj.load_knee("ten_bundle")
    assert changed_in_steps(knee, other, load_cases([0.2, 0.2]), begin) is None


def test_the_balance_on_the_path_from_the_unloaded_knee_is_reported(two_wells, knee, monkeypatch):
    """A record stays in the well of its neighbours in time; the path of each instant, from no load
    on, leads to the one to which its load points."""
    load = np.full(17, 0.4)
    load[5:8] = -0.4
    near = second.balance_near

    def one(knee, at):
        force = np.asarray(at.loads[0].force)[:, 0]
        begin = guessed(np.sign(force))
        return near(knee, None, None, at, begin["q"][None], begin["contact_points"][None])

    monkeypatch.setattr(_activity, "balance_one", one)
    found, beside = _activity.Instants.of(knee, load_cases(load))
    x, other = found.nodes["q"][:, ANTERIOR], beside.found["q"][:, ANTERIOR]
    assert np.sign(x).tolist() == np.sign(load).tolist()
    assert np.sign(other).tolist() == (-np.sign(load)).tolist()


def drawer_record(force, compression):
    count = len(force)
    pose, wrench = np.zeros((count, 6)), np.zeros((count, 6))
    pose[:, 0], wrench[:, 0], wrench[:, 1] = 25.0, force, compression
    ends = np.zeros((0, 3, count))
    muscles = Muscles(ends, ends, np.zeros((0, count)), ())
    time, still = np.linspace(0.0, 1.0, count), np.zeros((count, 3))
    return LegRecord(
        time, pose, {"device": wrench}, muscles, np.zeros(count), still, False, 0.0
    )  # fmt: skip


@pytest.mark.slow
def test_of_a_drawer_without_an_acl_both_balances_are_known():
    """Drawn back by a third of the compression the tibia may rest where it is, or 20 mm forwards:
    that depends on whether it was pressed before the ACL was cut, or after."""
    knee = kj.load_knee("lenhart2015_reduced")
    torn = cut(knee, ["ACL"])
    force = np.array([0.0, -18.5, -35.3, -57.1, -60.0, -57.1, -35.3, -18.5, 0.0])
    record = drawer_record(force, 200.0)
    intact = activity(knee, record)
    assert np.isnan(intact.other).all()
    found = activity(torn, record, near=intact)
    table = np.asarray(found.motion.to_table())
    back = np.abs(force) > 30.0
    assert found.holds.all()
    assert np.abs(table[back] - np.asarray(intact.motion.to_table())[back]).max() < 2.0
    assert (np.isfinite(found.other).all(axis=1) == back).all()
    assert (found.other[back, 3] > 15.0).all() and (table[~back, 3] > 15.0).all()
    # The laboratory cuts first: there the other one is reported, and this one named.
    (test,) = lab_tests("drawer", [25.0], force_N=60.0, both=True, steps=4,
                        constant={"compression_N": 200.0})  # fmt: skip
    (curves,) = load_curves(torn, [test])
    other = second_balances(curves, knee)[0]
    known = np.isfinite(other).all(axis=1)
    assert known[:2].all() and not known[curves.part > -0.4].any()
    here = np.asarray(curves.motion.to_table())[curves.nodes[0]]
    assert (np.abs(other[known, 3]) < 3.0).all() and (here[known, 3] > 15.0).all()
