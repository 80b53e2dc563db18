"""Forces from the ground: which force acts on which body, and their tables."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from kneejax.files.opensim._joints import Movement
from kneejax.files.opensim._model import GROUND, Model
from kneejax.files.opensim._xml import parse_xml
from kneejax.files.reading import InputProblem
from kneejax.files.tables import Storage
from kneejax.files.tables._storage import read_storage

KIND = "external loads of OpenSim (.xml)"
#: Parts of the largest force above which a force's point is looked at: below, points are noise.
_SOME_FORCE = 0.1
#: A heel is no farther than this from the toes on which it presses: a point farther from the body
#: is another foot's, or of an origin elsewhere, m.
_FAR_M = 0.5
#: A point that no body reaches, m.
_NOWHERE_M = 3.0
#: Largest forces and torques of the ground that are taken without a doubt, N and N m.
_LEAST_N, _MOST_N, _MOST_NM = 5.0, 2e4, 300.0


@dataclasses.dataclass(frozen=True)
class ExternalForce:
    """A force of a table on a body."""

    name: str
    body: str  # on which it acts
    force_in: str  # body whose axes the force and the torque are along
    point_in: str  # body in whose frame the point is
    force: tuple[str, ...]  # columns, three; likewise point and torque, or none
    point: tuple[str, ...]
    torque: tuple[str, ...]

    def rows(self, table: Storage) -> tuple[np.ndarray, ...]:
        """Force, point and torque, N, m, N m, `(rows, 3)` each; zeros for those it has not."""
        none = np.zeros((len(table.time), 3))
        return tuple(
            np.stack([table.named(name) for name in names], axis=1) if names else none
            for names in (self.force, self.point, self.torque)
        )


@dataclasses.dataclass(frozen=True)
class ExternalLoads:
    """Forces from the ground over time."""

    table: Storage  # with the columns
    forces: tuple[ExternalForce, ...]  # of the file, those that apply
    doubts: tuple[str, ...]  # what looks wrong in the file, a sentence each


def read_external_loads(
    path: str | os.PathLike[str], model: Model, called: Mapping[str, str] | None = None
) -> ExternalLoads:
    """Read which force acts on which body of a model, and the table that it names, which is sought
    beside the file; `called` says by which names the file has bodies."""
    file, back = parse_xml(path, KIND), {own: name for name, own in (called or {}).items()}
    top = next((e for e in file.root.iter("*") if e.tag == "ExternalLoads"), None)
    if top is None:
        raise file.root.problem("", file.root.tag, f"{KIND}: an element ExternalLoads")
    word = top.word("datafile")
    if not word:
        raise top.problem("datafile", "missing", "the table of forces")
    table, found = read_storage(Path(path).parent / word), []
    for element in top.inside("objects"):
        off = element.word("isDisabled").lower() == "true"
        off = off or element.word("appliesForce").lower() == "false"
        if element.tag != "ExternalForce" or off:
            continue
        bodies, columns = [], []
        for tag, usual in (("applied_to_body", ""), ("force_expressed_in_body", GROUND),
                           ("point_expressed_in_body", GROUND)):
            body = element.last_word(tag) or usual
            bodies.append(model.named(back.get(body, body)))
            if not bodies[-1]:
                word, expected = element.word(tag) or "missing", "a body of the model"
                raise element.problem(tag, word, expected, model.bodies)
        for tag in ("force_identifier", "point_identifier", "torque_identifier"):
            stem = element.word(tag)
            needed = stem or tag == "force_identifier"
            columns.append(tuple(f"{stem}{axis}" for axis in "xyz") if needed else ())
            for name in columns[-1]:
                table.named(name, f"a column of {tag} of {element.name}")
        found.append(ExternalForce(element.name, *bodies, *columns))
    if not found:
        raise top.problem("objects", "none", "at least one ExternalForce")
    return ExternalLoads(table, tuple(found), tuple(_doubts(Path(path).name, found, table)))


def _doubts(file: str, forces: list[ExternalForce], table: Storage) -> Iterator[str]:
    """Torques that look like another force's: another one of the table is called more alike."""
    spins = [name for name in table.columns if "torque" in name.lower() and name[-1:] == "x"]
    for one in forces:
        if not one.torque:
            continue
        # How many letters the two begin with together, but for the word that says which it is.
        likeness = {
            name: len(os.path.commonprefix(
                [name.lower().replace("torque", "force"), one.force[0].lower()]))
            for name in (one.torque[0], *spins)
        }
        nearest = max(likeness, key=lambda name: likeness[name])
        if likeness[nearest] > likeness[one.torque[0]]:
            own = one.torque[0][:-1].rstrip("_")
            yield (
                f"{file}: force {one.name} takes its torque from {own}; "
                f"{nearest[:-1].rstrip('_')} would fit its force."
            )


