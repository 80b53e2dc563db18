"""YAML files: `1e-3` is a number, `10:50:5` and `no` are text, and no key stands twice."""

__all__ = ["format_yaml", "load_yaml"]

import os
import re
from typing import Any

import yaml

from kneejax.files.reading._text import LONGEST_NUMBER, TOO_DEEP, InputProblem, read_text

_WIDTH = 96
#: Levels of lists and mappings in one another; no file of the package has more than eight.
_DEEPEST = 50
#: Values that aliases may add to those that are written out.
_MOST_BY_ALIASES = 100_000

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
_PLAIN = {tag: re.compile(pattern) for tag, pattern, _ in _MEANINGS}
_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_TEXT = "tag:yaml.org,2002:str"
_LIST = "tag:yaml.org,2002:seq"
_KINDS = {yaml.SequenceNode: _LIST, yaml.MappingNode: "tag:yaml.org,2002:map"}


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict = {}

    def __init__(self, stream):
        super().__init__(stream)
        #: Node -> values in it, aliases written out, and levels in one another.
        self.measured: dict[yaml.Node, tuple[int, int]] = {}
        self.level = 0

    def fetch_flow_collection_start(self, TokenClass):
        # Refused before the scanner looks ahead, which takes time with the square of the depth.
        if self.flow_level >= _DEEPEST:
            raise _fault(TOO_DEEP, self.get_mark())
        super().fetch_flow_collection_start(TokenClass)

    def compose_node(self, parent, index):
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            node = super().compose_node(parent, index)
            if node not in self.measured:
                raise _fault("an alias inside what it names", event.start_mark)
            return node
        if self.level >= _DEEPEST:
            raise _fault(TOO_DEEP, event.start_mark)
        self.level += 1
        node = super().compose_node(parent, index)
        self.level -= 1
        assert node is not None  # the types of PyYAML allow for none
        is_scalar = isinstance(node, yaml.ScalarNode)
        if event.tag is not None:  # it is one of those that are found without, and fits
            plain = _PLAIN.get(node.tag) if is_scalar else None
            if is_scalar and node.tag != _TEXT and not (plain and plain.fullmatch(node.value)):
                raise _fault(f"the tag {node.tag} of {node.value!r}", node.start_mark)
            if not is_scalar and node.tag != _KINDS[type(node)]:
                raise _fault(f"the tag {node.tag}", node.start_mark)
        if is_scalar:
            if len(node.value) > LONGEST_NUMBER and node.tag in _NUMBER_TAGS:
                raise _fault(f"a number of {len(node.value)} characters", node.start_mark)
            self.measured[node] = 1, 1
            return node
        below = [self.measured[one] for one in _below(node)]
        size = 1 + sum(size for size, _ in below)
        depth = 1 + max((depth for _, depth in below), default=0)
        self.measured[node] = size, depth
        if size - len(self.measured) > _MOST_BY_ALIASES:
            raise _fault(f"aliases that stand for {size:,} values", node.start_mark)
        if depth > _DEEPEST:
            raise _fault(TOO_DEEP, node.start_mark)
        return node


def _fault(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, mark)


def _below(node: yaml.Node) -> list[yaml.Node]:
    """What a list or a mapping holds; keys are texts, none twice."""
    if isinstance(node, yaml.SequenceNode):
        return node.value
    seen, found = set(), []
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag != _TEXT:
            what = repr(key.value) if isinstance(key, yaml.ScalarNode) else "a list or mapping"
            raise _fault(f"the key {what}, which is not text", key.start_mark)
        if key.value in seen:
            raise _fault(f"the key {key.value} twice", key.start_mark)
        seen.add(key.value)
        found += (key, value)
    return found


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers: dict = {}

    def ignore_aliases(self, data):
        return True

    def increase_indent(self, flow=False, indentless=False):
        return super().increase_indent(flow, False)


# YAML 1.1 would read 010 as eight.
_Loader.add_constructor(_NUMBER_TAGS[0], lambda loader, node: int(loader.construct_scalar(node)))
for _kind in (_Loader, _Dumper):
    for _tag, _pattern, _first in _MEANINGS:
        _kind.add_implicit_resolver(_tag, re.compile(f"^(?:{_pattern})$"), _first)


# Lists of plain values in one line.
_Dumper.add_representer(list, lambda dumper, items: dumper.represent_sequence(
    _LIST, items, flow_style=not any(isinstance(item, list | dict) for item in items)))


def load_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """As `load_json`, of a YAML file; raises also where aliases make it too large, or a key is no
    text."""
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
    """YAML of what `load_yaml` gives: keys in the order given, lists of plain values in one line;
    the same text for the same document."""
    return yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
