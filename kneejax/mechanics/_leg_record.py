"""What was recorded of a leg that moved: where its bones were, and what acted on its tibia."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from kneejax.mechanics._muscles import Muscles

#: Names of the quadriceps' heads.
_HEAD = re.compile(r"rec|vas", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class LegRecord:
    """A recorded movement, as a knee needs it.

    Attributes:
        time_s: of the instants, `(n,)`.
        pose: of the tibia in the femur in the record, `(n, 6)`, degrees and mm, in the order of
            `kneejax.geometry.COLUMNS`.
        acting: what acts on the leg below the knee besides muscles, by name, about the tibia's
            origin along its axes, `(n, 6)` each, N and N mm.
        muscles: over the knee, arrays end in instants. Each is the piece that leaves the thigh for
            the leg below the knee (what runs along the thigh or below the knee does no work on the
            knee): from its last point above, in the femur's frame, in which points on the pelvis
            move, to its first point below.
        quadriceps_N: together, of those that end on the patella, `(n,)`.
        ground_N: force of the ground on this foot, `(n, 3)`, in the ground's axes; zero without a
            record of it.
        same_frames: whether the knee was made of this model, so that frames are the same.
        mass_kg: of the leg below the knee.
        notes: what was taken as what, a sentence each.
        doubts: what a person should look at.
    """

    time_s: np.ndarray
    pose: np.ndarray
    acting: dict[str, np.ndarray]
    muscles: Muscles
    quadriceps_N: np.ndarray
    ground_N: np.ndarray
    same_frames: bool
    mass_kg: float
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def at(self, rows: np.ndarray) -> LegRecord:
        """Some of the instants, in the order of `rows`."""
        own = {x: getattr(self, x)[rows] for x in ("time_s", "pose", "quadriceps_N", "ground_N")}
        acting = {name: wrench[rows] for name, wrench in self.acting.items()}
        ends = self.muscles.femoral_attachment, self.muscles.tibial_attachment
        femoral, tibial, tension = (x[..., rows] for x in (*ends, self.muscles.tension))
        muscles = dataclasses.replace(
            self.muscles, femoral_attachment=femoral, tibial_attachment=tibial, tension=tension
        )
        return dataclasses.replace(self, acting=acting, muscles=muscles, **own)

    def with_heads_on_patella(self) -> LegRecord:
        """The same where heads of the quadriceps that end on the tibia pull on the patella.

        Models without a patella have them end there; they are known by their names (`rec...`,
        `vas...`).
        """
        heads = np.array([_HEAD.match(name) is not None for name in self.muscles.names], bool)
        if not heads.any():
            return self
        pull = self.quadriceps_N + np.asarray(self.muscles.tension)[heads].sum(axis=0)
        muscles = self.muscles.only([int(row) for row in np.flatnonzero(~heads)])
        return dataclasses.replace(self, muscles=muscles, quadriceps_N=pull)
