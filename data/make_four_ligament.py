"""Make the bundled knee `four_ligament` from the public meshes and ligaments of lenhart2015.

    python data/make_four_ligament.py FOLDER_OF_lenhart2015 [--out FILE] [--figures FOLDER]

Surfaces are our own fits to the cartilage meshes, attachments are means of fibre bundles, and the
parameters are those of paper 1's Table 1. The output is the committed file, byte for byte.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from kneejax import geometry as geo  # noqa: E402
from kneejax.files import read_mesh_points, write_knee  # noqa: E402
from kneejax.report import save_figure, surface_fit_figure  # noqa: E402

HERE = Path(__file__).resolve().parent
DEFAULT_SOURCE = HERE.parent.parent / "shared" / "data" / "lenhart2015"

#: Table 1 of paper 1: stiffness (N) and reference strain.
TABLE_1 = {
    "ACL": (4500.0, 0.03),
    "PCL": (3860.0, -0.1),
    "MCL": (8000.0, 0.07),
    "LCL": (6000.0, 0.07),
}
#: Bundles of the source whose attachments are averaged.
BUNDLES = {"ACL": "ACL", "PCL": "PCL", "MCL": "MCLs", "LCL": "LCL"}
AXIS_POINT_MM = (-3.0, -1.0, 0.0)
#: Regions as large as the cartilage, and the parts of them that meet in passive flexion.
CONDYLE = {"angle_deg": (15.0, 250.0), "degree": (5, 2)}
CONDYLE_WIDTH_MM = {"medial": (-34.0, -6.0), "lateral": (6.0, 36.0)}
PLATEAU_REGION_MM = {
    "medial": {"x_mm": (-20.0, 24.0), "z_mm": (-32.0, -2.0)},
    "lateral": {"x_mm": (-19.0, 19.0), "z_mm": (3.0, 37.0)},
}
MEETS_DEG = (45.0, 222.0)
MEETS_MM = {
    "medial": {"width": (-32.0, -10.0), "x": (-15.0, 18.0), "z": (-27.0, -11.0)},
    "lateral": {"width": (10.0, 32.0), "x": (-14.0, 14.0), "z": (10.0, 29.0)},
}
#: Weight of cartilage that meets under load only: it keeps low powers from running off there.
BESIDE_CONDYLE, BESIDE_PLATEAU = 0.05, 0.02
CITATION = (
    "lenhart2015 model of OpenSim JAM (Apache-2.0); Lenhart et al., Annals of Biomedical "
    "Engineering 43 (2015)"
)


def main() -> None:
    """Read the source, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", nargs="?", type=Path, default=DEFAULT_SOURCE)
    parser.add_argument("--out", type=Path, default=HERE / "knees" / "four_ligament.yaml")
    parser.add_argument("--figures", type=Path, help="folder for a picture of the residuals")
    arguments = parser.parse_args()
    write_knee(document(arguments.source), arguments.out)
    if arguments.figures:
        fits = {}
        for name in PLATEAU_REGION_MM:
            condyle, plateau = surface_fits(name, arguments.source)
            fits |= {f"{name} condyle": condyle, f"{name} plateau": plateau}
        save_figure(surface_fit_figure(fits), arguments.figures, "surface_fits", svg=True)


def document(source: Path) -> dict:
    """The knee file as nested dictionaries."""
    with (source / "ligaments.csv").open() as file:
        ligaments = list(csv.DictReader(file))
    return {
        "kneejax": 1,
        "name": "four_ligament",
        "side": "right",
        "description": (
            "Four straight ligaments on the articular surfaces of one healthy adult's right knee, "
            "with the parameters of paper 1's Table 1"
        ),
        "reference_pose": {
            "flexion_deg": 0.0,
            "adduction_deg": 0.0,
            "internal_rotation_deg": 0.0,
            "anterior_mm": 0.0,
            "superior_mm": 0.0,
            "lateral_mm": 0.0,
            "source": f"pose of the MRI in extension (all coordinates zero), {CITATION}",
        },
        "ligaments": {name: _ligament(name, ligaments) for name in TABLE_1},
        "contacts": {name: _contact(name, source) for name in ("medial", "lateral")},
        # Of the same person, in the same frames.
        "patella": {"same_as": "lenhart2015_reduced"},
        "lines": {"patellar_tendon": _patellar_tendon(source, ligaments)},
        "adaptations": ADAPTATIONS,
        "notes": (
            "The tibia turns outwards beyond 40 degrees of flexion, where measured knees turn "
            "inwards: lines between the means of the footprints do not hold it. Those of "
            "four_ligament_fitted do."
        ),
    }


