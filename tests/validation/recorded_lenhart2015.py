"""What OpenSim JAM recorded on lenhart2015, and a knee held against it pose by pose.

Read by the tests beside this file and by `docs/make_lenhart2015_validation.py`.
"""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from kneejax import Knee, Mechanics, Pose

DATA = Path(__file__).parents[2] / "../shared/data/lenhart2015"
#: Instants before this one, s, still settle from the start of the recorded simulation.
SETTLED_S = 0.5
#: Largest errors of fibres that have no obstacle, and of those that have one.
LENGTH_MM, FORCE_N = 1e-3, 0.01
WRAPPED_LENGTH_MM, WRAPPED_FORCE_SHARE, WRAPPED_FORCE_N = 0.1, 0.02, 0.5
#: Largest errors of contact: shares of what was recorded, and mm for the centre of pressure.
CONTACT_CRITERIA = {"force": 0.10, "area": 0.10, "max_pressure": 0.15, "center": 1.0}
_AXES = "xyz"


@dataclasses.dataclass(frozen=True)
class Record:
    """The recorded passive flexion; instants are the rows of every array.

    Attributes:
        time: s, `(n,)`.
        table: flexion, adduction, internal rotation (degrees), anterior, superior, lateral (mm).
        patella: flexion, rotation, tilt (degrees) and translation (mm) of the patella in the femur.
        force: of contact on the tibia in tibia axes, N, `(n, 3)`.
        moment: likewise about the tibia's origin, N mm. (The record's sign is that of the moment
            on the femur; here it is turned.)
        area: mm^2, `(n,)`.
        max_pressure: MPa, `(n,)`.
        center: of pressure, tibia frame, mm, `(n, 3)`.
        fibres: name -> row of `table` -> length (mm) and spring force (N).
        points: name -> bodies, ends (mm, each in its body), stiffness (N), slack length (mm) and
            transition strain of the fibre.
    """

    time: np.ndarray
    table: np.ndarray
    patella: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    area: np.ndarray
    max_pressure: np.ndarray
    center: np.ndarray
    fibres: dict[str, dict[int, tuple[float, float]]]
    points: dict[str, dict]

    @property
    def flexion(self) -> np.ndarray:
        """Degrees."""
        return self.table[:, 0]

    def poses(self, rows=slice(None)) -> Pose:
        """Recorded poses."""
        return Pose.from_table(self.table[rows])

    def rows_with(self, names) -> list[int]:
        """Rows at which all these fibres were recorded."""
        return sorted(set.intersection(*(set(self.fibres[name]) for name in names)))


def read_record(folder: Path = DATA) -> Record:
    """Read the folder `lenhart2015`; what was recorded before 0.5 s is left out."""
    recorded = folder / "recorded"
    pose = _columns(recorded / "jam_passive_flexion_kinematics.csv")
    contact = _columns(recorded / "jam_passive_flexion_tf_contact.csv")
    kept = pose["time"] >= SETTLED_S - 1e-9
    time = pose["time"][kept]
    names = ["flex_r_deg", "add_r_deg", "rot_r_deg", *(f"t{a}_r_mm" for a in _AXES)]
    patella = ["flex_r_deg", "rot_r_deg", "tilt_r_deg", *(f"t{a}_r_mm" for a in _AXES)]

    def vectors(name: str, factor: float) -> np.ndarray:
        return factor * np.stack([contact[f"{name}_{a}"][kept] for a in _AXES], axis=1)

    fibres: dict[str, dict[int, tuple[float, float]]] = {}
    for row in _rows(recorded / "jam_passive_flexion_fibre_golden.csv"):
        near = np.abs(time - float(row["time"]))
        if near.min() < 1e-6:
            value = 1e3 * float(row["length_m"]), float(row["force_spring_N"])
            fibres.setdefault(row["name"], {})[int(near.argmin())] = value
    points = {row["name"]: _fibre(row) for row in _rows(folder / "ligaments.csv")}
    return Record(
        time,
        np.stack([pose[f"knee_{name}"][kept] for name in names], axis=1),
        np.stack([pose[f"pf_{name}"][kept] for name in patella], axis=1),
        vectors("contact_force", 1.0),
        vectors("contact_moment", -1e3),
        1e6 * contact["contact_area"][kept],
        1e-6 * contact["max_pressure"][kept],
        vectors("center_of_pressure", 1e3),
        fibres,
        points,
    )


def alone(knee: Knee, points: tuple[int, int] | None = None) -> Knee:
    """The knee without its own loads and lines; its contacts with so many points."""
    contacts = knee.contacts
    if points is not None:
        contacts = tuple(dataclasses.replace(c, points=points) for c in contacts)
    return dataclasses.replace(knee, loads=(), lines=(), contacts=contacts)


