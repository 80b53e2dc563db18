"""Options of the commands on studies, cohorts and plans: what data and parameters determine."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_origin

from pydantic import BaseModel, Field, create_model

from kneejax import studies
from kneejax.cli import _command
from kneejax.cli._command import Bundled, Command, Drawn, File, Form, Only, Place, Problem
from kneejax.cli._words import Split, plain_type
from kneejax.cli.options._types import KNEE, Knee
from kneejax.files import InputProblem
from kneejax.files.reading import meaning

# fmt: off
PART = "I/N with I from 1 to N, e.g. 3/20"
STUDY = "study file or bundled study"
#: What counts for single studies is not that of knees compared.
STUDIED = Only(lambda asked: not asked.knees, "a study, not --knees, with it")
BOOTSTRAPPED = Only(lambda asked: asked.bootstrap is not None, "--bootstrap N with it")
ALONE = Only(lambda asked: asked.jobs is None and asked.shard is None,
             "one of --scheduler, and --jobs or --shard")
PAPER_1 = Only(lambda asked: asked.paper == "1", "paper 1 with it", "paper")
Noise = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Calibrate(Drawn):
    """Identify the parameters of ligaments from measured motion."""

    example: ClassVar = "kneejax calibrate passive_flexion"
    body: ClassVar = "kneejax.cli._studies:calibrate"
    folder: ClassVar = "kneejax-calibration"

    study: Annotated[str, Place("STUDY"), Bundled("studies", others=True)] = meaning(
        f"{STUDY}; or a cohort: a folder of studies, a pattern in quotes, or a file "
        "that names its knees", "passive_flexion")
    bootstrap: Annotated[int | None, Form("N")] = meaning(
        "of a cohort: for each knee N fits of data that its answer would give, with noise",
        None, ge=1, le=1_000_000)
    blocks: Annotated[bool, BOOTSTRAPPED] = meaning(
        "with --bootstrap: of curves drawn among those that were measured, each the passive motion "
        "or a test at one flexion", False)
    jobs: Annotated[int | None, Form("N")] = meaning(
        "of a cohort: workers on this machine, a core each (package dask; default: this process "
        "alone)", None, ge=1, le=1024)
    scheduler: Annotated[str | None, Form("ADDRESS"), ALONE] = meaning(
        "of a cohort: the workers of a Dask cluster, e.g. tcp://10.0.0.1:8786", None)
    shard: Annotated[tuple[int, int] | None, Split("/", PART, "I/N")] = meaning(
        "of a cohort: only the I-th of N parts, for job arrays; the last part to finish writes the "
        "report", None)

    def resumes(self) -> bool:
        """Cohorts go on, knee by knee."""
        from kneejax.cohorts import is_cohort

        try:
            return is_cohort(self.study)
        except InputProblem:
            return False

    def problems(self) -> Iterator[Problem]:
        """A part that does not exist."""
        if self.shard is not None and not 1 <= self.shard[0] <= self.shard[1] <= 100_000:
            yield "--shard", "/".join(map(str, self.shard)), PART


class Asked(Drawn):
    """A command that asks something of a study."""

    asks: ClassVar[type[BaseModel]]  # the question, whose fields are its options
    study: Annotated[str, Place("STUDY"), Bundled("studies")] = meaning(STUDY, "passive_flexion")

    def question(self, **read: Any) -> Any:
        """The question, checked; values that are read of a file in the place of its name."""
        given = {name: getattr(self, name) for name in self.asks.model_fields}
        return self.asks(**given | read)

    def said(self, problem: ValueError) -> ValueError:
        """Also what the question refuses names the option."""
        if not isinstance(problem, InputProblem) or problem.file not in self.asks.model_fields:
            return super().said(problem)
        option = _command.shown_name(type(self).model_fields[problem.file])
        return InputProblem(option, problem.field, problem.value, problem.expected, problem.nearest)


def asking(asks: type[BaseModel], **as_words: tuple[Any, ...]) -> type[Asked]:
    """A command whose options are the fields of a question: their type, meaning and default. In
    `as_words` stand marks of how a field is written, and a type or a text in place of its own."""
    fields: dict[str, Any] = {}
    for name, field in asks.model_fields.items():
        kind, words, marks = plain_type(field.annotation), field.description, []
        for one in as_words.get(name, ()):
            if isinstance(one, str):
                words = one
            elif isinstance(one, type) or get_origin(one):
                kind = one
            else:
                marks.append(one)
        default = field.get_default(call_default_factory=True)
        default = list(default) if get_origin(kind) is list else default
        kind = kind | None if default is None else kind
        alias = "global" if name == "indices" else _command.option_name(name)
        option = Field(default, alias=alias, description=words)
        fields[name] = (Annotated[kind, *marks] if marks else kind, option)
    model = create_model(asks.__name__, __base__=Asked, **fields)
    model.asks = asks
    return model


class Map(asking(
    studies.Map,
    pair=(list[tuple[str, str]], Form("X Y"),
          "two parameters, e.g. PCL.stiffness PCL.reference_strain; may be repeated"),
    grid=(Split("x", "points a side, as in 41 or 41x61", "NxM", single=True),
          "points a side, or as in 41x61"),
    range=(Form("NAME=LOW:HIGH"), "of a parameter; the study's bounds otherwise"),
)):
    """Compute the objective over pairs of parameters."""

    example: ClassVar = "kneejax map --pair PCL.stiffness PCL.reference_strain --grid 21"
    body: ClassVar = "kneejax.cli._studies:objective_maps"

    def resumes(self) -> bool:
        """Maps go on, part by part."""
        return True


class Sensitivity(asking(
    studies.Sensitivity,
    sweep=(Form("NAME[=LOW:HIGH[:COUNT]]"), STUDIED,
           "a parameter, or as *.stiffness, one at a time; all of the study's otherwise"),
    prior=(Form("NAME=SD"), STUDIED,
           "standard deviation of a parameter, or as *.stiffness; usual ones otherwise"),
    indices=(STUDIED,),
    samples=(STUDIED,),
    range=(Form("NAME=LOW:HIGH"), STUDIED),
)):
    """Compute how the motion depends on each parameter."""

    example: ClassVar = "kneejax sensitivity --sweep ACL.stiffness"
    body: ClassVar = "kneejax.cli._studies:sensitivity"

    knees: Annotated[list[Knee], Bundled("knees"), Form("KNEE", several=True)] = meaning(
        "compare knees instead: varus and valgus moments, scores of paper 4; each a "
        f"{KNEE}", [])


class Identify(asking(
    studies.Identify,
    prior=(Form("NAME=MEAN:SD, e.g. ACL.stiffness=4500:900"),),
    next_tests=(Form("K"),),
    candidates=(Path, File("a CSV table"), "CSV of tests to choose from; a usual set otherwise"),
)):
    """Report what the data of a study determine, and what to measure next."""

    example: ClassVar = "kneejax identify --next-tests 2"
    body: ClassVar = "kneejax.cli._studies:what_data_tell"


class CohortSynthesise(_command.Written):
    """Make up knees and their measurements; the truth is kept aside."""

    example: ClassVar = (
        "kneejax cohort synthesise --knees 100 --out made-up && kneejax calibrate made-up")
    body: ClassVar = "kneejax.cli._cohort:make_up"

    knees: int = meaning("how many", 100, ge=1, le=100_000)
    seed: int = meaning("of the random numbers", 0, ge=0)
    knee: Knee = meaning(f"that is varied: {KNEE}", "four_ligament")
    noise_mm: Noise = meaning("standard deviation of measured positions", 0.2)
    noise_deg: Noise = meaning("standard deviation of measured rotations", 0.2)


class PlanAcl(Drawn):
    """Find where, and how tight, to place a graft for the anterior cruciate ligament."""

    example: ClassVar = "kneejax plan acl ten_bundle --points 11"
    body: ClassVar = "kneejax.cli._studies:plan_acl"

    plan: Annotated[str, Place("PLAN"), Bundled("plans")] = meaning(
        "plan file or bundled plan", "ten_bundle")
    points: Annotated[int | None, Form("N")] = meaning(
        "of a map along each axis, 0 for no maps (default: what the plan says)", None, ge=0, le=401)
    front: bool = meaning(
        "also find the places that are best in some balance of laxity, force and strains", False)

    def problems(self) -> Iterator[Problem]:
        """A map of one or two points."""
        if self.points in (1, 2):
            yield "--points", self.points, "0, or 3 to 401"


class Reproduce(Drawn):
    """Compute what a paper claims, and judge each claim."""

    example: ClassVar = "kneejax reproduce 1"
    body: ClassVar = "kneejax.cli._studies:reproduce"
    folder: ClassVar = "kneejax-reproduction"

    paper: Annotated[Literal["1", "2", "3", "4", "5"], Place("PAPER")] = meaning(
        "number of the paper")
    knee: Annotated[Knee | None, PAPER_1] = meaning(
        f"of paper 1, four_ligament_fitted by default: {KNEE}", None)
    patella: Annotated[Literal["on-path", "balanced", "none"] | None, PAPER_1] = meaning(
        "of paper 1, on which its 2 kg pull: on-path, with one degree of freedom as in the paper "
        "(default); balanced, a third bone; none, a line of constant tension instead", None)


class Rerun(Command):
    """Repeat the run that wrote a folder."""

    example: ClassVar = (
        "kneejax simulate passive-flexion && kneejax rerun kneejax-passive-flexion --out again")
    body: ClassVar = "kneejax.cli._main:rerun"

    folder: Annotated[Path, Place("FOLDER")] = meaning("folder with the settings.json of a command")
    out: Path | None = meaning("folder for the results; the same one otherwise", None)


class Completion(Command):
    """Print a script that lets a shell complete commands, options and files."""

    example: ClassVar = 'eval "$(kneejax completion bash)"'
    body: ClassVar = "kneejax.cli._main:completion"

    shell: Annotated[Literal["bash", "zsh", "fish"], Place("SHELL")] = meaning("bash, zsh or fish")
