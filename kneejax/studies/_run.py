"""Running a study: what its commands do after they have read their words."""

from __future__ import annotations

from typing import overload

from kneejax.files.reading import InputProblem
from kneejax.inference import BlockStore, Calibration, ParameterMap
from kneejax.inference.fit import Progress
from kneejax.studies import _answer_identify, _answer_map, _answer_sensitivity
from kneejax.studies._answer_calibrate import calibrated
from kneejax.studies._answer_identify import Identified
from kneejax.studies._answer_sensitivity import Sensitivities
from kneejax.studies._questions import Identify, Map, Sensitivity
from kneejax.studies._study import Study


def check(study: Study, question: Identify | Map | Sensitivity | None = None) -> None:
    """Refuse what cannot be answered, before anything is computed; `run` does so first.

    Args:
        study: checked when it was made.
        question: as in `run`.

    Raises:
        InputProblem: a field of the question is out of range.
        UnknownParameter: a name that the knee does not have, or that is not free.
        UnsuitableData: too few data, samples or candidates, or a package that is not installed.
    """
    if isinstance(question, Sensitivity):
        named = {"loads": [*study.loads], "tests": [test.name for test in study.tests]}
        for field, names in named.items():
            if names:
                expected = f"a study without {field}: sensitivities are of passive motion"
                raise InputProblem(study.file, field, ", ".join(names), f"{expected} so far")
    match question:
        case Identify():
            _answer_identify.check(study, question)
        case Map():
            _answer_map.check(study, question)
        case Sensitivity():
            _answer_sensitivity.check(study, question)


@overload
def run(study: Study, *, progress: Progress | None = None) -> Calibration:
    """Calibrate."""


@overload
def run(
    study: Study, question: Identify, *, progress: Progress | None = None
) -> Identified:
    """Tell what the data determine."""


@overload
def run(
    study: Study,
    question: Map,
    *,
    progress: Progress | None = None,
    store: BlockStore | None = None,
) -> tuple[ParameterMap, ...]:
    """Map the misfit over pairs of parameters."""


@overload
def run(
    study: Study, question: Sensitivity, *, progress: Progress | None = None
) -> Sensitivities:
    """Tell what each parameter does."""




def run(study, question=None, *, progress=None, store=None):
    """Calibrate as a study says, or answer another question about it.

    This is what `kneejax calibrate`, `identify`, `map` and `sensitivity` compute; they print and
    write it.

    Args:
        study: as `read_study` reads it.
        question: `Identify`, `Map` or `Sensitivity`; a calibration is done without one.
        progress: called now and then, from any thread, with what is computed, and balances done and
            asked for; of a calibration with how far it has come and no numbers.
        store: of maps: keeps finished blocks; what it has is not computed again.

    Returns:
        A `Calibration`, an `Identified`, one `ParameterMap` a pair, or `Sensitivities`.

    Raises:
        InputProblem: as `check`, before anything is computed.
        UnknownParameter: likewise.
        UnsuitableData: likewise; or where no pose has a balance.
    """
    check(study, question)
    match question:
        case None:
            return calibrated(study, progress)
        case Identify():
            return _answer_identify.identified(study, question)
        case Map():
            return _answer_map.mapped(study, question, progress, store)
        case Sensitivity():
            return _answer_sensitivity.answered(study, question, progress)
    raise TypeError(f"{question!r} is no question: expected Identify, Map or Sensitivity")
