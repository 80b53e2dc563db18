"""Options of the commands on knees and their files: look at, evaluate, import, export, begin."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from kneejax.cli._command import (
    Bundled,
    Command,
    Drawn,
    File,
    Form,
    Group,
    Only,
    Place,
)
from kneejax.cli._words import Split
from kneejax.cli.options._types import KNEE, SET, Convention, Knee, Mesh, Model, Table, Values
from kneejax.files import InputProblem

Side = Literal["r", "l"]
ALL_DATA = "kneejax.cli._knees"
#: What OpenSim is to compute, for an activity.
COMPUTED = Only(
    lambda asked: asked.motion is not None,
    "--motion with it: coordinates that OpenSim computes forces for",
)
PLANNED = Only(
    lambda asked: asked.plan is None,
    "no --plan with it: a plan states its knee, and which ligament is torn",
)


class Knees(Command):
    """List bundled knees, studies and measurements."""

    command: ClassVar = "knees"
    example: ClassVar = "kneejax knees"
    body: ClassVar = ALL_DATA

    copy_of: Annotated[str | None, Form("NAME")] = Field(
        None, alias="copy", description="copy something bundled into this folder, by its name"
    )


class Init(Command):
    """Write a commented file to begin with."""

    command: ClassVar = "init"
    example: ClassVar = "kneejax init study"
    body: ClassVar = "kneejax.cli._knees:begin"

    kind: Annotated[Literal["study", "knee", "cohort", "plan"], Place("KIND")] = Field(
        description="study, knee, cohort or plan"
    )
    out: Annotated[Path | None, Form("FILE")] = Field(
        None, description="the new file (default: KIND.yaml in this folder)"
    )


class Describe(Command):
    """Print a knee: ligaments, surfaces, contact, frames."""

    command: ClassVar = "describe"
    example: ClassVar = "kneejax describe four_ligament"
    body: ClassVar = "kneejax.cli._look:describe_knee"

    knee: Annotated[Knee, Place("KNEE")] = Field(description=KNEE)
    fibres: bool = Field(
        False, description="a row for each fibre, with its strain at the reference pose"
    )
    parameters: bool = Field(
        False,
        description="names of all parameters, as a study and --set take them, with value, unit "
        "and the range of a value",
    )


class Evaluate(Drawn):
    """Compute ligaments and contact at given poses; nothing is solved."""

    command: ClassVar = "evaluate"
    example: ClassVar = (
        "kneejax simulate passive-flexion && "
        "kneejax evaluate average_knee kneejax-passive-flexion/poses.csv"
    )
    body: ClassVar = "kneejax.cli._look:evaluate_poses"
    folder: ClassVar = "kneejax-evaluate"

    knee: Annotated[Knee, Place("KNEE")] = Field(description=KNEE)
    poses: Annotated[Table, Place("POSES")] = Field(description="CSV of poses")
    convention: Convention = Field("femoral", description="of the poses")


class View(Drawn):
    """Draw a knee in space at poses: pictures, a film, and a page to turn it."""

    command: ClassVar = "view"
    example: ClassVar = (
        "kneejax simulate passive-flexion && "
        "kneejax view average_knee kneejax-passive-flexion/poses.csv"
    )
    body: ClassVar = "kneejax.cli._look:view_knee"
    folder: ClassVar = "kneejax-view"

    knee: Annotated[Knee, Place("KNEE")] = Field(description=KNEE)
    poses: Annotated[Table | None, Place("POSES")] = Field(
        None, description="CSV of poses; the reference pose otherwise"
    )
    patella: bool = Field(
        False,
        description="with the patella and the quadriceps, as where a table has the patella's "
        "columns",
    )
    femur_bone: Annotated[Mesh | None, Form("FILE")] = Field(
        None, description="mesh of the femur to show, in its frame, m or mm"
    )
    tibia_bone: Annotated[Mesh | None, Form("FILE")] = Field(
        None, description="mesh of the tibia to show, in its frame, m or mm"
    )
    patella_bone: Annotated[Mesh | None, Form("FILE")] = Field(
        None, description="mesh of the patella to show, in its frame, m or mm"
    )
    convention: Convention = Field("femoral", description="of the poses")


class ImportOsim(Drawn):
    """Make a knee from an OpenSim model, schema 3 or 4."""

    command: ClassVar = "import osim"
    example: ClassVar = "kneejax import osim MODEL.osim --side r"
    body: ClassVar = "kneejax.cli._exchange:import_model"
    folder: ClassVar = "kneejax-import"

    file: Annotated[Model, Place("FILE")] = Field(description="the model")
    side: Side = Field(description="right or left knee")
    geometry: Annotated[Path | None, File("a folder of meshes")] = Field(
        None, description="folder of the model's cartilage meshes"
    )
    femur: Annotated[str | None, Form("BODY")] = Field(
        None, description="found from the joints if not given"
    )
    tibia: Annotated[str | None, Form("BODY")] = Field(
        None, description="likewise; both or none"
    )
    without: Annotated[list[str], Form("FIBRE")] = Field(
        [], description="leave out a fibre or force, or those that fit a pattern"
    )
    inside: Literal["refuse", "straight"] = Field(
        "refuse",
        description="what to do where a fibre begins inside what it goes around; straight is what "
        "OpenSim does",
    )
    without_patella: bool = Field(
        False, description="leave out the patella, its ligaments and the muscles over the knee"
    )
    at: Annotated[dict[str, float], Form("COORDINATE=VALUE")] = Field(
        {},
        description="of hip or foot, degrees: where muscles and ligaments from the pelvis begin; "
        "the model's defaults otherwise",
    )


class ImportStl(Drawn):
    """Fit contacts to meshes of cartilage."""

    command: ClassVar = "import stl"
    example: ClassVar = (
        "kneejax import stl --femur-cartilage FEMUR.stl --tibia-cartilage TIBIA.stl --side r "
        "--knee four_ligament"
    )
    body: ClassVar = "kneejax.cli._exchange:import_surfaces"
    folder: ClassVar = "kneejax-import"

    femur_cartilage: Mesh = Field(description="mesh, in any unit")
    tibia_cartilage: Mesh = Field(description="mesh, likewise")
    patella_cartilage: Mesh | None = Field(None, description="fitted with the groove of the femur")
    femur_bone: Mesh | None = Field(None, description="for the layer's thickness")
    tibia_bone: Mesh | None = Field(None, description="for the layer's thickness")
    side: Side = Field(description="right or left knee")
    knee: Knee | None = Field(
        None, description=f"whose ligaments are kept, its contacts replaced: {KNEE}"
    )
    layer_thickness: Annotated[float | None, Form("MM")] = Field(
        None, description="both cartilages; measured otherwise"
    )
    thickness: Literal["constant", "field"] = Field(
        "constant", description="one number for the layer, or as it varies over the surface"
    )
    modulus: Annotated[float, Form("MPA")] = Field(10.0, description="Young's modulus, MPa")
    poisson_ratio: float = Field(0.45, description="of the cartilage")
    law: Literal["linear", "log", "ratio"] = Field(
        "linear", description="how pressure grows with the depth"
    )
    unit: Literal["auto", "m", "mm", "cm"] = Field("auto", description="of the meshes")
    axis_point: tuple[float, float, float] | None = Field(
        None, description="of the femoral axis, mm; found otherwise"
    )
    axis_rotation: tuple[float, float, float] | None = Field(
        None, description="of that axis about X, Y, Z, degrees"
    )
    notch: Annotated[float | None, Form("MM")] = Field(
        None, description="along the axis; found otherwise"
    )
    split: Annotated[float | None, Form("MM")] = Field(
        None, description="between the tibial compartments, along Z"
    )
    angle: Annotated[tuple[float, float] | None, Form("DEGREES")] = Field(
        None, description="region of the condyles"
    )


class ExportOsim(Command):
    """Write a knee's numbers into the OpenSim model that it came from."""

    command: ClassVar = "export osim"
    example: ClassVar = (
        "kneejax import osim MODEL.osim --side r && "
        "kneejax export osim kneejax-import/knee.yaml MODEL.osim --out NEW.osim"
    )
    body: ClassVar = "kneejax.cli._exchange:export_model"

    knee: Annotated[Knee, Place("KNEE")] = Field(description=KNEE)
    model: Annotated[Model, Place("MODEL")] = Field(
        description="the original model; it is not changed"
    )
    out: Path = Field(description="the new model")
    replace: bool = Field(
        False,
        description="the model's fibres over the knee become the knee's: grafts are put in, what "
        "the knee has not is taken out",
    )
    coupled: Annotated[Table | None, Form("POSES.csv")] = Field(
        None,
        description="the model's knee follows its flexion as these poses do, along splines: a "
        "CustomJoint of one coordinate",
    )
    convention: Convention = Field("femoral", description="of these poses")


