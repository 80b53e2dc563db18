"""`kneejax init study|knee|cohort|plan`: a commented file to begin with."""

from __future__ import annotations

from pathlib import Path

from kneejax.cli.options import Init
from kneejax.files import InputProblem, bundled_path, write_text

#: What to do with the new file.
_NEXT = {
    "study": "kneejax calibrate {}",
    "knee": "kneejax describe {}",
    "cohort": "kneejax calibrate {}",
    "plan": "kneejax plan acl {}",
}


def run(asked: Init) -> int:
    """Write the file, which runs as it is, and print what to do with it."""
    out = asked.out or Path(f"{asked.kind}.yaml")
    if out.exists():
        raise InputProblem("init", "--out", str(out), "a file that is not there yet")
    text = bundled_path("templates", asked.kind).read_text(encoding="utf-8")
    if asked.kind == "knee":
        text += bundled_path("knees", "four_ligament").read_text(encoding="utf-8")
    write_text(out, text)
    print(f"written: {out}\nnext: {_NEXT[asked.kind].format(out)}")
    return 0
