"""`kneejax import osim FILE --side r|l`."""

from __future__ import annotations

from kneejax.cli._deliver import deliver
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import ImportOsim
from kneejax.files import (
    add_osim_contacts,
    counted,
    format_import_report,
    format_knee,
    import_osim,
    write_knee,
    write_text,
)
from kneejax.files.opensim import import_sections
from kneejax.report import osim_import_answer


def run(arguments: ImportOsim) -> int:
    """Write a knee from an OpenSim model, and what of it was read and left out."""
    read = import_osim(
        arguments.file,
        side=arguments.side,
        femur=arguments.femur,
        tibia=arguments.tibia,
        without=arguments.without,
        inside=arguments.inside,
        patella=not arguments.without_patella,
        at=arguments.at,
    )
    findings, missed = (), False
    document, file = read.document, arguments.out / "knee.yaml"
    if arguments.geometry is None:
        write_text(file, format_knee(document))  # checked on reading; to build it takes longer
    else:
        with stages_on_terminal("surfaces and layers"):
            geometry = add_osim_contacts(read, arguments.geometry)
        document, findings, missed = geometry.document, geometry.findings, geometry.doubtful
        write_knee(document, file)
    write_text(arguments.out / "import_report.md", format_import_report(read, findings))
    knee = read.knee
    said = [
        f"{knee.femur} taken as the femur, {knee.tibia} as the tibia",
        f"{counted(len(read.ligaments), 'fibre')}, {counted(len(read.wraps), 'wrap object')}, "
        f"{counted(len(document['contacts']), 'contact')}; "
        f"{counted(len(read.found.outside), 'other fibre')} left out",
        *knee.unusual,
    ]
    free = sum(not c.locked for joint in knee.joints for c in joint.coordinates)
    if free < 6:
        kinds = ", ".join(f"{joint.kind} {joint.name}" for joint in knee.joints)
        coordinates = counted(free, "free coordinate")
        said.append(f"{kinds}: {coordinates} in the model; here the tibia has six")
    waiting = [] if arguments.geometry else [*read.contacts, *read.patellofemoral]
    if waiting:
        names = ", ".join(contact.name for contact in waiting)
        said.append(f"no surfaces yet for {names}: --geometry FOLDER fits the model's meshes")
    said += [f"left out: {line}" for line in read.left_out]
    name, sections = document["name"], import_sections(read, findings)
    answer = osim_import_answer(
        name, said, sections, document["ligaments"], read.doubts, missed=missed
    )
    return deliver(answer, arguments, ["knee.yaml", "import_report.md"])
