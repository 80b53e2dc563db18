"""Knees from OpenSim models and from meshes, and their numbers written into a model."""

import copy
from collections.abc import Sequence

from kneejax import files
from kneejax.cli._deliver import deliver
from kneejax.cli._words import SIDES
from kneejax.cli.options import knees as options
from kneejax.files.opensim.report import import_sections
from kneejax.report import knee_import
from kneejax.report.look import Table
from kneejax.studies import stages_on_terminal


def import_model(arguments: options.ImportOsim) -> int:
    """Write a knee from an OpenSim model, and what of it was read and left out."""
    read = files.import_osim(arguments.file, side=arguments.side, femur=arguments.femur,
                             tibia=arguments.tibia, without=arguments.without,
                             inside=arguments.inside, patella=not arguments.without_patella,
                             at=arguments.at)  # fmt: skip
    document, file, findings, missed = read.document, arguments.out / "knee.yaml", (), False
    if arguments.geometry is None:
        # It was checked when it was read; to build the knee takes longer.
        files.write_text(file, files.format_knee(document))
    else:
        with stages_on_terminal("surfaces and layers"):
            geometry = files.add_osim_contacts(read, arguments.geometry)
        document, findings, missed = geometry.document, geometry.findings, geometry.doubtful
        files.write_knee(document, file)
    files.write_text(arguments.out / "import_report.md", files.format_import_report(read, findings))
    knee = read.knee
    parts = {"fibre": read.ligaments, "wrap object": read.wraps, "contact": document["contacts"]}
    counts = ", ".join(files.counted(len(some), name) for name, some in parts.items())
    said = [f"{knee.femur} taken as the femur, {knee.tibia} as the tibia",
            f"{counts}; {read.numbers_left_out or 'nothing left out'}", *knee.found.unusual]
    free = sum(not c.locked for joint in knee.joints for c in joint.coordinates)
    if free < 6:
        kinds = ", ".join(f"{joint.kind} {joint.name}" for joint in knee.joints)
        coordinates = files.counted(free, "free coordinate")
        said.append(f"{kinds}: {coordinates} in the model; here the tibia has six")
    waiting = ", ".join(x.name for x in (*read.contacts, *read.patellofemoral, *read.menisci))
    if waiting and not arguments.geometry:
        said.append(f"no surfaces yet for {waiting}: --geometry FOLDER fits the model's meshes")
    said += [f"left out: {line}" for line in read.left_out]
    name, sections = document["name"], import_sections(read, findings)
    answer = knee_import.osim_import_answer(name, said, sections, document["ligaments"],
                                            read.doubts, missed=missed)
    return deliver(answer, arguments, ["knee.yaml", "import_report.md"])


#: Of a band: strain at which the toe region of Blankevoort's law ends, and the rounding at slack.
_TRANSITION_STRAIN, _TRANSITION_WIDTH = 0.06, 0.001

def import_surfaces(arguments: options.ImportStl) -> int:
    """Fit contacts to meshes, write the knee and how well its surfaces fit."""
    knee, pose = None, None
    if arguments.knee is not None:
        knee = files.load_knee_file(arguments.knee)
        pose = knee.knee.reference_pose
        if knee.document["side"] != SIDES[arguments.side]:
            expected = f"{knee.document['side'][0]}, the side of {knee.path}"
            raise files.InputProblem("--side", "side", arguments.side, expected)
    asked = files.MeshOptions(
        patellar_cartilage=arguments.patella_cartilage, femur_bone=arguments.femur_bone,
        tibia_bone=arguments.tibia_bone, layer_thickness_mm=arguments.layer_thickness,
        thickness=arguments.thickness, youngs_modulus_MPa=arguments.modulus,
        poisson_ratio=arguments.poisson_ratio, law=arguments.law, unit=arguments.unit,
        axis_point_mm=arguments.axis_point, notch_mm=arguments.notch, split_mm=arguments.split,
        axis_rotation_deg=arguments.axis_rotation or (0.0, 0.0, 0.0), angle_deg=arguments.angle,
        reference_pose=pose)  # fmt: skip
    meshes = arguments.femur_cartilage, arguments.tibia_cartilage
    with stages_on_terminal("surfaces and layers"):
        found = files.import_meshes(*meshes, side=arguments.side, options=asked)
    if knee is None:
        pose = {"flexion_deg": 0.0, "adduction_deg": 0.0, "internal_rotation_deg": 0.0,
                "anterior_mm": 0.0, "superior_mm": 0.0, "lateral_mm": 0.0,
                "source": "the pose of the meshes: both bones' frames coincide"}  # fmt: skip
        about = f"Contacts from {meshes[0].name} and {meshes[1].name}; no ligaments yet"
        document = {"kneejax": 1, "name": arguments.out.name or "imported",
                    "side": SIDES[arguments.side], "description": about, "reference_pose": pose,
                    "ligaments": {}, "contacts": found.contacts}  # fmt: skip
    else:
        document = copy.deepcopy(knee.document) | {"contacts": found.contacts}
    if found.patellofemoral is not None and "muscles" in document.get("patella", {}):
        document["patella"]["contacts"] = {"patellofemoral": found.patellofemoral}
    elif found.patellofemoral is not None:
        # Without ligaments and muscles there is no patella yet: its surface waits for them.
        document["surfaces"] = {"patella": found.patellofemoral["patellar_surface"]}
    files.write_knee(document, arguments.out / "knee.yaml")
    answer = knee_import.mesh_import_answer(found.fits, found.findings, found.doubtful)
    report = _report(found.findings, answer.tables["fit_report"])
    files.write_text(arguments.out / "fit_report.md", report)
    return deliver(answer, arguments, ["knee.yaml", "fit_report.md"])


