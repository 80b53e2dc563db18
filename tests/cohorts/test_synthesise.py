"""Made-up knees: their sizes, their truth, and what they depend on."""

import dataclasses

import numpy as np
import pytest

from kneejax.cohorts import Protocol, Spread, synthesise
from kneejax.files import load_knee
from kneejax.files.knee.file import build_knee
from kneejax.parameters import UnsuitableData

pytestmark = pytest.mark.usefixtures("optimised_code")

SHORT = Protocol(passive_deg=(0.0, 30.0), flexion_deg=(30.0,), steps=3)
SAME = Spread(size=0.1, attachment_mm=0.0, stiffness=0.0, reference_strain=0.0)


@pytest.fixture(scope="module")
def three():
    return list(synthesise(3, seed=1, protocol=SHORT))


def test_a_knee_depends_on_the_seed_and_its_own_number(three):
    (first,) = synthesise(1, seed=1, protocol=SHORT)
    (other,) = synthesise(1, seed=2, protocol=SHORT)
    assert [one.name for one in three] == ["K001", "K002", "K003"]
    assert first.truth == three[0].truth and first.document == three[0].document
    np.testing.assert_array_equal(first.passive, three[0].passive)
    assert other.truth != first.truth
    assert len({one.size for one in three}) == 3


def test_a_larger_knee_is_larger_in_every_length_of_its_bones():
    (made,) = synthesise(1, seed=5, spread=SAME, protocol=SHORT)
    base, own = load_knee("four_ligament"), build_knee(made.document, "K001").knee
    ratio = np.asarray(own.reference_length()) / np.asarray(base.reference_length())
    np.testing.assert_allclose(ratio, made.size, rtol=1e-4)
    assert abs(made.size - 1.0) > 0.01
    np.testing.assert_allclose(own.reference_strain(), base.reference_strain(), atol=1e-12)
    # The layer of cartilage and its law are not lengths of the bone.
    own_medial, medial = own.contacts[0], base.contacts[0]
    assert own_medial.layer_thickness == medial.layer_thickness


def test_noise_is_what_is_stated():
    spread = dataclasses.replace(SAME, noise_mm=0.5, noise_deg=0.1)
    long = Protocol(passive_deg=tuple(np.arange(0.0, 91.0, 1.0)), flexion_deg=(30.0,), steps=3)
    (made,) = synthesise(1, seed=0, spread=spread, protocol=long)
    tiny = dataclasses.replace(spread, noise_mm=1e-12, noise_deg=1e-12)
    (exact,) = synthesise(1, seed=0, spread=tiny, protocol=long)
    left = (made.passive - exact.passive)[:, 1:].std(axis=0)
    np.testing.assert_allclose(left, [0.1, 0.1, 0.5, 0.5, 0.5], rtol=0.25)
    assert (made.tests[0].sd_mm, made.tests[0].sd_deg) == (0.5, 0.1)


def test_distributions_without_balance_are_said():
    wild = dataclasses.replace(SAME, reference_strain=80.0)
    with pytest.raises(UnsuitableData, match="K001: 50 draws in a row have no balance"):
        list(synthesise(1, spread=wild, protocol=SHORT))
