"""A planned reconstruction from its file: checked whole before a knee moves."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files import (
    Calibrated,
    KneeFile,
    bone_surface,
    knee_with,
    load_knee_file,
    named_document,
    parse_flexion,
    read_calibrated,
)
from kneejax.files.reading import Field
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import RANGES, Knee, Range, range_of_parameter
from kneejax.parameters import UnknownParameter, fibre_rows
from kneejax.planning import (
    DIRECTIONS,
    FARTHEST_MM,
    FREE,
    GENERATIONS,
    GRAFTS,
    MOST_EVALUATIONS,
    POPULATION,
    SEMI_AXES_MM,
    STARTS,
    WINDOW,
    AclPlan,
    Footprint,
    GraftType,
    Limits,
    Protocol,
    Reconstruction,
    Surgery,
    footprint_of,
    reconstruction_of,
)
from kneejax.studies._checked import Mistakes, by_parameter

_REQUIRED = ("title", "knee", "graft")
_OPTIONAL = (
    "set", "ligament", "fixation", "tunnels", "footprints", "bones", "flexion_deg", "lachman",
    "window", "limits", "octagon_apothem_mm", "map", "optimum", "front", "draws",
)  # fmt: skip
_BONES = (TIBIA, FEMUR)
_TENSION = Range(1.0, 1000.0, "N", too_small="a graft that is not pulled has no zero-load length")
_PLACE, _HALF, _BAND = Range(-30.0, 30.0, "mm"), Range(1.0, 30.0, "mm"), Range(0.05, 20.0, "mm")
_FORCE, _GRAFT = Range(10.0, 300.0, "N"), Range(10.0, 5000.0, "N")
_USUAL: dict[str, Any] = {
    "flexion_deg": "80:0:-2.5",
    "fixation_deg": 20.0,
    "tension_N": 80.0,
    "lachman_deg": (20.0, 90.0),
    "force_N": 100.0,
    "graft_N": 400.0,
    "laxity_band_mm": 2.0,
    "tension_range_N": (20.0, 150.0),
}
#: Tries for each draw before the nearest possible value is taken.
_TRIES = 100
#: Steps in which the force of a Lachman test grows; a path divides those that are too long.
_STEPS = 1


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
            unknown or out of range; or the knee's file has no patella and one is asked for.
        UnknownParameter: a parameter that the knee does not have.

    Example:
        >>> plan = read_plan("ten_bundle")
        >>> plan.graft.name, plan.surgery.plan.torn
        ('hamstring', ('aACL', 'pACL'))
    """
    return plan_of(*named_document("plans", name_or_path), patella=patella)


def plan_of(plan: Field, folder: Path = Path(), *, patella: bool = False) -> AclPlan:
    """Make a plan of what a file says.

    Args:
        plan: everything that the file says.
        folder: to which paths in it are relative.
        patella: as in `read_plan`.
    """
    plan.mapping(_REQUIRED, _OPTIONAL)
    read, path = _read_knee(plan, folder)
    knee, drawn, held = _knee(plan, read.with_patella() if patella else read.knee, path)
    ligament = _ligament(plan, knee)
    graft, stiffness, bundles = _graft(plan["graft"])
    reconstruction = reconstruction_of(knee, ligament, bundles, stiffness, graft.failure_N)
    fixation_deg, tension = _fixation(plan, bundles, graft)
    tibia, femur = (_footprint(plan, knee, ligament, bone, folder) for bone in _BONES)
    surgery = Surgery(
        reconstruction, tibia, femur, _replaced(reconstruction), fixation_deg, _protocol(plan),
        plan["window"].integer(0, 1000) if "window" in plan else WINDOW, _limits(plan, graft),
    )  # fmt: skip
    base = np.hstack([_tunnels(plan, tibia, bundles), _tunnels(plan, femur, bundles),
                      np.array(tension)[:, None]]).ravel()  # fmt: skip
    free, starts, most = _optimum(plan)
    population, generations = _front(plan, free)
    points, halves = _map(plan)
    return AclPlan(
        title=plan["title"].text(),
        surgery=surgery,
        own=knee,
        ligament=ligament,
        graft=graft,
        base=base,
        octagon_mm=_octagon(plan),
        map_points=points,
        map_half_mm=halves,
        free=free,
        starts=starts,
        evaluations=most,
        population=population,
        generations=generations,
        drawn=drawn,
        held=held,
        said=plan.value,
        document=read.document,
        file=plan.file,
    )


def _read_knee(plan: Field, folder: Path) -> tuple[KneeFile, Path]:
    """The knee as its file has it, and where that is."""
    name = plan["knee"].text()
    path = folder / name if os.path.isfile(folder / name) else Path(name)
    return load_knee_file(path if os.path.isfile(path) else name), path


