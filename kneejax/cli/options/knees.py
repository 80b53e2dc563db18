"""Options of the commands on knees and their files: look at, evaluate, import, export, begin."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from kneejax.cli._command import Bundled, Command, Drawn, File, Form, Group, Only, Place, Problem
from kneejax.cli._words import Split
from kneejax.cli.options._types import KNEE, SET, Convention, Knee, Mesh, Table, Values
from kneejax.files.reading import Distinct, meaning

# fmt: off
Side = Literal["r", "l"]
Bone = Annotated[Mesh | None, Form("FILE")]
Model = Annotated[Path, File("an OpenSim model")]
Millimetres = Annotated[float | None, Form("MM")]
Modulus = Annotated[float, Form("MPA")]
Stiffness = Annotated[float, Form("N/MM")]
Body = Annotated[str | None, Form("BODY")]
BY_OPENSIM = Group("Forces by OpenSim")
#: What OpenSim is to compute, for an activity.
COMPUTED = Only(lambda asked: asked.motion is not None,
                "--motion with it: coordinates that OpenSim computes forces for")
RECORDED = Only(lambda asked: asked.motion is None, "FILES with it; OpenSim reads --motion itself")
WITH_TOE = Only(lambda asked: asked.law == "blankevoort", "--law blankevoort with it", "law")
PLANNED = Only(lambda asked: asked.plan is None,
               "no --plan with it: a plan states its knee, and which ligament is torn")
SHOWN = "mesh of the {} to show, in its frame, m or mm"


class Knees(Command):
    """List bundled knees, studies and measurements."""

    example: ClassVar = "kneejax knees"

    copy_of: Annotated[str | None, Form("NAME")] = meaning(
        "copy something bundled into this folder, by its name", None, alias="copy")


class Init(Command):
    """Write a commented file to begin with."""

    example: ClassVar = "kneejax init study"
    body: ClassVar = "kneejax.cli._knees:begin"

    kind: Annotated[Literal["study", "knee", "cohort", "plan"], Place("KIND")] = meaning(
        "study, knee, cohort or plan")
    out: Annotated[Path | None, Form("FILE")] = meaning(
        "the new file (default: KIND.yaml in this folder)", None)


class Describe(Command):
    """Print a knee: ligaments, surfaces, contact, frames."""

    example: ClassVar = "kneejax describe four_ligament"
    body: ClassVar = "kneejax.cli._look:describe_knee"

    knee: Annotated[Knee, Place("KNEE")] = meaning(KNEE)
    fibres: bool = meaning("a row for each fibre, with its strain at the reference pose", False)
    parameters: bool = meaning(
        "names of all parameters, as a study and --set take them, with value, unit and the range "
        "of a value", False)


class Evaluate(Drawn):
    """Compute ligaments and contact at given poses; nothing is solved."""

    example: ClassVar = ("kneejax simulate passive-flexion && "
                         "kneejax evaluate average_knee kneejax-passive-flexion/poses.csv")
    body: ClassVar = "kneejax.cli._look:evaluate_poses"

    knee: Annotated[Knee, Place("KNEE")] = meaning(KNEE)
    poses: Annotated[Table, Place("POSES")] = meaning("CSV of poses")
    convention: Convention = meaning("of the poses", "femoral")


class View(Drawn):
    """Draw a knee in space at poses: pictures, a film, and a page to turn it."""

    example: ClassVar = ("kneejax simulate passive-flexion && "
                         "kneejax view average_knee kneejax-passive-flexion/poses.csv")
    body: ClassVar = "kneejax.cli._look:view_knee"

    knee: Annotated[Knee, Place("KNEE")] = meaning(KNEE)
    poses: Annotated[Table | None, Place("POSES")] = meaning(
        "CSV of poses; the reference pose otherwise", None)
    patella: bool = meaning(
        "with the patella and the quadriceps, as where a table has the patella's columns", False)
    femur_bone: Bone = meaning(SHOWN.format("femur"), None)
    tibia_bone: Bone = meaning(SHOWN.format("tibia"), None)
    patella_bone: Bone = meaning(SHOWN.format("patella"), None)
    convention: Convention = meaning("of the poses", "femoral")


class Explore(Command):
    """Move a knee in the browser: loads, ligaments, attachments, curves, sensitivities.

    The page is served on this computer alone. Needs kneejax[explore].
    """

    example: ClassVar = "kneejax explore average_knee --open --out my-settings"

    subject: Annotated[str, Place("SUBJECT")] = meaning(
        f"{KNEE}; or a study, whose measured poses stand behind the curves", "average_knee")
    patella: bool = meaning("with the patella and the quadriceps", False)
    femur_bone: Bone = meaning(SHOWN.format("femur"), None)
    tibia_bone: Bone = meaning(SHOWN.format("tibia"), None)
    patella_bone: Bone = meaning(SHOWN.format("patella"), None)
    port: Annotated[int, Form("N")] = meaning("the first to try; the next free one is used", 8137)
    open: bool = meaning("open the page in the browser", False)
    out: Annotated[Path | None, Form("FOLDER")] = meaning(
        "folder for what is saved from the page; without one nothing is written", None)


class ImportOsim(Drawn):
    """Make a knee from an OpenSim model, schema 2, 3 or 4."""

    example: ClassVar = "kneejax import osim MODEL.osim --side r"
    body: ClassVar = "kneejax.cli._exchange:import_model"

    file: Annotated[Model, Place("FILE")] = meaning("the model")
    side: Side = meaning("right or left knee")
    geometry: Annotated[Path | None, File("a folder of meshes")] = meaning(
        "folder of the model's cartilage meshes", None)
    femur: Body = meaning("found from the joints if not given", None)
    tibia: Body = meaning("likewise; both or none", None)
    without: Annotated[list[str], Form("FIBRE")] = meaning(
        "leave out a fibre or force, or those that fit a pattern", [])
    inside: Literal["refuse", "straight"] = meaning(
        "what to do where a fibre begins inside what it goes around; straight is what OpenSim does",
        "refuse")
    without_patella: bool = meaning(
        "leave out the patella, its ligaments and the muscles over the knee", False)
    at: Annotated[dict[str, float], Form("COORDINATE=VALUE")] = meaning(
        "of hip or foot, degrees: where muscles and ligaments from the pelvis begin; the model's "
        "defaults otherwise", {})


class ImportStl(Drawn):
    """Fit contacts to meshes of cartilage."""

    example: ClassVar = (
        "kneejax import stl --femur-cartilage FEMUR.stl --tibia-cartilage TIBIA.stl --side r "
        "--knee four_ligament")
    body: ClassVar = "kneejax.cli._exchange:import_surfaces"

    femur_cartilage: Mesh = meaning("mesh, in any unit")
    tibia_cartilage: Mesh = meaning("mesh, likewise")
    patella_cartilage: Mesh | None = meaning("fitted with the groove of the femur", None)
    femur_bone: Mesh | None = meaning("for the layer's thickness", None)
    tibia_bone: Mesh | None = meaning("for the layer's thickness", None)
    side: Side = meaning("right or left knee")
    knee: Knee | None = meaning(f"whose ligaments are kept, its contacts replaced: {KNEE}", None)
    layer_thickness: Millimetres = meaning("both cartilages; measured otherwise", None)
    thickness: Literal["constant", "field"] = meaning(
        "one number for the layer, or as it varies over the surface", "constant")
    modulus: Modulus = meaning("Young's modulus, MPa", 10.0)
    poisson_ratio: float = meaning("of the cartilage", 0.45)
    law: Literal["linear", "log", "ratio"] = meaning("how pressure grows with the depth", "linear")
    unit: Literal["auto", "m", "mm", "cm"] = meaning("of the meshes", "auto")
    axis_point: tuple[float, float, float] | None = meaning(
        "of the femoral axis, mm; found otherwise", None)
    axis_rotation: tuple[float, float, float] | None = meaning(
        "of that axis about X, Y, Z, degrees", None)
    notch: Millimetres = meaning("along the axis; found otherwise", None)
    split: Millimetres = meaning("between the tibial compartments, along Z", None)
    angle: Annotated[tuple[float, float] | None, Form("DEGREES")] = meaning(
        "region of the condyles", None)


class ImportLigament(Drawn):
    """Make a band of a ligament's mesh between the bones of a knee."""

    example: ClassVar = ("kneejax import ligament ACL.stl --knee knee.yaml --femur-bone FEMUR.stl "
                         "--tibia-bone TIBIA.stl --modulus 120")
    body: ClassVar = "kneejax.cli._exchange:import_ligament"

    file: Annotated[Mesh, Place("MESH")] = meaning(
        "closed, in the femur's frame, at the knee's reference pose")
    knee: Knee = meaning(f"that gets the ligament: {KNEE}")
    femur_bone: Mesh = meaning("mesh, in the femur's frame")
    tibia_bone: Mesh = meaning("mesh, in the tibia's frame")
    modulus: Modulus = meaning("Young's modulus along the fibres, MPa")
    name: str | None = meaning(
        "of the ligament, the mesh's if not given; what has it in the knee is replaced", None)
    prestretch: float = meaning("length over slack length at the reference pose", 1.0)
    law: Literal["neo_hookean", "blankevoort"] = meaning("of each fibre", "neo_hookean")
    transition_strain: Annotated[float | None, WITH_TOE] = meaning(
        "where the toe region ends, of --law blankevoort; 0.06 if not given", None)
    fibres: int = meaning("that the band is drawn as", 24)
    within: Annotated[float, Form("MM")] = meaning(
        "how far from a bone the ligament is attached to it", 1.0)


