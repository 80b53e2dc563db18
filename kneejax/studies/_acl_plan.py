"""A planned reconstruction from its file: checked whole before a knee moves."""

__all__ = ["drawn_parameters", "read_plan"]

import os
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ValidationInfo

from kneejax import files, planning
from kneejax.files import reading
from kneejax.files.reading import Mistakes, Number, Part, Text, meaning, one_of, reads, whole, wrong
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Range, range_of_parameter
from kneejax.parameters import fibre_rows
from kneejax.planning import DIRECTIONS, FREE, GRAFTS, AclPlan, Footprint
from kneejax.studies._fields import Values, file_named

_TENSION = Range(1.0, 1000.0, "N", too_small="a graft that is not pulled has no zero-load length")
_PLACE, _HALF, _BAND = Range(-30.0, 30.0, "mm"), Range(1.0, 30.0, "mm"), Range(0.05, 20.0, "mm")
_FORCE, _GRAFT = Range(10.0, 300.0, "N"), Range(10.0, 5000.0, "N")
#: Tries for each draw before the nearest possible value is taken.
_TRIES = 100
#: Steps in which the force of a Lachman test grows; a path divides those that are too long.
_STEPS = 1


def _mesh(value: Any, info: ValidationInfo) -> Path:
    return Path(file_named(value, info, f"a mesh of the {info.field_name}"))


def _angles(value: Any) -> np.ndarray:
    angles = files.parse_flexion(reading.text(value), "", "")
    if len(angles) < 2:
        raise wrong(value, "at least two angles")
    return angles


def _tensions(value: Any) -> tuple[float, ...] | float:
    """One number for all bundles, or one each."""
    several = isinstance(value, list)
    return reading.numbers(value, None, _TENSION) if several else reading.number(value, _TENSION)


Half = Annotated[float, reads(reading.number, _HALF)]
Places = Annotated[Any, reads(reading.rows, 2, _PLACE)]
SemiAxes = Annotated[tuple[float, float], reads(reading.numbers, 2, _HALF)]
Mesh = Annotated[Path, BeforeValidator(_mesh)]
#: True as usual, false not at all, or a mapping with what is not as usual.
Switch = BeforeValidator(lambda value: {True: {}, False: None}[value] if value in (True, False)
                         else value)  # fmt: skip


class Graft(Part):
    """What stands for the torn ligament."""

    type: Annotated[str, one_of(GRAFTS)] = meaning("a name of `kneejax.planning.GRAFTS`")
    bundles: Annotated[int, reads(whole, 1, 2)] = meaning("one or two", 1)
    stiffness_N: Number | None = meaning("as its type", None)


class Fixation(Part):
    """How the graft is fixed."""

    flexion_deg: Number = meaning("of the knee meanwhile", 20.0)
    tension_N: Annotated[tuple[float, ...] | float, reads(_tensions)] = meaning(
        "of each bundle", 80.0)


class Tunnels(Part):
    """Where each bundle leaves the bones; the middle of what it replaces otherwise."""

    tibia_mm: Places | None = meaning("two numbers a bundle", None)
    femur_mm: Places | None = meaning("likewise", None)


class Footprints(Part):
    """Semi-axes of the ellipses in which tunnels may lie."""

    tibia_mm: SemiAxes = meaning("along, across", planning.SEMI_AXES_MM[TIBIA])
    femur_mm: SemiAxes = meaning("along, across", planning.SEMI_AXES_MM[FEMUR])


class Bones(Part):
    """Meshes on which tunnels lie."""

    tibia: Mesh | None = meaning("relative to the plan's folder", None)
    femur: Mesh | None = meaning("likewise", None)


class Lachman(Part):
    """Tests for laxity."""

    flexion_deg: Annotated[
        tuple[float, ...], reading.numbers_within(None, "flexion_deg")
    ] = meaning("at which", (20.0, 90.0))
    force_N: Annotated[float, reads(reading.number, _FORCE)] = meaning(
        "on the tibia, anterior", 100.0)


