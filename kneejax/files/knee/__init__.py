"""The knee file: its fields, reading, writing, mirroring."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module, imported when one of its names is first asked for.
_MODULES = {
    "ENDS": "kneejax.files.knee._schema_parts",
    "KneeFile": "kneejax.files.knee._file",
    "build_obstacle": "kneejax.files.knee._building",
    "build_knee": "kneejax.files.knee._file",
    "format_knee": "kneejax.files.knee._format",
    "read_knee": "kneejax.files.knee._file",
    "write_knee": "kneejax.files.knee._file",
    "mirror_document": "kneejax.files.knee._mirror",
    "mirror_part": "kneejax.files.knee._mirror",
    "reconstructed": "kneejax.files.knee._reconstructed",
    "restated": "kneejax.files.knee._restated",
    "check_knee": "kneejax.files.knee._schema",
}

if TYPE_CHECKING:
    from kneejax.files.knee._building import build_obstacle as build_obstacle
    from kneejax.files.knee._file import KneeFile as KneeFile
    from kneejax.files.knee._file import build_knee as build_knee
    from kneejax.files.knee._file import read_knee as read_knee
    from kneejax.files.knee._file import write_knee as write_knee
    from kneejax.files.knee._format import format_knee as format_knee
    from kneejax.files.knee._mirror import mirror_document as mirror_document
    from kneejax.files.knee._mirror import mirror_part as mirror_part
    from kneejax.files.knee._reconstructed import reconstructed as reconstructed
    from kneejax.files.knee._restated import restated as restated
    from kneejax.files.knee._schema import check_knee as check_knee
    from kneejax.files.knee._schema_parts import ENDS as ENDS
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
