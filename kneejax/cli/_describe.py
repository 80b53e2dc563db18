"""`kneejax describe KNEE`."""

from __future__ import annotations

from kneejax.cli.options import Describe
from kneejax.files import load_knee_file
from kneejax.report import knee_text


def run(arguments: Describe) -> int:
    """Print a knee: ligaments, contacts, loads, frames, adaptations."""
    knee_file = load_knee_file(arguments.knee)
    print(knee_text(knee_file.knee, knee_file.document, arguments.fibres))
    return 0
