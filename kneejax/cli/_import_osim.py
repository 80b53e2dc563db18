"""`kneejax import osim FILE --side r|l`."""

from __future__ import annotations

from kneejax.cli._main import DONE, DOUBTFUL
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


def run(arguments: ImportOsim) -> int:
    """Write knee.yaml and import_report.md from an OpenSim model."""
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
    findings, doubtful = (), bool(read.doubts)
    document, file = read.document, arguments.out / "knee.yaml"
    if arguments.geometry is None:
        write_text(file, format_knee(document))  # checked on reading; to build it takes longer
    else:
        with stages_on_terminal("surfaces and layers"):
            geometry = add_osim_contacts(read, arguments.geometry)
        document, findings = geometry.document, geometry.findings
        doubtful = doubtful or geometry.doubtful
        write_knee(document, file)
    write_text(arguments.out / "import_report.md", format_import_report(read, findings))
    knee = read.knee
    print(f"{knee.femur} taken as the femur, {knee.tibia} as the tibia")
    print(
        f"{counted(len(read.ligaments), 'fibre')}, {counted(len(read.wraps), 'wrap object')}, "
        f"{counted(len(document['contacts']), 'contact')}; "
        f"{counted(len(read.found.outside), 'other fibre')} left out"
    )
    for sentence in knee.unusual:
        print(sentence)
    free = sum(not c.locked for joint in knee.joints for c in joint.coordinates)
    if free < 6:
        kinds = ", ".join(f"{joint.kind} {joint.name}" for joint in knee.joints)
        print(f"{kinds}: {counted(free, 'free coordinate')} in the model; here the tibia has six")
    waiting = [] if arguments.geometry else [*read.contacts, *read.patellofemoral]
    if waiting:
        names = ", ".join(contact.name for contact in waiting)
        print(f"no surfaces yet for {names}: --geometry FOLDER fits the model's meshes")
    for line in read.left_out:
        print(f"left out: {line}")
    for doubt in read.doubts:
        print(f"doubtful: {doubt}")
    print(f"written: {arguments.out}/knee.yaml, import_report.md, settings.json")
    if doubtful and not read.doubts:
        print("doubtful: a surface misses its target; the report says which")
    return DOUBTFUL if doubtful else DONE
