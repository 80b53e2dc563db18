"""A cohort: studies of the same kind, one a knee, and what is asked of all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from kneejax.studies import Study


@dataclasses.dataclass(frozen=True, eq=False)
class Member:
    """One knee of a cohort.

    Attributes:
        name: of the knee; of its folder of results too.
        study: what is asked of it.
        about: what else is known of it, e.g. `mass_kg`, as the table says; carried along.
        place: file and row where it stands, for errors.
    """

    name: str
    study: Study
    about: Mapping[str, float | str] = dataclasses.field(default_factory=dict)
    place: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Cohort:
    """Knees that are calibrated together.

    Attributes:
        title: for reports.
        members: one a knee, in the order of the file or of their names.
        file: where the cohort stands.
    """

    title: str
    members: Sequence[Member]
    file: str

    def __len__(self) -> int:
        return len(self.members)


class CohortProblems(ValueError):
    """Everything that is wrong with a cohort, a sentence each.

    Attributes:
        problems: in the order of the rows.
    """

    def __init__(self, problems: Sequence[str]):
        """Keep the sentences; together they are the error's text, a line each."""
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self):
        return type(self), (self.problems,)
