"""What is said of a package that is not installed."""

import pytest

from kneejax.numerics import MissingPackage, check_installed


@pytest.mark.parametrize(
    ("extra", "begins"),
    [
        ("explore", "the explorer needs"),
        ("notebook", "sliders in a notebook need"),
        ("view", "the 3-D view needs"),
        ("posterior", "the posterior needs"),
    ],
)
def test_a_missing_package_is_a_sentence_that_ends_in_what_to_do(extra, begins):
    with pytest.raises(MissingPackage) as found:
        check_installed("no_such_package", extra)
    ends = f"no_such_package, which is not installed: pip install 'kneejax[{extra}]'"
    assert str(found.value) == f"{begins} {ends}"