def _knee(plan: Field, read: Knee, path: Path) -> tuple[Knee, tuple[Knee, ...], tuple[str, ...]]:
    """The knee; those drawn from its calibration; parameters that no draw changes."""
    own, mistakes = {}, Mistakes(plan.file)
    with mistakes.gathered("set"):
        own = by_parameter(Field.number)(plan["set"].value) if "set" in plan else {}
    mistakes.check()
    knee = knee_with(read, own, plan.file)
    if "draws" not in plan:
        return knee, (), ()
    count = plan["draws"].integer(2, 4096)
    if path.suffix.lower() != ".json":
        name = plan["knee"].text()
        expected = f"no draws of {name}: a knee that is the result.json of a calibration has them"
        raise plan["draws"].problem(expected)
    values, held = drawn_parameters(read_calibrated(path).of_structures(read), count)
    knees = tuple(knee_with(knee, one | own, plan.file) for one in values)
    return knee, knees, held


def _ligament(plan: Field, knee: Knee) -> str:
    name = plan["ligament"].text() if "ligament" in plan else "ACL"
    try:
        fibre_rows(knee, name)
    except UnknownParameter as problem:
        raise UnknownParameter(f"{plan.file}: ligament: {problem}") from None
    return name


def _graft(field: Field) -> tuple[GraftType, float, int]:
    field.mapping(("type",), ("bundles", "stiffness_N"))
    graft = GRAFTS[field["type"].choice(GRAFTS)]
    stiffness = graft.stiffness_N
    if "stiffness_N" in field:
        stiffness = field["stiffness_N"].number(RANGES["stiffness_N"])
    return graft, stiffness, field["bundles"].integer(1, 2) if "bundles" in field else 1


def _fixation(plan: Field, bundles: int, graft: GraftType) -> tuple[float, list[float]]:
    flexion, tension = _USUAL["fixation_deg"], [_USUAL["tension_N"]] * bundles
    if "fixation" in plan:
        field = plan["fixation"].mapping((), ("flexion_deg", "tension_N"))
        if "flexion_deg" in field:
            flexion = field["flexion_deg"].number(RANGES["flexion_deg"])
        if "tension_N" in field:
            own = field["tension_N"]
            several = isinstance(own.value, list)
            one = [] if several else [own.number(_TENSION)]
            tension = list(own.numbers(bundles, _TENSION)) if several else one * bundles
            fails = graft.failure_N / bundles
            if max(tension) >= fails:
                raise own.problem(f"less than the {fails:g} N at which a bundle fails")
    return flexion, tension


def _footprint(plan: Field, knee: Knee, ligament: str, bone: str, folder: Path) -> Footprint:
    semi, surface = SEMI_AXES_MM[bone], None
    if "footprints" in plan:
        field = plan["footprints"].mapping((), [f"{one}_mm" for one in _BONES])
        if f"{bone}_mm" in field:
            first, second = field[f"{bone}_mm"].numbers(2, _HALF)
            semi = first, second
    if "bones" in plan:
        field = plan["bones"].mapping((), _BONES)
        if bone in field:
            path = folder / field[bone].text()
            if not os.path.isfile(path):
                raise field[bone].problem(f"a mesh of the {bone}; not at {path}")
            surface = bone_surface(path)
    return footprint_of(knee, ligament, bone, semi, surface)


def _tunnels(plan: Field, footprint: Footprint, bundles: int) -> np.ndarray:
    """Where the plan puts the tunnels on a bone, `(bundles, 2)`, mm."""
    place, bone = f"{footprint.bone}_mm", footprint.bone
    halves = np.array_split(footprint.fibres, bundles)
    tunnels = np.array([half.mean(axis=0) for half in halves])
    own = None
    if "tunnels" in plan:
        field = plan["tunnels"].mapping((), [f"{one}_mm" for one in _BONES])
        if place in field:
            own = field[place]
            each = own.items("tunnels, two numbers each", bundles)
            tunnels = np.array([item.numbers(2, _PLACE) for item in each])
    said = own or Field(plan.file, f"tunnels.{place}", tunnels.round(1).tolist())
    names = " and ".join(name for name, _ in DIRECTIONS[bone])
    if footprint.surface is not None:
        off = float(footprint.off_bone(tunnels).max())
        if off > FARTHEST_MM:
            expected = f"within {FARTHEST_MM:g} mm of the {bone}'s mesh; this is {off:.1f} mm off"
            raise said.problem(expected)
    elif own is not None and footprint.outside(tunnels).max() > 1.0:
        along, across = footprint.semi_axes_mm
        expected = f"on the bone: {names} within an ellipse of {along:g} by {across:g} mm"
        raise said.problem(expected)
    return tunnels


def _replaced(plan: Reconstruction) -> tuple[tuple[str, ...], ...]:
    """The torn fibres that each bundle stands for, in their order."""
    halves = np.array_split(np.arange(len(plan.torn)), len(plan.bundles))
    if any(not len(half) for half in halves):
        return (plan.torn,) * len(plan.bundles)
    return tuple(tuple(plan.torn[k] for k in half) for half in halves)


def _protocol(plan: Field) -> Protocol:
    angles, tests = parse_flexion(_USUAL["flexion_deg"]), _USUAL["lachman_deg"]
    force = _USUAL["force_N"]
    if "flexion_deg" in plan:
        angles = parse_flexion(plan["flexion_deg"].text(), plan.file, "flexion_deg")
    if len(angles) < 2:
        raise plan["flexion_deg"].problem("at least two angles")
    if "lachman" in plan:
        field = plan["lachman"].mapping((), ("flexion_deg", "force_N"))
        if "flexion_deg" in field:
            tests = field["flexion_deg"].numbers(None, RANGES["flexion_deg"])
        if "force_N" in field:
            force = field["force_N"].number(_FORCE)
    return Protocol(angles, tests, force, _STEPS)


