"""What a person has set, as a link holds it; the pose and curves that it gives; files of it."""

__all__ = ["Setting", "Subject"]

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import numpy as np
import yaml

from kneejax.files import reconstructed, restated, write_knee, write_poses
from kneejax.geometry import FEMUR, TIBIA, State
from kneejax.mechanics import NAMED_LOADS, QUADRICEPS, Knee
from kneejax.parameters import Selection, cut, default_bounds, fibre_rows, fibres_cut, select
from kneejax.quantities import AXES
from kneejax.statics import Equilibrium, Status

#: Ends of a ligament that may be moved, and the bone that each is on.
ENDS = {"femoral_attachment": FEMUR, "tibial_attachment": TIBIA}
#: Largest size of each load, on either side of zero, N and N m.
_LOADS = {"lateral_N": 100.0, "anterior_N": 200.0, "compression_N": 800.0, "varus_Nm": 15.0,
          "internal_Nm": 15.0}  # fmt: skip
_FLEXION, _PULL = "flexion_deg", "quadriceps_N"
#: How far an attachment may be moved along an axis, mm, and a reference strain changed.
_MOVED_MM, _STRAINED = 15.0, 0.1
#: Flexions of the curves, degrees.
FLEXIONS = np.linspace(0.0, 120.0, 25)
#: Tests of laxity: load -> its size, both ways.
TESTS = {"anterior_N": 100.0, "varus_Nm": 10.0, "internal_Nm": 5.0}
#: The coordinate that each moves most.
MOVED = {"anterior_N": "anterior", "varus_Nm": "adduction", "internal_Nm": "internal_rotation"}


@dataclasses.dataclass(frozen=True)
class Setting:
    """Numbers that a person has set; immutable, equal where all numbers are.

    Attributes:
        numbers: name -> number, sorted: `flexion_deg`, names of `kneejax.mechanics.NAMED_LOADS`,
            `quadriceps_N`, parameters as `ACL.stiffness`, and `ACL.cut`, which is 1 where the
            ligament is cut. What is left out is the knee's own, or zero.

    Example:
        >>> setting = Setting().to("flexion_deg", 30.0).to("ACL.cut", 1.0)
        >>> setting.link, Setting.of_link(setting.link) == setting
        ('ACL.cut=1&flexion_deg=30', True)
    """

    numbers: tuple[tuple[str, float], ...] = ()

    @property
    def given(self) -> dict[str, float]:
        """Name -> number."""
        return dict(self.numbers)

    def to(self, name: str, number: float | None) -> "Setting":
        """The same with another number; None takes it away."""
        others = {k: x for k, x in self.numbers if k != name}
        return Setting.of(others if number is None else others | {name: float(number)})

    @classmethod
    def of(cls, numbers: Mapping[str, float]) -> "Setting":
        """A setting from numbers by name."""
        return cls(tuple(sorted(numbers.items())))

    @property
    def link(self) -> str:
        """The setting as the query of a link; numbers in full, so that they come back equal."""
        words = {name: repr(x)[:-2] if x.is_integer() else repr(x) for name, x in self.numbers}
        return urlencode(words)

    @classmethod
    def of_link(cls, query: str) -> "Setting":
        """The setting of a link; what is no number is left out."""
        numbers = {}
        for name, word in parse_qsl(query):
            try:
                number = float(word)
            except ValueError:
                continue
            if math.isfinite(number):
                numbers[name] = number
        return cls.of(numbers)


