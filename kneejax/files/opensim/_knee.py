"""Which bodies of an OpenSim model are the femur and the tibia: found from its joints."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from kneejax.files.opensim._joints import Joint, read_joints
from kneejax.files.opensim._model import GROUND, Model, Offset
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, PATELLA, TIBIA, angles_from_rotation

SIDES = {"r": "right", "l": "left"}
_MARKS = {
    "r": re.compile(r"(?:^|[^a-z])r(?:$|[^a-z])|right", re.IGNORECASE),
    "l": re.compile(r"(?:^|[^a-z])l(?:$|[^a-z])|left", re.IGNORECASE),
}
_CAMEL = {"r": re.compile(r"[a-z0-9]R$"), "l": re.compile(r"[a-z0-9]L$")}
_KNEE = re.compile(r"knee|tibiofemoral|femorotibial|(?:^|[^a-z])tf(?:$|[^a-z])", re.IGNORECASE)
_OTHER = re.compile(r"patell|menisc|(?:^|[^a-z])(?:pf|pat)(?:$|[^a-z])", re.IGNORECASE)
_PATELLA = re.compile(r"patell|kneecap", re.IGNORECASE)
_FEMUR = re.compile(r"femur|femor|thigh", re.IGNORECASE)
_TIBIA = re.compile(r"tibia|shank|shin|lower_?leg|crus", re.IGNORECASE)
_FOOT = re.compile(r"foot|calcn|calcan|talus|toes", re.IGNORECASE)
_ABOVE = re.compile(r"pelvis|hips?(?:$|[^a-z])|sacrum|torso", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class OsimKneeJoint:
    """The knee of a model.

    Attributes:
        side: `r` or `l`.
        femur: body whose frame is the femur's.
        tibia: likewise.
        joints: between them, from the femur to the tibia.
        rigid: body -> (`femur`, `tibia` or `patella`, the motion from the body's to that bone's
            coordinates), for the bones and what does not move against them.
        pose: table row of the tibia in the femur at the coordinates' defaults, in the order of
            `kneejax.geometry.COLUMNS`, by clinical meaning.
        tibia_in_femur: the same as a motion, in the model's own axes.
        findings: what was taken as what.
        doubts: what a person should look at.
        patella: its body; empty without one.
        patella_pose: as `pose`.
        patella_in_femur: as `tibia_in_femur`.
        turned: whether the bones' axes are others than those of their bodies.
        unusual: what was taken otherwise than in most models, a sentence each.
    """

    side: str
    femur: str
    tibia: str
    joints: tuple[Joint, ...]
    rigid: dict[str, tuple[str, Offset]]
    pose: tuple[float, ...]
    tibia_in_femur: Offset
    findings: tuple[str, ...]
    doubts: tuple[str, ...]
    patella: str = ""
    patella_pose: tuple[float, ...] = ()
    patella_in_femur: Offset = dataclasses.field(default_factory=Offset)
    turned: bool = False
    unusual: tuple[str, ...] = ()

    def placed_as(
        self, tibia_in_femur: Offset, patella: str = "", patella_in_femur: Offset | None = None
    ) -> OsimKneeJoint:
        """The same bones with the poses of tibia and patella, which are motions to the femur."""
        there = Offset() if patella_in_femur is None else patella_in_femur
        return dataclasses.replace(
            self,
            pose=_pose(tibia_in_femur, self.side),
            tibia_in_femur=tibia_in_femur,
            patella=patella,
            patella_pose=_pose(there, self.side) if patella else (),
            patella_in_femur=there,
        )

    @property
    def in_femur(self) -> dict[str, Offset]:
        """Bone -> the motion from its coordinates to the femur's at the coordinates' defaults."""
        return {
            FEMUR: Offset(), PATELLA: self.patella_in_femur, TIBIA: self.tibia_in_femur,
        }  # fmt: skip


def find_knee(
    model: Model,
    side: str,
    femur: str | None = None,
    tibia: str | None = None,
    *,
    may_be_named: bool = False,
) -> OsimKneeJoint:
    """Find the knee of a side.

    It is the joint (or the joints in a row) whose names speak of a knee of that side, and of these
    the one whose child carries the foot.

    Args:
        model: the model.
        side: `r` or `l`.
        femur: the femur's body; with `tibia`, nothing is guessed.
        tibia: likewise.
        may_be_named: whether a person could say these, and is told how where no knee is found.

    Returns:
        The bones, what is rigidly joined to each, and the reference pose.

    Raises:
        InputProblem: the model has no such knee, several, or not those bodies.
    """
    joints = read_joints(model)
    above = {joint.child: joint for joint in joints}
    findings: list[str] = []
    turned: list[str] = []
    unusual: tuple[str, ...] = ()
    if (femur is None) != (tibia is None):
        given = "--femur" if femur is not None else "--tibia"
        raise InputProblem(model.file.path, given, femur or tibia, "--femur and --tibia together")
    if femur is not None and tibia is not None:
        femur, tibia = _body(model, "--femur", femur), _body(model, "--tibia", tibia)
        found = _between(above, femur, tibia)
        turned = _exchanged(joints, found, femur, tibia)
    else:
        found = _guess(model, joints, above, side, findings, may_be_named)
        femur, tibia = found[0].parent, found[-1].child
        if _carries_upwards(joints, found, femur, tibia):
            femur, tibia, found = tibia, femur, found[::-1]
            unusual = (f"{tibia} carries {femur} in this model, as their names say.",)
    findings += [f"{femur} was taken as the femur.", f"{tibia} was taken as the tibia."]
    names = ", ".join(f"{joint.name} ({joint.kind})" for joint in found)
    findings.append(f"Joint between them: {names}.")
    doubts: list[str] = []
    rigid = _rigid_with_bones(model, joints, (femur, tibia), found, findings)
    from_femur = placed(model, above, femur).inverse()
    there = from_femur.after(placed(model, above, tibia))
    patellae = _patellae(joints, rigid)
    patella = patellae[0] if len(patellae) == 1 else ""
    if patella:
        findings.append(f"{patella} was taken as the patella.")
        rigid |= {body: (PATELLA, at) for body, at, _ in _rigid(model, joints, patella, [])}
    elif patellae:
        doubts.append(f"{len(patellae)} bodies may be the patella: {', '.join(patellae)}.")
    doubts += turned + [
        f"Coordinate {c.name} is prescribed by a function of time: the reference pose takes its "
        "value at 0 s."
        for joint in found for c in joint.coordinates if c.prescribed
    ]  # fmt: skip
    knee = OsimKneeJoint(
        side, femur, tibia, tuple(found), rigid, (), there, tuple(findings), tuple(doubts),
        unusual=unusual,
    )  # fmt: skip
    in_femur = from_femur.after(placed(model, above, patella)) if patella else None
    return knee.placed_as(there, patella, in_femur)


def _rigid_with_bones(
    model: Model,
    joints: list[Joint],
    bodies: tuple[str, str],
    found: list[Joint],
    findings: list[str],
) -> dict[str, tuple[str, Offset]]:
    """Body -> femur or tibia, against which it does not move, and where it is in it."""
    rigid: dict[str, tuple[str, Offset]] = {}
    for bone, body in zip(("femur", "tibia"), bodies, strict=True):
        for other, offset, through in _rigid(model, joints, body, found):
            if other in rigid:
                at = f"{rigid[other][0]} and {bone}"
                raise InputProblem(
                    model.file.path, f"body {other}", at, "bones that are not one rigid body"
                )
            rigid[other] = bone, offset
            if other != body:
                findings.append(f"{other} does not move against the {bone} ({through}).")
    return rigid


def _patellae(joints: list[Joint], rigid: dict) -> list[str]:
    """Bodies called so that a joint joins to the knee's bones."""
    return [
        joint.child
        for joint in joints
        if joint.coordinates and joint.parent in rigid and _PATELLA.search(joint.child)
    ]


