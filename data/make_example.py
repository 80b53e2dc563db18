"""Make the example of docs/my_specimen.md: an OpenSim knee, its meshes, and a robot's tables.

    python data/make_example.py [--out FOLDER]

Nobody's knee: condyles are arcs, plateaux are dishes, attachments are round numbers, and what the
robot measured is simulated with other ligaments than the model's, plus noise. The output are the
committed files.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path

import jax
import numpy as np
import trimesh

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402
from kneejax.files import add_osim_contacts, import_osim, write_knee  # noqa: E402

HERE = Path(__file__).resolve().parent
#: Fibre -> femoral and tibial end, mm, stiffness, N per unit strain, and reference strain, of the
#: model: what somebody would take from the literature.
FIBRES = {
    "ACLam": ((-1.0, 2.0, 4.0), (19.0, -23.0, -2.0), 2000.0, 0.03),
    "ACLpl": ((-3.0, -3.0, 6.0), (13.0, -22.0, 2.0), 2000.0, 0.01),
    "PCLal": ((6.0, -4.0, -6.0), (-12.0, -28.0, 1.0), 3000.0, -0.04),
    "PCLpm": ((2.0, -6.0, -10.0), (-13.0, -30.0, -4.0), 1500.0, 0.02),
    "MCLs1": ((3.0, 2.0, -40.0), (14.0, -62.0, -18.0), 1500.0, 0.04),
    "MCLs2": ((-1.0, 2.0, -40.0), (4.0, -62.0, -22.0), 1500.0, 0.04),
    "MCLp1": ((-3.0, 3.0, -39.0), (-18.0, -34.0, -26.0), 1500.0, 0.04),
    "LCL": ((0.0, 2.0, 37.0), (-14.0, -48.0, 44.0), 1500.0, 0.04),
    "PFL": ((4.0, -6.0, 36.0), (-18.0, -38.0, 40.0), 1500.0, 0.03),
    "ALL": ((-4.0, 6.0, 38.0), (12.0, -34.0, 38.0), 1500.0, 0.02),
}
#: What the specimen has instead: of each structure, stiffness over the model's, and how much more
#: reference strain. The others are the model's.
SPECIMEN = {"ACL": (1.3, 0.02), "PCL": (0.8, 0.02), "MCL": (1.2, -0.02), "LCL": (1.3, 0.015)}
NOISE_MM, NOISE_DEG, SEED = 0.2, 0.2, 7
FLEXION = (0.0, 15.0, 30.0, 45.0)
COMPRESSION_N = 100.0
#: Middle of each compartment along Z, mm; the depth of its dish over 20 mm forwards and 12 mm to a
#: side.
COMPARTMENTS = {"medial": (-22.0, 4.0, 3.0), "lateral": (22.0, 1.5, 2.0)}
TIBIA_MM = -30.0


def sheet(rows: int, columns: int, point) -> trimesh.Trimesh:
    """A rectangular sheet of triangles, its corners by two parameters from 0 to 1."""
    u, v = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (
        x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return trimesh.Trimesh(point(u.ravel(), v.ravel()), faces, process=False)


def condyle(middle: float) -> trimesh.Trimesh:
    def point(u, v):
        angle, z = np.deg2rad(40.0 + 190.0 * u), 32.0 * (v - 0.5)
        radius = 24.0 + 6.0 / (1.0 + np.exp((angle - np.deg2rad(115.0)) / 0.35)) - z**2 / 44.0
        return 1e-3 * np.stack(
            [radius * np.cos(angle), -radius * np.sin(angle), middle + z], axis=1
        )

    return sheet(40, 15, point)


def plateau(middle: float, forwards: float, aside: float) -> trimesh.Trimesh:
    def point(u, v):
        x, z = 40.0 * (u - 0.5), 26.0 * (v - 0.5)
        y = TIBIA_MM + forwards * (x / 20.0) ** 2 + aside * (z / 12.0) ** 2
        return 1e-3 * np.stack([x, y, middle + z], axis=1)

    mesh = sheet(17, 12, point)
    mesh.invert()
    return mesh


def write_model(folder: Path) -> None:
    """Write specimen.osim and the two meshes that it names."""
    geometry = folder / "Geometry"
    geometry.mkdir(parents=True, exist_ok=True)
    parts = {
        "femur_cartilage": [condyle(middle) for middle, *_ in COMPARTMENTS.values()],
        "tibia_cartilage": [plateau(*sizes) for sizes in COMPARTMENTS.values()],
    }
    for name, sheets in parts.items():
        trimesh.util.concatenate(sheets).export(geometry / f"{name}.stl")
    (folder / "specimen.osim").write_text(MODEL.format(
        fibres="\n".join(fibre(name, *numbers) for name, numbers in FIBRES.items()),
        meshes="\n".join(MESH.format(bone=bone) for bone in ("femur", "tibia")),
        coordinates="\n".join(COORDINATE.format(name=name) for _, name, _ in AXES),
        axes="\n".join(
            AXIS.format(kind=kind, number=k % 3 + 1, name=name, axis=axis)
            for k, (kind, name, axis) in enumerate(AXES)
        ),
    ), encoding="utf-8")  # fmt: skip


def fibre(name: str, femoral, tibial, stiffness: float, strain: float) -> str:
    """A ligament of OpenSim's, its slack length from the strain at the reference pose."""
    slack = np.linalg.norm(np.subtract(femoral, tibial)) / (1.0 + strain)
    ends = [" ".join(f"{1e-3 * x:.4f}" for x in end) for end in (femoral, tibial)]
    return FIBRE.format(name=name, femoral=ends[0], tibial=ends[1], stiffness=stiffness,
                        slack=1e-3 * slack)  # fmt: skip


