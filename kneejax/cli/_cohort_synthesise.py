"""`kneejax cohort synthesise`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import CohortSynthesise
from kneejax.cohorts import MadeUpKnee, Spread, synthesise
from kneejax.files import write_knee, write_poses, write_rows, write_text
from kneejax.files.reading import format_yaml
from kneejax.geometry import COORDINATES, FREE_COORDINATES

_SOURCE = "made up: kneejax cohort synthesise"
#: Bounds that hold what the distributions draw.
_BOUNDS = {"stiffness": [300.0, 30000.0], "reference_strain": [-0.25, 0.25]}
_COMMENT = """A made-up knee: its size and shape are its own, its ligaments are those of the bundled
knee. What made its data stands in truth.csv."""


def run(arguments: CohortSynthesise) -> int:
    """Make up a cohort and write its files."""
    out, count = arguments.out, arguments.knees
    spread = Spread(noise_mm=arguments.noise_mm, noise_deg=arguments.noise_deg)
    rows, truth, redrawn, names = [], [], 0, []
    with stages_on_terminal("made-up knees") as progress:
        for made in synthesise(count, arguments.seed, arguments.knee, spread):
            rows.append(_written(made, out))
            truth += [[made.name, "size", made.size]]
            truth += [[made.name, name, value] for name, value in made.truth.items()]
            redrawn, names = redrawn + made.redrawn, [test.name for test in made.tests]
            progress("made-up knees", len(rows), count)
    files = [f"{name}.file" for name in names]
    write_rows(out / "truth.csv", ["knee", "parameter", "value"], truth)
    write_rows(out / "knees.csv", ["name", "side", "knee", "measured.file", *files], rows)
    study: dict[str, Any] = {
        "title": "Made-up knee",
        "knee": "four_ligament",
        "parameters": ["*.stiffness", "*.reference_strain"],
        "bounds": _BOUNDS,
        "procedures": ["III"],
        # One over the variances.
        "weights": {"mm": spread.noise_mm**-2, "deg": spread.noise_deg**-2},
        "noise_mm": spread.noise_mm,
        "noise_deg": spread.noise_deg,
        "measured": {"file": "", "source": _SOURCE},
        "tests": [
            {"name": name, "file": "", "source": _SOURCE, "sd_mm": spread.noise_mm,
             "sd_deg": spread.noise_deg}
            for name in names
        ],
    }  # fmt: skip
    title = f"{count} made-up knees, seed {arguments.seed}"
    document = {"title": title, "study": study, "knees": "knees.csv"}
    # Last of all: without it the folder is no cohort.
    write_text(out / "cohort.yaml", format_yaml(document))
    print(f"{count} made-up knees of {arguments.knee}, seed {arguments.seed}")
    if redrawn:
        print(f"drawn again, since they had no balance somewhere: {redrawn}")
    print(f"written: {out}/cohort.yaml, knees.csv, truth.csv, knees/, data/")
    print(f"next: kneejax calibrate {out}")
    return 0


def _written(made: MadeUpKnee, out: Path) -> list[str]:
    """Write a knee and its data; its row of the table."""
    knee, passive = f"knees/{made.name}.yaml", f"data/{made.name}_passive.csv"
    write_knee(made.document, out / knee, _COMMENT)
    write_poses(out / passive, made.passive)
    row = [made.name, "right", knee, passive]
    for test in made.tests:
        row.append(f"data/{made.name}_{test.name.replace(' ', '_')}.csv")
        places = [FREE_COORDINATES.index(name) for name in test.coordinates]
        observed = [f"{name}_{COORDINATES[name].unit}" for name in test.coordinates]
        columns = [test.flexion_deg, *test.loads.values(), *test.observed[:, places].T]
        rows = np.column_stack(columns).tolist()
        write_rows(out / row[-1], ["flexion_deg", *test.loads, *observed], rows)
    return row