def _guess(
    model: Model,
    joints: list[Joint],
    above: dict[str, Joint],
    side: str,
    findings: list[str],
    may_be_named: bool,
) -> list[Joint]:
    moving = [joint for joint in joints if joint.coordinates]
    candidates = [j for j in moving if _KNEE.search(_words(j)) and not _OTHER.search(_words(j))]
    if not candidates:
        candidates = [
            joint
            for joint in moving
            if any(_FEMUR.search(n) for n in _row(joints, joint.parent, joint))
            and any(_TIBIA.search(n) for n in _row(joints, joint.child, joint))
        ]
    marked = {s: [j for j in candidates if _side(j) == s] for s in SIDES}
    if marked["r"] or marked["l"]:
        if not marked[side]:
            other = "l" if side == "r" else "r"
            names = ", ".join(joint.name for joint in marked[other])
            expected = f"a side the model has a knee of: {other} ({names})"
            expected += "; or give --femur and --tibia" if may_be_named else ""
            raise InputProblem(model.file.path, "--side", side, expected)
        candidates = marked[side]
    elif candidates:
        findings.append(
            f"No name says which side the knee is of; it was taken as {SIDES[side]}, as asked."
        )
    carrying = [j for j in candidates if any(k.parent == j.child for k in joints)]
    candidates = carrying if len(candidates) > 1 and carrying else candidates
    row = _in_a_row(candidates, above)
    if row:
        return row
    shown = candidates or moving
    names = "; ".join(f"{j.name}: {j.parent} to {j.child}" for j in shown[:12]) or "no joint"
    many = f"{len(candidates)} joints that may be the knee" if candidates else "no joint of a knee"
    say = "; say which bodies with --femur BODY --tibia BODY" if may_be_named else ""
    raise InputProblem(model.file.path, "knee joint", many, f"one{say} ({names})")


