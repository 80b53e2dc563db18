"""Make the bundled knees `ten_bundle` (paper 2) and `twelve_bundle` (paper 3).

    python data/make_ten_bundle.py [--out FOLDER]

Both papers print stiffness and reference strain of each bundle, and neither where its bundles begin
and end. So each bundle takes the attachments of one fibre of lenhart2015, on the surfaces of that
knee. The output are the committed files, byte for byte.
"""

from __future__ import annotations

import argparse
import copy
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kneejax.files import write_knee

HERE = Path(__file__).resolve().parent
#: Whose surfaces and pull of the patellar tendon are taken, and whose fibres.
SURFACES, FIBRES = "lenhart2015_reduced", "lenhart2015"
#: Bundle -> fibres of lenhart2015 among which its own is; those of one ligament in the same part of
#: it: superficial and deep MCL by how far forwards they begin and end.
MAY_BE = {
    "aACL": ("ACLam*",),
    "pACL": ("ACLpl*",),
    "aPCL": ("PCLal*",),
    "pPCL": ("PCLpm*",),
    "aMCL": ("MCLs1", "MCLs2"),
    "iMCL": ("MCLs5", "MCLs6"),
    "pMCL": ("MCLs3", "MCLs4"),
    "aDMCL": ("MCLd2", "MCLd3"),
    "pDMCL": ("MCLd1", "MCLd4", "MCLd5"),
    "LCL": ("LCL*",),
}
#: Paper 2, Table 1: reference length in mm, stiffness in N, reference strain.
TABLE_1 = {
    "aACL": (32.3, 1500.0, 0.02),
    "pACL": (24.7, 1600.0, 0.01),
    "aPCL": (25.8, 2600.0, -0.23),
    "pPCL": (25.2, 1900.0, 0.02),
    "aMCL": (72.2, 2500.0, 0.02),
    "iMCL": (73.1, 3000.0, 0.04),
    "pMCL": (88.0, 2500.0, 0.02),
    "aDMCL": (36.3, 2000.0, -0.08),
    "pDMCL": (37.2, 4500.0, 0.03),
    "LCL": (55.9, 2000.0, 0.02),
}
#: Farthest that a tibial end is moved along its bundle, mm: cruciates and collaterals insert over
#: areas of about that radius, the superficial MCL along a strip.
FARTHEST_MM, FARTHEST_SUPERFICIAL_MM = 3.0, 5.0
#: Paper 3's bundle -> bundle of `ten_bundle` whose attachments it has, stiffness in N, reference
#: strain, and where the two numbers come from.
PRINTED, LOST, ASSUMED = (
    "paper 3, Table 1",
    "paper 2, Table 1: this row of paper 3's table is lost",
    "paper 3, Table 1; reference strain assumed: that of its other bundles behind the axis",
)
PAPER_3 = {
    "aAC": ("aACL", 1500.0, 0.02, PRINTED),
    "pAC": ("pACL", 1600.0, 0.02, PRINTED),
    "aPC": ("aPCL", 2600.0, -0.21, PRINTED + ", where it stands beside the name of pPC"),
    "pPC": ("pPCL", 1900.0, 0.02, LOST),
    "aMC": ("aMCL", 2500.0, 0.05, PRINTED),
    "iMC": ("iMCL", 3000.0, 0.04, PRINTED),
    "pMC": ("pMCL", 2500.0, 0.02, PRINTED),
    "aCM": ("aDMCL", 2000.0, -0.08, PRINTED),
    "pCM": ("pDMCL", 4500.0, 0.03, LOST),
    "LCL": ("LCL", 2000.0, 0.02, PRINTED),
}
#: Paper 3's posterior capsule -> fibres whose mean attachments it has.
CAPSULE = {"LPC": ("pCAP2", "pCAP6", "pCAP8"), "MPC": ("pCAP1", "pCAP5", "pCAP7")}
CAPSULE_N, CAPSULE_STRAIN = 1500.0, 0.02
#: Both papers: the force is linear from twice 0.03 on.
LAW = {"transition_strain": 0.06, "transition_width": 0.0001}
#: Beginning of a name without its place -> strain at which the ligament fails, as in lenhart2015;
#: plays no part in forces.
FAILS = {"AC": 0.15, "PC": 0.18, "MC": 0.17, "DM": 0.17, "CM": 0.17, "LCL": 0.15}
CAPSULE_FAILS = 0.15
GROUPS = {
    "ten_bundle": {
        "ACL": ["aACL", "pACL"],
        "PCL": ["aPCL", "pPCL"],
        "MCL": ["aMCL", "iMCL", "pMCL", "aDMCL", "pDMCL"],
    },
    "twelve_bundle": {
        "ACL": ["aAC", "pAC"],
        "PCL": ["aPC", "pPC"],
        "MCL": ["aMC", "iMC", "pMC", "aCM", "pCM"],
        "pCap": ["LPC", "MPC"],
    },
}
NOTES = (
    "For paper {paper}'s tests of laxity, not for passive motion: beyond 30 degrees the tibia "
    "turns outwards. No menisci, muscles or gravity."
)


