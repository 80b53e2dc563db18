"""What tests of `kneejax joint fit` share: two poses of a knee, its axes, a refusal."""

import numpy as np

from kneejax.cli import main
from kneejax.geometry import COLUMNS

ENDS = np.array([[3.5, 0.1, 5.1, -3.4, -34.6, 4.8], [86.6, -2.6, 11.3, 10.6, -33.5, 2.6]])
AXES = """
extension: {medial_mm: [6, 8, -21.5], lateral_mm: [1, 11, 23]}
flexion: {medial_mm: [0.5, 1.5, -21], lateral_mm: [-2, 1, 23.5]}
epicondyles: {medial_mm: [0, 2, -40], lateral_mm: [-1, 3, 41]}
"""

def write_poses(path, table, columns=COLUMNS):
    """A table of poses; its name."""
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, r)) for r in table)]))
    return str(path)


def refused(words, capsys, out):
    """The one line that says what is wrong, before any work."""
    assert main([*words, "--out", str(out)]) == 2
    assert not out.exists()
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    return line
