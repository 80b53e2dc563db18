"""Options of `kneejax simulate`; each belongs to some of the experiments."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, get_args

from kneejax.cli._command import Angles, Drawn, Form, Group, Only, Place, Problem, option_name
from kneejax.cli.options._types import KNEE, SET, Convention, Knee, Table, Values
from kneejax.files.reading import Distinct, Number, meaning, within

# fmt: off
#: As `kneejax.experiments.READY`, which would bring in JAX, and two more.
Test = Literal["drawer", "lachman", "torsion", "varus-valgus", "compression", "distraction",
               "pivot", "envelope", "load"]
#: Experiments in which the quadriceps pulls on a patella, and those through time.
Extensor = Literal["patellar-tracking", "extension", "leg-raise"]
InTime = Literal["settle", "drop"]
Damper = Literal["critical", "damping_N_s_per_mm", "dissipation_s_per_mm"]
TESTS, EXTENSOR, IN_TIME = get_args(Test), get_args(Extensor), get_args(InTime)
DAMPERS = get_args(Damper)
#: Options that say how large a test is.
SIZES = ("force_N", "moment_Nm", "displacement_mm", "rotation_deg")


def _only(where, expected: str) -> Only:
    return Only(where, f"{expected} with it", "experiment")


#: What an option belongs to.
BY_LOAD = _only(lambda asked: asked.experiment in TESTS, "a test under load")
IN_STEPS = _only(lambda asked: asked.experiment in (*TESTS, *EXTENSOR), "a test under load")
AT_REST = _only(lambda asked: not asked.dynamic, "a test without --dynamic")
PASSIVE = _only(lambda asked: asked.experiment == "passive-flexion", "passive-flexion")
LEG = _only(lambda asked: asked.experiment == "leg-raise" or asked.in_time,
            "leg-raise, or a motion in time")
PULLED = _only(lambda asked: asked.experiment in EXTENSOR[:2] and not asked.in_time,
               f"{' or '.join(EXTENSOR[:2])}")
DRIVEN = _only(lambda asked: asked.experiment in EXTENSOR[1:], "extension or leg-raise")
HELD = Only(lambda asked: not asked.in_time, "one at rest; in time --loads gives lengths",
            "experiment")
TIME = _only(lambda asked: asked.in_time, f"--dynamic, or {' or '.join(IN_TIME)},")
RECORDED = _only(lambda asked: asked.experiment != "leg-raise",
                 "settle, drop or a test under load")
NOT_RAISED = _only(lambda asked: asked.experiment != "leg-raise", "a test under load")
LOAD, QUADRICEPS = Group("Tests under load"), Group("Pull of the quadriceps")
MOTION, KNEE_OPTIONS = Group("Motion through time"), Group("Knee")
OfLeg = Annotated[Number | None, LEG, QUADRICEPS]


class Simulate(Drawn):
    """Move a knee through flexion, or load it as a laboratory does."""

    example: ClassVar = (
        "kneejax simulate drawer --knee lenhart2015_reduced --flexion 0:90:15 --force-N 100 --both")
    folder: ClassVar = "kneejax-EXPERIMENT"
    renamed: ClassVar = {"flexion_deg": "flexion", "held": "hold"}

    experiment: Annotated[
        Literal["passive-flexion", Test, Extensor, InTime], Place("EXPERIMENT")] = meaning(
        f"passive-flexion, or a test under load: {', '.join(TESTS)}; `load` makes the "
        "load that --load says grow from nothing, `envelope` is drawer, varus-valgus and torsion; "
        f"or with the patella, {', '.join(EXTENSOR)}; or through time, {', '.join(IN_TIME)}, or a "
        "test with --dynamic")
    knee: Annotated[Knee, KNEE_OPTIONS] = meaning(KNEE, "average_knee")
    flexion: Annotated[str | None, Angles(), KNEE_OPTIONS] = meaning(
        "degrees: first:last:step or a,b,c (default: 0:120:5 in passive-flexion, 0:90:15 in tests, "
        "20 in lachman)", None)
    values: Values = meaning(SET, {}, alias="set")
    cut: Annotated[list[str], Distinct, Form("LIGAMENT"), KNEE_OPTIONS] = meaning(
        "a ligament, or a group of them, that does not act; or a meniscus that is removed, whole "
        "or in part, as medial_meniscus, medial_meniscus:inner=0.5 (of its width) or "
        "medial_meniscus:posterior=0.4 (of its arc); once for each", [])
    load: Annotated[dict[str, float], Form("NAME=SIZE"), KNEE_OPTIONS] = meaning(
        "on the tibia, along the axes of Grood and Suntay: lateral_N, anterior_N, compression_N "
        "(at the tibia's origin), varus_Nm, internal_Nm; e.g. anterior_N=134. In a test it acts "
        "throughout", {})
    branches: Annotated[bool, PASSIVE, KNEE_OPTIONS] = meaning(
        "look for other stable balances at the same angles and load as well: branches.csv", False)
    force_N: Annotated[Annotated[float, within("anterior_N")] | None, BY_LOAD, LOAD] = meaning(
        "full force of a test (default: 100; compression 500, distraction 50)", None)
    moment_Nm: Annotated[Annotated[float, within("varus_Nm")] | None, BY_LOAD, LOAD] = meaning(
        "full moment of a test (default: 10; torsion 5); pivot adds half of it in internal torque, "
        "torsion in an envelope is half of it", None)
    displacement_mm: Annotated[float | None, BY_LOAD, AT_REST, LOAD] = meaning(
        "of drawer and lachman: a machine moves the tibia so far, and its force is read", None)
    rotation_deg: Annotated[float | None, BY_LOAD, AT_REST, LOAD] = meaning(
        "of torsion and varus-valgus: a machine turns the tibia so far; its moment is read", None)
    hold: Annotated[
        list[Literal["adduction", "internal_rotation"]], BY_LOAD, AT_REST, Form("ROTATION"), LOAD
    ] = meaning("a rotation that a machine holds where it is without the test's load: adduction or "
                "internal_rotation; once for each", [])
    counted_from: Annotated[Literal["unloaded", "intact"] | None, BY_LOAD, AT_REST, LOAD] = meaning(
        "what displacements of a cut knee are counted from: its own unloaded pose (default), or "
        "that of the intact knee, from which a machine moves it too; as in a study", None)
    both: Annotated[bool, BY_LOAD, AT_REST, LOAD] = meaning(
        "load a test in the opposite sense too", False)
    steps: Annotated[int | None, IN_STEPS, AT_REST, LOAD] = meaning(
        "of a test, from nothing to the full load (default: 20)", None)
    quadriceps_N: Annotated[float | None, PULLED, QUADRICEPS] = meaning(
        "pull of the quadriceps: of patellar-tracking (default: 100), and the largest of extension "
        "(default: 1000), which --steps divides", None, ge=1, le=12_000)
    quadriceps_mm: Annotated[str | None, DRIVEN, HELD, Form("FROM:TO:STEP"), QUADRICEPS] = meaning(
        "of extension and leg-raise, instead of a pull: how much longer the quadriceps is than at "
        "rest, at the flexion that is held or in extension; as 0:-3:-0.5; its pull, and of "
        "leg-raise flexion, is a result", None)
    body_kg: OfLeg = meaning(
        "of leg-raise: the person (default: 75); shank and foot are 6.1 % of it", None)
    height_m: OfLeg = meaning("of leg-raise (default: 1.75)", None)
    ankle_kg: OfLeg = meaning(
        "of leg-raise: a weight at the ankle in addition (default: 0)", None)
    femur_deg: OfLeg = meaning(
        "of leg-raise: of the thigh from the horizontal, knee above hip positive (default: 0)",
        None)
    dynamic: Annotated[bool, MOTION] = meaning(
        "of a test by load, at one flexion: with mass, damping and time; the load grows in "
        "--ramp-s and stays; of leg-raise: a motor shortens the quadriceps. settle and drop are so "
        "anyway", False)
    loads: Annotated[Table | None, TIME, Form("FILE.csv"), MOTION] = meaning(
        "of `load --dynamic`: loads over time, a column time_s and columns like anterior_N; "
        "columns like flexion_deg lead a coordinate; of `leg-raise --dynamic`: a column "
        "quadriceps_mm, what a motor makes of its length", None)
    duration_s: Annotated[float | None, TIME, MOTION] = meaning(
        "of a motion through time (default: 1; settle 2; leg-raise 20; that of --loads)",
        None, ge=1e-4, le=120)
    every_ms: Annotated[float | None, TIME, MOTION] = meaning(
        "between two rows of its tables (default: 1; leg-raise 100)", None, ge=1e-3, le=1000)
    ramp_s: Annotated[float | None, TIME, BY_LOAD, NOT_RAISED, MOTION] = meaning(
        "in which the load of a test grows (default: 0.1)", None, ge=0, le=60)
    critical: Annotated[Number | None, TIME, MOTION] = meaning(
        "damping of each fibre, as part of sqrt(4 k m) (default: 1; paper 2)", None)
    damping_N_s_per_mm: Annotated[Number | None, TIME, MOTION] = meaning(
        "of every coordinate, rotations at 30 mm (default: 0; settle 1)", None)
    dissipation_s_per_mm: Annotated[Number | None, TIME, MOTION] = meaning(
        "of every contact: its force grows by so much with each mm/s of its overlap (default: 0)",
        None)
    recorded: Annotated[Table | None, TIME, RECORDED, Form("FILE.csv"), MOTION] = meaning(
        "a recorded motion, columns time_s and some like anterior_mm, of which changes from the "
        "first row count: finds the damping that --free names", None)
    free: Annotated[list[Damper], TIME, Form("NAME"), MOTION] = meaning(
        "what is found from --recorded: critical, damping_N_s_per_mm or dissipation_s_per_mm; once "
        "for each", [])
    offset: Annotated[dict[str, float], TIME, NOT_RAISED, Form("NAME=SIZE"), MOTION] = meaning(
        "how far from its balance the knee is let go, as anterior_mm=3 or adduction_deg=2; once "
        "for each (default of settle: anterior_mm=3)", {}, alias="from")
    error_mm: Annotated[Number | None, TIME, MOTION] = meaning(
        "that the steps may leave in any pose (default: 0.01); they become as short as it takes",
        None)
    convention: Annotated[Convention, Group("Results")] = meaning(
        "of the poses that are printed and written", "femoral")

    @property
    def in_time(self) -> bool:
        """Whether mass and time play a part."""
        return self.dynamic or self.experiment in IN_TIME

    @property
    def person(self) -> dict[str, float]:
        """Whose leg it is."""
        usual = {"body_kg": 75.0, "height_m": 1.75, "ankle_kg": 0.0}
        return usual | {name: x for name in usual if (x := getattr(self, name)) is not None}

    @property
    def in_errors(self) -> str:
        """The command in errors, with its experiment."""
        return f"{self.command} {self.experiment}"

    def problems(self) -> Iterator[Problem]:
        """Options that an experiment needs, or that exclude each other."""
        name = self.experiment
        if self.dynamic and name in EXTENSOR[:2]:
            yield "--dynamic", name, "leg-raise, or a test under load"
        if self.dynamic and name in ("envelope", "passive-flexion"):
            yield "--dynamic", name, "one test under load with it"
        if self.loads is not None and name not in ("load", "leg-raise"):
            yield "--loads", name, "load --dynamic with it"
        if name == "leg-raise" and self.load:
            yield "--load", name, "patellar-tracking, extension or a test under load with it"
        if self.counted_from == "intact" and not self.cut:
            yield "--counted-from", "intact", "--cut too, or unloaded"
        if self.free and self.recorded is None:
            yield "--free", self.free[0], "--recorded FILE.csv with it"
        if self.recorded is not None and not self.free:
            yield "--recorded", str(self.recorded), f"--free with one of {', '.join(DAMPERS)}"
        most = 200 if name in EXTENSOR else 1000
        if self.steps is not None and not 1 <= self.steps <= most:
            yield "--steps", self.steps, f"between 1 and {most}"
        if self.quadriceps_mm is not None:
            for option in ("quadriceps_N", "steps", *["flexion"] * (name == "leg-raise")):
                if getattr(self, option) is not None:
                    place = f"--{option_name(option)}"
                    yield place, name, "--quadriceps-mm without it: a result"
        for option in SIZES:
            place, size = f"--{option_name(option)}", getattr(self, option)
            if size is not None and name == "load":
                yield place, name, "the load's size in --load NAME=SIZE"
            elif size is not None and not size > 0:
                yield place, f"{size:g}", "a size above zero; --both for both"
        if name == "load" and not self.load and self.loads is None:
            more = ", or --loads FILE.csv" if self.dynamic else ""
            yield "--load", name, f"the load that grows, loads as NAME=SIZE{more}"
