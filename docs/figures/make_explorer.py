"""Picture of the explorer in a browser: the default knee, bent, under a drawer.

Usage: `python docs/figures/make_explorer.py`; needs `kneejax[explore]`, playwright and Chromium.
"""

from pathlib import Path

from playwright.sync_api import sync_playwright

import kneejax as kj
from kneejax.cli._explore import begin
from kneejax.cli.options.knees import Explore
from kneejax.explorer import Setting

SETTING = {"flexion_deg": 30.0, "anterior_N": 100.0}
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    """Serve the page, set it, and take its picture."""
    kj.configure()
    page = begin(Explore.read({"subject": "average_knee"}))
    page.solved.wait()
    page.keep()
    page.go(Setting.of(SETTING))
    page.solved.wait()
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path="/usr/bin/chromium", args=SOFTWARE)
        tab = browser.new_page(viewport={"width": 1280, "height": 860})
        tab.goto(page.link)
        tab.get_by_text("Peak pressure, medial", exact=True).wait_for(timeout=90_000)
        # What a browser without a graphics card says of itself.
        tab.locator("button.mantine-Notification-closeButton").first.click()
        tab.wait_for_timeout(8000)
        tab.screenshot(path=Path(__file__).with_name("explorer.png"))
        browser.close()
    page.stop()


if __name__ == "__main__":
    main()
