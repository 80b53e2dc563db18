"""Waiting for a page that solves in a thread of its own."""

import time


def settled(page):
    assert page.solved.wait(120.0)


def until(holds, seconds=30.0):
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "never came"
        time.sleep(0.05)
