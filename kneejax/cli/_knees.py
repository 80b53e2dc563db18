"""`kneejax knees` lists and copies what is bundled; `kneejax init` writes a file to begin with."""

import shutil
import textwrap
from collections.abc import Mapping
from pathlib import Path

from kneejax import files
from kneejax.cli.options.knees import Init, Knees

#: What to do with the new file.
_NEXT = {"study": "kneejax calibrate {}", "knee": "kneejax describe {}",
         "cohort": "kneejax calibrate {}", "plan": "kneejax plan acl {}"}  # fmt: skip
_INDENT = " " * 23
_HANGING = {"subsequent_indent": _INDENT, "break_on_hyphens": False}


def run(arguments: Knees) -> int:
    """Print what is bundled, with its source, or copy some of it."""
    if arguments.copy_of is not None:
        return _copy(arguments.copy_of)
    _print_named("Knees", files.bundled_knee_descriptions())
    print("Studies")
    for name, title in files.bundled_studies().items():
        print(f"  {name:<20} {title}")
        source = files.absent_measurement(name)
        if source is not None:
            needs = "needs measured motion that is not bundled"
            said = f"{needs} ({source}): name its `file` in a copy"
            print(textwrap.fill(said, 98, initial_indent=_INDENT, **_HANGING))
    measured = files.bundled_measurements()
    words = {name: f"{one.title} ({one.source})" for name, one in measured.items()}
    _print_named("Measurements" + ("" if measured else ": none bundled"), words)
    print("Laxity, as others measured it: drawn beside `simulate` under the same load,")
    _print_named("and a test of a study by its name, with `load:` where that is not known",
                 files.bundled_laxity_sources(), 24)  # fmt: skip
    examples = {name: about.title for name, about in files.bundled_examples().items()}
    heading = "Examples, made up: `kneejax knees --copy NAME` copies one, or a knee file, to here"
    _print_named(heading, examples)
    return 0


def _print_named(heading: str, texts: Mapping[str, str], width: int = 20) -> None:
    print(heading)
    for name, text in texts.items():
        print(textwrap.fill(text, 98, initial_indent=f"  {name:<{width}} ", **_HANGING))


def _copy(name: str) -> int:
    """Copy something bundled, with the tables that it names, to where the command was called."""
    known = {one: example.path for one, example in files.bundled_examples().items()}
    for kind in ("knees", "studies", "plans", "measurements"):
        bundled = files.bundled_files(kind)
        known = {**bundled, **known, **{f"{kind}/{one}": path for one, path in bundled.items()}}
    if name not in known:
        raise files.InputProblem("knees", "--copy", name, known)
    source, folder = known[name], known[name].parent
    if source.is_dir():
        found = {one: one.relative_to(folder) for one in sorted(source.rglob("*.*"))}
    else:
        # A study's tables are called as it is; a table of measurements has its source beside it.
        beside = [*folder.glob(f"{source.stem}.*"), *folder.glob(f"{source.stem}_*.csv")]
        found = {one: Path(one.name) for one in sorted(beside)}
    for target in {Path(one.parts[0]) for one in found.values()}:
        if target.exists():
            expected = "no such file or folder here yet"
            raise files.InputProblem("knees", "--copy", str(target), expected)
    for one, target in found.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(one, target)
    print(f"written: {', '.join(one.as_posix() for one in found.values())}")
    return 0


def begin(asked: Init) -> int:
    """Write the file, which runs as it is, and print what to do with it."""
    out = asked.out or Path(f"{asked.kind}.yaml")
    if out.exists():
        raise files.InputProblem("init", "--out", str(out), "a file that is not there yet")
    text = files.bundled_path("templates", asked.kind).read_text(encoding="utf-8")
    if asked.kind == "knee":
        text += files.bundled_path("knees", "four_ligament").read_text(encoding="utf-8")
    files.write_text(out, text)
    print(f"written: {out}\nnext: {_NEXT[asked.kind].format(out)}")
    return 0
