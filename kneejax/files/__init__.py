"""Knee files, studies, tables and meshes: the only rooms that touch a disk."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files._bundled import *
    from kneejax.files._joint import *
    from kneejax.files._knees import *
    from kneejax.files._landmarks import *
    from kneejax.files.knee.document import *
    from kneejax.files.knee.file import *
    from kneejax.files.knee.restated import *
    from kneejax.files.meshes.importing import *
    from kneejax.files.meshes.points import *
    from kneejax.files.meshes.soft_tissues import *
    from kneejax.files.opensim.contact import *
    from kneejax.files.opensim.coupled import *
    from kneejax.files.opensim.export import *
    from kneejax.files.opensim.frames import *
    from kneejax.files.opensim.importing import *
    from kneejax.files.opensim.model import *
    from kneejax.files.opensim.record import *
    from kneejax.files.opensim.report import *
    from kneejax.files.opensim.whole_body import *
    from kneejax.files.reading import InputProblem as InputProblem
    from kneejax.files.reading import InputProblems as InputProblems
    from kneejax.files.reading import counted as counted
    from kneejax.files.reading import parse_flexion as parse_flexion
    from kneejax.files.reading import parse_range as parse_range
    from kneejax.files.reading import said_of as said_of
    from kneejax.files.reading import write_bytes as write_bytes
    from kneejax.files.reading import write_text as write_text
    from kneejax.files.results import *
    from kneejax.files.tables.loads import *
    from kneejax.files.tables.storage import *
    from kneejax.files.tables.tables import *
else:
    lazy_imports(globals())
