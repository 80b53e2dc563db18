"""Pages that the site makes from the code: commands, files, quantities, statuses, knees, names."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import GenericAlias, ModuleType
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

import kneejax
from kneejax.cli._command import Form, Group, Place, Written, marks
from kneejax.cli._words import Split, choices_of, plain_type
from kneejax.cli.options import COMMANDS
from kneejax.files import (
    bundled_knee_descriptions,
    bundled_laxity_sources,
    bundled_measurements,
    bundled_studies,
    load_knee_file,
)
from kneejax.quantities import QUANTITIES, RANGES
from kneejax.statics import Status

#: Room -> what it is about, in the order of the reference.
ROOMS = {
    "kneejax.files": "Knees, tables, models of other programs",
    "kneejax.experiments": "Motion, laxity, extensor mechanism, activities",
    "kneejax.studies": "What is fitted to what",
    "kneejax.inference": "Fits, limits, sensitivity, design",
    "kneejax.planning": "Reconstructions",
    "kneejax.cohorts": "Many knees",
    "kneejax.joints": "Hinges and moving axes",
    "kneejax.report": "Pages and figures",
    "kneejax.parameters": "Select, set, cut",
    "kneejax.statics": "Equilibria and their statuses",
    "kneejax.dynamics": "Motion through time",
    "kneejax.mechanics": "Ligaments, contact, loads",
    "kneejax.geometry": "Poses, surfaces, fibre paths",
    "kneejax.numerics": "Configuring JAX, compiling",
}
_FILES = """# File formats

