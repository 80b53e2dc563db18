"""The knee file: its fields, reading, writing, mirroring."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Module -> its public names, imported when one of them is first asked for.
_NAMES = {
    "_building": ("build_obstacle", "build_surface"),
    "_document": ("check_knee", "format_knee", "mirror_document", "mirror_part"),
    "_file": ("KneeFile", "build_knee", "read_knee", "write_knee"),
    "_parts": ("ENDS",),
    "_restated": ("reconstructed", "restated"),
}
_MODULES = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}

if TYPE_CHECKING:
    from kneejax.files.knee._building import build_obstacle as build_obstacle
    from kneejax.files.knee._building import build_surface as build_surface
    from kneejax.files.knee._document import check_knee as check_knee
    from kneejax.files.knee._document import format_knee as format_knee
    from kneejax.files.knee._document import mirror_document as mirror_document
    from kneejax.files.knee._document import mirror_part as mirror_part
    from kneejax.files.knee._file import KneeFile as KneeFile
    from kneejax.files.knee._file import build_knee as build_knee
    from kneejax.files.knee._file import read_knee as read_knee
    from kneejax.files.knee._file import write_knee as write_knee
    from kneejax.files.knee._parts import ENDS as ENDS
    from kneejax.files.knee._restated import reconstructed as reconstructed
    from kneejax.files.knee._restated import restated as restated
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
