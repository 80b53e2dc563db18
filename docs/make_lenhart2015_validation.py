"""Write docs/validation_lenhart2015.md: an imported knee against what OpenSim JAM recorded on it.

    python docs/make_lenhart2015_validation.py [FOLDER_OF_lenhart2015]

Every number of the page and its figures comes from this run.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import re
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np

import kneejax as kj

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), *(str(HERE.parent / "tests" / x) for x in ("validation", "mechanics"))]

import equilibrium_lenhart2015 as standing  # noqa: E402
import lenhart2015_figures as figures  # noqa: E402
import recorded_lenhart2015 as recorded  # noqa: E402
from imported_lenhart2015 import import_both  # noqa: E402
from lenhart2015_text import page  # noqa: E402
from raycast_foundation import load_mesh_mm, raycast_contact  # noqa: E402
from second_knee import write_second_knee  # noqa: E402

from kneejax.mechanics import Knee, Ligaments  # noqa: E402
from kneejax.report.look.style import picture_png, write_whole  # noqa: E402

#: Flexion, degrees, at which the outcomes of equilibrium are parted.
BANDS = ((0, 10), (10, 20), (20, 25), (25, 30), (30, 35), (35, 45), (45, 60), (60, 90))
#: Directions from which each pose is sought, and steps of a search more patient than usual.
STARTS, PATIENT_STEPS = 4, 150


def main() -> None:
    """Import, compare, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=recorded.DATA)
    data = parser.parse_args().folder
    kj.use_shared_fusion()
    jax.config.update("jax_enable_x64", True)
    record = recorded.read_record(data)
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch)
        second = write_second_knee(data / "lenhart2015.osim", data / "meshes", out / "unseen")
        first, twin = import_both(data, second, out)
    knee = recorded.alone(first.knee)
    found = kj.evaluate(knee, record.poses())
    entries = first.document["ligaments"]
    obstacles = {name: entry["wrap"] for name, entry in entries.items() if "wrap" in entry}
    results = {
        "record": record,
        "knee": knee,
        "document": first.document,
        "versions": _versions(),
        "fibres": recorded.compare_fibres(knee, obstacles, found, record),
        "contact": recorded.compare_contact(found, record),
        "rays": _rays(data, knee, found, record),
        "points": _by_points(knee, record),
        "twin": _twin(twin, second, found, record),
        "criteria": recorded.CONTACT_CRITERIA,
    }
    results["bundles"] = _bundles(knee.ligaments.names)
    results["standing"] = _stand(knee, record)
    _draw(results, np.asarray(found.tension))
    write_whole(HERE / "validation_lenhart2015.md", page(results).encode())


def _versions() -> dict[str, str]:
    others = ("jax", "numpy", "scipy", "trimesh")
    return {"kneejax": kj.__version__} | {x: importlib.metadata.version(x) for x in others}


def _bundles(names) -> dict[str, list[int]]:
    """Bundle -> rows of its fibres, which differ in the number at the end."""
    bundles: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        bundles.setdefault(re.sub(r"\d+$", "", name), []).append(row)
    return bundles


def _rays(data: Path, knee: Knee, found, record) -> list[dict]:
    """The foundation by rays between the meshes, at five instants spread over the record."""
    entry = knee.contacts[0]
    meshes = [
        load_mesh_mm(data / "meshes" / f"lenhart2015-R-{bone}-cartilage.stl")
        for bone in ("femur", "tibia")
    ]
    answer = []
    for row in np.linspace(0, len(record.time) - 1, 5).astype(int):
        layer = float(entry.modulus), float(entry.layer_thickness)
        rays = raycast_contact(*meshes, record.table[row], *layer)
        ours = np.asarray(found.contact_force)[row].sum(axis=0)
        theirs = record.force[row]
        answer.append(
            {
                "flexion": record.flexion[row],
                "recorded": np.linalg.norm(theirs),
                "rays": np.linalg.norm(rays.force),
                "ours": np.linalg.norm(ours),
                "rays_error": np.linalg.norm(rays.force - theirs) / np.linalg.norm(theirs),
                "ours_error": np.linalg.norm(ours - theirs) / np.linalg.norm(theirs),
            }
        )
    return answer