def _limits(plan: Field, graft: GraftType) -> Limits:
    limits = [_USUAL["graft_N"], _USUAL["laxity_band_mm"], _USUAL["tension_range_N"]]
    if "limits" in plan:
        field = plan["limits"].mapping((), ("graft_N", "laxity_band_mm", "tension_N"))
        if "graft_N" in field:
            limits[0] = field["graft_N"].number(_GRAFT)
            if limits[0] > graft.failure_N:
                fails = f"at most the {graft.failure_N:g} N at which it fails"
                raise field["graft_N"].problem(fails)
        if "laxity_band_mm" in field:
            limits[1] = field["laxity_band_mm"].number(_BAND)
        if "tension_N" in field:
            limits[2] = field["tension_N"].interval(_TENSION)
    return Limits(*limits)


def _octagon(plan: Field) -> float:
    name = "octagon_apothem_mm"
    return plan[name].number(_HALF) if name in plan else 10.0


def _optimum(plan: Field) -> tuple[tuple[str, ...], int, int]:
    if "optimum" not in plan:
        return tuple(FREE), STARTS, MOST_EVALUATIONS
    if plan["optimum"].value is False:
        return (), STARTS, MOST_EVALUATIONS
    field = plan["optimum"].mapping((), ("free", "starts", "evaluations"))
    free = tuple(FREE)
    if "free" in field:
        free = tuple(item.choice(FREE) for item in field["free"].items("names"))
    starts = field["starts"].integer(1, 64) if "starts" in field else STARTS
    most = field["evaluations"].integer(starts + 1, 10_000) if "evaluations" in field else None
    return free, starts, most or max(MOST_EVALUATIONS, starts + 1)


def _front(plan: Field, free: tuple[str, ...]) -> tuple[int, int]:
    if "front" not in plan or plan["front"].value is False:
        return 0, GENERATIONS
    if not free:
        raise plan["front"].problem("an optimum that says what is free")
    if plan["front"].value is True:
        return POPULATION, GENERATIONS
    field = plan["front"].mapping((), ("population", "generations"))
    return (
        field["population"].integer(8, 1024) if "population" in field else POPULATION,
        field["generations"].integer(1, 1000) if "generations" in field else GENERATIONS,
    )


def _map(plan: Field) -> tuple[int, dict[str, float]]:
    points, halves = 41, {TIBIA: 11.0, FEMUR: 8.0}
    if "map" not in plan:
        return points, halves
    if plan["map"].value is False:
        return 0, halves
    field = plan["map"].mapping((), ("points", *(f"{bone}_half_mm" for bone in _BONES)))
    if "points" in field:
        points = field["points"].integer(3, 401)
    for bone in _BONES:
        if f"{bone}_half_mm" in field:
            halves[bone] = field[f"{bone}_half_mm"].number(_HALF)
    return points, halves


def drawn_parameters(
    calibrated: Calibrated, count: int, seed: int = 0
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
        >>> fit = Calibrated("k", {}, {"ACL.stiffness": 5000.0}, {}, "", {},
        ...                  {"ACL.stiffness": 100.0})
        >>> draws, held = drawn_parameters(fit, 1000)
        >>> round(float(np.std([x["ACL.stiffness"] for x in draws])), -1), held
        (100.0, ())
    """
    names = [name for name in calibrated.found if name in calibrated.standard_error]
    held = tuple(name for name in calibrated.found if name not in names)
    middle = np.array([calibrated.found[name] for name in names])
    error = np.array([calibrated.standard_error[name] for name in names])
    root = _root(_correlation(calibrated, names)) * error[:, None] if names else np.zeros((0, 0))
    ranges = [range_of_parameter(name) for name in names]
    draw, answer = np.random.default_rng(seed), []
    for _ in range(count):
        values = middle
        for _ in range(_TRIES):
            values = middle + root @ draw.standard_normal(len(names))
            if all(one is None or one.holds(x) for one, x in zip(ranges, values, strict=True)):
                break
        else:
            values = np.array([
                x if one is None else np.clip(x, one.lower, one.upper)
                for one, x in zip(ranges, values, strict=True)
            ])  # fmt: skip
        answer.append(dict(zip(names, values.tolist(), strict=True)))
    return answer, held


def _correlation(calibrated: Calibrated, names: list[str]) -> np.ndarray:
    known, matrix = calibrated.correlation
    if not known or any(name not in known for name in names):
        return np.eye(len(names))
    rows = [known.index(name) for name in names]
    found = np.array(matrix)[np.ix_(rows, rows)]
    np.fill_diagonal(found, 1.0)
    return 0.5 * (found + found.T)


def _root(matrix: np.ndarray) -> np.ndarray:
    """A root of a correlation, whose smallest values may have been rounded below zero."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0))