class Activity(Drawn):
    """Balance a knee at each instant of a movement that OpenSim recorded."""

    command: ClassVar = "activity"
    example: ClassVar = (
        "kneejax activity coordinates.sto muscle_forces.sto external_loads.xml "
        "--model MODEL.osim --side r"
    )
    body: ClassVar = "kneejax.cli._activity"
    folder: ClassVar = "kneejax-activity"

    files: Annotated[list[Path], File("a table of OpenSim, or external loads"), Place("FILES")] = (
        Field(
            [],
            description="OpenSim's tables (.sto, .mot) of coordinates, and of muscle forces with "
            "the external loads (.xml), if some act, or of joint reactions; each is known by its "
            "columns",
        )
    )
    model: Model = Field(description="the model that moved (.osim)")
    motion: Annotated[Path | None, File("a table of OpenSim"), Group("Forces by OpenSim")] = Field(
        None,
        description="in place of FILES: coordinates (.sto, .mot) for which OpenSim itself finds "
        "the forces, by inverse dynamics and static optimisation; needs the extra opensim",
    )
    grf: Annotated[Path | None, COMPUTED, File("external loads"), Group("Forces by OpenSim")] = (
        Field(
            None,
            description="with --motion: forces from the ground, external loads (.xml); without "
            "them the model's own contacts press its feet",
        )
    )
    actuators: Annotated[
        Path | None, COMPUTED, File("a ForceSet"), Group("Forces by OpenSim")
    ] = Field(
        None,
        description="with --motion: reserves and residuals, a ForceSet (.xml); weak ones otherwise",
    )
    time_s: Annotated[
        tuple[float, float] | None,
        COMPUTED,
        Split(":", "BEGIN:END, two numbers of seconds", "BEGIN:END"),
        Group("Forces by OpenSim"),
    ] = Field(None, description="with --motion: a part of it (default: all)")
    rounds: Annotated[int, COMPUTED, Group("Forces by OpenSim")] = Field(
        0,
        description="with --motion: how often the knee's secondary motion goes back into the "
        "model, as splines of flexion, for OpenSim to find the forces again",
        ge=0,
        le=20,
    )
    side: Side = Field("r", description="right or left knee")
    femur: Annotated[str | None, Form("BODY")] = Field(
        None, description="body of the model; found from its joints if not given"
    )
    tibia: Annotated[str | None, Form("BODY")] = Field(
        None, description="likewise; both or none"
    )
    knee: Annotated[Knee | None, PLANNED, Group("Knee")] = Field(
        None, description=f"{KNEE} (default: lenhart2015_reduced)"
    )
    plan: Annotated[str | None, Bundled("plans"), Form("PLAN"), Group("Knee")] = Field(
        None,
        description="plan file or bundled plan, in place of --knee: its knee intact, without the "
        "ligament, and with the graft where it is planned and in the corners of the octagon",
    )
    frames: Literal["auto", "same", "landmarks"] = Field(
        "auto",
        description="whether the knee's frames are the model's; auto: where the knee was made of "
        "it",
    )
    patella: Annotated[bool, Group("Knee")] = Field(
        False, description="with the patella, on which the quadriceps pulls"
    )
    instants: int | None = Field(
        None,
        description="so many, evenly spaced; the coarsest table's rows otherwise",
        ge=4,
        le=20_000,
    )
    values: Annotated[Values, PLANNED] = Field({}, alias="set", description=SET)
    cut: Annotated[list[str], PLANNED, Form("LIGAMENT"), Group("Knee")] = Field(
        [],
        description="compare with the knee in which a ligament, or a group of them, does not act; "
        "once for each",
    )
    convention: Annotated[Convention, Group("Results")] = Field(
        "femoral", description="of the poses written"
    )

    def problems(self) -> Iterator[InputProblem]:
        """Tables of OpenSim, or a motion for it to make them."""
        if self.motion is None and not self.files:
            expected = "OpenSim's tables, or --motion and --grf for OpenSim to make them"
            yield InputProblem("activity", "FILES", "none", expected)
        if self.motion is not None and self.files:
            expected = "one of both: with --motion OpenSim makes the other tables itself"
            yield InputProblem("activity", "--motion", "--motion and FILES", expected)
