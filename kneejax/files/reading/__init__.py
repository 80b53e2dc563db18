"""Text, YAML and models of files; problems that say file, field and value."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.reading._model import Chosen as Chosen
    from kneejax.files.reading._model import Mistakes as Mistakes
    from kneejax.files.reading._model import Part as Part
    from kneejax.files.reading._model import checked as checked
    from kneejax.files.reading._model import checks as checks
    from kneejax.files.reading._model import fill as fill
    from kneejax.files.reading._model import folder_of as folder_of
    from kneejax.files.reading._model import said_of as said_of
    from kneejax.files.reading._model import together as together
    from kneejax.files.reading._text import InputProblem as InputProblem
    from kneejax.files.reading._text import InputProblems as InputProblems
    from kneejax.files.reading._text import counted as counted
    from kneejax.files.reading._text import load_json as load_json
    from kneejax.files.reading._text import neighbour as neighbour
    from kneejax.files.reading._text import plain_number as plain_number
    from kneejax.files.reading._text import read_bytes as read_bytes
    from kneejax.files.reading._text import read_text as read_text
    from kneejax.files.reading._text import write_bytes as write_bytes
    from kneejax.files.reading._text import write_text as write_text
    from kneejax.files.reading._text import wrong as wrong
    from kneejax.files.reading._values import Choice as Choice
    from kneejax.files.reading._values import Distinct as Distinct
    from kneejax.files.reading._values import Flag as Flag
    from kneejax.files.reading._values import Name as Name
    from kneejax.files.reading._values import Number as Number
    from kneejax.files.reading._values import Text as Text
    from kneejax.files.reading._values import by_parameter as by_parameter
    from kneejax.files.reading._values import choice as choice
    from kneejax.files.reading._values import deviation as deviation
    from kneejax.files.reading._values import entries as entries
    from kneejax.files.reading._values import interval as interval
    from kneejax.files.reading._values import items as items
    from kneejax.files.reading._values import mapping_of as mapping_of
    from kneejax.files.reading._values import meaning as meaning
    from kneejax.files.reading._values import name as name
    from kneejax.files.reading._values import named as named
    from kneejax.files.reading._values import number as number
    from kneejax.files.reading._values import numbers as numbers
    from kneejax.files.reading._values import numbers_within as numbers_within
    from kneejax.files.reading._values import one_of as one_of
    from kneejax.files.reading._values import parameter_name as parameter_name
    from kneejax.files.reading._values import parse_flexion as parse_flexion
    from kneejax.files.reading._values import parse_range as parse_range
    from kneejax.files.reading._values import plain as plain
    from kneejax.files.reading._values import reads as reads
    from kneejax.files.reading._values import rows as rows
    from kneejax.files.reading._values import text as text
    from kneejax.files.reading._values import whole as whole
    from kneejax.files.reading._values import within as within
    from kneejax.files.reading._yaml import format_yaml as format_yaml
    from kneejax.files.reading._yaml import load_yaml as load_yaml
else:
    lazy_imports(globals())
