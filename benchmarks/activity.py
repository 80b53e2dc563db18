"""Walking of lenhart2015 as `kneejax activity` finds it: how near to the record, how fast.

python benchmarks/activity.py ../shared/data/lenhart2015 [KNEE] [INSTANTS ...]
"""

import sys
import time
from pathlib import Path

import numpy as np

import kneejax as kj
from kneejax.experiments import activity
from kneejax.files import load_knee_file, read_activity
from kneejax.geometry import COLUMNS

FILES = "comak_coordinates.sto", "comak_muscle_forces.sto", "external_loads.xml"


def main(folder: str, name: str = "lenhart2015_reduced", *instants: str) -> None:
    """Print agreement with the record and time for each number of instants."""
    kj.configure()
    data, read = Path(folder), load_knee_file(name)
    for count in [int(x) for x in instants] or [112]:
        record = read_activity(
            data / "lenhart2015.osim", [data / "walking" / x for x in FILES], side="r",
            knee=read.knee, document=read.document, instants=count,
        )  # fmt: skip
        activity(read.knee, record)
        began, worked = time.perf_counter(), time.process_time()
        found = activity(read.knee, record)
        wall, cpu = time.perf_counter() - began, time.process_time() - worked
        away = np.asarray(found.motion.to_table()) - record.pose
        print(f"{count} instants: {found.holds.sum()} in balance")
        print(f"  hot: {wall:.1f} s, {cpu:.1f} s of cores, {count / wall:.0f} instants a second")
        rms = np.sqrt(np.nanmean(away**2, axis=0))
        print("  rms: " + ", ".join(f"{n} {x:.2f}" for n, x in zip(COLUMNS, rms, strict=True)))
        residual = found.residual_Nm
        print(f"  moment holding flexion: {np.sqrt(np.nanmean(residual**2)):.2f} N m rms, "
              f"at most {np.nanmax(np.abs(residual)):.1f}")  # fmt: skip


if __name__ == "__main__":
    main(*sys.argv[1:])