class ImportMeniscus(Drawn):
    """Make a meniscus, a contact with a ring, of its mesh on the plateau of a knee."""

    example: ClassVar = "kneejax import meniscus MEDIAL.stl --knee knee.yaml --compartment medial"
    body: ClassVar = "kneejax.cli._exchange:import_meniscus"

    file: Annotated[Mesh, Place("MESH")] = meaning("closed, in the tibia's frame")
    knee: Knee = meaning(f"that gets the meniscus: {KNEE}")
    compartment: Literal["medial", "lateral"] = meaning("in which the meniscus lies")
    frame: Literal["tibia", "femur"] = meaning(
        "of the mesh; the femur's at the knee's reference pose", "tibia")
    unit: Literal["auto", "m", "mm", "cm"] = meaning("of the mesh", "auto")
    modulus: Modulus = meaning("Young's modulus across the fibres, MPa", 20.0)
    poisson_ratio: float = meaning("likewise", 0.2)
    layer_thickness: Millimetres = meaning(
        "of the meniscus and both cartilages; the mean thickness of the mesh and the cartilage of "
        "the compartment if not given", None)
    hoop_modulus: Modulus = meaning("Young's modulus along the fibres, MPa", 120.0)
    horn_stiffness: Stiffness = meaning("of each horn's attachment", 180.0)
    coronary_stiffness: Stiffness = meaning("of all that holds the border along its arc", 30.0)


