"""A knee like the average one, outside and inside: lenhart2015 with its bundles fitted to what was
published of motion, laxity and the forces of ligaments.

    python data/make_average_knee.py start      # data/studies/average_knee*, and the knee unfitted
    kneejax calibrate average_knee --out OUT
    python data/make_average_knee.py knee OUT   # data/knees/average_knee.yaml

To lenhart2015 come what stands on its plateaus and is not in it, menisci (`menisci.py`), the
anterolateral ligament and the tendon of popliteus; and its plateaus, steeper than the average, are
turned to the mean slopes.
`docs/average_knee.md` says what is fitted and holds the knee against what was kept aside.

`data/studies/average_knee_room.csv` says where the femur passes: poses of this knee's cartilage
with bundles that were calibrated to the same motion alone.
"""

from __future__ import annotations

import argparse
import copy
import tempfile
from pathlib import Path

import numpy as np
import yaml
from matplotlib.path import Path as Outline
from menisci import Rim, contact_of
from walker import coupled_motion

import kneejax as kj
from kneejax.files import read_poses, write_poses

HERE = Path(__file__).parent
START, NAME = "lenhart2015", "average_knee"
BUNDLES = (
    "MCLd", "MCLs", "MCLp", "ACLam", "ACLpl", "PCLal", "PCLpm", "LCL", "PFL", "pCAP",
)  # fmt: skip
#: Bundles whose ends are free too: with ends where lenhart2015 has them no slack length makes both
#: bundles of a cruciate ligament carry what they carry, and the posterior MCL ends on its bound.
MOVED, ENDS = ("ACLam", "ACLpl", "PCLal", "PCLpm", "MCLp"), ("femoral", "tibial")
#: What is believed of the published stiffnesses, as a part of each, and of reference strains, which
#: nobody measures.
STIFFNESS_PART, STRAIN = 0.2, 0.08
#: The same of structures that lenhart2015 does not have: just taut, stiffness of few knees.
ADDED_STIFFNESS_PART, ADDED_STRAIN = 0.3, 0.04
#: How far one person's attachment may be from where the average knee has it, mm.
ATTACHMENT_MM = 3.0
#: Bounds: times the published stiffness, around the published strain, and mm.
TIMES, AROUND, AWAY = 2.0, 0.25, 8.0
#: Walker's femur is not this one: mm and degrees by which a motion may differ from the average.
NOISE_MM, NOISE_DEG = 3.0, 1.0
#: The knee's own numbers and draws from the prior.
STARTS = 8
#: Of a mean of twelve knees that scatter by 1.4 to 2.5 mm.
LAXITY_MM = 0.5
#: Of forces that are published as "below 20 N". Without them a fit as good exists in which the
#: medial collateral ligament holds the tibia and the ACL is idle.
COLLATERAL_N = 10.0
#: Standard errors of the mean of forces of the ACL, of nine and ten knees: N.
SAKANE = {"file": "sakane1997"}
GABRIEL = {"file": "gabriel2004"}
#: Of the PCL the bundles are fitted and the whole is kept aside: a graft of one bundle needs its
#: share, which neither motion nor laxity determines, and what they carry together follows from
#: balance. Standard errors as for nine knees, whose number is not known here: N.
FOX = {"file": "fox1998"}
IN_SITU = [
    SAKANE | {"name": "ACL", "sd_N": 5.0, "ignore": ["ACLpl.tension_N"]},
    SAKANE | {"name": "ACLpl at 15 degrees", "sd_N": 6.0, "ignore": ["ACL.tension_N"]},
    GABRIEL | {"name": "ACLpl in extension", "sd_N": 9.5, "ignore": ["ACLam.tension_N"]},
    GABRIEL | {"name": "ACLam at 60 degrees", "sd_N": 5.4, "ignore": ["ACLpl.tension_N"]},
    FOX | {"name": "PCLal at 60 degrees", "sd_N": 7.7,
           "ignore": ["PCL.tension_N", "PCLpm.tension_N"]},
    FOX | {"name": "PCLpm at 90 degrees", "sd_N": 10.5,
           "ignore": ["PCL.tension_N", "PCLal.tension_N"]},
]  # fmt: skip
#: Assumed, with what it may be wrong by: what posterior capsule, collateral ligaments and popliteus
#: pull in unloaded extension, and the PCL in unloaded flexion, N; how far 1 kN of compression moves
#: and turns the tibia, mm and degrees (on plateaus that slope by 5.5 degrees it pushes with 96 N
#: forwards, and 90 N alone move 4 to 6 mm); and how far an anterior load does, which turns it
#: inwards (Fukubayashi 1982).
UNLOADED_N, COMPRESSION_MM, COMPRESSION_DEG = (25.0, 12.0), (4.0, 1.0), (2.0, 4.0)
#: Slack in unloaded flexion: the posterior part of the medial collateral ligament and its capsule
#: restrain an extended knee alone (Ball 2020).
SLACK, SLACK_AT = "MCLp", (60, 90, 120)
COMPRESSION_N, COMPRESSED_AT = 1000.0, (0, 30, 60, 90)
#: Internal and external rotation at 30 degrees (Komzak 2013), by a moment that is assumed.
TORSION_DEG, TORSION_NM, TORSION_SD_DEG = (12.1, -10.1), 5.0, 2.5
#: Of the coronary attachment of a meniscus, N/mm: assumed.
CORONARY_SD = 15.0
CORONARY_BOUNDS = [5.0, 120.0]
#: Flexion up to which menisci leave the femur room, degrees: beyond, it takes them along.
ROOM_DEG = 90.0
COUPLED_DEG, COUPLED_N, COUPLED_AT = (3.0, 4.0), 110.0, (15, 30, 60, 90)
#: Mean posterior slopes of the medial and the lateral plateau, degrees, of 33 women and 22 men:
#: Hashemi 2008, the mean of both sexes.
SLOPES = {"medial": 4.8, "lateral": 6.2}
_RIM = (
    "height of the posterior horn in vivo, {} mm unloaded (magnetic resonance, 20 knees), the same "
    "all around; width 10 mm; Haut Donahue 2003: 20 MPa and 0.2 across its fibres, 120 MPa along "
    "them; a horn's attachment: 18 springs of 10 N/mm; what holds its border: calibrated, study "
    "average_knee; the layer is the rim with both cartilages; {:g} mm higher than the femur leaves "
    "room from 0 to {:g} degrees"
)
RIMS = {
    "medial_meniscus": Rim("medial", 1, 6.8, _RIM.format(6.8, Rim.over_mm, ROOM_DEG)),
    "lateral_meniscus": Rim("lateral", -1, 7.6, _RIM.format(7.6, Rim.over_mm, ROOM_DEG)),
}
#: Just taut in the reference pose. Stiffness: 41.9 N/mm (Helito 2016, 14 knees) times the length.
ANTEROLATERAL = {
    "femoral_attachment_mm": [-5.0, 12.5, 36.0],
    "tibial_attachment_mm": [0.0, -30.0, 37.0],
    "stiffness_N": 1600.0,
    "reference_strain": 0.0,
    "transition_strain": 0.06,
    "transition_width": 0.0001,
    "source": {
        "femoral_attachment_mm": "Dodds 2014: 8 mm proximal and 4.3 mm posterior of the lateral "
        "epicondyle, taken as the middle of the LCL's attachments",
        "tibial_attachment_mm": "between Gerdy's tubercle (the model's ITB) and the head of the "
        "fibula (its LCL), 8 mm below the plateau",
        "stiffness_N": "Helito 2016: 41.9 N/mm (sd 25.7) of 14 knees, times the length here",
        "reference_strain": "assumed: just taut in extension",
        "transition_strain": "as the model's other fibres",
    },
}
#: One tendon, one line; straight, since it cuts less than 4 mm into the bone that it passes.
POPLITEUS = {
    "femoral_attachment_mm": [3.8, -1.0, 38.0],
    "tibial_attachment_mm": [-18.0, -31.0, 27.0],
    "stiffness_N": 3240.0,
    "reference_strain": 0.0,
    "transition_strain": 0.06,
    "transition_width": 0.0001,
    "source": {
        "femoral_attachment_mm": "Osti 2013: 5.7 mm distal and 5.0 mm anterior of the LCL's in 30 "
        "knees, taken from the middle of the model's LCL to its bone",
        "tibial_attachment_mm": "assumed: where muscle becomes tendon, on lenhart2015's bone at "
        "the posterolateral corner, 8 mm below the plateau and 10 mm medial of its PFL's",
        "stiffness_N": "LaPrade 2005: 83.7 N/mm of 8 knees, times the length here",
        "reference_strain": "assumed: just taut in extension",
        "transition_strain": "as the model's other fibres",
    },
}
ADDED = {"ALL": ANTEROLATERAL, "POP": POPLITEUS}


