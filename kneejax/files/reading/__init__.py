"""Text, YAML and checked fields; problems that say file, field and value."""

from kneejax.files.reading._problem import InputProblem as InputProblem
from kneejax.files.reading._problem import counted as counted
from kneejax.files.reading._problem import nearest_name as nearest_name
from kneejax.files.reading._schema import Field as Field
from kneejax.files.reading._text import neighbour as neighbour
from kneejax.files.reading._text import read_bytes as read_bytes
from kneejax.files.reading._text import read_text as read_text
from kneejax.files.reading._text import write_bytes as write_bytes
from kneejax.files.reading._text import write_text as write_text
from kneejax.files.reading._yaml import format_yaml as format_yaml
from kneejax.files.reading._yaml import load_yaml as load_yaml