def main() -> None:
    """Write both knees."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "knees")
    out = parser.parse_args().out
    for name, document in documents().items():
        write_knee(document, out / f"{name}.yaml")


def documents() -> dict[str, dict[str, Any]]:
    """Name -> document of each knee."""
    base = yaml.safe_load((HERE / "knees" / f"{SURFACES}.yaml").read_text())
    fibres = yaml.safe_load((HERE / "knees" / f"{FIBRES}.yaml").read_text())["ligaments"]
    lines, moved = ten(fibres)
    return {
        "ten_bundle": _knee(
            base, "ten_bundle", lines, 2,
            "The ten ligament bundles of paper 2's Table 1, straight, on the articular surfaces of "
            "one healthy adult's right knee (lenhart2015)",
            [_ends_from(moved), _straight("MCL")],
        ),
        "twelve_bundle": _knee(
            base, "twelve_bundle", twelve(lines, fibres), 3,
            "The twelve bundles of paper 3's Table 1, straight, on the articular surfaces of one "
            "healthy adult's right knee (lenhart2015)",
            [_ends_of_ten(), _reconstructed(), _straight("MCL and capsule")],
        ),
    }  # fmt: skip


def ten(fibres: dict[str, Any]) -> tuple[dict[str, Any], dict[str, tuple[str, float]]]:
    """Paper 2's bundles; and bundle -> the fibre whose line it has, mm by which its tibial end was
    moved away from the femoral one."""
    lines, moved = {}, {}
    for name, (length, stiffness, strain) in TABLE_1.items():
        sizes = {one: _length(fibres[one]) for one in _among(fibres, MAY_BE[name])}
        chosen = min(sizes, key=lambda one: abs(sizes[one] - length))
        by = length - sizes[chosen]
        superficial = chosen.startswith("MCLs")
        if abs(by) > (FARTHEST_SUPERFICIAL_MM if superficial else FARTHEST_MM):
            raise SystemExit(f"{name}: {chosen} is {sizes[chosen]:.1f} mm long, not {length:g}")
        femoral, tibial = _ends(fibres[chosen])
        tibial = femoral + (tibial - femoral) * length / sizes[chosen]
        source = f"attachments: fibre {chosen}, tibial one moved by {by:.1f} mm; numbers: paper 2, "
        lines[name] = _line(femoral, tibial, stiffness, strain, _fails(name), source + "Table 1")
        moved[name] = chosen, by
    return lines, moved


def twelve(lines: dict[str, Any], fibres: dict[str, Any]) -> dict[str, Any]:
    """Paper 3's bundles, along the lines of paper 2's."""
    answer = {}
    for name, (own, stiffness, strain, source) in PAPER_3.items():
        ends = [np.array(lines[own][f"{end}_attachment_mm"]) for end in ("femoral", "tibial")]
        said = f"attachments: {own} of ten_bundle; numbers: {source}"
        answer[name] = _line(*ends, stiffness, strain, _fails(name), said)
    for name, members in CAPSULE.items():
        ends = np.mean([_ends(fibres[one]) for one in members], axis=0)
        said = f"attachments: means of fibres {', '.join(members)}; numbers: {ASSUMED}"
        answer[name] = _line(*ends, CAPSULE_N, CAPSULE_STRAIN, CAPSULE_FAILS, said)
    return answer


def _among(fibres: dict[str, Any], patterns: tuple[str, ...]) -> list[str]:
    stems = tuple(pattern.removesuffix("*") for pattern in patterns)
    return [one for one in fibres if one.startswith(stems)]


def _ends(fibre: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    femoral, tibial = (np.array(fibre[f"{end}_attachment_mm"]) for end in ("femoral", "tibial"))
    return femoral, tibial


def _length(fibre: dict[str, Any]) -> float:
    """Of the straight line in the reference pose, in which both bones share one frame."""
    femoral, tibial = _ends(fibre)
    return float(np.linalg.norm(tibial - femoral))


def _fails(name: str) -> float:
    """Of `aACL`, what stands beside AC; the LCL has no place in front."""
    return next(strain for part, strain in FAILS.items() if name.lstrip("aip").startswith(part))


def _line(
    femoral: np.ndarray,
    tibial: np.ndarray,
    stiffness: float,
    strain: float,
    fails: float,
    source: str,
) -> dict[str, Any]:
    return {
        "femoral_attachment_mm": np.round(femoral, 3).tolist(),
        "tibial_attachment_mm": np.round(tibial, 3).tolist(),
        "stiffness_N": stiffness,
        "reference_strain": strain,
        **LAW,
        "failure_strain": fails,
        "source": source,
    }


def _knee(
    base: dict[str, Any], name: str, lines: dict[str, Any], paper: int, said: str, adapted: list
) -> dict[str, Any]:
    """A knee with other ligaments."""
    kept = [part for part in base["adaptations"] if part["field"] in KEPT]
    answer = copy.deepcopy(base) | {
        "name": name,
        "description": said,
        "ligaments": lines,
        "patella": {"same_as": SURFACES},
        "groups": GROUPS[name],
        "adaptations": [*adapted, *kept],
        "notes": NOTES.format(paper=paper),
    }
    del answer["wraps"]
    return answer


#: Adaptations of the surfaces' knee that hold here as well.
KEPT = ("lines.patellar_tendon", "contacts.*", "ligaments.*.transition_width")


def _ends_from(moved: dict[str, tuple[str, float]]) -> dict[str, str]:
    each = ", ".join(f"{name} {one} {by:+.1f}" for name, (one, by) in moved.items())
    return {
        "field": "ligaments.*.tibial_attachment_mm",
        "from": "attachments of paper 2's generic model, which it does not print",
        "to": (
            "of the fibres of lenhart2015 in the same part of a ligament the one whose length in "
            "the reference pose is nearest to the reference length, its tibial end then moved "
            "along the line until both are the same"
        ),
        "reason": (
            "length, stiffness and reference strain are those of Table 1 then, on these bones; "
            f"fibre and mm by which the tibial end was moved away from the femur: {each}"
        ),
    }


def _ends_of_ten() -> dict[str, str]:
    return {
        "field": "ligaments.*_attachment_mm",
        "from": "attachments of Garg and Walker (1990), Blankevoort (1991) and Reicher (1993)",
        "to": "those of ten_bundle; of the capsule, means of fibres on its own side",
        "reason": "paper 3 prints neither ends nor lengths: stiffness and strain alone are its own",
    }


def _reconstructed() -> dict[str, str]:
    return {
        "field": "ligaments.*.reference_strain",
        "from": "a Table 1 whose rows are partly lost",
        "to": (
            "aPC has the numbers that stand beside pPC, whose own and pCM's are paper 2's; LPC and "
            f"MPC have {CAPSULE_STRAIN:g}, an ASSUMPTION"
        ),
        "reason": "of the capsule the table has kept the stiffness alone",
    }


def _straight(what: str) -> dict[str, str]:
    return {
        "field": "ligaments.*.wrap",
        "from": f"wrap objects of lenhart2015 for {what}",
        "to": "none: straight lines",
        "reason": "as in the paper, which lets no ligament touch a bone",
    }


if __name__ == "__main__":
    main()