ADAPTATIONS = [
    {
        "field": "ligaments.*.reference_length",
        "from": "37.1, 29.6, 82.5, 54.4 mm (Table 1)",
        "to": "26.6, 31.9, 80.9, 57.3 mm, the lengths of the mean fibres at the reference pose",
        "reason": "another person's knee; reference strains are kept, slack lengths follow",
    },
    {
        "field": "contacts.*.femoral_surface.coefficients_mm",
        "from": "degree 8 in angle and 6 in width (0.06 to 0.14 mm rms)",
        "to": "degree 5 in angle, 2 in width; what meets in passive flexion weighs 20 times more",
        "reason": (
            "one elliptical patch needs a gap with one minimum: with degree 4 in width the lateral "
            "contact point jumps by 8 mm between 25 and 45 degrees"
        ),
    },
    {
        "field": "contacts.*.tibial_surface.coefficients_mm",
        "from": "degree 4 to 6 over the whole sheet",
        "to": "total degree 2; what meets in passive flexion weighs 50 times more",
        "reason": "as above: a second minimum of the gap",
    },
    {
        "field": "lines.patellar_tendon",
        "from": "2 kg on the quadriceps tendon over a patella (paper 1)",
        "to": "the same force as the patellar tendon's pull along the patella's recorded path",
        "reason": (
            "without any compression the knee is loose where the patella is not asked for. "
            "Recorded 0 to 90 degrees; continued to 120 along the circle of the last 45 degrees"
        ),
    },
]


def _ligament(name: str, rows: list[dict]) -> dict:
    fibres = [row for row in rows if row["name"].startswith(BUNDLES[name])]
    ends = {
        end: np.mean([[1e3 * float(row[f"{p}_{a}_m"]) for a in "xyz"] for row in fibres], axis=0)
        for end, p in (("femoral", "p1"), ("tibial", "p2"))
    }
    stiffness, strain = TABLE_1[name]
    points = f"mean of the {len(fibres)} fibres {BUNDLES[name]}*, {CITATION}"
    return {
        "femoral_attachment_mm": _rounded(ends["femoral"], 3),
        "tibial_attachment_mm": _rounded(ends["tibial"], 3),
        "stiffness_N": stiffness,
        "reference_strain": strain,
        "transition_strain": 0.03,
        "transition_width": 0.001,
        "source": {
            "femoral_attachment_mm": points,
            "tibial_attachment_mm": points,
            "stiffness_N": "paper 1, Table 1",
            "reference_strain": "paper 1, Table 1",
            "transition_strain": "paper 1, Eq 2: twice 0.015",
            "transition_width": "chosen: the tension errs by less than 0.6 N at 9300 N",
        },
    }


def surface_fits(name: str, source: Path):
    """Fits of a compartment's condyle and plateau."""
    femur = read_mesh_points(source / "meshes" / "lenhart2015-R-femur-cartilage.stl").points_mm
    tibia = read_mesh_points(source / "meshes" / "lenhart2015-R-tibia-cartilage.stl").points_mm
    condyle = geo.fit_condyle(
        femur,
        width_mm=CONDYLE_WIDTH_MM[name],
        frame=geo.Frame(AXIS_POINT_MM),
        weights=np.where(_femur_meets(femur, name), 1.0, BESIDE_CONDYLE),
        **CONDYLE,
    )
    plateau = geo.fit_plateau(
        tibia,
        degree=(2, 2),
        total_degree=2,
        weights=np.where(_tibia_meets(tibia, name), 1.0, BESIDE_PLATEAU),
        **PLATEAU_REGION_MM[name],
    )
    return condyle, plateau


def _femur_meets(points: np.ndarray, name: str) -> np.ndarray:
    x, y, z = (points - np.array(AXIS_POINT_MM)).T
    angle, width = np.degrees(0.5 * np.pi - np.arctan2(x, -y)), MEETS_MM[name]["width"]
    return _between(angle, MEETS_DEG) & _between(z, width)


def _tibia_meets(points: np.ndarray, name: str) -> np.ndarray:
    along = [
        (2.0 * value - sum(limits)) / np.ptp(limits)
        for value, limits in zip(points.T[[0, 2]], (MEETS_MM[name][c] for c in "xz"), strict=True)
    ]
    return along[0] ** 2 + along[1] ** 2 < 1.0


