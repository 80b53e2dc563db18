"""The knee file: its fields, reading, writing, mirroring."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.knee.document import check_knee as check_knee
    from kneejax.files.knee.document import mirror_part as mirror_part
    from kneejax.files.knee.file import build_knee as build_knee
    from kneejax.files.knee.parts import ENDS as ENDS
    from kneejax.files.knee.surfaces import build_obstacle as build_obstacle
    from kneejax.files.knee.surfaces import build_surface as build_surface
else:
    lazy_imports(globals())
