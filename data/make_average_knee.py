"""A knee that moves like the average one: lenhart2015 with its bundles fitted to published motion.

    python data/make_average_knee.py start      # data/studies/average_knee*, and the knee unfitted
    kneejax calibrate average_knee --out OUT
    python data/make_average_knee.py knee OUT   # data/knees/average_knee.yaml

The search has two ends, and from the published numbers, about which the prior lies, it finds the
worse one: hence several starts, drawn from the prior.

To lenhart2015 come what stands on its plateaus and is not in it, menisci (`menisci.py`), and the
anterolateral ligament; both have published numbers that are not fitted. Fitted are passive motion
(Walker 1988) and the anterior laxity of intact knees (robot, 90 N). What torsion, varus-valgus and
a cut ACL do is kept aside: `docs/average_knee.md` holds the knee against it.

`data/studies/average_knee_room.csv` says where the femur passes: poses of lenhart2015 whose
bundles alone were calibrated to the same data.
"""

from __future__ import annotations

import argparse
import copy
from pathlib import Path

import numpy as np
import yaml
from menisci import Rim, contact_of
from walker import coupled_motion

import kneejax as kj
from kneejax.files import read_poses, write_poses

HERE = Path(__file__).parent
START, NAME = "lenhart2015", "average_knee"
BUNDLES = (
    "MCLd", "MCLs", "MCLp", "ACLam", "ACLpl", "PCLal", "PCLpm", "LCL", "PFL", "pCAP",
)  # fmt: skip
#: Bundles whose ends are free too: with ends where lenhart2015 has them the one is strained to 0.19
#: and the other to its bound (docs/average_knee.md).
MOVED, ENDS = ("ACLam", "MCLp"), ("femoral", "tibial")
#: What is believed of the published stiffnesses, as a part of each, and of reference strains, which
#: nobody measures.
STIFFNESS_PART, STRAIN = 0.2, 0.08
#: How far one person's attachment may be from where the average knee has it, mm.
ATTACHMENT_MM = 3.0
#: Bounds: times the published stiffness, and around the published strain.
TIMES, AROUND = 4.0, 0.25
#: Walker's femur is not this one: mm and degrees by which a motion may differ from the average.
NOISE_MM, NOISE_DEG = 3.0, 2.0
#: The knee's own numbers and draws from the prior.
STARTS = 6
#: Of a mean of twelve knees that scatter by 1.4 to 2.5 mm.
LAXITY_MM = 0.5
#: Of forces that are published as "below 20 N". Without them a fit as good exists in which the
#: medial collateral ligament holds the tibia and the ACL is idle.
COLLATERAL_N = 10.0
_RIM = (
    "height of the posterior horn in vivo, {} mm unloaded (magnetic resonance, 20 knees), the same "
    "all around; width 10 mm; elastic across its fibres: Haut Donahue 2003, 20 MPa and 0.2; the "
    "layer is the rim with both cartilages; nowhere higher than the femur leaves room"
)
RIMS = {
    "medial_meniscus": Rim("medial", 1, 6.8, _RIM.format(6.8)),
    "lateral_meniscus": Rim("lateral", -1, 7.6, _RIM.format(7.6)),
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


def study() -> dict:
    """What is fitted to what, as a study file says it."""
    names = [f"{bundle}.{what}" for bundle in BUNDLES for what in ("stiffness", "reference_strain")]
    ends = [f"{bundle}.{end}_attachment" for bundle in MOVED for end in ENDS]
    chosen = kj.select(kj.load_knee(START), names + ends)
    values = dict(zip(chosen.names, map(float, chosen.read(kj.load_knee(START))), strict=True))
    stiffness = {n: x for n, x in values.items() if n.endswith(".stiffness")}
    strains = {n: x for n, x in values.items() if n.endswith(".reference_strain")}
    bounds = {n: [round(x / TIMES, 1), round(x * TIMES, 1)] for n, x in stiffness.items()}
    bounds |= {n: [round(x - AROUND, 4), round(x + AROUND, 4)] for n, x in strains.items()}
    return {
        "title": "An average knee: published motion and laxity",
        "knee": NAME,
        "start": {name: float(f"{x:.6g}") for name, x in values.items()},
        "measured": {
            "file": "average_knee_passive.csv",
            "source": "Walker 1988, coupled motion of passive knees, from this knee's extension",
        },
        "frame_offset": ["adduction", "internal_rotation", "anterior", "superior"],
        "tests": [
            {"name": "anterior laxity", "file": "robot_anterior_90N", "sd_mm": LAXITY_MM},
            {"name": "collateral forces", "file": "kanamori2000", "sd_N": COLLATERAL_N},
        ],
        "parameters": names + ends,
        "bounds": bounds,
        "prior": {n: round(STIFFNESS_PART * x, 1) for n, x in stiffness.items()}
        | dict.fromkeys(strains, STRAIN)
        | dict.fromkeys(ends, ATTACHMENT_MM),
        "noise_mm": NOISE_MM,
        "noise_deg": NOISE_DEG,
        "weights": {"lateral": 0.0},
        "procedures": ["III"],
        "starts": STARTS,
    }


def unfitted() -> dict:
    """The start's knee document with menisci and the anterolateral ligament."""
    document = yaml.safe_load((HERE / "knees" / f"{START}.yaml").read_text())
    poses = read_poses(HERE / "studies" / "average_knee_room.csv")
    knee = kj.load_knee(START)
    document["name"] = NAME
    document["ligaments"]["ALL"] = copy.deepcopy(ANTEROLATERAL)
    rims = {name: contact_of(document, knee, rim, poses) for name, rim in RIMS.items()}
    document["contacts"] |= rims
    document["patella"] = {"same_as": "lenhart2015_reduced"}
    document["description"] = document["description"].replace(
        " with all 55 tibiofemoral ligament fibres, imported from its OpenSim model and cartilage",
        ", with the 55 tibiofemoral ligament fibres of its OpenSim model and its cartilage",
    )
    document["description"] += (
        "; menisci as rims and the anterolateral ligament, one more fibre, added; its bundles "
        "calibrated to the coupled motion of Walker (1988) and the anterior laxity of 12 cadaver "
        "knees (PMC7148266)"
    )
    notes = document["notes"].replace("No menisci or gravity.", "No gravity. The menisci are rims.")
    document["notes"] = notes
    return document


def fitted(document: dict, folder: Path) -> dict:
    """A knee document with what a calibration found of its bundles."""
    found = yaml.safe_load((folder / "knee.yaml").read_text())["ligaments"]
    for name, fibre in document["ligaments"].items():
        if name != "ALL":
            for field in ("stiffness_N", "slack_length_mm"):
                fibre[field] = float(f"{found[name][field]:.6g}")
            fibre["source"] += "; stiffness and slack length: calibrated, study average_knee"
        if name.startswith(MOVED):
            for field in (f"{end}_attachment_mm" for end in ENDS):
                fibre[field] = [float(f"{x:.5g}") for x in found[name][field]]
            fibre["source"] += "; attachments: calibrated, the whole bundle alike"
    return document


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
    text = yaml.safe_dump(study(), sort_keys=False, width=100)
    (HERE / "studies" / "average_knee.yaml").write_text(
        "# Written by data/make_average_knee.py; docs/average_knee.md holds the result against\n"
        "# what was kept aside.\n" + text
    )
    return None


if __name__ == "__main__":
    main()
