"""Make the bundled knees `lenhart2015` and `lenhart2015_reduced` from the public model and meshes.

    python data/make_lenhart2015.py [FOLDER_OF_lenhart2015] [--out FOLDER]

`lenhart2015` is what `kneejax import osim` makes of the model: every tibiofemoral fibre, the wrap
objects, and surfaces fitted to the cartilage meshes. `lenhart2015_reduced` has one line a bundle.
The output are the committed files, byte for byte.
"""

from __future__ import annotations

import argparse
import copy
import tempfile
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from scipy.optimize import minimize_scalar

jax.config.update("jax_enable_x64", True)

from kneejax.files import (  # noqa: E402
    KneeFile,
    add_osim_contacts,
    import_osim,
    load_knee_file,
    read_knee,
    write_knee,
)
from kneejax.geometry import Frame, Pose, State  # noqa: E402
from kneejax.mechanics import Knee, add_lane_axis, ligament_law  # noqa: E402

HERE = Path(__file__).resolve().parent
DEFAULT_SOURCE = HERE.parent.parent / "shared" / "data" / "lenhart2015"
CITATION = (
    "lenhart2015 model of OpenSim JAM (Apache-2.0); Lenhart et al., Annals of Biomedical "
    "Engineering 43 (2015)"
)
#: Line of the reduced knee -> fibres it stands for. The capsule is one bundle in the model, but
#: its line would run between the condyles: it is parted by the condyle that a fibre begins on.
BUNDLES = {
    "MCLd": ("MCLd",),
    "MCLs": ("MCLs",),
    "MCLp": ("MCLp",),
    "ACLam": ("ACLam",),
    "ACLpl": ("ACLpl",),
    "PCLal": ("PCLal",),
    "PCLpm": ("PCLpm",),
    "LCL": ("LCL",),
    "PFL": ("PFL",),
    "pCAPm": ("pCAP1", "pCAP3", "pCAP5", "pCAP7"),
    "pCAPl": ("pCAP2", "pCAP4", "pCAP6", "pCAP8"),
}
#: Likewise of the patella. The tendon is three lines, since its breadth turns the patella.
PATELLAR_BUNDLES = {
    "PTl": ("PT1", "PT5"),
    "PTc": ("PT3", "PT4"),
    "PTm": ("PT2", "PT6"),
    "lPFL": ("lPFL",),
    "mPFL": ("mPFL",),
}
ALL_BUNDLES = BUNDLES, PATELLAR_BUNDLES
GROUPS = {
    "MCL": ["MCLd", "MCLs", "MCLp"],
    "ACL": ["ACLam", "ACLpl"],
    "PCL": ["PCLal", "PCLpm"],
    "pCAP": ["pCAPm", "pCAPl"],
}
#: Recorded instants before this one, s, still settle from the start of the simulation.
SETTLED_S = 0.5


def main() -> None:
    """Read the source, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", nargs="?", type=Path, default=DEFAULT_SOURCE)
    parser.add_argument("--out", type=Path, default=HERE / "knees")
    arguments = parser.parse_args()
    write_both(arguments.source, arguments.out)


def write_both(source: Path, out: Path) -> None:
    """Write both knees into a folder."""
    full = document(source)
    write_knee(full, out / "lenhart2015.yaml")
    read = read_knee(out / "lenhart2015.yaml")
    write_knee(reduced(full, read, recorded_poses(source)), out / "lenhart2015_reduced.yaml")


def document(source: Path) -> dict[str, Any]:
    """The knee with every fibre."""
    read = import_osim(source / "lenhart2015.osim", side="r")
    made = add_osim_contacts(read, source / "meshes").document
    reasons = [note.partition(": ") for note in read.knee.found.notes]
    straight = [
        {
            "field": f"ligaments.{fibre}.wrap",
            "from": "a wrap object",
            "to": "none: a straight line",
            "reason": said.removesuffix("."),
        }
        for fibre, _, said in reasons
    ]
    return made | {
        "description": (
            f"One healthy adult's right knee with all {len(made['ligaments'])} tibiofemoral "
            f"ligament fibres, imported from its OpenSim model and cartilage meshes: {CITATION}"
        ),
        "lines": load_knee_file("four_ligament").document["lines"],
        "adaptations": [PULL, SURFACES, _corners(made["ligaments"]), *straight],
        "notes": (
            "No menisci or gravity. Patella, its ligaments and muscles stand in a section of their "
            "own, which acts where the patella is asked for; without it the line patellar_tendon "
            "stands for them. The iliotibial band (ITB1) is there too: like muscles it comes from "
            "the pelvis, and an isolated knee has none. "
            f"{_contact_note(made['contacts'])} Fibres take the shortest way around a wrap object; "
            "for MCLp4 and MCLp5 the ways around both sides of Med_LigP_r are nearly as long over "
            "much of the motion. damping_N_s is the model's and plays no part in statics. "
            f"{' '.join(read.knee.found.patella)}"
        ),
    }


def _contact_note(contacts: dict[str, Any]) -> str:
    sums = ", ".join(f"{name} {m} x {n}" for name, (m, n) in _points(contacts).items())
    thick = {part["layer_thickness_mm"] for part in contacts.values()}
    assert len(thick) == 1
    return (
        f"The layer is {thick.pop():g} mm thick everywhere: 3 mm of cartilage on either bone, "
        f"as in the model. Pressure is summed over a grid of points on the tibia: {sums}."
    )


def _points(contacts: dict[str, Any]) -> dict[str, list[int]]:
    return {name: part["points"] for name, part in contacts.items()}


def recorded_poses(source: Path) -> State:
    """OpenSim JAM's own passive flexion, 0 to 90 degrees, of both bones."""
    file = source / "recorded" / "jam_passive_flexion_kinematics.csv"
    rows = np.genfromtxt(file, delimiter=",", names=True)
    equilibrium = rows["time"] >= SETTLED_S

    def pose(prefix: str, *names: str) -> Pose:
        table = np.stack([rows[f"{prefix}_{name}"] for name in names], axis=1)
        return Pose.from_table(table[equilibrium])

    shifts = ("tx_r_mm", "ty_r_mm", "tz_r_mm")
    return State(
        {
            "tibia": pose("knee", "flex_r_deg", "add_r_deg", "rot_r_deg", *shifts),
            "patella": pose("pf", "flex_r_deg", "rot_r_deg", "tilt_r_deg", *shifts),
        }
    )