def study() -> dict:
    """What is fitted to what, as a study file says it."""
    quantities = ("stiffness", "reference_strain")
    held = [f"{name}.coronary_stiffness" for name in RIMS]
    names = [f"{bundle}.{what}" for bundle in (*BUNDLES, *ADDED) for what in quantities] + held
    ends = [f"{bundle}.{end}_attachment" for bundle in MOVED for end in ENDS]
    knee = _read(unfitted())
    chosen = kj.select(knee, names + ends)
    values = dict(zip(chosen.names, map(float, chosen.read(knee)), strict=True))
    stiffness = {n: x for n, x in values.items() if n.endswith(".stiffness")}
    strains = {n: x for n, x in values.items() if n.endswith(".reference_strain")}
    bounds = {n: [round(x / TIMES, 1), round(x * TIMES, 1)] for n, x in stiffness.items()}
    bounds |= {n: [round(x - AROUND, 4), round(x + AROUND, 4)] for n, x in strains.items()}
    bounds |= {
        n: [round(x - AWAY, 4), round(x + AWAY, 4)]
        for n, x in values.items()
        if "_attachment." in n
    }
    bounds |= dict.fromkeys(held, CORONARY_BOUNDS)
    tests = [
        {"name": "anterior laxity", "file": "robot_anterior_90N", "sd_mm": LAXITY_MM},
        {"name": "collateral forces", "file": "kanamori2000", "sd_N": COLLATERAL_N},
        *IN_SITU,
        {"name": "unloaded", "file": f"{NAME}_unloaded.csv", "sd_N": UNLOADED_N[1],
         "counted_from": "unloaded"},
        {"name": "compression", "file": f"{NAME}_compression.csv", "sd_mm": COMPRESSION_MM[1],
         "sd_deg": COMPRESSION_DEG[1], "counted_from": "unloaded"},
        {"name": "torsion", "file": f"{NAME}_torsion.csv", "sd_deg": TORSION_SD_DEG,
         "counted_from": "unloaded"},
        {"name": "coupled rotation", "file": f"{NAME}_coupled.csv", "sd_deg": COUPLED_DEG[1],
         "counted_from": "unloaded"},
    ]  # fmt: skip
    prior = {n: round(STIFFNESS_PART * x, 1) for n, x in stiffness.items()}
    prior |= dict.fromkeys(held, CORONARY_SD)
    prior |= dict.fromkeys(strains, STRAIN) | dict.fromkeys(ends, ATTACHMENT_MM)
    for name in ADDED:
        part = ADDED_STIFFNESS_PART * stiffness[f"{name}.stiffness"]
        prior |= {f"{name}.stiffness": round(part, 1), f"{name}.reference_strain": ADDED_STRAIN}
    return {
        "title": "An average knee: published motion, laxity and forces",
        "knee": NAME,
        "start": {name: float(f"{x:.6g}") for name, x in values.items()},
        "measured": {
            "file": f"{NAME}_passive.csv",
            "source": "Walker 1988, coupled motion of passive knees, from this knee's extension",
        },
        "frame_offset": ["adduction", "internal_rotation", "anterior", "superior"],
        "tests": tests,
        "parameters": names + ends,
        "bounds": bounds,
        "prior": prior,
        "noise_mm": NOISE_MM,
        "noise_deg": NOISE_DEG,
        "weights": {"lateral": 0.0},
        "procedures": ["III"],
        "starts": STARTS,
    }


