"""How far a whole body and a knee agree about the knee's secondary motion, round by round."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from kneejax.experiments import Round
from kneejax.geometry import FREE_COORDINATES, coordinate

#: Columns of the table of rounds.
ROUND_COLUMNS = (
    "round", "coordinate", "residual_rms", "residual_largest", "left_by_splines_rms",
    "balanced_instants", "instants", "moment_Nm_rms", "reaction_N_rms",
)  # fmt: skip


def round_rows(rounds: Sequence[Round]) -> Iterator[list]:
    """Rows of the table, degrees and mm.

    Args:
        rounds: in their order.
    """
    for one in rounds:
        rms, largest = one.residual
        for k, name in enumerate(FREE_COORDINATES):
            column = coordinate(name).column
            yield [one.number, column, rms[k], largest[k], one.left[k], *one.holds, one.moment_Nm,
                   one.reaction_N]  # fmt: skip


def round_lines(rounds: Sequence[Round]) -> Iterator[str]:
    """The same in sentences.

    Args:
        rounds: in their order.
    """
    for one in rounds:
        rms, largest = one.residual
        turns, shifts = rms[:2], rms[2:]
        worst = int(largest[:2].argmax()), 2 + int(largest[2:].argmax())
        most = " and ".join(
            f"{largest[k]:.2g} {coordinate(FREE_COORDINATES[k]).unit} "
            f"({FREE_COORDINATES[k].replace('_', ' ')})"
            for k in worst
        )
        yield (
            f"Round {one.number}: the knee's secondary motion is off the one that OpenSim's model "
            f"had by {turns.max():.2g} degrees and {shifts.max():.2g} mm rms, at most {most}; "
            f"{one.holds[0]} of {one.holds[1]} instants in balance."
        )
