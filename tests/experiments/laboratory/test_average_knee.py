"""The bundled knee that was calibrated to published motion and laxity shows them."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_bands
from kneejax.parameters import stated

#: Each compiles a search of its own.
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("average_knee")


def test_the_tibia_turns_inwards_with_flexion(knee):
    table = np.asarray(kj.passive_flexion(knee, [0.0, 30.0, 60.0, 90.0]).to_table("grood-suntay"))
    turned = np.diff(table[:, 2])
    assert (turned > 0.0).all()
    # Walker 1988: 14.9 degrees at 90.
    assert turned.sum() == pytest.approx(14.9, abs=2.0)


def test_its_anterior_laxity_is_that_of_twelve_knees(knee):
    (band,) = bundled_bands(cut=(), name="robot_anterior_90N")
    chosen = np.isfinite(band.sd)
    (test,) = kj.lab_tests("drawer", band.flexion_deg[chosen], force_N=90.0, steps=1)
    (curves,) = kj.load_curves(knee, test)
    found = np.array([row.positive for row in kj.laxity(curves)])
    assert (np.abs(found - band.mean[chosen]) < band.sd[chosen]).all()
    # Largest between 20 and 30 degrees, smallest at the ends.
    assert found[1:3].min() > max(found[0], found[-1])


def test_its_study_is_bundled_and_whole():
    study = kj.read_study("average_knee")
    assert study.knee.name == "average_knee"
    # It begins at the published numbers, about which the prior lies, not at what was fitted.
    assert study.start["ACLam.stiffness"] == 4920.0  # six fibres of 820 N
    whole = kj.load_knee("lenhart2015")
    published = np.asarray(study.selection.read(whole))
    np.testing.assert_allclose(study.selection.read(study.knee_at_start), published, rtol=1e-4)
    assert [test.driven_by for test in study.tests] == ["anterior_N", "anterior_N"]
    assert len(study.selection) == 32
    assert None not in stated(study.selection, study.prior, "prior")
    assert set(study.selection.names) == set(study.start)