@dataclasses.dataclass(frozen=True)
class Subject:
    """A knee with everything of it that can be set.

    Attributes:
        knee: as it was read.
        ligaments: names of groups and single fibres, no fibre in two of them.
        selection: stiffness and attachments of each ligament, then the reference strains.
        plain: of these the stiffnesses and attachments.
        strains: of these the reference strains.
        own: values of these parameters in the knee, `(p,)`.
        limits: name of a setting -> its own value, the smallest and the largest.

    Example:
        >>> import kneejax as kj
        >>> subject = Subject.of(kj.load_knee("four_ligament"))
        >>> subject.ligaments, subject.limits["anterior_N"]
        (('ACL', 'PCL', 'MCL', 'LCL'), (0.0, -200.0, 200.0))
    """

    knee: Knee
    ligaments: tuple[str, ...]
    selection: Selection
    plain: Selection
    strains: Selection
    own: np.ndarray
    limits: dict[str, tuple[float, float, float]]

    @classmethod
    def of(cls, knee: Knee, parameters: Sequence[str] = ()) -> "Subject":
        """What can be set of a knee.

        Args:
            knee: any knee.
            parameters: names, with `*` for every ligament; by default stiffness, attachments and
                reference strain of each.
        """
        taken: set[int] = set()
        ligaments = []
        for name in (*(group for group, _ in knee.groups), *knee.ligaments.names):
            rows = set(fibre_rows(knee, name))
            if not rows & taken:
                taken |= rows
                ligaments.append(name)
        names = [f"{one}.stiffness" for one in ligaments]
        for one in ligaments:
            joined = [set(knee.ligaments.bodies[row]) for row in fibre_rows(knee, one)]
            for end, bone in ENDS.items():
                if all(bone in pair for pair in joined):
                    names += [f"{one}.{end}.{axis}" for axis in AXES]
        strains = [f"{one}.reference_strain" for one in ligaments]
        if parameters:
            every = select(knee, parameters).names
            strains = [x for x in every if x.endswith(".reference_strain")]
            names = [x for x in every if x not in strains]
        both = select(knee, names), select(knee, strains)
        selection = select(knee, [*names, *strains])
        own = np.asarray(selection.read(knee))
        limits = {_FLEXION: (0.0, -5.0, 120.0)} | {k: (0.0, -x, x) for k, x in _LOADS.items()}
        if QUADRICEPS in knee.pullable:
            limits[_PULL] = (0.0, 0.0, 1000.0)
        lower, upper = default_bounds(knee, selection)
        for i, (name, value) in enumerate(zip(selection.names, own.tolist(), strict=True)):
            far = {"stiffness": (min(float(lower[i]), value), max(float(upper[i]), value)),
                   "reference_strain": (value - _STRAINED, value + _STRAINED)}  # fmt: skip
            usual = (value - _MOVED_MM, value + _MOVED_MM)
            limits[name] = (value, *far.get(selection.quantity(i), usual))
        limits |= {f"{one}.cut": (0.0, 0.0, 1.0) for one in ligaments}
        return cls(knee, tuple(ligaments), selection, *both, own, limits)

    def within(self, setting: Setting) -> Setting:
        """The setting without names that this knee does not have, each number within its limits and
        left out where it is the knee's own."""
        numbers = {}
        for name, number in setting.numbers:
            own, low, high = self.limits.get(name, (number, number, number))
            number = min(max(number, low), high)
            if number != own:
                numbers[name] = float(round(number)) if name.endswith(".cut") else number
        return Setting.of(numbers)

    def value(self, setting: Setting, name: str) -> float:
        """A number of a setting, the knee's own where it says nothing."""
        return setting.given.get(name, self.limits[name][0])

    def cut_in(self, setting: Setting) -> tuple[str, ...]:
        """The ligaments that are cut."""
        return tuple(one for one in self.ligaments if setting.given.get(f"{one}.cut"))

    def numbers(self, setting: Setting) -> tuple[Knee, np.ndarray]:
        """The knee of a setting with nothing cut, and numbers that vary it: its stiffnesses and
        attachments, changes of its reference strains (none), and of each ligament the share that is
        left: 1, or 0 where it is cut."""
        knee, gone = self.set_in(setting), self.cut_in(setting)
        left = [float(one not in gone) for one in self.ligaments]
        plain = np.asarray(self.plain.read(knee)) if len(self.plain) else []
        return knee, np.r_[plain, np.zeros(len(self.strains)), left]

    def loads(self, setting: Setting) -> dict[str, float]:
        """Name -> size of what acts on the tibia."""
        return {name: self.value(setting, name) for name in NAMED_LOADS}

    def set_in(self, setting: Setting) -> Knee:
        """The knee with a setting's parameters, as `--set` gives it; nothing cut, without loads.

        An end that moves leaves the slack length as it is, unless a reference strain is set.
        """
        changed = {k: x for k, x in setting.numbers if k in self.selection.names}
        if not changed:
            return self.knee
        chosen = select(self.knee, tuple(changed))
        return chosen.apply(self.knee, np.array([changed[name] for name in chosen.names]))

    def knee_at(self, setting: Setting) -> Knee:
        """The same with what is cut, as `--cut` gives it."""
        return cut(self.set_in(setting), self.cut_in(setting))


