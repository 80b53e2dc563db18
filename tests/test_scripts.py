"""The scripts of docs/in_python.md run as they are printed, and are as short as they say."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "in_python.md"
SCRIPTS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
LONGEST = 20


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:kneejax:RuntimeWarning")
def test_the_scripts_run_as_printed(capsys):
    names: dict = {}
    for script in SCRIPTS:
        exec(compile(script, str(PAGE), "exec"), names)
    said = capsys.readouterr().out
    assert names["acl"].value == pytest.approx(5000.0, rel=1e-4)
    assert (np.diff(names["anterior_mm"]) > 0).all()
    assert "ACL.stiffness" in said and "anterior" in said
    np.testing.assert_allclose(names["test"].to_table()[0, [2, 3]], [10.0, 2.0], atol=1e-9)


def test_each_has_at_most_twenty_lines():
    first, *others = SCRIPTS
    assert len(others) == 5
    for script in others:
        assert len((first + script).strip().splitlines()) <= LONGEST
