"""What an explorer writes."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.explorer import Setting, Subject
from kneejax.explorer.setting import Folder
from kneejax.files import load_knee_file
from kneejax.parameters import fibres_cut


@pytest.mark.parametrize("name, groups", [("four_ligament", ["ACL"]),
                                          ("lenhart2015_reduced", ["PCL", "mPFL"])])
def test_a_saved_knee_is_without_what_is_cut(tmp_path, name, groups):
    read = load_knee_file(name)
    patella = "patella" in read.document
    knee = read.with_patella() if patella else read.knee
    subject = Subject.of(knee)
    folder = Folder(tmp_path, subject, read.document, np.empty((0, 6)))
    changed = {f"{one}.cut": 1.0 for one in groups} | {"MCL.stiffness": 3000.0}
    saved = kj.load_knee(folder.knee(subject.within(Setting.of(changed))), patella=patella)
    gone = {knee.ligaments.names[row] for row in fibres_cut(knee, groups)}
    assert gone and {*saved.ligaments.names} == {*knee.ligaments.names} - gone
