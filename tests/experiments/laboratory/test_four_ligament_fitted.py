"""The bundled knee of four lines that was fitted to published motion and laxity shows them."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_bands, load_knee_file
from kneejax.parameters import select

NAME, ENDS = "four_ligament_fitted", ("femoral_attachment_mm", "tibial_attachment_mm")
#: Line -> how the fibres of lenhart2015 that it stands for begin.
BUNDLES = {"ACL": "ACL", "PCL": "PCL", "MCL": "MCLs", "LCL": "LCL"}


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee(NAME)


@pytest.mark.long
def test_the_tibia_turns_inwards_over_the_whole_range_without_a_warning(knee):
    motion = kj.passive_flexion(knee, np.arange(0.0, 121.0, 5.0))
    assert not np.asarray(motion.status).any()
    table = np.asarray(motion.to_table("grood-suntay"))
    turned = table[:, 2] - table[0, 2]
    # Walker 1988: 8.6, 13.2, 14.9 and 15.0 degrees at 30, 60, 90 and 120.
    assert turned[[6, 12, 18, 24]] == pytest.approx([8.6, 13.2, 14.9, 15.0], abs=2.5)
    assert (np.diff(turned[:15]) > 0.0).all()


def test_its_anterior_laxity_is_that_of_twelve_knees(knee):
    (band,) = bundled_bands(cut=(), name="robot_anterior_90N")
    (test,) = kj.lab_tests("drawer", band.flexion_deg, force_N=90.0, steps=1)
    (curves,) = kj.load_curves(knee, test)
    found = np.array([row.positive for row in kj.laxity(curves)])
    spread = np.where(np.isfinite(band.sd), band.sd, 0.25 * band.mean)
    assert (np.abs(found - band.mean) < 2.0 * spread).all()


def test_only_attachments_were_moved_and_each_stays_beside_its_fibres():
    own, start = (dict(load_knee_file(n).document) for n in (NAME, "four_ligament"))
    fibres = load_knee_file("lenhart2015").document["ligaments"]
    for part in ("reference_pose", "contacts", "lines"):
        assert own[part] == start[part]
    for name, line in own["ligaments"].items():
        for field in ("stiffness_N", "reference_strain", "transition_strain", "transition_width"):
            assert line[field] == start["ligaments"][name][field]
        for end in ENDS:
            bundle = [one[end] for f, one in fibres.items() if f.startswith(BUNDLES[name])]
            low, high = np.min(bundle, axis=0), np.max(bundle, axis=0)
            assert (low - 1e-3 <= line[end]).all() and (line[end] <= high + 1e-3).all()


def test_its_study_frees_attachments_and_holds_reference_strains():
    study = kj.read_study(NAME)
    assert study.knee.name == "four_ligament"
    assert [test.driven_by for test in study.tests] == ["anterior_N", "internal_Nm"]
    points = [name for name in study.selection.names if "attachment" in name]
    assert len(points) == 24
    strains = [name for name in study.selection.names if name not in points]
    assert strains == list(select(study.knee, ["*.reference_strain"]).names)
    assert {study.prior["reference_strain"]} == {0.002}


@pytest.mark.slow
def test_its_study_leads_to_its_file(knee):
    found = kj.calibrate(kj.read_study(NAME))
    for estimate in found.fit.estimates:
        if "attachment" in estimate.name:
            here = float(select(knee, [estimate.name]).read(knee)[0])
            assert estimate.value == pytest.approx(here, abs=0.02)
