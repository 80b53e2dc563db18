"""`kneejax sensitivity [STUDY.yaml]`: what each parameter does to the motion."""

from __future__ import annotations

from kneejax import studies
from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.studies import Sensitivity


def run(arguments: options.Sensitivity) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        from kneejax.cli import _sensitivity_knees

        return _sensitivity_knees.run(arguments)
    with said_of_options(Sensitivity):
        question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(Sensitivity), stages_on_terminal() as progress:
        found = studies.sensitivity(study, question, progress=progress)
    from kneejax.report.sensitivity import sensitivity_answer

    names = {"sweep": "sweep", "scale": "scale", "prior": "prior", "global": "indices",
             "samples": "samples", "range": "ranges", "seed": "seed"}  # fmt: skip
    asked = {name: getattr(arguments, field) for name, field in names.items()}
    return deliver(sensitivity_answer(found, asked), arguments, seconds=found.seconds)


def _question(arguments: options.Sensitivity) -> Sensitivity:
    # A count is a whole number; what is none is refused as it was given.
    lines = {
        name: ends and (*ends[:2], *(int(n) if n.is_integer() else n for n in ends[2:]))
        for name, ends in arguments.sweep.items()
    }
    return Sensitivity(
        sweep=lines,
        scale=arguments.scale,
        prior=arguments.prior,
        indices=arguments.indices,
        samples=arguments.samples,
        range=arguments.ranges,
        seed=arguments.seed,
    )