def specimen(folder: Path) -> kj.Knee:
    """The knee that the robot had: the model's with other ligaments."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "knee.yaml"
        read = import_osim(folder / "specimen.osim", side="r")
        write_knee(add_osim_contacts(read, folder / "Geometry").document, file)
        knee = kj.load_knee(file)
    values = {}
    for name, (_, _, stiffness, strain) in FIBRES.items():
        factor, more = SPECIMEN.get(name[:3], (1.0, 0.0))
        values |= {
            f"{name}.stiffness": factor * stiffness,
            f"{name}.reference_strain": strain + more,
        }
    return knee.replace(values)


def write_tables(folder: Path, knee: kj.Knee) -> None:
    """Simulate what the robot did, and write it as the robot did: columns and senses of its own."""
    cases = [
        (None, 0.0),
        *((test, part * size) for test, (_, size, *_) in TABLES.items() for part in PARTS),
    ]
    of_test = [
        kj.load_of(**{
            name: np.tile([size if own == test else 0.0 for own, size in cases], len(FLEXION))
            for test, (name, *_) in TABLES.items()
        })
    ]  # fmt: skip
    flexion = np.repeat(FLEXION, len(cases))
    found = kj.passive_flexion(knee, flexion, [kj.load_of(compression_N=COMPRESSION_N), *of_test])
    print(sorted({kj.Status(one).word for one in found.status.tolist()}))
    shape = (len(FLEXION), len(cases), 6)
    poses = np.asarray(found.to_table("grood-suntay")).reshape(shape)
    changes, noise = poses - poses[:, :1], np.random.default_rng(SEED)
    for test, (_, _, force, per_force, moved, sign, column) in TABLES.items():
        rows = []
        for at, flexion in enumerate(FLEXION):
            for case, (own, size) in enumerate(cases):
                if own == test:
                    sd = NOISE_MM if column >= 3 else NOISE_DEG
                    change = sign * (changes[at, case, column] + noise.normal(0.0, sd))
                    rows.append([f"{flexion:g}", f"{per_force * size:g}", f"{change:.2f}"])
        with (folder / f"{test}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(
                [["Flexion Angle (deg)", force, moved], *rows]
            )
    (folder / "README.txt").write_text(ABOUT, encoding="utf-8")


#: Test -> load, full size, the robot's name of it and its unit and sense, the robot's name of what
#: moved, its sense, and its column among poses.
TABLES = {
    "drawer": ("anterior_N", 100.0, "Posterior Force (N)", -1.0, "JCS Posterior (mm)", -1.0, 3),
    "torsion": ("internal_Nm", 5.0, "Torque (Nmm)", 1000.0, "JCS Internal (deg)", 1.0, 2),
    "varus": ("varus_Nm", 8.0, "Varus Torque (Nm)", 1.0, "JCS Varus (deg)", 1.0, 1),
}
PARTS = (-1.0, -0.5, 0.5, 1.0)
ABOUT = """\
An OpenSim knee, its cartilage meshes and a robot's tables, for docs/my_specimen.md

