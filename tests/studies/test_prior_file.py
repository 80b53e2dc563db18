"""What a study takes from the prior of a cohort, and what stiffness means in either."""

import shutil

import numpy as np
import pytest
import yaml

from kneejax.files import InputProblem, bundled_path, write_poses
from kneejax.parameters import MEANING, Assumption, DoubtfulValue, UnsuitableData
from kneejax.studies import Map, Study, fingerprint, read_study

#: ACL and MCL of this knee are two and three lines: 9840 and 8000 N.
KNEE = "lenhart2015_reduced"
NAMES = ["ACL.stiffness", "MCL.stiffness", "LCL.stiffness"]


@pytest.fixture
def study(tmp_path):
    write_poses(tmp_path / "poses.csv", np.array([[0.0, 0, 0, 0, 0, 0], [30.0, 0, 0, 0, 0, 0]]))

    def read(kept=None, **changes) -> Study:
        document = {
            "title": "Next knee", "knee": KNEE, "parameters": NAMES, "noise_mm": 1.0,
            "noise_deg": 1.0, "measured": {"file": "poses.csv", "source": "made"},
        } | changes  # fmt: skip
        if kept is not None:
            (tmp_path / "prior.yaml").write_text(yaml.safe_dump(kept))
            document["prior"] = "prior.yaml"
        document = {name: value for name, value in document.items() if value is not None}
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump(document))
        return read_study(path)

    return read


def prior_of(**values):
    names = {f"{name}.stiffness": x for name, x in values.items()}
    return {"start": names, "prior": {name: 0.3 * x for name, x in names.items()}}


def test_a_cohorts_prior_is_of_structures(study):
    found = study(prior_of(ACL=9000.0, LCL=2000.0) | MEANING)
    acl = found.selection.read(found.knee_at_start)[0]
    assert float(acl) == pytest.approx(9000.0, rel=1e-14)
    assert found.prior == {"ACL.stiffness": 2700.0, "LCL.stiffness": 600.0}


def test_an_older_prior_with_the_mean_of_fibres_is_refused(study):
    assert study(prior_of(LCL=2000.0)).start == {"LCL.stiffness": 2000.0}  # one line
    with pytest.raises(InputProblem) as caught:
        study(prior_of(LCL=2000.0, MCL=2700.0))
    assert "prior.yaml: start.MCL.stiffness: 2700.0: expected the sum over the" in str(caught.value)
    assert "3 fibres" in str(caught.value) and "add stiffness_of: structure" in str(caught.value)
    with pytest.raises(InputProblem, match="stiffness_of: fibre: expected one of structure"):
        study(prior_of(ACL=9000.0) | {"stiffness_of": "fibre"})


def test_numbers_of_one_fibre_are_doubted_or_refused_with_the_structures(study):
    """Studies of older versions state means of fibres, and do not say so."""
    whole = "is of the whole MCL, drawn as 3 fibres with 8,000 N in this knee"
    for field in ("start", "set"):
        with pytest.warns(DoubtfulValue, match=f"MCL.stiffness: 2500 N {whole}"):
            study(**{field: {"MCL.stiffness": 2500.0}})
    with pytest.warns(DoubtfulValue, match="a prior of 250 N is of the whole MCL"):
        study(prior={"MCL.stiffness": 250.0})
    with pytest.raises(UnsuitableData, match="exclude the start 8000; it is the sum over the 3"):
        study(bounds={"MCL.stiffness": [1000.0, 5000.0]})
    # As published, of the structure; nothing is doubted: warnings are errors here.
    study(start={"MCL.stiffness": 6000.0}, prior={"MCL.stiffness": 1800.0},
          bounds={"MCL.stiffness": [1000.0, 20000.0], "stiffness": [300.0, 40000.0]})  # fmt: skip


def test_kept_parts_of_maps_are_of_one_meaning(study, monkeypatch):
    """Parts of an older map, whose axes are means of fibres, are of another study."""
    question = Map(pair=(("ACL.stiffness", "ACL.reference_strain"),))
    read = study()
    now = fingerprint(read, question)
    monkeypatch.setattr("kneejax.studies._maps.MEANING", {})
    assert now != fingerprint(read, question)


END = "LCL.femoral_attachment"


def test_attachments_of_a_knee_file_are_as_exact_as_they_are_digitised(study, tmp_path):
    """Freed without a prior they get one, which a study states otherwise or turns off."""
    own = shutil.copy(bundled_path("knees", KNEE), tmp_path / "mine.yaml")
    freed = {"knee": own.name, "parameters": ["LCL.stiffness", END]}
    axes = [f"{END}.{axis}" for axis in ("anterior", "superior", "lateral")]
    found = study(**freed)
    with pytest.warns(Assumption, match=f"{END}: free without a prior; a standard deviation of 2"):
        believed = found.believed
    assert believed == dict.fromkeys(axes, 2.0) and found.prior == {}
    with pytest.warns(Assumption, match="prior"):
        again = found.replace(attachment_sd_mm=1.0).believed
    assert again == dict.fromkeys(axes, 1.0)
    assert study(**freed, prior={END: 3.0}).believed == {END: 3.0}
    assert study(**freed, attachment_sd_mm=0).believed == {}
    # A bundled knee is not one's own.
    assert study(**freed | {"knee": KNEE}).believed == {}
    with pytest.warns(DoubtfulValue, match="none counts unless noise_mm and noise_deg"):
        assert study(**freed, noise_mm=0.5, noise_deg=None).believed == {}
