"""What is wrong with a mesh, with landmarks or with poses of which a joint should be made."""

from __future__ import annotations

from kneejax.numerics import WrongValue


class JointProblem(WrongValue):
    """Input from which no joint can be made; `field` is the part that it is about."""


class UnsuitableMesh(JointProblem):
    """A mesh in which axes of condyles cannot be found."""


class UnsuitableLandmarks(JointProblem):
    """Landmarks that make no anatomical frame."""


class UnsuitableAxis(JointProblem):
    """Points or calibration angles that make no axis of a knee."""


class UnsuitablePoses(JointProblem):
    """Measured poses on which no joint can be calibrated."""