def _by_points(knee: Knee, record) -> list[dict]:
    """Contact with fewer and with more points, at every eighth instant."""
    rows = np.arange(0, len(record.time), 8)
    bare = dataclasses.replace(knee, ligaments=Ligaments(*[[]] * 6, names=()), groups=())
    answer = []
    for factor in (0.5, 1, 2, 4):
        contacts = tuple(
            dataclasses.replace(c, points=tuple(max(1, round(factor * n)) for n in c.points))
            for c in bare.contacts
        )
        found = kj.evaluate(dataclasses.replace(bare, contacts=contacts), record.poses(rows))
        compared = recorded.compare_contact(found, record, rows)
        answer.append({"points": [c.points for c in contacts], "compared": compared})
    return answer


def _twin(twin, second, found, record) -> dict:
    """The unseen knee against the record and against the known knee, scaled."""
    rows = np.arange(0, len(record.time), 10)
    table = record.table[rows] * [1, 1, 1, *[second.scale] * 3]
    here = kj.evaluate(recorded.alone(twin.knee), kj.Pose.from_table(table))
    known = [np.asarray(x)[rows] for x in (found.length, found.tension)]
    forces = [np.asarray(x.contact_force).sum(axis=1) for x in (here, found)]
    ours, theirs = (np.linalg.norm(x, axis=1) for x in forces)
    return {
        "scale": second.scale,
        "side": twin.knee.side,
        "instants": len(rows),
        "length": np.abs(np.asarray(here.length) / second.scale / known[0] - 1.0).max(),
        "tension": np.abs(np.asarray(here.tension) - known[1]).max(),
        "force": np.abs(ours / second.scale**2 / theirs[rows] - 1.0).max(),
        "compared": recorded.compare_contact(here, record, rows, second.scale),
    }


def _stand(knee: Knee, record) -> dict:
    """Equilibrium at every instant: the missing wrench as a load, then with the tendon's fibres."""
    rows, poses, answer = np.arange(len(record.time)), record.poses(), {}
    for name, share in (("dead", 0.0), ("tendon", 1.0)):
        lanes = standing.standing(knee, record, rows, share)
        patient = standing.EnergyNewton(most_steps=PATIENT_STEPS)
        answer[name] = {
            "footing": standing.footing(lanes, poses),
            "searches": [standing.search_from_away(lanes, poses, seed) for seed in range(STARTS)],
            "patient": standing.search_from_away(lanes, poses, 0, patient),
            "load": np.linalg.norm(np.asarray(lanes.loads[0].force), axis=0),
        }
    fibres, footing = list(standing.tendon_fibres(record)), answer["tendon"]["footing"]
    line = standing.without_elasticity(footing, lanes, poses, fibres)
    return answer | {
        "smallest": {
            "dead load": answer["dead"]["footing"].eigenvalues[:, 0],
            "line of constant tension": line.eigenvalues[:, 0],
            "elastic tendon": footing.eigenvalues[:, 0],
        },
        "patient_steps": PATIENT_STEPS,
        "usual_steps": standing.EnergyNewton().most_steps,
        "bands": BANDS,
        "limits": (standing.RETURN_DEG, standing.RETURN_MM),
        "start": (standing.START_DEG, standing.START_MM),
        "arm_mm": standing.ARM_MM,
        "fibres": len(fibres),
    }


def _draw(results: dict, tension: np.ndarray) -> None:
    record, fibres, stand = results["record"], results["fibres"], results["standing"]
    bundles = {
        name: (tension[:, rows].sum(axis=1), fibres.recorded_force[rows].sum(axis=0))
        for name, rows in results["bundles"].items()
    }
    ends = [(x.turned, x.moved) for x in (stand[k]["searches"][0] for k in ("dead", "tendon"))]
    loose = ~stand["dead"]["footing"].holds
    drawn = {
        "fibres": figures.fibres(record.flexion, bundles, fibres.rows),
        "contact": figures.contact(record.flexion, results["contact"], results["criteria"]),
        "equilibrium": figures.equilibrium(
            record.flexion, stand["smallest"], loose, ends, stand["limits"]
        ),
    }
    for name, figure in drawn.items():
        write_whole(HERE / "figures" / f"validation_{name}.png", picture_png(figure))


if __name__ == "__main__":
    main()
