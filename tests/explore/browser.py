"""What a person does with a page, and sees of it."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from tests.explore.waiting import settled, until

CHROMIUM = Path("/usr/bin/chromium")
WAIT_MS = 240_000


def number(tab, label):
    return tab.locator(
        f"xpath=//label[contains(., '{label}')]/following::input[not(@type='hidden')][1]"
    )


def enter(tab, page, label, value):
    field = number(tab, label)
    field.fill(str(value))
    field.press("Enter")
    if page is not None:
        until(lambda: page.setting.given)
        settled(page)


def pixels(tab):
    """What the knee's side of the page shows."""
    clip = {"x": 330, "y": 0, "width": 700, "height": 900}
    return np.asarray(Image.open(io.BytesIO(tab.screenshot(clip=clip))).convert("RGB"), float)
