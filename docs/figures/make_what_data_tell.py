"""Pictures of README.md and docs/identification.md, by the very commands that they print.

    python docs/figures/make_what_data_tell.py [FOLDER]

Results are written into FOLDER (by default a temporary one), each command's into one of its own;
what the commands print is shown. With two cores this takes some minutes, most of it compiling.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
#: Folder of results -> command, and its pictures: name of the figure, name of the file here.
COMMANDS = {
    "calibrate": ("calibrate", {"motion": "motion.png"}),
    "sensitivity": (
        "sensitivity paper1 --global sobol --samples 64",
        {
            "sweep_LCL_reference_strain": "tell_sweep.png",
            "local_heatmap": "tell_local.png",
            "sobol_fit": "tell_sobol.png",
        },
    ),
    "map": ("map paper1 --pair LCL.stiffness LCL.reference_strain", {"map": "tell_map.png"}),
    "identify": (
        "identify paper1 --posterior",
        {"profiles": "tell_profiles.png", "next_tests": "tell_next_tests.png"},
    ),
    "knees": (
        "sensitivity --knees four_ligament lenhart2015_reduced",
        {"scores": "tell_scores.png"},
    ),
}
_WIDTH = 1000


def main() -> None:
    """Run the commands, keep the pictures."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary)
        for name, (words, pictures) in COMMANDS.items():
            run(words.split(), folder / name)
            for figure, picture in pictures.items():
                keep(folder / name / "figures" / f"{figure}.png", HERE / picture)


def run(words: list[str], out: Path) -> None:
    """One command; a status of 1 is an answer, with doubts that it says."""
    done = subprocess.run([sys.executable, "-m", "kneejax.cli", *words, "--out", str(out)])
    if done.returncode > 1:
        raise SystemExit(done.returncode)


def keep(source: Path, target: Path) -> None:
    """A picture at a moderate size, with a palette, for a repository's sake."""
    picture = Image.open(source).convert("RGB")
    size = _WIDTH, round(_WIDTH * picture.height / picture.width)
    small = picture.resize(size, Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    small.quantize(256, kmeans=3, dither=Image.Dither.NONE).save(stream, "PNG", optimize=True)
    target.write_bytes(stream.getvalue())


if __name__ == "__main__":
    main()
