"""Scripts of the pages: those of docs/in_python.md run as printed, and are as short as they say."""

import re
import runpy
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


POINT = '<PathPoint name="{0}-P{1}"><body>{2}</body><location>{1} 0 0</location></PathPoint>'
MUSCLE = '<Muscle name="{}">{}<max_isometric_force>{}</max_isometric_force></Muscle>'


def muscle(name, bodies, force):
    points = "".join(POINT.format(name, k, body) for k, body in enumerate(bodies, 1))
    return MUSCLE.format(name, points, force)


def test_a_hamstring_is_divided_by_shares_and_ends_of_three_and_nothing_else():
    path = PAGE.parent / "figures" / "make_push_off.py"
    script = runpy.run_path(str(path))
    lump, other = [], []
    for side in "rl":
        lump.append(muscle(f"bifemlh_{side}", ("pelvis", "tibia", "tibia"), 2700))
        for name, ends, force in (("bifemlh", 1, 900), ("semimem", 2, 1200), ("semiten", 3, 600)):
            other.append(muscle(f"{name}_{side}", ("hip", *["shank"] * ends), force))
    new = script["three_hamstrings"]("\n".join(["begin", *lump, "end"]), "".join(other))
    assert new.startswith("begin\n") and new.endswith("\nend")
    found = re.findall(r'<Muscle name="(\w+)">.*?force>(\d+)<', new, re.DOTALL)
    shares = [("bifemlh", "900"), ("semimem", "1200"), ("semiten", "600")]
    assert found == [(f"{name}_{side}", force) for side in "rl" for name, force in shares]
    own = re.search(r'<Muscle name="semiten_l">.*?</Muscle>', new, re.DOTALL)[0]
    assert re.findall(r'name="(\w+-P\d)"><body>(\w+)</body><location>(\d)', own) == [
        ("semiten_l-P1", "pelvis", "1"), ("semiten_l-P2", "tibia", "2"),
        ("semiten_l-P3", "tibia", "3"), ("semiten_l-P4", "tibia", "4"),
    ]  # fmt: skip
