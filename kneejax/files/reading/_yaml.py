"""YAML as people mean it: `1e-3` is a number, `10:50:5` and `no` are text, no key stands twice."""

from __future__ import annotations

import os
import re
from typing import Any

import yaml

from kneejax.files.reading._problem import InputProblem
from kneejax.files.reading._text import read_text

_WIDTH = 96

# What a plain scalar means, as in YAML 1.2; YAML 1.1 would read 10:50:5 as 39005.
_MEANINGS = (
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)"
        r"|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
)


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict = {}

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a key that is not text", key_node.start_mark
                )
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key_node.value} twice", key_node.start_mark
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers: dict = {}

    def ignore_aliases(self, data):
        return True

    def increase_indent(self, flow=False, indentless=False):
        return super().increase_indent(flow, False)


def _decimal(loader: _Loader, node: yaml.ScalarNode) -> int:
    # YAML 1.1 would read 010 as eight.
    return int(loader.construct_scalar(node))


_Loader.add_constructor("tag:yaml.org,2002:int", _decimal)
for _kind in (_Loader, _Dumper):
    for _tag, _pattern, _first in _MEANINGS:
        _kind.add_implicit_resolver(_tag, re.compile(f"^(?:{_pattern})$"), _first)


def _list_in_one_line(dumper: _Dumper, items: list) -> yaml.Node:
    short = not any(isinstance(item, list | dict) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=short)


_Dumper.add_representer(list, _list_in_one_line)


def load_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """Read a YAML file.

    Args:
        path: the file.
        kind: what it should be, for the error.

    Returns:
        Mappings, lists, texts, numbers, booleans and None.

    Raises:
        InputProblem: the file cannot be read, is not YAML, or holds a key twice.
    """
    text = read_text(path, kind)
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = "file" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}"
        found = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
        raise InputProblem(path, place, found, f"{kind} in well-formed YAML") from None
    except (RecursionError, ValueError) as error:
        raise InputProblem(path, "file", str(error), f"{kind} in well-formed YAML") from None


def format_yaml(document: Any) -> str:
    """Write YAML: keys in the order given, lists of plain values in one line.

    Args:
        document: mappings, lists, texts, numbers, booleans and None.

    Returns:
        The text, the same for the same document.
    """
    return yaml.dump(
        document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH
    )