class PlanLimits(Part):
    """What a good reconstruction keeps."""

    graft_N: Annotated[float, reads(reading.number, _GRAFT)] = meaning(
        "the most in the graft", 400.0)
    laxity_band_mm: Annotated[float, reads(reading.number, _BAND)] = meaning(
        "about the intact knee's", 2.0)
    tension_N: Annotated[tuple[float, float], reads(reading.interval, _TENSION)] = meaning(
        "at fixation, least and most", (20.0, 150.0))


class Map(Part):
    """Maps of both footprints."""

    points: Annotated[int, reads(whole, 3, 401)] = meaning("along each axis", 41)
    tibia_half_mm: Half = meaning("how far the map reaches", 11.0)
    femur_half_mm: Half = meaning("likewise", 8.0)


class Optimum(Part):
    """The search for the best choices."""

    free: Annotated[tuple[Annotated[str, one_of(FREE)], ...], reading.entries("names"),
                    reading.Distinct] = meaning("what may change", tuple(FREE))
    starts: Annotated[int, reads(whole, 1, 64)] = meaning("of the search", planning.STARTS)
    evaluations: Annotated[int, reads(whole, 2, 10_000)] | None = meaning("in all", None)

    @reading.checks
    def _check_count(self, _: Mistakes) -> None:
        if self.evaluations is not None and self.evaluations <= self.starts:
            expected = f"a whole number from {self.starts + 1} to 10000"
            raise wrong(self.evaluations, expected, at="evaluations")


class Front(Part):
    """The search for a front of several criteria."""

    population: Annotated[int, reads(whole, 8, 1024)] = meaning("of each", planning.POPULATION)
    generations: Annotated[int, reads(whole, 1, 1000)] = meaning("in all", planning.GENERATIONS)


class PlanFields(Part):
    """All that a plan file may say."""

    title: Text = meaning("of the report")
    knee: Text = meaning("a bundled knee, a knee file, or the result.json of a calibration")
    graft: Graft = meaning("its type, and what is not as usual")
    set: Values = meaning("parameter -> value of the knee", dict)
    ligament: Text = meaning("that is torn", "ACL")
    fixation: Fixation = meaning("flexion and tension", Fixation)
    tunnels: Tunnels = meaning("on both bones, mm", Tunnels)
    footprints: Footprints = meaning("on both bones, mm", Footprints)
    bones: Bones = meaning("meshes", Bones)
    flexion_deg: Annotated[Any, reads(_angles)] = meaning(
        "through which the knee is extended", lambda: _angles("80:0:-2.5"))
    lachman: Lachman = meaning("flexions and force", Lachman)
    window: Annotated[int, reads(whole, 0, 1000)] = meaning("of time warping", planning.WINDOW)
    limits: PlanLimits = meaning("of graft force, laxity and tension", PlanLimits)
    octagon_apothem_mm: Half = meaning("of the octagon on the tibia", 10.0)
    map: Annotated[Map | None, Switch] = meaning("maps; false for none", Map)
    optimum: Annotated[Optimum | None, Switch] = meaning("the search; false for none", Optimum)
    front: Annotated[Front | None, Switch] = meaning("true for one", None)
    draws: Annotated[int, reads(whole, 2, 4096)] | None = meaning(
        "of the calibration that the knee comes from", None)

    @reading.checks
    def _check_together(self, mistakes: Mistakes) -> None:
        graft = GRAFTS[self.graft.type]
        count, tension = self.graft.bundles, self.fixation.tension_N
        with mistakes.gathered("fixation.tension_N"):
            several = isinstance(tension, tuple)
            stated, fails = [*tension] if several else [tension], graft.failure_N / count
            if max(reading.items(stated, "numbers", count if several else 1)) >= fails:
                raise wrong(tension, f"less than the {fails:g} N at which a bundle fails")
        if self.limits.graft_N > graft.failure_N:
            expected = f"at most the {graft.failure_N:g} N at which it fails"
            mistakes.append(wrong(self.limits.graft_N, expected, at="limits.graft_N"))
        for bone in (TIBIA, FEMUR):
            places = getattr(self.tunnels, f"{bone}_mm")
            with mistakes.gathered(f"tunnels.{bone}_mm"):
                if places is not None:
                    reading.items([*map(list, places)], "tunnels, two numbers each", count)
        if self.front is not None and self.optimum is None:
            mistakes.append(wrong(True, "an optimum that says what is free", at="front"))
        if self.draws and Path(self.knee).suffix.lower() != ".json":
            expected = (f"no draws of {self.knee}: a knee that is the result.json of a calibration "
                        "has them")  # fmt: skip
            mistakes.append(wrong(self.draws, expected, at="draws"))