class ExportOsim(Command):
    """Write a knee's numbers into the OpenSim model that it came from."""

    example: ClassVar = ("kneejax import osim MODEL.osim --side r && "
                         "kneejax export osim kneejax-import/knee.yaml MODEL.osim --out NEW.osim")
    body: ClassVar = "kneejax.cli._exchange:export_model"

    knee: Annotated[Knee, Place("KNEE")] = meaning(KNEE)
    model: Annotated[Model, Place("MODEL")] = meaning("the original model; it is not changed")
    out: Path = meaning("the new model")
    replace: bool = meaning(
        "the model's fibres over the knee become the knee's: grafts are put in, what the knee has "
        "not is taken out", False)
    coupled: Annotated[Table | None, Form("POSES.csv")] = meaning(
        "the model's knee follows its flexion as these poses do, along splines: a CustomJoint of "
        "one coordinate", None)
    convention: Convention = meaning("of these poses", "femoral")


class Activity(Drawn):
    """Balance a knee at each instant of a movement that OpenSim recorded."""

    example: ClassVar = ("kneejax activity coordinates.sto muscle_forces.sto external_loads.xml "
                         "--model MODEL.osim --side r")

    files: Annotated[
        list[Path], File("a table of OpenSim, or external loads"), Place("FILES")] = meaning(
        "OpenSim's tables (.sto, .mot) of coordinates, and of muscle forces with the external "
        "loads (.xml), if some act, or of joint reactions; each is known by its columns", [])
    model: Model = meaning("the model that moved (.osim)")
    motion: Annotated[Path | None, File("a table of OpenSim"), BY_OPENSIM] = meaning(
        "in place of FILES: coordinates (.sto, .mot) for which OpenSim itself finds the forces, by "
        "inverse dynamics and static optimisation; needs the extra opensim", None)
    grf: Annotated[Path | None, COMPUTED, File("external loads"), BY_OPENSIM] = meaning(
        "with --motion: forces from the ground, external loads (.xml); without them the model's "
        "own contacts press its feet", None)
    actuators: Annotated[Path | None, COMPUTED, File("a ForceSet"), BY_OPENSIM] = meaning(
        "with --motion: reserves and residuals, a ForceSet (.xml); weak ones otherwise", None)
    time_s: Annotated[
        tuple[float, float] | None, COMPUTED, BY_OPENSIM,
        Split(":", "BEGIN:END, two numbers of seconds", "BEGIN:END"),
    ] = meaning("with --motion: a part of it (default: all)", None)
    rounds: Annotated[int, COMPUTED, BY_OPENSIM] = meaning(
        "with --motion: how often the knee's secondary motion goes back into the model, as splines "
        "of flexion, for OpenSim to find the forces again", 0, ge=0, le=20)
    side: Side = meaning("right or left knee", "r")
    femur: Body = meaning("body of the model; found from its joints if not given", None)
    tibia: Body = meaning("likewise; both or none", None)
    called: Annotated[dict[str, str], RECORDED, Form("NAME=OTHER")] = meaning(
        "what the files call a coordinate, a muscle or a body of the model; may be repeated", {})
    knee: Annotated[Knee | None, PLANNED, Group("Knee")] = meaning(
        f"{KNEE} (default: lenhart2015_reduced)", None)
    plan: Annotated[str | None, Bundled("plans"), Form("PLAN"), Group("Knee")] = meaning(
        "plan file or bundled plan, in place of --knee: its knee intact, without the ligament, and "
        "with the graft where it is planned and in the corners of the octagon", None)
    frames: Literal["auto", "same", "landmarks"] = meaning(
        "whether the knee's frames are the model's; auto: where the knee was made of it", "auto")
    patella: Annotated[bool, Group("Knee")] = meaning(
        "with the patella, on which the quadriceps pulls", False)
    instants: int | None = meaning("so many, evenly spaced; the coarsest table's rows otherwise",
                                   None, ge=4, le=20_000)
    values: Annotated[Values, PLANNED] = meaning(SET, {}, alias="set")
    cut: Annotated[list[str], Distinct, PLANNED, Form("LIGAMENT"), Group("Knee")] = meaning(
        "compare with the knee in which a ligament, or a group of them, does not act, or without a "
        "meniscus or a part of it (as in simulate); once for each", [])
    convention: Annotated[Convention, Group("Results")] = meaning("of the poses written", "femoral")

    def problems(self) -> Iterator[Problem]:
        """Tables of OpenSim, or a motion for it to make them."""
        if self.motion is None and not self.files:
            expected = "OpenSim's tables, or --motion and --grf for OpenSim to make them"
            yield "FILES", "none", expected
        if self.motion is not None and self.files:
            expected = "one of both: with --motion OpenSim makes the other tables itself"
            yield "--motion", "--motion and FILES", expected