All files are YAML. An unknown field is an error that suggests the nearest name. Allowed values of
fields with units: [Quantities](quantities.md). Tables are CSV files whose columns
[Units and conventions](../units_and_conventions.md#columns) lists.
"""
_QUANTITIES = """# Quantities

A parameter is `PART.quantity`, such as `ACL.stiffness` or `medial.tibial_surface.superior`;
`*.quantity` means every part. `kneejax describe KNEE --parameters` lists the names of a knee.
"""
_STATUSES = """# Statuses

The status of a pose is the worst that applies. Up to 7 the forces balance and the numbers stand;
from 8 on there is no equilibrium and the coordinates are NaN. A study's `failures:` says which of
them count as failed poses. [Equilibrium](../equilibrium.md) explains how a pose is found.
"""
_BUNDLED = """# Bundled knees

`kneejax describe NAME` prints a knee, `kneejax knees --copy NAME` copies its file. Pictures:
lateral and anterior view at the reference pose; ligament fibres by group, femoral (grey) and tibial
(brown) articular surfaces, mm. Made by `docs/figures/make_knees.py`.
"""


def write_all(folder: Path, notebooks: Path) -> None:
    """Write every page that is made from the code, and copies of the notebooks.

    Args:
        folder: for the pages; its files are replaced.
        notebooks: folder of notebooks, executed or not.
    """
    shown: set[int] = set()  # objects that stand on a page already
    pages = {
        "commands.md": commands(),
        "file_formats.md": file_formats(),
        "quantities.md": quantities(),
        "statuses.md": statuses(),
        "bundled.md": bundled(),
        "api.rst": api_page(kneejax, "Top-level names", [*_top_level()], shown),
    }
    for room, title in ROOMS.items():
        module = importlib.import_module(room)
        name = f"api_{room.rpartition('.')[2]}.rst"
        pages[name] = api_page(module, title, [*_offered(module)], shown)
    folder.mkdir(exist_ok=True)
    for name, text in pages.items():
        path = folder / name
        # Sphinx reads again what has changed alone.
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in sorted(notebooks.glob("*.ipynb")):
        _copy_notebook(path, folder / path.name)


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(_cell(x) for x in one) + " |" for one in lines) + "\n"


def _cell(text: Any) -> str:
    return " ".join(str(text).split()).replace("|", "\\|").replace("*.", "\\*.")


def commands() -> str:
    """Every command with its options, from their models."""
    out = ["# Commands", "", "`kneejax COMMAND --help` prints the same. Exit status: 0 done,",
           "1 doubtful results, 2 wrong input.", ""]  # fmt: skip
    for heading, models in COMMANDS.items():
        out += [f"## {heading}", ""]
        for model in models:
            out += [f"### kneejax {model.command}", "", _sentence(model), ""]
            out += ["```sh", model.example, "```", ""]
            if issubclass(model, Written):
                out += [f"Writes the folder `{model.folder}`, or `--out`.", ""]
            rows = [
                [f"`{_shown(name, field)}`", _form(field), _default(field), field.description or ""]
                for name, field in sorted(model.model_fields.items(), key=_places_first)
                if name not in ("out", "verbose", "svg")
            ]
            if rows:
                out += [table(["option", "value", "default", "meaning"], rows)]
    out += ["## Options of every command that writes", "",
            table(["option", "meaning"], [["`--out FOLDER`", "folder for the results"],
                  ["`--verbose`", "print what was compiled, and how long it took"],
                  ["`--svg`", "write figures as SVG too (commands that draw)"]])]  # fmt: skip
    return "\n".join(out)


def _places_first(item: tuple[str, FieldInfo]) -> tuple[bool, bool]:
    return not marks(item[1], Place), bool(marks(item[1], Group))


def _shown(name: str, field: FieldInfo) -> str:
    places = marks(field, Place)
    return places[0].name if places else f"--{field.alias or name.replace('_', '-')}"


def _form(field: FieldInfo) -> str:
    for mark in field.metadata:
        if isinstance(mark, Form | Split):
            return f"`{mark.form}`"
    if choices := choices_of(field.annotation):
        return ", ".join(f"`{x}`" for x in choices)
    return _kind(field.annotation)


def _kind(annotation: Any) -> str:
    kind = plain_type(annotation)
    words = {float: "number", int: "whole number", bool: "", str: "text", Path: "path", Any: ""}
    if kind in words:
        return words[kind]
    if get_origin(kind) in (list, tuple):
        inner = [x for x in get_args(kind) if x is not Ellipsis]
        return f"several: {_kind(inner[0])}" if inner and _kind(inner[0]) else "several"
    if get_origin(kind) is dict:
        return "mapping"
    if inspect.isclass(kind) and issubclass(kind, BaseModel):
        return f"`{kind.__name__}`"
    return ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, list | tuple):
        return ", ".join(f"`{x}`" for x in value)
    plain = isinstance(value, str | int | float) and value is not False and value != ""
    return f"`{value}`" if plain else ""


def file_formats() -> str:
    """Fields of every file that a person writes, from their models."""
    from kneejax.cohorts import _reading
    from kneejax.files import _joint
    from kneejax.files.knee import document
    from kneejax.studies import _acl_plan, _lab_tests, _schema

    formats = {
        "Study": ("What is fitted to what; `kneejax init study`.", _schema.StudyFields),
        "Knee": ("One knee; `kneejax init knee`.", document.KneeDocument),
        "Cohort": ("Several knees, one template; `kneejax init cohort`.", _reading.CohortFile),
        "Plan of a reconstruction": ("`kneejax init plan`.", _acl_plan.PlanFields),
        "Joint": ("A simple joint, as `kneejax joint fit` writes it.", _joint.JointFields),
    }
    of_study = [_schema.Measured, _schema.Synthetic, _schema.StudyStage, _lab_tests.StudyTest]
    out = [_FILES]
    for title, (sentence, model) in formats.items():
        more = [*of_study, _lab_tests.InTime] if model is _schema.StudyFields else []
        out += [f"## {title}", "", sentence, "", _fields(model)]
        seen = {model}
        for part in [*more, *_parts_of(model)]:
            if part not in seen and part.model_fields:
                seen.add(part)
                out += [f"### {title}: {part.__name__}", "", _sentence(part), "", _fields(part)]
    return "\n".join(out)


def _parts_of(model: type[BaseModel], seen: tuple = ()) -> Iterator[type[BaseModel]]:
    for field in model.model_fields.values():
        for part in _models_in(field.annotation):
            if part not in seen:
                seen += (part,)
                yield part
                yield from _parts_of(part, seen)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    inside = get_args(annotation)
    if inspect.isclass(annotation) and not inside and issubclass(annotation, BaseModel):
        yield annotation
    for inner in inside:
        yield from _models_in(inner)


def _sentence(part: type) -> str:
    return (inspect.getdoc(part) or "").split("\n\n")[0]


def _fields(model: type[BaseModel]) -> str:
    rows = [
        [f"`{field.alias or name}`", _form(field), _default(field),
         field.description or _range_of(name)]
        for name, field in model.model_fields.items()
    ]  # fmt: skip
    return table(["field", "value", "default", "meaning"], rows)


def _range_of(name: str) -> str:
    return str(RANGES[name]) if name in RANGES else ""


def quantities() -> str:
    """Every quantity of a knee."""
    rows = [
        [f"`{one.name}`", ", ".join(one.owners), one.unit, f"`{one.field}`" if one.field else "",
         str(one.allowed), _bounds(one), one.source]
        for one in QUANTITIES.values()
    ]  # fmt: skip
    others = [[f"`{name}`", str(allowed)] for name, allowed in RANGES.items()
              if name not in {one.field for one in QUANTITIES.values()}]  # fmt: skip
    heads = ["quantity", "parts", "unit", "field in a file", "allowed", "usual bounds", "source"]
    below = "## Fields of files, columns and loads"
    fields = table(["name", "allowed"], others)
    return "\n".join([_QUANTITIES, table(heads, rows), below, "", fields])


def _bounds(one: Any) -> str:
    if one.bounds is not None:
        return f"{one.bounds[0]:g} to {one.bounds[1]:g}"
    return f"value ± {one.within:g}" if one.within is not None else "half to twice the value"


def statuses() -> str:
    """Every status with what to do."""
    rows = [
        [str(int(one)), f"`{one.word}`", "yes" if one.converged else "no",
         one.fault or "balanced and stable", one.advice]
        for one in Status
    ]  # fmt: skip
    heads = ["code", "status", "equilibrium", "what is wrong", "what to do"]
    return _STATUSES + "\n" + table(heads, rows)


def bundled() -> str:
    """The bundled knees with pictures, studies and measurements."""
    rows, below = [], []
    for name, sentence in bundled_knee_descriptions().items():
        found = load_knee_file(name)
        knee, place = found.knee, name.replace("_", "-")
        counts = [str(len(knee.ligaments.names)), str(len(knee.contacts))]
        patella = "yes" if found.has_patella else "no"
        rows.append([f"[`{name}`](#{place})", *counts, patella, knee.side])
        picture = f"![{name}: fibres and surfaces, two views](../figures/knee_{name}.png)"
        below += [f"({place})=", f"## `{name}`", "", sentence, "", picture, ""]
    measured = [[f"`{k}`", x.title, x.source] for k, x in bundled_measurements().items()]
    return "\n".join([
        _BUNDLED, table(["knee", "fibres", "contacts", "patella", "side"], rows), *below,
        "## Studies", "", _named("title", bundled_studies()),
        "## Measurements", "", table(["table", "what", "source"], measured),
        "## Laxity", "", "Drawn beside `simulate` under the same load.", "",
        _named("source", bundled_laxity_sources()),
    ])  # fmt: skip


def _named(what: str, known: dict[str, str]) -> str:
    return table(["name", what], [[f"`{name}`", text] for name, text in known.items()])


def _top_level() -> Iterator[str]:
    return (name for name in kneejax.__all__ if not inspect.ismodule(getattr(kneejax, name)))


def _offered(package: ModuleType) -> Iterator[str]:
    """Names that the `__init__` of a room offers."""
    tree = ast.parse(Path(package.__file__ or "").read_text(encoding="utf-8"))
    found = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    top = {id(getattr(kneejax, name)) for name in _top_level()}
    for alias in (alias for node in found for alias in node.names):
        thing = getattr(package, alias.name, None)
        shown = inspect.isclass(thing) or inspect.isroutine(thing)
        plain = shown and not isinstance(thing, GenericAlias)
        if alias.asname == alias.name and plain and id(thing) not in top:
            yield alias.name


def api_page(module: ModuleType, title: str, names: list[str], shown: set[int]) -> str:
    """A page of names with their docstrings, in reStructuredText; `shown` grows by them."""
    room = "" if module is kneejax else f"``{module.__name__}``: "
    heading = room + (title if module is kneejax else title[0].lower() + title[1:])
    first = (inspect.getdoc(module) or "").split("\n\n")[0]
    out = [heading, "=" * len(heading), "", _escaped(first), ""]
    if module is not kneejax:
        out += ["What ``import kneejax`` offers of this room stands under :doc:`api`.", ""]
    kinds = (inspect.isclass, "Classes", "class"), (inspect.isroutine, "Functions", "function")
    for kind, heading, word in kinds:
        chosen = sorted(name for name in names if kind(getattr(module, name)))
        if chosen:
            out += [heading, "-" * len(heading), ""]
        for name in chosen:
            thing = getattr(module, name)
            out += [f".. auto{word}:: {module.__name__}.{name}"]
            out += ["   :members:"] * (word == "class")
            out += ["   :no-index:"] * (id(thing) in shown) + [""]
            out += [_escaped(where_shown(name, thing)), ""]
            shown.add(id(thing))
    return "\n".join(out)


def has_example(thing: Any) -> bool:
    """Whether the docstring of a name, or of one of its members, has an example that is run."""
    members = [*vars(thing).values()] if inspect.isclass(thing) else []
    every = [thing, *(getattr(one, "__func__", one) for one in members)]
    return any(">>>" in (getattr(one, "__doc__", None) or "") for one in every)


def where_shown(name: str, thing: Any) -> str:
    """Where a name without an example of its own is used: by what returns it, or by a test."""
    if has_example(thing):
        return ""
    makers = [x for x in _makers().get(name, ()) if x.rpartition(".")[2] != name]
    if inspect.isclass(thing) and makers:
        return f"Example: `{makers[0]}`."
    used = [file for file, words in _words_of_tests().items() if name in words]
    order = ("tests", "notebooks", "kneejax", "benchmarks")
    used.sort(key=lambda file: (order.index(file.split("/")[0]), len(file)))
    return f"Runs in `{used[0]}`." if used else f"Runs within `{_caller(thing, name)}`."


def _caller(thing: Any, name: str) -> str:
    """A file of another room that uses a name, or that of the name itself."""
    root = Path(__file__).parents[1]
    own = inspect.getsourcefile(inspect.unwrap(thing)) or ""
    for file in sorted(root.glob("kneejax/**/*.py"), key=lambda x: len(str(x))):
        words = file.name != "__init__.py" and str(file) != own and file.read_text("utf-8")
        if words and re.search(rf"\b{name}\b", words):
            return str(file.relative_to(root))
    return str(Path(own).relative_to(root))


@functools.cache
def _makers() -> dict[str, list[str]]:
    """Class -> public names that return one, or hold one in a field; those with examples first."""
    found: dict[str, list[str]] = {}
    for room in ["kneejax", *ROOMS]:
        module = importlib.import_module(room)
        names = _top_level() if module is kneejax else _offered(module)
        for name in sorted(names):
            thing = getattr(module, name)
            noted = getattr(thing, "__annotations__", {})
            kinds = noted.values() if inspect.isclass(thing) else [noted.get("return")]
            for word in {word for kind in kinds for word in re.findall(r"\w+", str(kind))}:
                found.setdefault(word, []).append(f"{room}.{name}")
                if has_example(thing):  # those with examples first
                    found[word].insert(0, found[word].pop())
    return found


@functools.cache
def _words_of_tests() -> dict[str, set[str]]:
    root = Path(__file__).parents[1]
    files = [*root.glob("tests/**/*.py"), *root.glob("notebooks/*.ipynb")]
    # What commands call runs in the tests of the commands.
    files += [*root.glob("benchmarks/*.py"), *root.glob("kneejax/cli/**/*.py")]
    return {
        str(file.relative_to(root)): set(re.findall(r"\w+", file.read_text(encoding="utf-8")))
        for file in sorted(files)
    }


def _escaped(text: str) -> str:
    parts = re.split(r"(`[^`]*`)", text)
    marks_of_rst = re.compile(r"([*_|])(?=\W|$)")
    return "".join(x if x[:1] == "`" else marks_of_rst.sub(r"\\\1", x) for x in parts)


def plain_docstring(app, what, name, obj, options, lines) -> None:
    """Escape stars, bars and trailing underscores outside of backticks; shorten types."""
    for number, line in enumerate(lines):
        if line.startswith(":vartype "):
            lines[number] = re.sub(r"\b\w+\.[\w.]+", r"~\g<0>", line)
        elif not line.lstrip().startswith((">>>", "...", ".. ", ":")) and "`" not in line:
            lines[number] = _escaped(line)


def plain_signature(app, what, name, obj, options, signature, returns):
    """Signatures say `jax.Array`, and not where jaxlib keeps it."""
    return tuple(x and x.replace("jaxlib._jax.Array", "jax.Array") for x in (signature, returns))


def skip_member(app, what, name, obj, skip, options) -> bool | None:
    """Fields of pydantic and of tuples are listed under Attributes."""
    return True if name.startswith("model_") else None


def _copy_notebook(source: Path, target: Path) -> None:
    """Copy a notebook; outputs that would load scripts from a network are left out."""
    book = json.loads(source.read_text(encoding="utf-8"))
    for cell in book["cells"]:
        kept = []
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            for kind in [k for k in data if "plotly" in k or "widget" in k or "javascript" in k]:
                del data[kind]
            html = "".join(data.get("text/html", ""))
            if "<script" in html or "<style" in html:  # their colours know no dark page
                del data["text/html"]
            if data or "text" in output:
                kept.append(output)
        if "outputs" in cell:
            cell["outputs"] = kept
    text = json.dumps(book, indent=1)
    for page in re.findall(r"\.\./docs/(\w+\.md)", text):
        text = text.replace(f"../docs/{page}", f"../{page}")
    if not target.exists() or target.read_text(encoding="utf-8") != text:
        target.write_text(text, encoding="utf-8")