def read_plan(name_or_path: str | os.PathLike[str], *, patella: bool = False) -> AclPlan:
    """Read a plan, its knee and its bones.

    Args:
        name_or_path: name of a bundled plan, or a plan file; paths in it are relative to its
            folder.
        patella: whether the knee is the one of three bones, grafts fixed with the patella in
            balance: for a movement in which the quadriceps pulls on it.

    Returns:
        The plan, checked whole.

    Raises:
        InputProblem: the file or one that it names cannot be read, or a field is missing,
            unknown or out of range; or the knee's file has no patella and one is asked for;
            `InputProblems` where several are.
        UnknownParameter: a parameter that the knee does not have.

    Example:
        >>> plan = read_plan("ten_bundle")
        >>> plan.graft.name, plan.surgery.plan.torn
        ('hamstring', ('aACL', 'pACL'))
    """
    document, where = files.named_document("plans", name_or_path)
    file, folder = os.fspath(where), where.parent
    plan, mistakes = reading.checked(PlanFields, document, file, folder=folder), Mistakes(file)
    path = folder / plan.knee if os.path.isfile(folder / plan.knee) else Path(plan.knee)
    read = files.load_knee_file(path if os.path.isfile(path) else plan.knee)
    base = read.with_patella() if patella else read.knee
    drawn, held = (), ()
    with files.said_of(file):
        knee = base.replace(plan.set)
    if plan.draws:
        values, held = drawn_parameters(files.read_calibrated(path).of_structures(base), plan.draws)
        with files.said_of(file):
            drawn = tuple(base.replace(one | plan.set) for one in values)
    with mistakes.gathered("ligament"):
        fibre_rows(knee, plan.ligament)
    mistakes.check()
    graft, count = GRAFTS[plan.graft.type], plan.graft.bundles
    stiffness = plan.graft.stiffness_N or graft.stiffness_N
    reconstruction = planning.reconstruction_of(knee, plan.ligament, count, stiffness,
                                                graft.failure_N)
    tibia, femur = (
        planning.footprint_of(knee, plan.ligament, bone, getattr(plan.footprints, f"{bone}_mm"),
                     mesh and files.bone_surface(mesh))
        for bone, mesh in ((TIBIA, plan.bones.tibia), (FEMUR, plan.bones.femur)))  # fmt: skip
    on_bones = []
    for place, stated in ((tibia, plan.tunnels.tibia_mm), (femur, plan.tunnels.femur_mm)):
        with mistakes.gathered(f"tunnels.{place.bone}_mm"):
            on_bones.append(_tunnels(stated, place, count))
    mistakes.check()
    # The torn fibres that each bundle stands for, in their order.
    torn = reconstruction.torn
    halves = [tuple(half.tolist()) for half in np.array_split(torn, count)]
    replaced = tuple(halves) if all(halves) else (torn,) * count
    tension = plan.fixation.tension_N
    tensions = tension if isinstance(tension, tuple) else (tension,) * count
    optimum, maps, tests = plan.optimum or Optimum(), plan.map or Map(), plan.lachman
    return AclPlan(
        title=plan.title,
        surgery=planning.Surgery(
            reconstruction, tibia, femur, replaced, plan.fixation.flexion_deg,
            planning.Protocol(plan.flexion_deg, tests.flexion_deg, tests.force_N, _STEPS),
            plan.window,
            planning.Limits(*(x for _, x in plan.limits))),
        own=knee, ligament=plan.ligament, graft=graft,
        base=np.hstack([*on_bones, np.array(tensions)[:, None]]).ravel(),
        octagon_mm=plan.octagon_apothem_mm, map_points=plan.map.points if plan.map else 0,
        map_half_mm={TIBIA: maps.tibia_half_mm, FEMUR: maps.femur_half_mm},
        free=optimum.free if plan.optimum else (), starts=optimum.starts,
        evaluations=optimum.evaluations or max(planning.MOST_EVALUATIONS, optimum.starts + 1),
        population=plan.front.population if plan.front else 0,
        generations=plan.front.generations if plan.front else planning.GENERATIONS, drawn=drawn,
        held=held, said=document, document=read.document, file=file)