def write_assumptions() -> None:
    """The tables of what is assumed, beside the study."""
    names = ("pCAP", "MCL", "LCL", "POP", "PFL")
    header = ",".join(f"{name}.tension_N" for name in names)
    row = ",".join(f"{UNLOADED_N[0]:g}" for _ in names)
    slack = "".join(f"{x},0{',' * len(names)},0,{UNLOADED_N[0]:g}\n" for x in SLACK_AT)
    (HERE / "studies" / f"{NAME}_unloaded.csv").write_text(
        f"flexion_deg,anterior_N,{header},{SLACK}.tension_N,PCL.tension_N\n0,0,{row},,\n{slack}"
    )
    (HERE / "studies" / f"{NAME}_torsion.csv").write_text(
        "flexion_deg,internal_Nm,internal_rotation_deg\n30,0,0\n"
        f"30,{TORSION_NM:g},{TORSION_DEG[0]:g}\n30,{-TORSION_NM:g},{TORSION_DEG[1]:g}\n"
    )
    moved = f"{COMPRESSION_MM[0]:g},{COMPRESSION_DEG[0]:g}"
    rows = [f"{x},0,0,0\n{x},{COMPRESSION_N:g},{moved}\n" for x in COMPRESSED_AT]
    (HERE / "studies" / f"{NAME}_compression.csv").write_text(
        "flexion_deg,compression_N,anterior_mm,internal_rotation_deg\n" + "".join(rows)
    )
    rows = [f"{x},0,0\n{x},{COUPLED_N:g},{COUPLED_DEG[0]:g}\n" for x in COUPLED_AT]
    (HERE / "studies" / f"{NAME}_coupled.csv").write_text(
        "flexion_deg,anterior_N,internal_rotation_deg\n" + "".join(rows)
    )


