"""Tables: poses, candidate tests, any rows as CSV; OpenSim's .sto and .mot."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.tables._loads import CandidateRow as CandidateRow
    from kneejax.files.tables._loads import LabTable as LabTable
    from kneejax.files.tables._loads import read_candidates as read_candidates
    from kneejax.files.tables._loads import read_lab_table as read_lab_table
    from kneejax.files.tables._loads import read_loads as read_loads
    from kneejax.files.tables._loads import read_loads_over_time as read_loads_over_time
    from kneejax.files.tables._storage import Storage as Storage
    from kneejax.files.tables._storage import angles_rad as angles_rad
    from kneejax.files.tables._storage import column_of as column_of
    from kneejax.files.tables._storage import common_times as common_times
    from kneejax.files.tables._storage import last_word as last_word
    from kneejax.files.tables._storage import read_storage as read_storage
    from kneejax.files.tables._tables import Table as Table
    from kneejax.files.tables._tables import read_patella_poses as read_patella_poses
    from kneejax.files.tables._tables import read_poses as read_poses
    from kneejax.files.tables._tables import read_rows as read_rows
    from kneejax.files.tables._tables import write_poses as write_poses
    from kneejax.files.tables._tables import write_rows as write_rows
else:
    lazy_imports(globals())
