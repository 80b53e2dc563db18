"""A page that is served for the tests of a file, and a browser."""

import pytest

from tests.explore.browser import CHROMIUM
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


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is not installed: apt-get install chromium")
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as started:
        yield started.chromium.launch(executable_path=str(CHROMIUM), args=software)
