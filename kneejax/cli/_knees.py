"""`kneejax knees`."""

from __future__ import annotations

import argparse

from kneejax.files import (
    absent_measurement,
    bundled_knees,
    bundled_measurements,
    bundled_path,
    bundled_studies,
    load_knee_file,
)

_INDENT = " " * 23


def run(_: argparse.Namespace) -> int:
    """Print what is bundled, with its source."""
    print("Knees")
    for name in bundled_knees():
        knee_file = load_knee_file(name)
        print(f"  {name:<20} {' '.join(knee_file.description.split())}")
    print("Studies")
    for name, title in bundled_studies().items():
        print(f"  {name:<20} {title}")
        table = absent_measurement(name)
        if table is not None:
            print(f"{_INDENT}needs measured motion that is not bundled: {table}")
            print(f"{_INDENT}put it there, or name your own `file` in a copy of")
            print(f"{_INDENT}{bundled_path('studies', name)}")
    measurements = bundled_measurements()
    print("Measurements" + ("" if measurements else ": none bundled"))
    for name, measurement in measurements.items():
        print(f"  {name:<20} {measurement.title} ({measurement.source})")
    return 0
