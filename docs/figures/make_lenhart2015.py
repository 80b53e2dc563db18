"""Picture of the bundled knee `lenhart2015` in passive flexion: strain of fibres, pressure.

    python docs/figures/make_lenhart2015.py [--femur-bone FILE --tibia-bone FILE]

The bones are meshes of the model, which are not bundled. The same picture, larger, and a page that
turns come from `kneejax simulate passive-flexion --knee lenhart2015 --flexion 0,30,60,90` and
`kneejax view lenhart2015 POSES.csv`.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

from kneejax.numerics import use_shared_fusion

use_shared_fusion()

import jax  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib import colormaps  # noqa: E402
from PIL import Image  # noqa: E402

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402
from kneejax import report  # noqa: E402
from kneejax.files import read_mesh_points  # noqa: E402

HERE = Path(__file__).resolve().parent
VIEWS = ("anterior", "anteromedial, from above")


def main() -> None:
    """Solve, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--femur-bone", type=Path)
    parser.add_argument("--tibia-bone", type=Path)
    arguments = parser.parse_args()
    knee = kj.load_knee("lenhart2015")
    poses = kj.passive_flexion(knee, [0.0, 30.0, 60.0, 90.0]).pose
    bones = []
    for bone, file in (("femur", arguments.femur_bone), ("tibia", arguments.tibia_bone)):
        if file is not None:
            mesh = read_mesh_points(file)
            bones.append(report.BoneMesh(bone, mesh.points_mm, mesh.faces))
    scenes = report.scenes(knee, poses, bones)
    write(report.scenes_figure(scenes, VIEWS), "lenhart2015_motion.png", 1240)


def write(figure, name: str, width: int) -> None:
    """Save a picture at a width in pixels with a palette, for a repository's sake."""
    picture = Image.open(io.BytesIO(report.picture_png(figure))).convert("RGB")
    size = width, round(width * picture.height / picture.width)
    small = picture.resize(size, Image.Resampling.LANCZOS)
    small = small.quantize(palette=palette_of(small), dither=Image.Dither.NONE)
    small.save(HERE / name, optimize=True)


def palette_of(picture: Image.Image) -> Image.Image:
    """256 colours for a picture: greys, both scales without bands, and what it has most of."""
    scales = [colormaps[name](np.linspace(0.0, 1.0, 56))[:, :3] for name in ("coolwarm", "YlOrRd")]
    greys = np.repeat(np.linspace(0.0, 1.0, 16)[:, None], 3, axis=1)
    fixed = np.round(255.0 * np.concatenate([greys, *scales])).astype(int).ravel().tolist()
    own = picture.quantize(256 - len(fixed) // 3).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette((fixed + own)[: 3 * 256])
    return palette


if __name__ == "__main__":
    main()
