"""What is wrong with a mesh, with landmarks or with poses of which a joint should be made."""

from __future__ import annotations


class JointProblem(ValueError):
    """Input from which no joint can be made: `PART: FOUND; expected EXPECTED`.

    Attributes:
        part: what it is about, e.g. `medial extension facet`.
        found: what is there.
        expected: what should be there.
    """

    def __init__(self, part: str, found: str, expected: str):
        self.part, self.found, self.expected = part, found, expected
        super().__init__(f"{part}: {found}; expected {expected}")

    def __reduce__(self):
        return type(self), (self.part, self.found, self.expected)


class UnsuitableMesh(JointProblem):
    """A mesh in which axes of condyles cannot be found."""


class UnsuitableLandmarks(JointProblem):
    """Landmarks that make no anatomical frame."""


class UnsuitableAxis(JointProblem):
    """Points or calibration angles that make no axis of a knee."""


class UnsuitablePoses(JointProblem):
    """Measured poses on which no joint can be calibrated."""
