"""`kneejax knees`."""

from __future__ import annotations

import argparse
import textwrap

from kneejax.files import (
    absent_measurement,
    bundled_knee_descriptions,
    bundled_laxity_sources,
    bundled_measurements,
    bundled_path,
    bundled_studies,
)

_INDENT = " " * 23
_HANGING = {"subsequent_indent": _INDENT, "break_on_hyphens": False}


def run(_: argparse.Namespace) -> int:
    """Print what is bundled, with its source."""
    print("Knees")
    for name, description in bundled_knee_descriptions().items():
        print(textwrap.fill(description, 98, initial_indent=f"  {name:<20} ", **_HANGING))
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
        said = f"{measurement.title} ({measurement.source})"
        print(textwrap.fill(said, 98, initial_indent=f"  {name:<20} ", **_HANGING))
    print("Laxity, as others measured it: drawn beside `simulate` under the same load,")
    print("and a test of a study by its name, with `load:` where that is not known")
    for name, source in bundled_laxity_sources().items():
        print(textwrap.fill(source, 98, initial_indent=f"  {name:<24} ", **_HANGING))
    return 0
