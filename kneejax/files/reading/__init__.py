"""Text, YAML and checked fields; problems that say file, field and value."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: what a mistake is called is said without a reader of YAML.
_MODULES = {
    "InputProblem": "kneejax.files.reading._problem",
    "InputProblems": "kneejax.files.reading._problem",
    "counted": "kneejax.files.reading._problem",
    "nearest_name": "kneejax.files.reading._problem",
    "MOST": "kneejax.files.reading._schema",
    "Field": "kneejax.files.reading._schema",
    "load_json": "kneejax.files.reading._text",
    "neighbour": "kneejax.files.reading._text",
    "plain_number": "kneejax.files.reading._text",
    "read_bytes": "kneejax.files.reading._text",
    "read_text": "kneejax.files.reading._text",
    "write_bytes": "kneejax.files.reading._text",
    "write_text": "kneejax.files.reading._text",
    "format_yaml": "kneejax.files.reading._yaml",
    "load_yaml": "kneejax.files.reading._yaml",
}

if TYPE_CHECKING:
    from kneejax.files.reading._problem import InputProblem as InputProblem
    from kneejax.files.reading._problem import InputProblems as InputProblems
    from kneejax.files.reading._problem import counted as counted
    from kneejax.files.reading._problem import nearest_name as nearest_name
    from kneejax.files.reading._schema import MOST as MOST
    from kneejax.files.reading._schema import Field as Field
    from kneejax.files.reading._text import load_json as load_json
    from kneejax.files.reading._text import neighbour as neighbour
    from kneejax.files.reading._text import plain_number as plain_number
    from kneejax.files.reading._text import read_bytes as read_bytes
    from kneejax.files.reading._text import read_text as read_text
    from kneejax.files.reading._text import write_bytes as write_bytes
    from kneejax.files.reading._text import write_text as write_text
    from kneejax.files.reading._yaml import format_yaml as format_yaml
    from kneejax.files.reading._yaml import load_yaml as load_yaml
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
