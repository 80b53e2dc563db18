"""`kneejax knees`."""

from __future__ import annotations

import argparse

from kneejax.files import bundled_knees, bundled_measurements, bundled_studies, load_knee_file


def run(_: argparse.Namespace) -> int:
    """Print what is bundled, with its source."""
    print("Knees")
    for name in bundled_knees():
        knee_file = load_knee_file(name)
        print(f"  {name:<20} {' '.join(knee_file.description.split())}")
    print("Studies")
    for name, title in bundled_studies().items():
        print(f"  {name:<20} {title}")
    measurements = bundled_measurements()
    print("Measurements" + ("" if measurements else ": none bundled"))
    for name, measurement in measurements.items():
        print(f"  {name:<20} {measurement.title} ({measurement.source})")
    return 0
