"""Menisci of a model of OpenSim JAM: bodies between two contacts become rings; the rest is said."""

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import MeshImport, import_osim, load_knee_file
from tests.files.meshes import meshed_meniscus as made
from tests.files.meshes.meshed_knee import written
from tests.files.opensim.test_nothing_is_dropped import (
    BODIES,
    CONSTRAINTS,
    JOINTS,
    PATH,
    with_force,
)

SHIFT = np.array([0.001, 0.002, -0.003])
KNEE = load_knee_file("average_knee").document


def mesh(name, body, more=""):
    return (f"<Smith2018ContactMesh name='{name}'><socket_frame>/bodyset/{body}</socket_frame>"
            f"<mesh_file>{name}.stl</mesh_file><poissons_ratio>0.45</poissons_ratio>{more}"
            "</Smith2018ContactMesh>")  # fmt: skip


def contact(name, target, casting):
    return (f"<Smith2018ArticularContactForce name='{name}'>"
            f"<socket_target_mesh>/contactgeometryset/{target}</socket_target_mesh>"
            f"<socket_casting_mesh>/contactgeometryset/{casting}</socket_casting_mesh>"
            "</Smith2018ArticularContactForce>")  # fmt: skip


def joint(body):
    words = [f"{body}_{x}" for x in ("flex", "add", "rot", "tx", "ty", "tz")]
    coordinates = "".join(
        f'<Coordinate name="{word}"><default_value>{x}</default_value></Coordinate>'
        for word, x in zip(words, [0, 0, 0, *SHIFT], strict=True)
    )
    return (f'<FreeJoint name="{body}_on_tibia"><socket_parent_frame>/bodyset/tibia_r'
            f"</socket_parent_frame><socket_child_frame>/bodyset/{body}</socket_child_frame>"
            f"<coordinates>{coordinates}</coordinates></FreeJoint>")  # fmt: skip


@pytest.fixture
def model(tmp_path, monkeypatch):
    """As smith2019: an upper and a lower mesh on each meniscus, springs to the tibia, dampers."""
    names = {"medial": "meniscus_medial_r", "lateral": "meniscus_lateral_r"}
    forces, meshes = contact("tf_contact", "femur", "tibia"), mesh("femur", "femur_r")
    meshes += mesh("tibia", "tibia_r")
    for name, body in names.items():
        for side, bone in (("upper", "femur"), ("lower", "tibia")):
            points, faces = made.wedge(KNEE, name, parts=(side,))
            written(tmp_path / f"{name}_{side}.stl", (1e-3 * points - SHIFT, faces))
            more = "<elastic_modulus>2e6</elastic_modulus><thickness>0.003</thickness>"
            meshes += mesh(f"{name}_{side}", body, more)
            forces += contact(f"{name}_on_{bone}", f"{name}_{side}", bone)
        for k in (1, 2, 3):
            path = PATH.format("tibia_r", body)
            forces += (f"<Blankevoort1991Ligament name='{name}_COR{k}'>{path}<slack_length>0.01"
                       "</slack_length></Blankevoort1991Ligament>")  # fmt: skip
        forces += (f"<SpringGeneralizedForce name='{name}_damper'><coordinate>{body}_tx"
                   "</coordinate><stiffness>0</stiffness><viscosity>5</viscosity>"
                   "</SpringGeneralizedForce>")  # fmt: skip
    for bone in ("femur", "tibia"):
        written(tmp_path / f"{bone}.stl", made.wedge(KNEE, "medial"))
    kept = {name: KNEE["contacts"][name] | {"source": {}} for name in names}
    kept = {name: part | {"source": dict.fromkeys(
        ("youngs_modulus_MPa", "poisson_ratio", "layer_thickness_mm"), "x")}
        for name, part in kept.items()}  # fmt: skip
    monkeypatch.setattr("kneejax.files.meshes.importing.import_meshes",
                        lambda *_, **__: MeshImport(kept, (), {}, False))  # fmt: skip
    bodies = "".join(f'<Body name="{body}"/>' for body in names.values())
    sets = f"<ContactGeometrySet><objects>{meshes}</objects></ContactGeometrySet>"
    text = with_force(forces, (BODIES, BODIES + bodies),
                      (JOINTS, "".join(map(joint, names.values())) + JOINTS),
                      (CONSTRAINTS, sets + CONSTRAINTS))  # fmt: skip
    path = tmp_path / "model.osim"
    path.write_text(text)
    return path


def test_menisci_become_rings_and_what_held_them_is_counted(model, tmp_path, capsys):
    words = ["import", "osim", str(model), "--side", "r", "--geometry", str(tmp_path),
             "--without-patella", "--out", str(tmp_path / "out")]  # fmt: skip
    status = main(words)
    printed = " ".join(capsys.readouterr().out.split())
    assert status == 0, printed
    assert "for which rings stand: 6 fibres" in printed and "left out: 1" not in printed
    assert "Blankevoort1991Ligament (6): medial_COR1" in printed
    document = load_knee_file(tmp_path / "out" / "knee.yaml").document
    assert [*document["contacts"]] == ["medial", "lateral", "medial_meniscus", "lateral_meniscus"]
    for name, horns in made.HORNS.items():
        part = document["contacts"][f"{name}_meniscus"]
        np.testing.assert_allclose(part["ring"]["horns_deg"], horns, atol=0.2)
        assert part["ring"]["cross_section_mm2"] == pytest.approx(made.AREA, rel=0.02)
        # 6 mm of cartilage and two layers of 3 mm, as springs in a row.
        assert part["layer_thickness_mm"] == 12.0 and part["poisson_ratio"] == pytest.approx(0.45)
        soft = 6.0 / 1.0 + 6.0 / 2.0
        assert part["youngs_modulus_MPa"] == pytest.approx(12.0 / soft)
        assert "model.osim, meniscus" in part["source"]["youngs_modulus_MPa"]
    report = (tmp_path / "out" / "import_report.md").read_text()
    assert "meniscus_medial_r: A ring stands for it and its 6 coordinates" in report
    assert "holds a meniscus, for which a ring stands" in report


def test_without_meshes_they_wait_and_one_contact_alone_is_doubted(model, tmp_path, capsys):
    words = ["import", "osim", str(model), "--side", "r", "--without-patella"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "no surfaces yet for tf_contact, meniscus_medial_r, meniscus_lateral_r" in printed
    text = model.read_text()
    off = "<appliesForce>false</appliesForce>"
    at = text.index("name='lateral_on_tibia'>") + len("name='lateral_on_tibia'>")
    found = import_osim("m.osim", side="r", patella=False,
                        data=(text[:at] + off + text[at:]).encode())  # fmt: skip
    assert [x.name for x in found.menisci] == ["meniscus_medial_r"]
    assert found.bodies == ("meniscus_lateral_r",)
    assert any("lateral_on_femur" in x and "left out, though" in x for x in found.doubts)
    assert any("lateral_COR1" in doubt for doubt in found.doubts)
