"""What tests of cohorts share."""

import json

import pytest


@pytest.fixture(scope="session")
def numbers():
    """Everything that a command has computed in a folder, without seconds."""

    def of(out):
        found = {}
        for path in sorted(out.glob("knees/*/result.json")):
            document = json.loads(path.read_text())
            found[path.parent.name] = {k: x for k, x in document.items() if k != "seconds"}
        for name in ("cohort.csv", "cohort.nc", "prior.yaml"):
            found[name] = (out / name).read_bytes()
        return found

    return of