def _words(joint: Joint) -> str:
    return " ".join((joint.name, joint.child, *(c.name for c in joint.coordinates)))


def _side(joint: Joint) -> str:
    """The side that a joint's names speak of; empty if none or both."""
    words = (joint.name, joint.parent, joint.child, *(c.name for c in joint.coordinates))
    said = {s for s in SIDES if any(_MARKS[s].search(w) or _CAMEL[s].search(w) for w in words)}
    return said.pop() if len(said) == 1 else ""


def _in_a_row(candidates: list[Joint], above: dict[str, Joint]) -> list[Joint]:
    """The candidates from the uppermost to the lowest, with what is between; else nothing."""
    for last in candidates:
        row, seen = [last], {last.child}
        while row[0].parent in above and row[0].parent not in seen:
            if all(any(j is c for j in row) for c in candidates):
                break
            seen.add(row[0].parent)
            row.insert(0, above[row[0].parent])
        if all(any(j is c for j in row) for c in candidates):
            return row
    return []


def _between(above: dict[str, Joint], femur: str, tibia: str) -> list[Joint]:
    """Joints of the way from one body to the other."""

    def way(body: str) -> list[Joint]:
        answer: list[Joint] = []
        while body in above and above[body] not in answer:
            answer.append(above[body])
            body = above[body].parent
        return answer

    up, down = way(femur), way(tibia)
    shared = [joint for joint in up if joint in down]
    joints = [j for j in up if j not in shared] + [j for j in reversed(down) if j not in shared]
    # Welds within the way belong to a bone; so do locked joints unless nothing else is left.
    return [j for j in joints if not j.fixed] or [j for j in joints if j.coordinates] or joints


def _carries_upwards(joints: list[Joint], knee: list[Joint], upper: str, lower: str) -> bool:
    """Whether the body above a knee's joints is the tibia, as in a model that stands on its foot.

    The names of the two bodies decide, or what hangs on each.
    """
    votes = 0
    for body, sign in ((upper, 1), (lower, -1)):
        row = _row(joints, body, knee[0])
        whole = beyond(joints, knee, body)
        for names, parts in ((row, (_TIBIA, _FEMUR)), (whole, (_FOOT, _ABOVE))):
            down, up = (any(part.search(name) for name in names) for part in parts)
            if down != up:
                votes += sign * (1 if down else -1) * (3 if names is row else 1)
    return votes > 0


