"""Options of the commands on simple kinematic joints."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from kneejax.cli._command import Bundled, Drawn, File, Form, Group, Only, Place, Written
from kneejax.cli.options._types import KNEE, Convention, Flexion, Knee, Mesh, Table
from kneejax.files import InputProblem
from kneejax.files.reading import meaning

Side = Literal["right", "left"]
Angle = Annotated[float, Field(allow_inf_nan=False)]
Point = Annotated[tuple[float, float, float] | None, Form("X Y Z"), Group("Axes of the femur")]
Facet = Annotated[
    tuple[float, float] | None,
    Form("DEGREES"),
    Only(lambda asked: asked.axes is None and asked.tibia is None, "no --axes or --tibia with it"),
    Group("Axes of the femur"),
]
Columns = Annotated[dict[str, str], Form("NAME=COLUMN")]
COLUMN = (
    "the table's column for one of the package's, as flexion_deg=knee_flex_deg; may be repeated"
)
FITTED_HERE = Only(lambda asked: asked.axes and asked.calibrate_at,
                   "--calibrate-at and --axes with it")
ANATOMY = Group("Axes of the femur")


def _needs(other: str, expected: str) -> Only:
    return Only(lambda asked: getattr(asked, other) is not None, f"{expected} with it")


class JointFit(Drawn):
    """Fit a moving axis and a hinge to poses or a contact knee."""

    command: ClassVar = "joint fit"
    example: ClassVar = "kneejax joint fit --knee four_ligament --flexion 0:90:10"
    body: ClassVar = "kneejax.cli.joint._fit"
    folder: ClassVar = "kneejax-joint"

    poses: Annotated[Table | None, Place("POSES")] = meaning(
        "CSV of two or more measured poses; or --knee", None
    )
    convention: Annotated[Convention | None, _needs("poses", "a CSV of poses")] = meaning(
        "of the poses (default: femoral)", None
    )
    column: Annotated[Columns, _needs("poses", "a CSV of poses")] = meaning(COLUMN, {})
    knee: Knee | None = meaning(
        f"passive flexion of a contact knee instead of poses: {KNEE}; without --femur "
        "and --axes its condyles give the axes", None,
    )  # fmt: skip
    at: Annotated[list[Angle], Form("DEGREES", several=True)] = meaning(
        "calibrate on the poses nearest to these flexions; on the first and last otherwise, of a "
        "knee at both ends of --flexion", [],
    )  # fmt: skip
    femur: Annotated[Mesh | None, Form("MESH"), ANATOMY] = meaning("bone or cartilage", None)
    axes: Annotated[Path | None, File("axis points"), Form("FILE"), ANATOMY] = meaning(
        "YAML or CSV of axis points", None
    )
    tibia: Annotated[Mesh | None, Form("MESH"), _needs("femur", "--femur"), ANATOMY] = meaning(
        "facets are where the femur meets it, at the first and at the last calibration pose", None
    )
    touching_within: Annotated[
        float | None, Form("MM"), _needs("tibia", "--tibia"), ANATOMY
    ] = meaning("how near that is (default: 4)", None, gt=0, allow_inf_nan=False)
    unit: Annotated[Literal["auto", "m", "mm", "cm"] | None, _needs("femur", "--femur"),
                    ANATOMY] = meaning("of the meshes (default: auto)", None)
    side: Annotated[Side | None, ANATOMY] = meaning(
        "of the knee (default: right, or that of --knee)", None
    )
    landmarks: Annotated[
        Path | None, File("landmarks"), Form("FILE"), _needs("femur", "--femur"), ANATOMY
    ] = meaning("YAML: axes of femur and tibia, in the frames of their meshes", None)
    extension_facet: Facet = meaning(
        "from anterior through distal, about the transverse axis (default: 65 110)", None
    )
    flexion_facet: Facet = meaning("likewise (default: 110 190)", None)
    medial_epicondyle: Point = meaning("mm, for the hinge", None)
    lateral_epicondyle: Point = meaning("likewise", None)
    interpolation: Literal["linear", "monotone"] | None = meaning(
        "between the poses (default: monotone from three poses on)", None
    )
    flexion: Flexion = meaning("of the tables: first:last:step or a,b,c", "0:120:5")

    def problems(self) -> Iterator[InputProblem]:
        """Poses of one origin, and axes of at most one."""
        if (self.poses is None) == (self.knee is None):
            found = "none" if self.poses is None else "a table and --knee"
            expected = "a CSV of measured poses, or --knee"
            yield InputProblem("joint fit", "POSES", found, expected)
        elif self.knee is None and self.femur is None and self.axes is None:
            expected = "--femur MESH, --axes FILE or, of a contact knee, --knee"
            yield InputProblem("joint fit", "axis points", "none", expected)
        if self.femur is not None and self.axes is not None:
            expected = "one of --femur and --axes"
            yield InputProblem("joint fit", "--axes", str(self.axes), expected)
        both = self.medial_epicondyle, self.lateral_epicondyle
        if (both[0] is None) != (both[1] is None):
            missing = "--medial-epicondyle" if both[0] is None else "--lateral-epicondyle"
            yield InputProblem("joint fit", missing, "missing", "both epicondyles, or none")


class JointCompare(Drawn):
    """Compare joints and contact knees with measured motion."""

    command: ClassVar = "joint compare"
    example: ClassVar = (
        "kneejax simulate passive-flexion && "
        "kneejax joint compare kneejax-passive-flexion/poses.csv --knee four_ligament"
    )
    body: ClassVar = "kneejax.cli.joint._compare"

    measured: Annotated[list[Path], File("a CSV table"), Place("MEASURED")] = meaning(
        "CSV of measured poses, one file a subject"
    )
    convention: Convention = meaning("of the poses", "femoral")
    column: Columns = meaning(COLUMN, {})
    joint: Annotated[list[str], Form("[NAME=]FILE[,FILE...]")] = meaning(
        "joint file for all subjects, or one for each, in their order; may be repeated", []
    )
    knee: Annotated[list[Knee], Bundled("knees"), Form("KNEE")] = meaning(
        f"contact knee in passive flexion: {KNEE}; may be repeated", []
    )
    calibrate_at: Annotated[list[Angle], Form("DEGREES", several=True)] = meaning(
        "fit moving axis and hinge here, each subject's on its own poses at these flexions with "
        "the points of --axes; and leave those poses out of the comparison", [],
    )  # fmt: skip
    average_within: Annotated[float, Form("DEGREES"), FITTED_HERE] = meaning(
        "poses as near as this to a flexion of calibration are averaged for it",
        0.5, ge=0, allow_inf_nan=False,
    )  # fmt: skip
    axes: Annotated[list[str], Form("FILE[,FILE...]")] = meaning(
        "axis points, as for kneejax joint fit: one file for all subjects, or one for each, in "
        "their order", [],
    )  # fmt: skip
    side: Annotated[Side, FITTED_HERE] = meaning(
        "of the knees whose points --axes gives, with Z to the person's right; poses go by "
        "clinical meaning on either side", "right",
    )  # fmt: skip
    spread: Annotated[float, Form("DEGREES")] = meaning(
        "by how much subjects may be flexed differently at one condition",
        1.0, ge=0, allow_inf_nan=False,
    )  # fmt: skip
    anova: bool | None = meaning(
        "test differences, by package pingouin (default: from three subjects on)", None
    )
    alpha: float = meaning("level of these tests", 0.01, gt=0, lt=1)

    def problems(self) -> Iterator[InputProblem]:
        """Subjects once each; calibration with axes."""
        for i, file in enumerate(self.measured):
            if file in self.measured[:i]:
                yield InputProblem("joint compare", "MEASURED", str(file), "every subject once")
        if bool(self.calibrate_at) != bool(self.axes):
            missing = "--calibrate-at" if self.axes else "--axes"
            expected = "both --calibrate-at and --axes"
            yield InputProblem("joint compare", missing, "missing", expected)


class JointExport(Written):
    """Write a joint as an OpenSim CustomJoint and as coupled coordinates."""

    command: ClassVar = "joint export"
    example: ClassVar = (
        "kneejax joint fit --knee four_ligament && kneejax joint export kneejax-joint/joint.yaml"
    )
    body: ClassVar = "kneejax.cli.joint._fit:export"

    joint: Annotated[Path, File("a joint file"), Place("JOINT")] = meaning("joint file")
