"""CSV tables: poses, candidate tests, any rows."""

from kneejax.files.tables._candidates import CandidateRow as CandidateRow
from kneejax.files.tables._candidates import read_candidates as read_candidates
from kneejax.files.tables._tables import FEMORAL as FEMORAL
from kneejax.files.tables._tables import cell_number as cell_number
from kneejax.files.tables._tables import read_poses as read_poses
from kneejax.files.tables._tables import read_rows as read_rows
from kneejax.files.tables._tables import write_poses as write_poses
from kneejax.files.tables._tables import write_rows as write_rows
