"""Tables: poses, candidate tests, any rows as CSV; OpenSim's .sto and .mot."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.tables.storage import Storage as Storage
    from kneejax.files.tables.storage import angles_rad as angles_rad
    from kneejax.files.tables.storage import common_times as common_times
    from kneejax.files.tables.storage import last_word as last_word
    from kneejax.files.tables.tables import Table as Table
    from kneejax.files.tables.tables import read_rows as read_rows
else:
    lazy_imports(globals())
