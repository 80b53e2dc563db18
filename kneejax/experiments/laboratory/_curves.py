"""What a knee answers to a test under load."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._doubts import doubts, of_search, with_flips
from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._motion import Motion, passive_flexion
from kneejax.experiments.laboratory._lab_test import LabTest
from kneejax.geometry import COORDINATES
from kneejax.mechanics import Knee

_CLINICAL = "grood-suntay"


@dataclasses.dataclass(frozen=True)
class Curves:
    """A test's load path at each flexion, followed from the balance without its load.

    Every load is balanced once, however often the path comes by it: nothing in the knee
    dissipates, and what is connected with the unloaded knee without a turning point is one curve,
    up and down. Beyond a turning point nothing is told but where it was.

    Attributes:
        test: that was made.
        motion: each different load once; flexion after flexion, the loads in order of their size.
        rows: of the motion at each step of the path, `(flexions, steps)`.
        neutral: of the motion without the test's load, `(flexions,)`.
        part: of the full load at the rows of one flexion, `(loads,)`.
    """

    test: LabTest
    motion: Motion
    rows: np.ndarray
    neutral: np.ndarray
    part: np.ndarray

    def to_table(self, convention: str = "femoral") -> Array:
        """Poses in degrees and mm, `(flexions, steps, 6)`, in the order of pose tables."""
        return self.motion.to_table(convention)[self.rows]

    @property
    def displacement(self) -> Array:
        """Change of what is observed from the neutral pose, `(flexions, steps)`, mm or degrees."""
        return self._moved()[self.rows]

    @property
    def displacement_by_load(self) -> Array:
        """The same at every different load in order of its size, `(flexions, loads)`."""
        return self._moved().reshape(len(self.neutral), -1)

    @property
    def neutral_value(self) -> Array:
        """What is observed in the neutral pose, `(flexions,)`, mm or degrees."""
        return self._observed()[self.neutral]

    def mechanics(self) -> Mechanics:
        """Ligaments and contact at the rows of the motion."""
        return evaluate(self.motion.knee, self.motion.pose, self.motion.settled.meeting)

    def status(self, mechanics: Mechanics) -> np.ndarray:
        """`Status` values at the rows of the motion; fibres are compared along each curve."""
        status = np.asarray(self.motion.status)
        each = [
            with_flips(status[rows], jax.tree.map(lambda x, own=rows: x[own], mechanics))
            for rows in self._flexions()
        ]
        return np.concatenate(each)

    def doubts(self, mechanics: Mechanics) -> tuple[str, ...]:
        """What is wrong at the rows of the motion, in words and numbers."""
        part = np.tile(self.part, len(self.neutral))
        sizes = {name: size * part for name, size in self.test.full.items()}
        found = of_search(self.motion, sizes)
        own = [
            doubts(
                self.motion.knee,
                jax.tree.map(lambda x, own=rows: x[own], mechanics),
                [found[row] for row in rows],
            )
            for rows in self._flexions()
        ]
        return tuple(text for texts in own for text in texts)

    def _flexions(self) -> np.ndarray:
        """Rows of each flexion, `(flexions, loads)`."""
        return np.arange(len(self.neutral) * len(self.part)).reshape(-1, len(self.part))

    def _observed(self) -> Array:
        column = list(COORDINATES).index(self.test.observed)
        return self.motion.to_table(_CLINICAL)[:, column]

    def _moved(self) -> Array:
        observed = self._observed()
        return observed - jnp.repeat(observed[self.neutral], len(self.part))


def load_curves(knee: Knee, test: LabTest) -> Curves:
    """Load a knee as a test says.

    At each flexion the knee is bent without a load, takes what acts throughout, and then the
    test's load grows from nothing, one way and the other (`kneejax.experiments.passive_flexion`).

    Args:
        knee: any knee.
        test: what is done.

    Returns:
        The curves, differentiable with respect to every number of the knee. Where the knee gives
        way poses are NaN, and `motion.reached` tells under which part of a load it still held.

    Raises:
        RuntimeError: float64 is switched off.

    Example:
        >>> import kneejax as kj
        >>> (test,) = kj.lab_tests("drawer", [30.0], force_N=50.0, steps=1)
        >>> curves = kj.load_curves(kj.load_knee("four_ligament"), test)
        >>> bool(curves.displacement[0, 1] > 0)
        True
    """
    part, back = np.unique(np.r_[0.0, test.path], return_inverse=True)
    angles = len(test.flexion_deg)
    flexion, along = np.repeat(test.flexion_deg, len(part)), np.tile(part, angles)
    motion = passive_flexion(knee, flexion, test.loads(along))
    first = np.arange(angles) * len(part)
    return Curves(test, motion, first[:, None] + back[1:], first + back[0], part)