def reduced(full: dict[str, Any], read: KneeFile, poses: State) -> dict[str, Any]:
    """The knee with one line a bundle, whose slack lengths are fitted to the bundles' forces."""
    answer = copy.deepcopy(full) | {
        "name": "lenhart2015_reduced",
        "description": (
            "The knee lenhart2015 with one line for each ligament bundle, on the same articular "
            f"surfaces: {CITATION}"
        ),
        "groups": GROUPS,
    }
    del answer["imported_from"]
    every = full["ligaments"], full["patella"]["ligaments"]
    sets = [_fibres(parts, bundles) for parts, bundles in zip(every, ALL_BUNDLES, strict=True)]
    for part, fibres, parts in zip((answer, answer["patella"]), sets, every, strict=True):
        lines = {name: _line([parts[f] for f in members]) for name, members in fibres.items()}
        used = {line.get("wrap") for line in (*lines.values(), *part.get("muscles", {}).values())}
        for line in lines.values():
            _keep_outside(line, part["wraps"])
        part["ligaments"] = lines
        part["wraps"] = {name: wrap for name, wrap in part["wraps"].items() if name in used}
    forces = _bundle_forces(read.with_patella(), sets[0] | sets[1], poses)
    lines = answer["ligaments"] | answer["patella"]["ligaments"]
    misses = {
        name: _fit_slack_length(lines[name], forces[name], length)
        for name, length in _lengths(answer, poses).items()
    }
    return answer | {
        "adaptations": [PULL, SURFACES, _corners(answer["ligaments"]), *_adaptations(misses)],
        "notes": (
            "Made of the knee lenhart2015. Attachments are means of the fibres', stiffnesses their "
            "sums. A single line pulls later and more suddenly than fibres that tighten one after "
            "the other; what that costs in force stands in the adaptations. "
            f"{_contact_note(answer['contacts'])} No menisci or gravity. The section of the "
            "patella acts where the patella is asked for; the tendon is three lines there, and the "
            "iliotibial band is left out, since its pull is that of one pose of the hip."
        ),
    }


def _fibres(parts: dict[str, Any], bundles: dict[str, tuple]) -> dict[str, list[str]]:
    return {name: [f for f in parts if f.startswith(stems)] for name, stems in bundles.items()}


def _line(fibres: list[dict[str, Any]]) -> dict[str, Any]:
    ends = {
        end: np.round(np.mean([fibre[end] for fibre in fibres], axis=0), 3).tolist()
        for end in fibres[0]
        if end.endswith("_attachment_mm")
    }
    wraps = {fibre.get("wrap") for fibre in fibres}
    wrap = wraps.pop() if len(wraps) == 1 else None
    same = ("transition_strain", "transition_width", "failure_strain")
    return {
        **ends,
        **({"wrap": wrap} if wrap else {}),
        "stiffness_N": sum(fibre["stiffness_N"] for fibre in fibres),
        # Where the search begins; fitted below.
        "slack_length_mm": float(np.mean([fibre["slack_length_mm"] for fibre in fibres])),
        **{field: fibres[0][field] for field in same},
        "source": (
            f"{len(fibres)} fibres, {CITATION}; slack length: own fit to their force, see "
            "adaptations"
        ),
    }