def _tunnels(stated: Any, footprint: Footprint, bundles: int) -> np.ndarray:
    """Where the plan puts the tunnels on a bone, `(bundles, 2)`, mm."""
    halves = np.array_split(footprint.fibres, bundles)
    tunnels = np.array([half.mean(axis=0) for half in halves] if stated is None else stated)
    shown = tunnels.round(1).tolist() if stated is None else [*map(list, stated)]
    bone = footprint.bone
    if footprint.surface is not None:
        off = float(footprint.off_bone(tunnels).max())
        if off > planning.FARTHEST_MM:
            most = f"{planning.FARTHEST_MM:g} mm"
            raise wrong(shown, f"within {most} of the {bone}'s mesh; this is {off:.1f} mm off")
    elif stated is not None and footprint.outside(tunnels).max() > 1.0:
        names = " and ".join(name for name, _ in DIRECTIONS[bone])
        along, across = footprint.semi_axes_mm
        raise wrong(shown, f"on the bone: {names} within an ellipse of {along:g} by {across:g} mm")
    return tunnels


def drawn_parameters(
    calibrated: "files.Calibrated", count: int, seed: int = 0
) -> tuple[list[dict[str, float]], tuple[str, ...]]:
    """Draw parameters from the normal distribution about a fit.

    Args:
        calibrated: values, standard errors and their correlation.
        count: of draws.
        seed: of the random numbers.

    Returns:
        Parameter -> value of each draw; and the parameters without a standard error, which keep
        their values. A draw that no knee can have is drawn anew.

    Example:
        >>> fit = files.Calibrated("k", {}, {"ACL.stiffness": 5000.0}, {}, "", {},
        ...                  {"ACL.stiffness": 100.0})
        >>> draws, held = drawn_parameters(fit, 1000)
        >>> round(float(np.std([x["ACL.stiffness"] for x in draws])), -1), held
        (100.0, ())
    """
    names = [name for name in calibrated.found if name in calibrated.standard_error]
    held = tuple(name for name in calibrated.found if name not in names)
    middle = np.array([calibrated.found[name] for name in names])
    error = np.array([calibrated.standard_error[name] for name in names])
    correlation, (known, matrix) = np.eye(len(names)), calibrated.correlation
    if known and all(name in known for name in names):
        places = [known.index(name) for name in names]
        correlation = np.array(matrix)[np.ix_(places, places)]
        np.fill_diagonal(correlation, 1.0)
    # The smallest eigenvalues of a correlation may have been rounded below zero.
    spread, axes = np.linalg.eigh(0.5 * (correlation + correlation.T))
    root = axes * np.sqrt(np.maximum(spread, 0.0)) * error[:, None]
    ranges = [range_of_parameter(name) for name in names]
    draw, answer = np.random.default_rng(seed), []
    for _ in range(count):
        values = middle
        for _ in range(_TRIES):
            values = middle + root @ draw.standard_normal(len(names))
            if all(one is None or one.holds(x) for one, x in zip(ranges, values, strict=True)):
                break
        else:
            values = np.array([x if one is None else np.clip(x, one.lower, one.upper)
                               for one, x in zip(ranges, values, strict=True)])  # fmt: skip
        answer.append(dict(zip(names, values.tolist(), strict=True)))
    return answer, held