Everything here is made up by data/make_example.py of kneejax. specimen.osim and Geometry are
nobody's knee. drawer.csv, torsion.csv and varus.csv are what a robot would have measured on a
specimen whose ligaments differ from the model's: simulated by kneejax under 100 N of compression,
with noise of 0.2 mm and 0.2 degrees, in columns as a robot might name them. study.yaml fits the
model's ligaments to them.
"""
AXES = (
    ("rotation", "knee_flex_r", "0 0 -1"), ("rotation", "knee_add_r", "1 0 0"),
    ("rotation", "knee_rot_r", "0 1 0"), ("translation", "knee_tx_r", "1 0 0"),
    ("translation", "knee_ty_r", "0 1 0"), ("translation", "knee_tz_r", "0 0 1"),
)  # fmt: skip
COORDINATE = """\
      <Coordinate name="{name}"><default_value>0</default_value></Coordinate>"""
AXIS = """\
      <TransformAxis name="{kind}{number}">
        <coordinates>{name}</coordinates><axis>{axis}</axis>
        <LinearFunction name="function"><coefficients>1 0</coefficients></LinearFunction>
      </TransformAxis>"""
FIBRE = """\
    <Blankevoort1991Ligament name="{name}">
      <GeometryPath name="path"><PathPointSet><objects>
        <PathPoint name="{name}-P1"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
          <location>{femoral}</location></PathPoint>
        <PathPoint name="{name}-P2"><socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
          <location>{tibial}</location></PathPoint>
      </objects></PathPointSet></GeometryPath>
      <linear_stiffness>{stiffness:g}</linear_stiffness><slack_length>{slack:.6f}</slack_length>
      <transition_strain>0.06</transition_strain><damping_coefficient>0</damping_coefficient>
    </Blankevoort1991Ligament>"""
MESH = """\
    <Smith2018ContactMesh name="{bone}_cartilage">
      <socket_frame>/bodyset/{bone}_r</socket_frame>
      <mesh_file>{bone}_cartilage.stl</mesh_file>
      <elastic_modulus>5000000</elastic_modulus><poissons_ratio>0.45</poissons_ratio>
      <thickness>0.003</thickness>
    </Smith2018ContactMesh>"""
MODEL = """\
<?xml version="1.0" encoding="UTF-8"?>
<!-- Made by data/make_example.py of kneejax: nobody's knee. -->
<OpenSimDocument Version="40500">
<Model name="specimen">
  <length_units>m</length_units><force_units>N</force_units>
  <Ground name="ground"/>
  <BodySet name="bodyset"><objects>
    <Body name="femur_r"><mass>1</mass></Body>
    <Body name="tibia_r"><mass>1</mass></Body>
  </objects></BodySet>
  <JointSet name="jointset"><objects>
    <WeldJoint name="clamp">
      <socket_parent_frame>/ground</socket_parent_frame>
      <socket_child_frame>/bodyset/femur_r</socket_child_frame>
    </WeldJoint>
    <CustomJoint name="knee_r">
      <socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
      <socket_child_frame>/bodyset/tibia_r</socket_child_frame>
      <coordinates>
{coordinates}
      </coordinates>
      <SpatialTransform>
{axes}
      </SpatialTransform>
    </CustomJoint>
  </objects></JointSet>
  <ForceSet name="forceset"><objects>
{fibres}
    <Smith2018ArticularContactForce name="knee_contact">
      <socket_target_mesh>/contactgeometryset/femur_cartilage</socket_target_mesh>
      <socket_casting_mesh>/contactgeometryset/tibia_cartilage</socket_casting_mesh>
    </Smith2018ArticularContactForce>
  </objects></ForceSet>
  <ContactGeometrySet name="contactgeometryset"><objects>
{meshes}
  </objects></ContactGeometrySet>
</Model>
</OpenSimDocument>
"""


def main() -> None:
    """Write everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "examples" / "specimen")
    out = parser.parse_args().out
    write_model(out)
    write_tables(out, specimen(out))


if __name__ == "__main__":
    main()
