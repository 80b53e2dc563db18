"""Options of the commands on studies, cohorts and plans: what data and parameters determine."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from kneejax.cli._command import Bundled, Command, Drawn, File, Form, Only, Place, Several, Written
from kneejax.cli._words import Split
from kneejax.cli.options._common import KNEE, Knee
from kneejax.files import InputProblem

Study = Annotated[str, Place("STUDY"), Bundled("studies")]
PART = "I/N with I from 1 to N, e.g. 3/20"
STUDY = "study file or bundled study"
#: A parameter's name or wildcard -> its limits.
Ranges = Annotated[dict[str, tuple[float, float]], Form("NAME=LOW:HIGH")]
#: What counts for single studies is not that of knees compared.
STUDIED = Only(lambda asked: not asked.knees, "a study, not --knees, with it")
Noise = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Calibrate(Drawn):
    """Identify the parameters of ligaments from measured motion."""

    command: ClassVar = "calibrate"
    example: ClassVar = "kneejax calibrate passive_flexion"
    body: ClassVar = "kneejax.cli._calibrate"
    folder: ClassVar = "kneejax-calibration"

    study: Annotated[str, Place("STUDY"), Bundled("studies", others=True)] = Field(
        "passive_flexion",
        description=f"{STUDY}; or a cohort: a folder of studies, a pattern in quotes, or a file "
        "that names its knees",
    )
    bootstrap: Annotated[int | None, Form("N")] = Field(
        None,
        description="of a cohort: for each knee N fits of data that its answer would give, with "
        "noise",
        ge=1,
        le=1_000_000,
    )
    blocks: Annotated[
        bool, Only(lambda asked: asked.bootstrap is not None, "--bootstrap N with it")
    ] = Field(
        False,
        description="with --bootstrap: of curves drawn among those that were measured, each the "
        "passive motion or a test at one flexion",
    )
    jobs: Annotated[int | None, Form("N")] = Field(
        None,
        description="of a cohort: workers on this machine, a core each (package dask; default: "
        "this process alone)",
        ge=1,
        le=1024,
    )
    scheduler: Annotated[
        str | None,
        Form("ADDRESS"),
        Only(
            lambda asked: asked.jobs is None and asked.shard is None,
            "one of --scheduler, and --jobs or --shard",
        ),
    ] = Field(
        None, description="of a cohort: the workers of a Dask cluster, e.g. tcp://10.0.0.1:8786"
    )
    shard: Annotated[tuple[int, int] | None, Split("/", PART, "I/N")] = Field(
        None,
        description="of a cohort: only the I-th of N parts, for job arrays; the last part to "
        "finish writes the report",
    )

    def resumes(self) -> bool:
        """Cohorts go on, knee by knee."""
        from kneejax.cohorts import is_cohort

        try:
            return is_cohort(self.study)
        except InputProblem:
            return False

    def problems(self) -> Iterator[InputProblem]:
        """A part that there is none of."""
        if self.shard is not None and not 1 <= self.shard[0] <= self.shard[1] <= 100_000:
            part = "/".join(map(str, self.shard))
            yield InputProblem("calibrate", "--shard", part, PART)


class Map(Drawn):
    """Compute the objective over pairs of parameters."""

    command: ClassVar = "map"
    example: ClassVar = "kneejax map --pair PCL.stiffness PCL.reference_strain --grid 21"
    body: ClassVar = "kneejax.cli._studies:objective_maps"
    folder: ClassVar = "kneejax-map"

    study: Study = Field("passive_flexion", description=STUDY)
    pair: Annotated[list[tuple[str, str]], Form("X Y")] = Field(
        [],
        description="two parameters, e.g. PCL.stiffness PCL.reference_strain; may be repeated",
    )
    all_pairs: bool = Field(False, description="every pair of the study's parameters")
    grid: Annotated[
        tuple[int, int], Split("x", "points a side, as in 41 or 41x61", "NxM", single=True)
    ] = Field((41, 41), description="points a side, or as in 41x61")
    ranges: Ranges = Field(
        {}, alias="range", description="of a parameter; the study's bounds otherwise"
    )

    def resumes(self) -> bool:
        """Maps go on, part by part."""
        return True


class Sensitivity(Drawn):
    """Compute how the motion depends on each parameter."""

    command: ClassVar = "sensitivity"
    example: ClassVar = "kneejax sensitivity --sweep ACL.stiffness"
    body: ClassVar = "kneejax.cli._studies:sensitivity"
    folder: ClassVar = "kneejax-sensitivity"

    study: Study = Field("passive_flexion", description=STUDY)
    sweep: Annotated[
        dict[str, tuple[float, ...] | None], Form("NAME[=LOW:HIGH[:COUNT]]"), STUDIED
    ] = Field(
        {},
        description="a parameter, or as *.stiffness, one at a time; all of the study's otherwise",
    )
    scale: Literal["prior", "percent"] = Field(
        "prior", description="local derivatives per standard deviation of a prior, or per per cent"
    )
    prior: Annotated[dict[str, float], Form("NAME=SD"), STUDIED] = Field(
        {},
        description="standard deviation of a parameter, or as *.stiffness; usual ones otherwise",
    )
    indices: Annotated[Literal["sobol", "morris"] | None, STUDIED] = Field(
        None, alias="global", description="global indices of the motion too (package SALib)"
    )
    samples: Annotated[int | None, STUDIED] = Field(
        None,
        description="points of Sobol's sequence, a power of two, or Morris trajectories (default: "
        "256 or 64)",
    )
    ranges: Annotated[Ranges, STUDIED] = Field(
        {},
        alias="range",
        description="of a parameter, for global indices; as wide as its prior otherwise",
    )
    knees: Annotated[list[Knee], Bundled("knees"), Several(), Form("KNEE")] = Field(
        [],
        description="compare knees instead: varus and valgus moments, scores of paper 4; each a "
        f"{KNEE}",
    )
    seed: int = Field(0, description="of the random numbers")


class Identify(Drawn):
    """Report what the data of a study determine, and what to measure next."""

    command: ClassVar = "identify"
    example: ClassVar = "kneejax identify --next-tests 2"
    body: ClassVar = "kneejax.cli._studies:what_data_tell"
    folder: ClassVar = "kneejax-identify"

    study: Study = Field("passive_flexion", description=STUDY)
    noise_mm: float | None = Field(None, description="standard deviation of measured positions")
    noise_deg: float | None = Field(None, description="standard deviation of measured rotations")
    prior: Annotated[
        dict[str, tuple[float, float]], Form("NAME=MEAN:SD, e.g. ACL.stiffness=4500:900")
    ] = Field({}, description="normal prior of a parameter or wildcard, for the posterior")
    posterior: bool = Field(False, description="sample it (packages BlackJAX and ArviZ)")
    chains: int = Field(4, description="of the posterior's samples")
    draws: int = Field(1000, description="of each chain, after warm-up")
    seed: int = Field(0, description="of the random numbers")
    next_tests: Annotated[int, Form("K")] = Field(3, description="how many tests to choose")
    criterion: Literal["D", "A"] = Field(
        "D",
        description="what they make small: the volume of the confidence region (D), or the mean "
        "squared standard error (A)",
    )
    candidates: Annotated[Path | None, File("a CSV table")] = Field(
        None, description="CSV of tests to choose from; a usual set otherwise"
    )


class CohortSynthesise(Written):
    """Make up knees and their measurements; the truth is kept aside."""

    command: ClassVar = "cohort synthesise"
    example: ClassVar = (
        "kneejax cohort synthesise --knees 100 --out made-up && kneejax calibrate made-up"
    )
    body: ClassVar = "kneejax.cli._cohort:make_up"
    folder: ClassVar = "kneejax-cohort"

    knees: int = Field(100, description="how many", ge=1, le=100_000)
    seed: int = Field(0, description="of the random numbers", ge=0)
    knee: Knee = Field("four_ligament", description=f"that is varied: {KNEE}")
    noise_mm: Noise = Field(0.2, description="standard deviation of measured positions")
    noise_deg: Noise = Field(0.2, description="standard deviation of measured rotations")


class PlanAcl(Drawn):
    """Find where, and how tight, to place a graft for the anterior cruciate ligament."""

    command: ClassVar = "plan acl"
    example: ClassVar = "kneejax plan acl ten_bundle --points 11"
    body: ClassVar = "kneejax.cli._plan"
    folder: ClassVar = "kneejax-plan"

    plan: Annotated[str, Place("PLAN"), Bundled("plans")] = Field(
        "ten_bundle", description="plan file or bundled plan"
    )
    points: Annotated[int | None, Form("N")] = Field(
        None,
        description="of a map along each axis, 0 for no maps (default: what the plan says)",
        ge=0,
        le=401,
    )
    front: bool = Field(
        False,
        description="also find the places that are best in some balance of laxity, force and "
        "strains",
    )

    def problems(self) -> Iterator[InputProblem]:
        """A map of one or two points."""
        if self.points in (1, 2):
            yield InputProblem("plan acl", "--points", self.points, "0, or 3 to 401")


class Reproduce(Drawn):
    """Compute what a paper claims, and judge each claim."""

    command: ClassVar = "reproduce"
    example: ClassVar = "kneejax reproduce 1"
    body: ClassVar = "kneejax.cli._reproduce"
    folder: ClassVar = "kneejax-reproduction"

    paper: Annotated[Literal["1", "2", "3", "4", "5"], Place("PAPER")] = Field(
        description="number of the paper"
    )
    knee: Annotated[
        Knee | None, Only(lambda asked: asked.paper == "1", "paper 1 with it", "paper")
    ] = Field(None, description=f"of paper 1, four_ligament_fitted by default: {KNEE}")
    patella: Annotated[
        Literal["on-path", "balanced", "none"] | None,
        Only(lambda asked: asked.paper == "1", "paper 1 with it", "paper"),
    ] = Field(
        None,
        description="of paper 1, on which its 2 kg pull: on-path, with one degree of freedom as "
        "in the paper (default); balanced, a third bone; none, a line of constant tension instead",
    )


class Rerun(Command):
    """Repeat the run that wrote a folder."""

    command: ClassVar = "rerun"
    example: ClassVar = (
        "kneejax simulate passive-flexion && kneejax rerun kneejax-passive-flexion --out again"
    )
    body: ClassVar = "kneejax.cli._main:rerun"

    folder: Annotated[Path, Place("FOLDER")] = Field(
        description="folder with the settings.json of a command"
    )
    out: Path | None = Field(
        None, description="folder for the results; the same one otherwise"
    )


class Completion(Command):
    """Print a script that lets a shell complete commands, options and files."""

    command: ClassVar = "completion"
    example: ClassVar = 'eval "$(kneejax completion bash)"'
    body: ClassVar = "kneejax.cli._main:completion"

    shell: Annotated[Literal["bash", "zsh", "fish"], Place("SHELL")] = Field(
        description="bash, zsh or fish"
    )
