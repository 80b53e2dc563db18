"""Options of the commands on simple kinematic joints."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from kneejax.cli import _command
from kneejax.cli._command import Bundled, Drawn, File, Form, Group, Only, Place, Problem
from kneejax.cli.options._types import KNEE, Convention, Knee, Mesh, Table
from kneejax.files.reading import meaning

# fmt: off
ANATOMY = Group("Axes of the femur")
Side = Literal["right", "left"]
Angle = Annotated[float, Field(allow_inf_nan=False)]
Point = Annotated[tuple[float, float, float] | None, Form("X Y Z"), ANATOMY]
Facet = Annotated[
    tuple[float, float] | None, Form("DEGREES"), ANATOMY,
    Only(lambda asked: asked.axes is None and asked.tibia is None, "no --axes or --tibia with it")]
Columns = Annotated[dict[str, str], Form("NAME=COLUMN")]
COLUMN = (
    "the table's column for one of the package's, as flexion_deg=knee_flex_deg; may be repeated")
FITTED_HERE = Only(lambda asked: asked.axes and asked.calibrate_at,
                   "--calibrate-at and --axes with it")
OF_POSES = Only(lambda asked: asked.poses is not None, "a CSV of poses with it")
OF_FEMUR = Only(lambda asked: asked.femur is not None, "--femur with it")
OF_TIBIA = Only(lambda asked: asked.tibia is not None, "--tibia with it")


class JointFit(Drawn):
    """Fit a moving axis and a hinge to poses or a contact knee."""

    example: ClassVar = "kneejax joint fit --knee four_ligament --flexion 0:90:10"

    poses: Annotated[Table | None, Place("POSES")] = meaning(
        "CSV of two or more measured poses; or --knee", None)
    convention: Annotated[Convention | None, OF_POSES] = meaning(
        "of the poses (default: femoral)", None)
    column: Annotated[Columns, OF_POSES] = meaning(COLUMN, {})
    knee: Knee | None = meaning(
        f"passive flexion of a contact knee instead of poses: {KNEE}; without --femur "
        "and --axes its condyles give the axes", None)
    at: Annotated[list[Angle], Form("DEGREES", several=True)] = meaning(
        "calibrate on the poses nearest to these flexions; on the first and last otherwise, of a "
        "knee at both ends of --flexion", [])
    femur: Annotated[Mesh | None, Form("MESH"), ANATOMY] = meaning("bone or cartilage", None)
    axes: Annotated[Path | None, File("axis points"), Form("FILE"), ANATOMY] = meaning(
        "YAML or CSV of axis points", None)
    tibia: Annotated[Mesh | None, Form("MESH"), OF_FEMUR, ANATOMY] = meaning(
        "facets are where the femur meets it, at the first and at the last calibration pose", None)
    touching_within: Annotated[float | None, Form("MM"), OF_TIBIA, ANATOMY] = meaning(
        "how near that is (default: 4)", None, gt=0, allow_inf_nan=False)
    unit: Annotated[Literal["auto", "m", "mm", "cm"] | None, OF_FEMUR, ANATOMY] = meaning(
        "of the meshes (default: auto)", None)
    side: Annotated[Side | None, ANATOMY] = meaning(
        "of the knee (default: right, or that of --knee)", None)
    landmarks: Annotated[Path | None, File("landmarks"), Form("FILE"), OF_FEMUR, ANATOMY] = meaning(
        "YAML: axes of femur and tibia, in the frames of their meshes", None)
    extension_facet: Facet = meaning(
        "from anterior through distal, about the transverse axis (default: 65 110)", None)
    flexion_facet: Facet = meaning("likewise (default: 110 190)", None)
    medial_epicondyle: Point = meaning("mm, for the hinge", None)
    lateral_epicondyle: Point = meaning("likewise", None)
    interpolation: Literal["linear", "monotone"] | None = meaning(
        "between the poses (default: monotone from three poses on)", None)
    flexion: Annotated[str, _command.Angles()] = meaning(
        "of the tables: first:last:step or a,b,c", "0:120:5")

    def problems(self) -> Iterator[Problem]:
        """Poses of one origin, and axes of at most one."""
        if (self.poses is None) == (self.knee is None):
            found = "none" if self.poses is None else "a table and --knee"
            yield "POSES", found, "a CSV of measured poses, or --knee"
        elif self.knee is None and self.femur is None and self.axes is None:
            yield "axis points", "none", "--femur MESH, --axes FILE or, of a contact knee, --knee"
        if self.femur is not None and self.axes is not None:
            yield "--axes", str(self.axes), "one of --femur and --axes"
        if (self.medial_epicondyle is None) != (self.lateral_epicondyle is None):
            side = "medial" if self.medial_epicondyle is None else "lateral"
            yield f"--{side}-epicondyle", "missing", "both epicondyles, or none"


class JointCompare(Drawn):
    """Compare joints and contact knees with measured motion."""

    example: ClassVar = (
        "kneejax simulate passive-flexion && "
        "kneejax joint compare kneejax-passive-flexion/poses.csv --knee four_ligament")
    folder: ClassVar = "kneejax-joint-compare"

    measured: Annotated[list[Path], File("a CSV table"), Place("MEASURED")] = meaning(
        "CSV of measured poses, one file a subject")
    convention: Convention = meaning("of the poses", "femoral")
    column: Columns = meaning(COLUMN, {})
    joint: Annotated[list[str], Form("[NAME=]FILE[,FILE...]")] = meaning(
        "joint file for all subjects, or one for each, in their order; may be repeated", [])
    knee: Annotated[list[Knee], Bundled("knees"), Form("KNEE")] = meaning(
        f"contact knee in passive flexion: {KNEE}; may be repeated", [])
    calibrate_at: Annotated[list[Angle], Form("DEGREES", several=True)] = meaning(
        "fit moving axis and hinge here, each subject's on its own poses at these flexions with "
        "the points of --axes; and leave those poses out of the comparison", [])
    average_within: Annotated[float, Form("DEGREES"), FITTED_HERE] = meaning(
        "poses as near as this to a flexion of calibration are averaged for it",
        0.5, ge=0, allow_inf_nan=False)
    axes: Annotated[list[str], Form("FILE[,FILE...]")] = meaning(
        "axis points, as for kneejax joint fit: one file for all subjects, or one for each, in "
        "their order", [])
    side: Annotated[Side, FITTED_HERE] = meaning(
        "of the knees whose points --axes gives, with Z to the person's right; poses go by "
        "clinical meaning on either side", "right")
    spread: Annotated[float, Form("DEGREES")] = meaning(
        "by how much subjects may be flexed differently at one condition",
        1.0, ge=0, allow_inf_nan=False)
    anova: bool | None = meaning(
        "test differences, by package pingouin (default: from three subjects on)", None)
    alpha: float = meaning("level of these tests", 0.01, gt=0, lt=1)

    def problems(self) -> Iterator[Problem]:
        """Subjects once each; calibration with axes."""
        for i, file in enumerate(self.measured):
            if file in self.measured[:i]:
                yield "MEASURED", str(file), "every subject once"
        if bool(self.calibrate_at) != bool(self.axes):
            missing = "--calibrate-at" if self.axes else "--axes"
            yield missing, "missing", "both --calibrate-at and --axes"


class JointExport(_command.Written):
    """Write a joint as an OpenSim CustomJoint and as coupled coordinates."""

    example: ClassVar = (
        "kneejax joint fit --knee four_ligament && kneejax joint export kneejax-joint/joint.yaml")
    body: ClassVar = "kneejax.cli._joint_fit:export"
    folder: ClassVar = "kneejax-joint-export"

    joint: Annotated[Path, File("a joint file"), Place("JOINT")] = meaning("joint file")
