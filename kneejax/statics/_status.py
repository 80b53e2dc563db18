"""What became of a pose, in a number, a word and a sentence."""

from __future__ import annotations

import enum


class Status(enum.IntEnum):
    """Outcome of a search for balance; the worst that applies to a pose.

    Attributes:
        sentence: what happened and what to try next.
    """

    BALANCED = 0, "balanced and stable"
    OUTSIDE_REGION = (
        1,
        "balanced, but the surfaces meet outside their fitted region: "
        "fit them over a larger region or leave this pose out",
    )
    UNSTABLE = (
        2,
        "forces balance, but the tangent stiffness is not positive definite: "
        "a small push would move the knee away; check slack lengths and add compression",
    )
    TOO_DEEP = (
        3,
        "the surfaces overlap by more than the cartilage layer: "
        "check frames, units and slack lengths, or stiffen the layer",
    )
    NOT_CONVERGED = (
        4,
        "no balance found: take smaller flexion steps or start from a pose nearer to it",
    )

    sentence: str

    def __new__(cls, value: int, sentence: str) -> Status:
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    @property
    def usable(self) -> bool:
        """Whether the pose is a balance (its numbers are not NaN)."""
        return self is not Status.NOT_CONVERGED and self is not Status.TOO_DEEP

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()