def beyond(joints: list[Joint], cut: list[Joint], body: str) -> set[str]:
    """A body and all that hangs together with it without some joints and without the ground."""
    names, grows = {body}, True
    while grows:
        before = len(names)
        for joint in joints:
            both = {joint.parent, joint.child}
            if names & both and GROUND not in both and not any(joint is one for one in cut):
                names |= both
        grows = len(names) > before
    return names


def _exchanged(joints: list[Joint], knee: list[Joint], femur: str, tibia: str) -> list[str]:
    """Whether the bodies that were given look like each other's."""
    above, body, seen = {joint.child: joint for joint in joints}, femur, {femur}
    while body in above and above[body].parent not in seen:
        body = above[body].parent
        seen.add(body)
    carried = tibia in seen and tibia != femur
    if not _carries_upwards(joints, knee, femur, tibia) and not (
        carried and not _carries_upwards(joints, knee, tibia, femur)
    ):
        return []
    return [
        f"{femur} was given as the femur and {tibia} as the tibia; their names or the model's "
        "joints say otherwise: have --femur and --tibia changed places?"
    ]


def _row(joints: list[Joint], body: str, knee: Joint) -> set[str]:
    """A body and those welded to it."""
    names, grows = {body}, True
    while grows:
        before = len(names)
        for joint in joints:
            if joint is not knee and joint.fixed and names & {joint.parent, joint.child}:
                names |= {joint.parent, joint.child}
        grows = len(names) > before
    return names - {GROUND}


def _rigid(model: Model, joints: list[Joint], bone: str, knee: list[Joint]):
    """Bodies that do not move against a bone: name, motion to the bone's coordinates, why."""
    found, waiting = {bone}, [(bone, Offset(), "")]
    while waiting:
        body, offset, through = waiting.pop(0)
        yield body, offset, through
        for joint in joints:
            moves = not joint.fixed or any(joint is other for other in knee)
            if moves or GROUND in (joint.parent, joint.child):
                continue
            why = f"{joint.kind} {joint.name}" + (", locked" if joint.coordinates else "")
            if joint.parent == body and joint.child not in found:
                found.add(joint.child)
                waiting.append((joint.child, offset.after(joint.placement(model)), why))
            if joint.child == body and joint.parent not in found:
                found.add(joint.parent)
                back = joint.placement(model).inverse()
                waiting.append((joint.parent, offset.after(back), why))


def placed(model: Model, above: dict[str, Joint], body: str) -> Offset:
    """The motion from a body's coordinates to the uppermost body's above it."""
    motion, seen = Offset(), set()
    while body in above and body not in seen:
        seen.add(body)
        motion = above[body].placement(model).after(motion)
        body = above[body].parent
    return motion


def _pose(tibia_in_femur: Offset, side: str) -> tuple[float, ...]:
    rotation = tibia_in_femur.matrix
    shift = np.array(tibia_in_femur.translation, float) * 1e3
    if side == "l":  # clinical meaning is that of the mirrored right knee
        mirror = np.diag([1.0, 1.0, -1.0])
        rotation, shift = mirror @ rotation @ mirror, mirror @ shift
    angles = [float(a) for a in angles_from_rotation(rotation)]
    return tuple(float(x) + 0.0 for x in (*np.rad2deg(angles), *shift))


def is_between(joint: Joint) -> bool:
    """Whether a joint carries what is part of neither bone: a meniscus or a patella, by name."""
    return bool(re.search("menisc|patell|kneecap", f"{joint.name} {joint.child}", re.IGNORECASE))


def _body(model: Model, option: str, name: str) -> str:
    found = model.named(name)
    if not found or found == GROUND:
        known = [body for body in model.bodies if body != GROUND]
        listed = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
        raise InputProblem(model.file.path, option, name, f"a body of the model: {listed}", known)
    return found
