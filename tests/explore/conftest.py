"""A page that is served for the tests of a file."""

import pytest

from tests.explore.waiting import settled


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    from kneejax.cli._explore import begin
    from kneejax.cli.options.knees import Explore

    out = tmp_path_factory.mktemp("saved")
    served = begin(Explore.read({"subject": "four_ligament", "port": "8410", "out": str(out)}))
    settled(served)
    yield served
    served.stop()