def _report(findings: Sequence[str], fits: Table) -> str:
    """The same in Markdown."""
    lines = ["# Surfaces from meshes", "", "## What was found", ""]
    lines += [f"- {finding}" for finding in findings]
    lines += ["", f"## {fits.title}", ""]
    lines += [f"| {' | '.join(fits.names)} |", f"|{'---|' * len(fits.names)}"]
    for row in fits.rows:
        words = [f"{x:.4f}" if isinstance(x, float) else str(x) for x in row]
        lines.append(f"| {' | '.join(words)} |")
    return "\n".join([*lines, "", fits.note, ""])


def import_ligament(arguments: options.ImportLigament) -> int:
    """Write a knee with a band where it had fibres, or nothing."""
    read, name = files.load_knee_file(arguments.knee), arguments.name or arguments.file.stem
    document = copy.deepcopy(read.document)
    band = files.band_of_meshes(arguments.file, arguments.femur_bone, arguments.tibia_bone,
                                read.knee.reference_pose, arguments.within,
                                document.get("side", "right"))  # fmt: skip
    strain = arguments.transition_strain
    if arguments.law == "blankevoort" and strain is None:
        strain = _TRANSITION_STRAIN
    toe = {} if strain is None else {"transition_strain": strain}
    entry = band.entry() | toe | {
        "youngs_modulus_MPa": arguments.modulus, "prestretch": arguments.prestretch,
        "law": arguments.law, "transition_width": _TRANSITION_WIDTH, "fibres": arguments.fibres,
        "source": f"areas and cross-section of {arguments.file.name}; its material as stated",
    }  # fmt: skip
    groups = document.pop("groups", {})
    replaced = {*groups.pop(name, [name])} & {*document["ligaments"]}
    for fibre in replaced:
        del document["ligaments"][fibre]
    groups = {group: [x for x in some if x not in replaced] for group, some in groups.items()}
    if groups := {group: some for group, some in groups.items() if some}:
        document["groups"] = groups
    document["bands"] = document.get("bands", {}) | {name: entry}
    files.write_knee(document, arguments.out / "knee.yaml")
    answer = knee_import.band_import_answer(name, band, arguments.modulus, arguments.fibres,
                                            sorted(replaced))
    return deliver(answer, arguments, ["knee.yaml"])


def import_meniscus(arguments: options.ImportMeniscus) -> int:
    """Write a knee with a meniscus made of a mesh, in place of one of that name."""
    read = files.load_knee_file(arguments.knee)
    document = copy.deepcopy(read.document)
    with stages_on_terminal("upper surface and ring"):
        found = files.meniscus_of_mesh(
            arguments.file, document, arguments.compartment, unit=arguments.unit,
            pose=read.knee.reference_pose if arguments.frame == "femur" else None,
            material={"youngs_modulus_MPa": arguments.modulus,
                      "poisson_ratio": arguments.poisson_ratio,
                      "layer_thickness_mm": arguments.layer_thickness},
            ring={"youngs_modulus_MPa": arguments.hoop_modulus,
                  "horn_stiffness_N_per_mm": arguments.horn_stiffness,
                  "coronary_stiffness_N_per_mm": arguments.coronary_stiffness})  # fmt: skip
    replaced = found.name in document["contacts"]
    document["contacts"][found.name] = found.contact
    files.write_knee(document, arguments.out / "knee.yaml")
    return deliver(knee_import.meniscus_import_answer(found, replaced), arguments, ["knee.yaml"])


def export_model(arguments: options.ExportOsim) -> int:
    """Write a knee's numbers into the OpenSim model that it came from."""
    if arguments.out.exists() and arguments.out.resolve() == arguments.model.resolve():
        raise files.InputProblem("--out", "file", str(arguments.out), "another file than the model")
    coupled = None
    if arguments.coupled is not None:
        poses = files.read_poses(arguments.coupled, arguments.convention)
        coupled = files.coupled_motion(poses, str(arguments.coupled))
    written = files.export_osim(arguments.knee, arguments.model, replace=arguments.replace,
                                coupled=coupled)
    files.write_bytes(arguments.out, written.data)
    for line in (*written.changes, *written.notes):
        print(line)
    count = files.counted(len(written.changes), "change") if written.changes else "no changes"
    print(f"written: {arguments.out}, {count}")
    return 0
