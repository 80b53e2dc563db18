"""Who waits for a calibration is told how far off the knee still is."""

import re

import numpy as np
import pytest

import kneejax as kj


@pytest.mark.long
def test_errors_fall_as_the_search_goes_on():
    knee = kj.load_knee("four_ligament")
    flexion = np.linspace(0.0, 90.0, 25)
    poses = np.asarray(kj.passive_flexion(knee, flexion).to_table())
    start = knee.replace({"ACL.reference_strain": 0.05})
    told = []
    study = kj.Study(
        title="a trial", knee=start, measured=poses, parameters=["ACL.reference_strain"],
        procedures=["III"], noise_mm=0.1, noise_deg=0.1,
    )  # fmt: skip
    kj.calibrate(study, progress=lambda what, done, total: told.append(what))
    assert told[0] == "first balances"
    assert told[-1] == "95 % limits of 1 numbers"
    errors = re.compile(r"III, step (\d+), errors (\S+) mm and (\S+) deg")
    steps = [errors.search(line) for line in told[1:-1]]
    found = np.array([match.groups() for match in steps if match], float)
    assert found[:, 0].tolist() == list(range(1, len(found) + 1))
    assert (found[-1, 1:] < 1e-2 * found[0, 1:]).all()
