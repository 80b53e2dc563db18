"""Tables of tests, and studies of them."""

import yaml

import kneejax as kj
from kneejax.files import write_rows


def table(folder, name="drawer.csv", header=("flexion_deg", "anterior_N", "anterior_mm"), rows=()):
    rows = rows or [(30.0, 45.0, 2.5), (30.0, 90.0, 4.0), (60.0, 90.0, 3.0)]
    write_rows(folder / name, header, rows)
    return folder / name


def study(folder, tests=({"name": "drawer", "file": "drawer.csv"},), **fields):
    file = folder / "study.yaml"
    document = {
        "title": "Laxity", "knee": "four_ligament", "parameters": ["ACL.stiffness"],
        "tests": list(tests),
    }  # fmt: skip
    file.write_text(yaml.safe_dump(document | fields))
    return kj.read_study(file)