def unfitted() -> dict:
    """The start's knee document with menisci and the ligaments that it lacks."""
    document = yaml.safe_load((HERE / "knees" / f"{START}.yaml").read_text())
    poses = read_poses(HERE / "studies" / "average_knee_room.csv")
    poses = poses[poses[:, 0] <= ROOM_DEG]
    document["name"] = NAME
    document["ligaments"] |= copy.deepcopy(ADDED)
    for name, slope in SLOPES.items():
        turn_to(document, name, slope)
    knee = _read(document)
    rims = {name: contact_of(document, knee, rim, poses) for name, rim in RIMS.items()}
    document["contacts"] |= rims
    document["patella"] = {"same_as": "lenhart2015_reduced"}
    document["description"] = document["description"].replace(
        " with all 55 tibiofemoral ligament fibres, imported from its OpenSim model and cartilage",
        ", with the 55 tibiofemoral ligament fibres of its OpenSim model and its cartilage",
    )
    document["description"] += (
        "; plateaus turned to mean slopes; menisci, the anterolateral ligament and the tendon of "
        "popliteus, one fibre each, added; its bundles calibrated to the coupled motion of Walker "
        "(1988), the anterior laxity of 12 cadaver knees (PMC7148266) and in-situ forces of the "
        "cruciate and collateral ligaments"
    )
    notes = document["notes"].replace("No menisci or gravity.", "No gravity.")
    document["notes"] = notes
    return document


def turn_to(document: dict, compartment: str, slope_deg: float) -> None:
    """Turn a plateau about the lateral axis through its middle, to a mean posterior slope."""
    surface = document["contacts"][compartment]["tibial_surface"]
    knee = _read(document)
    plateau = knee.contacts[knee.contact_names.index(compartment)].tibial
    x, z = np.meshgrid(*(np.linspace(*np.asarray(ends), 40) for ends in (plateau.x, plateau.z)))
    inside = Outline(np.asarray(plateau.outline)).contains_points(np.c_[x.ravel(), z.ravel()])
    x, z = x.ravel()[inside], z.ravel()[inside]
    height = np.asarray(plateau.point(x, z)[1])
    along = np.linalg.lstsq(np.c_[np.ones_like(x), x, z], height, rcond=None)[0][1]
    own = surface["rotation_deg"][2] + np.rad2deg(np.arctan(along))
    turned = round(float(surface["rotation_deg"][2] + slope_deg - own), 4)
    surface["rotation_deg"][2] = turned
    surface["source"] += f"; turned from a mean posterior slope of {own:.1f} to {slope_deg} degrees"


def fitted(document: dict, folder: Path) -> dict:
    """A knee document with what a calibration found of its bundles."""
    whole = yaml.safe_load((folder / "knee.yaml").read_text())
    found, held = whole["ligaments"], "coronary_stiffness_N_per_mm"
    for name in RIMS:
        own, contact = whole["contacts"][name]["ring"], document["contacts"][name]
        contact["ring"][held] = float(f"{own[held]:.4g}")
    for name, fibre in document["ligaments"].items():
        said = "calibrated, study average_knee"
        fields = ("stiffness_N", "reference_strain" if name in ADDED else "slack_length_mm")
        for field in fields:
            fibre[field] = float(f"{found[name][field]:.6g}")
        if name in ADDED:
            fibre["source"] |= dict.fromkeys(fields, said)
        else:
            fibre["source"] += f"; stiffness and slack length: {said}"
        if name.startswith(MOVED):
            for field in (f"{end}_attachment_mm" for end in ENDS):
                fibre[field] = [float(f"{x:.5g}") for x in found[name][field]]
            fibre["source"] += "; attachments: calibrated, the whole bundle alike"
    return document


def _read(document: dict) -> kj.Knee:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{document['name']}.yaml"
        path.write_text(yaml.safe_dump(document))
        return kj.load_knee(path)


def write_knee(document: dict) -> None:
    """Write the bundled knee file."""
    path = HERE / "knees" / f"{NAME}.yaml"
    path.write_text(
        yaml.safe_dump(
            document, sort_keys=False, width=100, allow_unicode=True, default_flow_style=None
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["start", "knee"])
    parser.add_argument("folder", type=Path, nargs="?")
    given = parser.parse_args()
    kj.configure()
    if given.what == "knee":
        return write_knee(fitted(unfitted(), given.folder))
    write_knee(unfitted())
    straight = np.asarray(kj.passive_flexion(kj.load_knee(START), [0.0]).to_table())[0]
    poses = np.round(coupled_motion(straight), 4)
    write_poses(HERE / "studies" / "average_knee_passive.csv", poses)
    write_assumptions()
    text = yaml.safe_dump(study(), sort_keys=False, width=100)
    (HERE / "studies" / "average_knee.yaml").write_text(
        "# Written by data/make_average_knee.py; docs/average_knee.md holds the result against\n"
        "# what was kept aside.\n" + text
    )
    return None


if __name__ == "__main__":
    main()
