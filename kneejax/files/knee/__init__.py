"""The knee file: its fields, reading, writing, mirroring."""

from kneejax.files.knee._file import KneeFile as KneeFile
from kneejax.files.knee._file import format_knee as format_knee
from kneejax.files.knee._file import read_knee as read_knee
from kneejax.files.knee._file import write_knee as write_knee
from kneejax.files.knee._mirror import mirror_document as mirror_document
from kneejax.files.knee._mirror import mirror_part as mirror_part
from kneejax.files.knee._schema import check_knee as check_knee