def _between(value: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    return (value > limits[0]) & (value < limits[1])


def _contact(name: str, source: Path) -> dict:
    condyle, plateau = surface_fits(name, source)
    region = PLATEAU_REGION_MM[name]
    return {
        "form": "elliptical_patch",
        "law": "log",
        "youngs_modulus_MPa": 5.0,
        "poisson_ratio": 0.45,
        "layer_thickness_mm": 6.0,
        "onset_width_mm": 0.02,
        "femoral_surface": {
            "kind": "condyle",
            "axis_point_mm": list(AXIS_POINT_MM),
            "angle_deg": list(CONDYLE["angle_deg"]),
            "width_mm": list(CONDYLE_WIDTH_MM[name]),
            "coefficients_mm": _rounded(condyle.surface.coefficients, 5),
            "fit_rms_mm": round(condyle.rms, 3),
            "fit_max_mm": round(condyle.maximum, 3),
            "source": f"own fit to {len(condyle.points)} vertices of the femur cartilage, "
            f"{CITATION}",
        },
        "tibial_surface": {
            "kind": "plateau",
            "origin_mm": [0.0, 0.0, 0.0],
            "anterior_mm": list(region["x_mm"]),
            "lateral_mm": list(region["z_mm"]),
            "coefficients_mm": _rounded(plateau.surface.coefficients, 5),
            "fit_rms_mm": round(plateau.rms, 3),
            "fit_max_mm": round(plateau.maximum, 3),
            "source": f"own fit to {len(plateau.points)} vertices of the tibia cartilage, "
            f"{CITATION}",
        },
        "source": (
            "E, nu and law: paper 3, section 4.1.3; layer: both cartilages, 6 mm, lenhart2015"
        ),
    }


def _patellar_tendon(source: Path, rows: list[dict]) -> dict:
    fibres = [row for row in rows if row["name"].startswith("PT")]
    origin, insertion = (
        np.mean([[1e3 * float(row[f"{p}_{a}_m"]) for a in "xyz"] for row in fibres], axis=0)
        for p in ("p1", "p2")
    )
    recorded = np.genfromtxt(
        source / "recorded" / "jam_passive_flexion_kinematics.csv", delimiter=",", names=True
    )
    flexion = np.radians(recorded["knee_flex_r_deg"])
    patella = np.column_stack([recorded[f"pf_t{a}_r_mm"] for a in "xyz"])
    path = patella + [_turn(-angle, origin) for angle in np.radians(recorded["pf_flex_r_deg"])]
    flexion, path = _continued(flexion, path)
    powers = np.vander(flexion, 5, increasing=True)
    coefficients, *_ = np.linalg.lstsq(powers, path, rcond=None)
    return {
        "tension_N": 19.61,
        "insertion_mm": _rounded(insertion, 3),
        "origin_mm": _rounded(coefficients, 3),
        "source": (
            "tension: 2 kg, paper 1, section 2.1; insertion and path of the origin with the "
            f"patella: mean of the 6 fibres PT* and recorded passive flexion, {CITATION}"
        ),
    }


def _continued(flexion: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The path to 120 degrees: along the circle of its last 45 degrees, at the same pace."""
    late = flexion > flexion.max() - np.radians(45)
    x, y = path[late, 0], path[late, 1]
    fit, *_ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x * x + y * y)
    center, radius = fit[:2], np.sqrt(fit[2] + fit[:2] @ fit[:2])
    angle = np.unwrap(np.arctan2(y - center[1], x - center[0]))
    pace, first = np.polyfit(flexion[late], angle, 1)
    beyond = np.radians(np.linspace(92, 120, 29))
    turn = first + pace * beyond
    depth = np.full_like(beyond, path[late, 2][-1])
    circle = np.column_stack(
        [center[0] + radius * np.cos(turn), center[1] + radius * np.sin(turn), depth]
    )
    # One sample a degree: the record has many at rest.
    grid = np.radians(np.arange(0.0, np.degrees(flexion.max())))
    order = np.argsort(flexion)
    early = np.column_stack([np.interp(grid, flexion[order], path[order, k]) for k in range(3)])
    return np.r_[grid, beyond], np.vstack([early, circle])


def _turn(angle: float, point: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]])


def _rounded(values, digits: int) -> list:
    # Adding zero turns -0.0 into 0.0.
    return (np.round(np.asarray(values, float), digits) + 0.0).tolist()


if __name__ == "__main__":
    main()
