"""A choice of parameters of the bundled knee, and where they are in it."""

import numpy as np
import pytest

import kneejax as kj


@pytest.fixture(scope="session")
def chosen(knee):
    """Every stiffness and reference strain, by ligament."""
    return kj.select(knee, ("*.stiffness", "*.reference_strain"))


@pytest.fixture(scope="session")
def base(knee, chosen):
    """Their values, `(8,)`."""
    return np.asarray(chosen.read(knee))
