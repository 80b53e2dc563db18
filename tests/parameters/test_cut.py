"""What is cut of a knee by name: ligaments, menisci, parts of menisci."""

import dataclasses

import equinox as eqx
import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax.inference.fit import without
from kneejax.mechanics import Ring
from kneejax.parameters import UnknownParameter, cut


@pytest.fixture(scope="module")
def knee():
    """The average knee with a ring in its medial meniscus alone."""
    knee = kj.load_knee("average_knee")
    ring = Ring(100.0, 30.0, 200.0, 50.0, [0.0, 0.0], np.deg2rad([135.0, 405.0]))
    contacts = list(knee.contacts)
    for name, own in (("medial_meniscus", ring), ("lateral_meniscus", None)):
        row = knee.contact_names.index(name)
        contacts[row] = dataclasses.replace(contacts[row], ring=own)
    return dataclasses.replace(knee, contacts=tuple(contacts))


area_of = eqx.filter_jit(lambda contact: contact.foundation.points.area.sum())


def area(knee, name):
    return float(area_of(knee.contacts[knee.contact_names.index(name)]))


def test_a_meniscus_is_removed_and_nothing_else(knee):
    found = cut(knee, ["medial_meniscus", "ACL"])
    assert area(found, "medial_meniscus") == 0.0
    for name in ("medial", "lateral", "lateral_meniscus"):
        assert area(found, name) == area(knee, name) > 0.0
    assert np.sum(np.asarray(found.ligaments.stiffness) == 0.0) == len(dict(knee.groups)["ACL"])
    shapes = [jax.tree.map(np.shape, one) for one in (found, knee)]
    assert shapes[0] == shapes[1]  # one program for both


@pytest.mark.parametrize(
    ("part", "left"), [("inner=0.5", 0.6), ("posterior=0.4", 0.6), ("inner=0.5,anterior=0.3", 0.87)]
)
def test_a_part_of_a_meniscus_is_removed(knee, part, left):
    found = cut(knee, [f"medial_meniscus:{part}"])
    share = area(found, "medial_meniscus") / area(knee, "medial_meniscus")
    assert share == pytest.approx(left, abs=0.08)


def test_a_fit_cuts_what_a_test_had_cut(knee):
    """After its numbers are set, as ligaments."""
    selection = kj.select(knee, ["ACL.stiffness", "medial_meniscus.hoop_modulus"])
    values = np.array([5000.0, 60.0])
    names = ("ACL", "medial_meniscus:posterior=0.4", "lateral_meniscus")
    base, vary = without(knee, selection, names)
    own, other = vary(base, values), cut(selection.apply(knee, values), names)
    for one, two in zip(jax.tree.leaves(own), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("medial_menisci", "no meniscus 'medial_menisci'; did you mean medial_meniscus?"),
        ("lateral_meniscus:inner=0.5", "expected the whole meniscus, since this one has no ring"),
        ("medial_meniscus:iner=0.5", "'iner=0.5': expected inner=PART, between 0 and 1"),
        ("medial_meniscus:inner=50", "expected inner=PART, between 0 and 1"),
        ("medial_meniscus:anterior=0.6,posterior=0.4", "expected less than the whole arc"),
        ("AC", "no ligament 'AC'; did you mean"),
    ],
)
def test_what_cannot_be_cut_is_said(knee, name, said):
    with pytest.raises(UnknownParameter, match=said):
        cut(knee, [name])


def test_a_knee_without_menisci_says_so():
    with pytest.raises(UnknownParameter, match="'four_ligament' has no menisci"):
        cut(kj.load_knee("four_ligament"), ["medial_meniscus"])
