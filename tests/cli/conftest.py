"""What tests of commands share."""

import pytest


@pytest.fixture
def unmeasured(monkeypatch):
    """A mistake on the command line is said at once; once it took a motion first, 17 s anew."""

    def never(*_, **__):
        raise AssertionError("the knee has moved before the mistake was said")

    monkeypatch.setattr("kneejax.inference.synthetic_motion", never)
