"""The push-off of docs/activity.md: OpenSim's jumper on the knees of a plan.

    python docs/figures/make_push_off.py JUMPER_FOLDER GAIT2392.osim --out FOLDER

The jumper lumps biceps femoris, semimembranosus and semitendinosus into one muscle that ends on the
head of the fibula. A knee that only bends does not notice; one that is free turns its tibia
outwards under it. So a copy of the model is made in which each of the three begins where the lump
does, ends where gait2392 has it, and gets its share of the strength there; all else of the text
stays. OpenSim makes the movement from the jumper's stored excitations, and `kneejax activity` is
run with both models. Last, the lump's own tension is divided by those shares: how far the intact
knee turns then is printed. OpenSim is needed.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
import shutil
from pathlib import Path

import numpy as np

import kneejax as kj
from kneejax.cli import main as kneejax
from kneejax.experiments import activity
from kneejax.files import load_knee_file, read_activity
from kneejax.mechanics import Muscles

HERE = Path(__file__).resolve().parent
MODEL, SETUP, STATES = "DynamicJumperModel.osim", "setup_forward.xml", "out/jump_states.sto"
LUMP, PARTS = "bifemlh", ("bifemlh", "semimem", "semiten")
_STRENGTH = re.compile(r"(<max_isometric_force>)([^<]*)")
_POINT = re.compile(r"<(\w*PathPoint) name=.*?</\1>", re.DOTALL)
_PLACE = re.compile(r"(<location>)([^<]*)")
_NAME = re.compile(r'name="[^"]*"')


def three_hamstrings(jumper: str, gait2392: str) -> str:
    """The jumper's text with three hamstrings on each side."""
    for side in "rl":
        lump = _muscle(jumper, f"{LUMP}_{side}")
        parts = {f"{name}_{side}": _muscle(gait2392, f"{name}_{side}")[0] for name in PARTS}
        jumper = jumper[: lump.start()] + _divided(lump[0], parts) + jumper[lump.end() :]
    return jumper


def _muscle(text: str, name: str) -> re.Match[str]:
    found = re.search(rf'<(\w*Muscle) name="{name}">.*?</\1>', text, re.DOTALL)
    if found is None:
        raise SystemExit(f"no muscle {name}: expected OpenSim's jumper and gait2392, in this order")
    return found


def _divided(lump: str, parts: dict[str, str]) -> str:
    """Muscles in place of one, with the ends and shares of others."""
    first, second, *rest = (found[0] for found in _POINT.finditer(lump))
    whole, every = _strength(lump), sum(map(_strength, parts.values()))
    for point in rest:
        lump = lump.replace(point, "")
    answer = []
    for name, own in parts.items():
        _, *ends = (_PLACE.findall(found[0])[0][1] for found in _POINT.finditer(own))
        points = [
            _PLACE.sub(rf"\g<1>{end}", _called(second, f"{name}-P{k}"))
            for k, end in enumerate(ends, 2)
        ]
        new = lump.replace(second, "\n".join(points)).replace(first, _called(first, f"{name}-P1"))
        new = _called(new, name)
        answer.append(_STRENGTH.sub(rf"\g<1>{whole * _strength(own) / every:.6g}", new))
    return "\n".join(answer)


def _called(element: str, name: str) -> str:
    return _NAME.sub(f'name="{name}"', element, count=1)


def _strength(element: str) -> float:
    return float(_STRENGTH.findall(element)[0][1])


def turned_deg(model: Path, folder: Path, gait2392: str) -> list[tuple[float, float]]:
    """Flexion and internal rotation of the intact knee under the lump's tension, divided.

    Args:
        model: the jumper.
        folder: where OpenSim's tables of it are.
        gait2392: text of the model whose hamstrings are taken.
    """
    read = load_knee_file("ten_bundle")
    tables = [folder / name for name in ("coordinates.sto", "static_optimisation_force.sto")]
    record = read_activity(model, tables, side="r", knee=read.knee, document=read.document)
    record = record.at(np.unique(np.linspace(0, len(record.time_s) - 1, 12).round().astype(int)))
    own, at = record.muscles, record.muscles.names.index(f"{LUMP}_r")
    begin, end, tension = (np.asarray(x)[at] for x in (
        own.femoral_attachment, own.tibial_attachment, own.tension))  # fmt: skip
    parts = [_muscle(gait2392, f"{name}_r")[0] for name in PARTS]
    shares = np.array([_strength(part) for part in parts])
    text = model.read_text(encoding="utf-8", errors="surrogateescape")
    lump, *first = (_first_below(x) for x in (_muscle(text, f"{LUMP}_r")[0], *parts))
    ends = [end + (place - lump)[:, None] for place in first]
    divided = Muscles(
        np.stack([begin] * 3), np.stack(ends), shares[:, None] / shares.sum() * tension, PARTS
    )
    rest = own.only([row for row in range(len(own.names)) if row != at])
    found = activity(
        read.with_patella(), dataclasses.replace(record, muscles=rest.with_more(divided))
    )
    return [(row[0], row[2]) for row in np.asarray(found.motion.to_table())]


def _first_below(element: str) -> np.ndarray:
    """Where a muscle first touches the leg below the knee, mm in its bone."""
    _, below, *_ = (found[0] for found in _POINT.finditer(element))
    return 1e3 * np.array(_PLACE.findall(below)[0][1].split(), float)


def _movement(folder: Path) -> Path:
    """States of the push-off, by OpenSim."""
    import opensim

    here = Path.cwd()
    os.chdir(folder)
    try:
        opensim.ForwardTool(SETUP).run()
    finally:
        os.chdir(here)
    return folder / STATES


def main() -> None:
    """Move, balance, keep the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("jumper", type=Path, help="folder of the jumper and its setup")
    parser.add_argument("gait2392", type=Path, help="model whose hamstrings are taken (.osim)")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--instants", type=int, default=22)
    options = parser.parse_args()
    kj.configure()
    folder = options.out / "jumper"
    shutil.copytree(options.jumper, folder, dirs_exist_ok=True)
    states = _movement(folder.resolve())
    text, other = (path.read_text(encoding="utf-8", errors="surrogateescape")
                   for path in (folder / MODEL, options.gait2392))  # fmt: skip
    divided = folder / "three_hamstrings.osim"
    divided.write_text(
        three_hamstrings(text, other), encoding="utf-8", errors="surrogateescape"
    )
    for name, model in (("lump", folder / MODEL), ("three", divided)):
        words = ["--model", model, "--motion", states, "--time_s", "0.02:0.42", "--patella",
                 "--plan", "ten_bundle", "--instants", options.instants]  # fmt: skip
        kneejax(["activity", *map(str, words), "--out", str(options.out / name)])
    for flexion, turn in turned_deg(folder / MODEL, options.out / "lump/opensim", other):
        print(f"{flexion:6.1f} degrees of flexion: turned inwards by {turn:6.1f} degrees")
    shutil.copy(options.out / "three/figures/places.png", HERE / "push_off_places.png")


if __name__ == "__main__":
    main()
