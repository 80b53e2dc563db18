"""What was recorded of a leg that moved, and what acted on it below the knee."""

__all__ = ["LegRecord", "MovingMass", "wrench_in_frame"]

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

    def at(self, rows: np.ndarray) -> "LegRecord":
        """Some of the instants, in the order of `rows`."""
        own = {x: getattr(self, x)[rows] for x in ("time_s", "pose", "quadriceps_N", "ground_N")}
        acting = {name: wrench[rows] for name, wrench in self.acting.items()}
        ends = self.muscles.femoral_attachment, self.muscles.tibial_attachment
        femoral, tibial, tension = (x[..., rows] for x in (*ends, self.muscles.tension))
        muscles = dataclasses.replace(
            self.muscles, femoral_attachment=femoral, tibial_attachment=tibial, tension=tension
        )
        return dataclasses.replace(self, acting=acting, muscles=muscles, **own)

    def with_heads_on_patella(self) -> "LegRecord":
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


@dataclasses.dataclass(frozen=True)
class MovingMass:
    """A rigid mass on its way through space.

    Attributes:
        mass_kg: of it.
        inertia_kg_m2: about the centre of mass, in the body's axes, `(3, 3)`.
        turn: from the body's axes to those of the ground, at five instants `step_s` apart about
            each instant, `(5, n, 3, 3)`.
        center_m: of mass, in the ground, `(5, n, 3)`.
        step_s: between those five.

    Example:
        >>> import numpy as np
        >>> axes, still = np.tile(np.eye(3), (5, 1, 1, 1)), np.zeros((5, 1, 3))
        >>> resting = MovingMass(3.0, np.diag([0.05, 0.01, 0.05]), axes, still, step_s=0.01)
        >>> resting.mass_kg, resting.center_m.shape
        (3.0, (5, 1, 3))
    """

    mass_kg: float
    inertia_kg_m2: np.ndarray
    turn: np.ndarray
    center_m: np.ndarray
    step_s: float

    def inertia(self) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment of its inertia, the latter about the ground's origin.

        Returns:
            Minus the rates of momentum and of angular momentum, `(n, 3)` each, N and N m, to
            second order in the step.
        """
        before, here, after = self.center_m[1:4]
        force = -self.mass_kg * (after - 2.0 * here + before) / self.step_s**2
        spin = (self._angular_momentum(3) - self._angular_momentum(1)) / (2.0 * self.step_s)
        return force, np.cross(here, force) - spin

    def _angular_momentum(self, k: int) -> np.ndarray:
        """About the centre of mass, in the ground, at one of the five instants."""
        rate = (self.turn[k + 1] - self.turn[k - 1]) / (2.0 * self.step_s)
        skew = rate @ np.swapaxes(self.turn[k], -1, -2)
        spin = 0.5 * np.stack(
            [skew[..., 2, 1] - skew[..., 1, 2], skew[..., 0, 2] - skew[..., 2, 0],
             skew[..., 1, 0] - skew[..., 0, 1]], axis=-1
        )  # fmt: skip
        inertia = self.turn[k] @ self.inertia_kg_m2 @ np.swapaxes(self.turn[k], -1, -2)
        return np.einsum("nij,nj->ni", inertia, spin)

    def weight(self, gravity_m_s2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment of its weight, likewise."""
        force = np.broadcast_to(self.mass_kg * gravity_m_s2, self.center_m[2].shape)
        return force, np.cross(self.center_m[2], force)


def wrench_in_frame(
    force_N: np.ndarray, moment_Nm: np.ndarray, turn: np.ndarray, origin_m: np.ndarray
) -> np.ndarray:
    """A wrench about a moving frame's origin, along its axes.

    Args:
        force_N: in the ground, `(n, 3)`.
        moment_Nm: about the ground's origin, `(n, 3)`.
        turn: from the frame's axes to the ground's, `(n, 3, 3)`.
        origin_m: of the frame, `(n, 3)`.

    Returns:
        `(n, 6)`: N and N mm.

    Example:
        >>> down, none = np.array([[0.0, -10.0, 0.0]]), np.zeros((1, 3))
        >>> wrench_in_frame(down, none, np.eye(3)[None], np.array([[0.1, 0.0, 0.0]])).tolist()
        [[0.0, -10.0, 0.0, 0.0, 0.0, 1000.0]]
    """
    about = moment_Nm - np.cross(origin_m, force_N)
    both = (np.einsum("nji,nj->ni", turn, x) for x in (force_N, 1000.0 * about))
    return np.concatenate(list(both), axis=1) + 0.0