def on_bodies(
    loads: ExternalLoads, movement: Movement, bodies: set[str], time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment of the ground on some bodies of a model that moves, at times `(n,)`, s.

    In the ground's axes and about its origin, `(n, 3)` each, N and N m. Between rows both are
    straight: forces jump where a foot meets the ground.
    """
    force, moment = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    inside = loads.table.time
    for one in loads.forces:
        if one.body not in bodies:
            continue
        pull, point, torque = one.rows(loads.table)
        if one.force_in == one.point_in == GROUND:
            # Forces and moments are taken between rows, not points: one without force jumps.
            here = _between(time, inside, pull)
            spin = _between(time, inside, torque + np.cross(point, pull))
        else:
            carrier, frame = movement.placed[one.force_in], movement.placed[one.point_in]
            turn = np.asarray(carrier.turn)
            here, spin = (np.einsum("nij,nj->ni", turn, _between(time, inside, x))
                          for x in (pull, torque))
            spin = spin + np.cross(frame.point(_between(time, inside, point)), here)
        force, moment = force + here, moment + spin
    return force, moment


def place_doubts(
    loads: ExternalLoads, movement: Movement, bodies: set[str], time: np.ndarray
) -> Iterator[str]:
    """Sentences on forces that cannot be those of the body that they are said to act on: their size
    or torque is no person's, or their point lies farther from the body than a foot is long. Raises
    where it is so far away that it must be in another unit."""
    file, inside = Path(loads.table.file).name, loads.table.time
    for one in loads.forces:
        if one.body not in bodies:
            continue
        largest = np.linalg.norm(one.rows(loads.table)[0], axis=1).max()
        pull, point, torque = (_between(time, inside, x) for x in one.rows(loads.table))
        size, spin = np.linalg.norm(pull, axis=1), np.linalg.norm(torque, axis=1).max()
        name = f"{file}: force {one.name} on {one.body}"
        if 0.0 < largest < _LEAST_N:
            yield f"{name} is at most {largest:.3g} N: kN or body weights are suspected."
        if largest > _MOST_N:
            yield f"{name} is up to {largest:,.0f} N: more than a person presses with."
        if spin > _MOST_NM:
            yield f"{name} turns by up to {spin:,.0f} N m: N mm are suspected."
        if not one.point or not size.any():
            continue
        reach = _reach(movement, one.body, movement.placed[one.point_in].point(point))
        reach = np.where(size > _SOME_FORCE * size.max(), reach, 0.0)
        row = int(np.argmax(reach))
        if reach[row] > _NOWHERE_M:
            shown = ", ".join(f"{x:g}" for x in point[row])
            suspected = "; mm are suspected" if np.abs(point[row]).max() > 10.0 else ""
            raise InputProblem(
                loads.table.file, ", ".join(one.point), f"({shown}) at {time[row]:g} s",
                f"a point of {one.body} in m, which is {reach[row]:,.1f} m away{suspected}",
            )
        if reach[row] > _FAR_M:
            yield (
                f"{name} acts {reach[row]:.2f} m away from it at {time[row]:g} s, farther than a "
                "foot is long: another foot's plate, or an origin that is not the model's?"
            )


def _reach(movement: Movement, body: str, point: np.ndarray) -> np.ndarray:
    """How far points of the ground, `(n, 3)`, are from what a model has on a body: its origin, its
    center of mass and its joints; m, `(n,)`."""
    model, here = movement.model, movement.placed[body]
    marks = [np.zeros(3), np.array(model.bodies[body].point("mass_center"), float)]
    marks += [np.array(frame.shift, float) for joint in movement.joints
              if GROUND not in (joint.parent, joint.child)
              for end, frame in joint.ends if end == body]
    return np.min([np.linalg.norm(point - here.point(np.broadcast_to(mark, point.shape)), axis=1)
                   for mark in marks], axis=0)


def of_contacts(
    model: Model, table: Storage, bodies: set[str], time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment of the ground on some bodies, by the contacts of the model itself.

    As `on_bodies`, from a table of forces in which OpenSim records each contact with the bodies
    that it acts on: the opposite of what the ground bears.
    """
    carriers = {e.name: e.last_word("socket_frame") for e in model.elements
                if e.tag.startswith("Contact") and e.child("socket_frame") is not None}
    force, moment = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    for element in model.elements:
        names = [f"{element.name}.ground.{kind}.{axis}" for kind in ("force", "torque")
                 for axis in "XYZ"]
        words = {w for e in element.iter("geometry") for w in e.content.split()}
        if names[0] in table.columns and {carriers.get(word, "") for word in words} & bodies:
            both = -table.at(time, names, degree=1).T
            force, moment = force + both[:, :3], moment + both[:, 3:]
    return force, moment


def _between(time: np.ndarray, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(time, rows, x) for x in values.T], axis=1)