@dataclasses.dataclass(frozen=True)
class Answer:
    """A pose at a setting."""

    setting: Setting  # that was asked for
    knee: Knee  # with its parameters
    status: Status | None  # of the pose; None until the first is known
    coordinates: dict[str, float]  # free coordinate -> degrees or mm; NaN where nothing balances
    #: Where the bones are, `(1,)`. Without a balance it is the last pose's, like the numbers below.
    state: State
    found: Equilibrium | None  # the balance; None where there is none
    force_N: dict[str, float]  # ligament -> force
    strain: dict[str, float]  # ligament -> largest strain of its fibres
    peak_MPa: dict[str, float]  # compartment -> largest pressure
    derive: Callable[[], dict[str, np.ndarray]]  # computes `slopes`

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Coordinate or ligament -> derivative of degrees, mm or N by the parameters, `(p,)`."""
        return self.derive()

    @property
    def sentence(self) -> str:
        """What is wrong with the pose and what to try; empty where nothing is."""
        if self.status is None:
            return "Compiling: some minutes the first time that a knee is opened, seconds later."
        if self.status == Status.BALANCED:
            return ""
        last = "" if self.status.converged else " The last pose that balanced is shown, grey."
        return f"{self.status.fault.capitalize()}: {self.status.advice}.{last}"


@dataclasses.dataclass(frozen=True)
class Curves:
    """What a setting does over flexion."""

    setting: Setting  # that was asked for
    flexion_deg: np.ndarray  # of the poses, `(n,)`
    status: np.ndarray  # `Status` values, `(n,)`
    coordinates: dict[str, np.ndarray]  # free ones, degrees or mm, `(n,)`; NaN without a balance
    force_N: dict[str, np.ndarray]  # ligament -> force, `(n,)`
    laxity: dict[str, np.ndarray]  # test, if any, -> degrees or mm between its two loads, `(n,)`
    own: np.ndarray  # free coordinates, `(n, free)`; of a test both loads follow, `(3 n, free)`
    contact_points: np.ndarray  # likewise, `(n, points, 2)`
    derive: Callable[[], dict[str, np.ndarray]]  # computes `slopes`

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Likewise, `(n, p)`; NaN where nothing balances."""
        return self.derive()

    @property
    def table(self) -> np.ndarray:
        """Poses in the order of `kneejax.geometry.COLUMNS`, `(n, 6)`, degrees and mm."""
        return np.column_stack([self.flexion_deg, *self.coordinates.values()])

    def at(self, flexion_deg: float) -> tuple[np.ndarray, np.ndarray]:
        """Free coordinates, `(free,)`, and contact points near a flexion."""
        flexion = self.flexion_deg
        q = np.array([np.interp(flexion_deg, flexion, x) for x in self.own[: len(flexion)].T])
        return q, self.contact_points[int(np.argmin(np.abs(flexion - flexion_deg)))]


@dataclasses.dataclass(frozen=True)
class Folder:
    """Where files go; a file that is there stays as it is, and the next number is taken."""

    path: Path  # made where the first file is written
    subject: Subject
    document: dict[str, Any]  # of its knee file
    measured: np.ndarray  # poses of a study, `(n, 6)`, degrees and mm; no row without a study

    def knee(self, setting: Setting) -> Path:
        """Write a setting as a knee file, without what is cut, the flexion and the loads."""
        path, link, whole = self._free("knee", "yaml"), _link(setting), self.subject.set_in(setting)
        rows = fibres_cut(whole, self.subject.cut_in(setting))
        torn = [whole.ligaments.names[row] for row in rows]
        document = restated(self.document, whole, link)
        write_knee(reconstructed(document, whole, torn, (), link), path, link)
        return path

    def study(self, setting: Setting) -> Path:
        """Write a study for `kneejax calibrate`.

        With measured poses its search begins at the setting. Without, its poses are those of the
        setting, to see whether a search from the knee as it was read finds its numbers.
        """
        link, names = _link(setting), self.subject.selection.names
        changed = {name: x for name, x in setting.numbers if name in names}
        knee = self.knee(Setting())
        study: dict[str, Any] = {
            "title": f"{self.subject.knee.name}, set by hand", "knee": knee.name,
            "parameters": [*changed] or ["*.stiffness", "*.reference_strain"],
        }  # fmt: skip
        if len(self.measured):
            poses = self._free("poses", "csv")
            write_poses(poses, self.measured)
            study |= {"measured": {"file": poses.name, "source": link}, "start": changed}
        else:
            study["synthetic"] = {"parameters": changed, "flexion_deg": FLEXIONS.tolist()}
        path = self._free("study", "yaml")
        path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
        return path

    def picture(self, client: Any) -> Path:
        """Write what a page shows of the knee."""
        from PIL import Image

        path = self._free("picture", "png")
        Image.fromarray(client.get_render(1080, 1440, transport_format="png")).save(path)
        return path

    def _free(self, kind: str, ending: str) -> Path:
        self.path.mkdir(parents=True, exist_ok=True)
        names = (self.path / f"explore-{kind}-{i}.{ending}" for i in range(1, 10_000))
        return next(path for path in names if not path.exists())


def _link(setting: Setting) -> str:
    return f"kneejax explore: {setting.link or 'as read'}"