def _columns(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def _fibre(row: dict[str, str]) -> dict:
    return {
        "bodies": (row["p1_body"], row["p2_body"]),
        "ends": [[1e3 * float(row[f"p{k}_{a}_m"]) for a in _AXES] for k in (1, 2)],
        "stiffness": float(row["linear_stiffness_N_per_strain"]),
        "slack_length": 1e3 * float(row["slack_length_m"]),
        # A model that states none has the class's default; the table then says so beside it.
        "transition_strain": float(row["transition_strain"].split()[0]),
    }


@dataclasses.dataclass(frozen=True)
class FibreComparison:
    """Fibres at the instants at which the record has them; arrays `(fibres, instants)`.

    Attributes:
        names: of the fibres.
        obstacles: name of each fibre's obstacle; empty where it has none.
        rows: of the record.
        length_error: mm.
        force, recorded_force: N.
        wrapped: whether the fibre lies on its obstacle.
    """

    names: tuple[str, ...]
    obstacles: tuple[str, ...]
    rows: list[int]
    length_error: np.ndarray
    force: np.ndarray
    recorded_force: np.ndarray
    wrapped: np.ndarray

    @property
    def force_error(self) -> np.ndarray:
        """N."""
        return self.force - self.recorded_force

    @property
    def has_obstacle(self) -> np.ndarray:
        """Mask of the fibres that something may be in the way of."""
        return np.array([bool(name) for name in self.obstacles])

    @property
    def within(self) -> np.ndarray:
        """Where length and force keep the criterion of the fibre's kind."""
        bent = self.has_obstacle[:, None]
        share = np.maximum(WRAPPED_FORCE_SHARE * self.recorded_force, WRAPPED_FORCE_N)
        length = np.where(bent, WRAPPED_LENGTH_MM, LENGTH_MM)
        force = np.where(bent, share, FORCE_N)
        return (abs(self.length_error) <= length) & (abs(self.force_error) <= force)


def compare_fibres(
    knee: Knee, obstacles: dict[str, str], found: Mechanics, record: Record
) -> FibreComparison:
    """Lengths and forces at recorded poses.

    Args:
        knee: with fibres of the record.
        obstacles: fibre -> name of its obstacle, for those that have one.
        found: the knee's mechanics at all recorded poses.
        record: what was recorded.
    """
    names = knee.ligaments.names
    rows = record.rows_with(names)
    length, tension, angle = (
        np.asarray(x)[rows].T for x in (found.length, found.tension, found.wrap_angle)
    )
    recorded = np.array([[record.fibres[name][row] for row in rows] for name in names])
    bent = tuple(obstacles.get(name, "") for name in names)
    error = length - recorded[..., 0]
    return FibreComparison(names, bent, rows, error, tension, recorded[..., 1], angle > 0)


@dataclasses.dataclass(frozen=True)
class ContactComparison:
    """Contact of all compartments together, ours and recorded; instants are rows.

    Attributes:
        force, recorded_force: magnitudes, N.
        area, recorded_area: mm^2.
        max_pressure, recorded_max_pressure: MPa.
        center, recorded_center: of pressure, tibia frame, mm, `(n, 3)`.
        usable: whether neither depth nor region fault the pose.
    """

    force: np.ndarray
    recorded_force: np.ndarray
    area: np.ndarray
    recorded_area: np.ndarray
    max_pressure: np.ndarray
    recorded_max_pressure: np.ndarray
    center: np.ndarray
    recorded_center: np.ndarray
    usable: np.ndarray

    @property
    def errors(self) -> dict[str, np.ndarray]:
        """Quantity -> error: shares of the recorded value, and mm for the centre."""
        return {
            "force": self.force / self.recorded_force - 1.0,
            "area": self.area / self.recorded_area - 1.0,
            "max_pressure": self.max_pressure / self.recorded_max_pressure - 1.0,
            "center": np.linalg.norm(self.center - self.recorded_center, axis=1),
        }


def compare_contact(
    found: Mechanics, record: Record, rows=slice(None), scale: float = 1.0
) -> ContactComparison:
    """Contact at recorded poses.

    Args:
        found: the mechanics there.
        record: what was recorded.
        rows: of the record that `found` is of.
        scale: lengths of the knee over those of the recorded one; what was found is scaled back.
    """
    force = np.asarray(found.contact_force).sum(axis=1)
    share = np.asarray(found.mean_pressure * found.area)
    center = np.sum(np.asarray(found.center) * share[..., None], axis=1)
    return ContactComparison(
        np.linalg.norm(force, axis=1) / scale**2,
        np.linalg.norm(record.force[rows], axis=1),
        np.asarray(found.area).sum(axis=1) / scale**2,
        record.area[rows],
        np.asarray(found.max_pressure).max(axis=1),
        record.max_pressure[rows],
        center / share.sum(axis=1)[:, None] / scale,
        record.center[rows],
        np.asarray(jnp.all(found.known & ~found.too_deep, axis=1)),
    )