def _keep_outside(line: dict[str, Any], wraps: dict[str, Any]) -> None:
    """Move the first attachment out of its ellipsoid: a mean of points on it lies within."""
    wrap = wraps.get(line.get("wrap"))
    if wrap is None or wrap["bone"] != "patella":
        return
    frame = Frame(wrap["center_mm"], np.deg2rad(wrap["rotation_deg"])).placement
    local = np.array([float(x) for x in frame.apply_inverse(line["patellar_attachment_mm"])])
    size = np.linalg.norm(local / wrap["semi_axes_mm"])
    out = frame.apply(tuple(local * max(1.0, 1.001 / size)))
    line["patellar_attachment_mm"] = [round(float(x), 3) for x in out]


@eqx.filter_jit
def _tension(knee: Knee, poses: State) -> jax.Array:
    return add_lane_axis(knee.ligaments).tension(poses)


@eqx.filter_jit
def _length(knee: Knee, poses: State) -> jax.Array:
    return add_lane_axis(knee.ligaments).length(poses)


def _bundle_forces(knee: Knee, fibres: dict[str, list[str]], poses: State) -> dict[str, np.ndarray]:
    tension = np.asarray(_tension(knee, poses))
    rows = {name: i for i, name in enumerate(knee.ligaments.names)}
    return {name: tension[[rows[f] for f in many]].sum(axis=0) for name, many in fibres.items()}


def _lengths(document: dict[str, Any], poses: State) -> dict[str, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        write_knee(document, Path(folder) / "knee.yaml")
        knee = read_knee(Path(folder) / "knee.yaml").with_patella()
    return dict(zip(knee.ligaments.names, np.asarray(_length(knee, poses)), strict=True))


def _fit_slack_length(
    line: dict[str, Any], wanted: np.ndarray, length: np.ndarray
) -> tuple[float, float, float]:
    """Set the slack length whose force is nearest to the fibres' over the motion.

    Returns:
        Root mean square and largest difference of the forces, and the largest force, N.
    """
    constants = [line[name] for name in ("stiffness_N", "transition_strain", "transition_width")]

    def miss(slack: float) -> np.ndarray:
        return np.asarray(ligament_law.tension(length / slack - 1.0, *constants)) - wanted

    def squares(slack: float) -> float:
        return float(np.sum(miss(slack) ** 2))

    # Several minima: a coarse look at all of them first.
    tried = line["slack_length_mm"] * np.linspace(0.8, 1.2, 801)
    best = int(np.argmin([squares(slack) for slack in tried]))
    bounds = tried[best - 1], tried[best + 1]
    found = minimize_scalar(squares, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    line["slack_length_mm"] = round(float(found.x), 4)
    left = miss(line["slack_length_mm"])
    return float(np.sqrt(np.mean(left**2))), float(np.abs(left).max()), float(wanted.max())


PULL = {
    "field": "lines.patellar_tendon",
    "from": "a patella with its ligaments, the quadriceps and the iliotibial band",
    "to": "the pull of the patellar tendon of four_ligament, 19.61 N",
    "reason": "without any compression the knee would be loose where the patella is not asked for",
}
SURFACES = {
    "field": "contacts.*",
    "from": "triangles of the cartilage meshes",
    "to": "cubic splines fitted to their corners, smoothed and cut at the cartilage's border",
    "reason": (
        "twice continuously differentiable; what the fits leave over in the contact region stands "
        "with each surface as fit_rms_mm and fit_max_mm"
    ),
}


def _corners(ligaments: dict[str, Any]) -> dict[str, str]:
    names = ("stiffness_N", "transition_strain", "transition_width")
    rows = {tuple(part[name] for name in names) for part in ligaments.values()}
    error = max(float(ligament_law.largest_tension_error(*row)) for row in rows)
    return {
        "field": "ligaments.*.transition_width",
        "from": "0: corners in the slope of the force",
        "to": "0.0001 of strain",
        "reason": f"derivatives at the corners; a force errs by at most {error:.2g} N",
    }


def _adaptations(misses: dict[str, tuple[float, float, float]]) -> list[dict[str, str]]:
    said = "; ".join(
        f"{name} {rms:.1f}, {worst:.1f} of {largest:.1f}"
        for name, (rms, worst, largest) in misses.items()
    )
    return [
        {
            "field": "ligaments.*.slack_length_mm",
            "from": "one a fibre",
            "to": "the one whose force is nearest to that of the fibres together (least squares)",
            "reason": (
                "over OpenSim JAM's recorded passive flexion, 0 to 90 degrees; difference, root "
                f"mean square and largest, and largest force of the fibres, N: {said}"
            ),
        },
        {
            "field": "ligaments.MCLp.wrap",
            "from": "Med_LigP_r for four of five fibres",
            "to": "none: a straight line",
            "reason": "a line wraps where all fibres of its bundle do",
        },
    ]


if __name__ == "__main__":
    main()
